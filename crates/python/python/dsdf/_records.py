"""Records of estimators, pictures of fields, and photographs."""

from __future__ import annotations

import os
from typing import Any, NamedTuple, Optional, Protocol, Sequence, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._native import Camera, Record

Array = NDArray[np.float64]

# Samples of a picture that are traced together.
_BATCH = 1 << 17


class Field(Protocol):
    """A signed distance f over batches of points: negative inside.

    All arrays are float64. The number n of points changes from call to call, and is never 0.
    """

    def value(self, x: Array) -> ArrayLike:
        """The values f(x): x is n x 3, the result has n numbers."""

    def value_gradient(self, x: Array) -> tuple[ArrayLike, ArrayLike]:
        """The values, n numbers, and the gradients, n x 3."""

    def hessian_vector(self, x: Array, p: Array) -> tuple[ArrayLike, ArrayLike]:
        """The gradients and the products of the Hessian with the vectors p, each n x 3."""


class Shader(Protocol):
    """The radiance at points x with unit normals n, seen along unit directions d: each k x 3."""

    def radiance(self, x: Array, n: Array, d: Array) -> ArrayLike:
        """The radiance, k x 3, linear RGB."""

    def vjp(
        self, x: Array, n: Array, d: Array, adjoint: Array
    ) -> tuple[ArrayLike, ArrayLike, ArrayLike]:
        """The adjoints of x, n and d, each k x 3, for the adjoint of the radiance, k x 3."""


class Photograph(NamedTuple):
    """An image with its camera."""

    name: str
    camera: Camera
    #: Linear RGB, height x width x 3, float32; over black if the file has an alpha channel.
    image: NDArray[np.float32]
    #: The part of each pixel that the object covers, height x width; None without masks.
    coverage: Optional[NDArray[np.float32]]


def record(
    field: Field,
    shader: Union[Shader, ArrayLike],
    cameras: Sequence[Union[Camera, dict]],
    pixels: ArrayLike,
    *,
    bounds: ArrayLike,
    estimator: str = "refined",
    seed: int = 0,
    spp: int = 64,
    edge_samples: Optional[int] = None,
    background: Optional[ArrayLike] = None,
    **options: Any,
) -> Record:
    """Samples pixels of a field, for their values and for derivatives of any function of them.

    - ``field``: an object with ``value``, ``value_gradient`` and ``hessian_vector`` (``Field``)
    - ``shader``: an object with ``radiance`` and ``vjp`` (``Shader``), or a colour
    - ``pixels``: n rows of camera number, column and row; ``dsdf.pixels`` has all of them
    - ``bounds``: x, y, z and radius of the sphere that holds the solid, with room around it;
      nothing outside is seen
    - ``estimator``, ``seed``, ``spp``, ``edge_samples``, ``relaxation``, ``hit_tolerance``,
      ``steps``, ``top_k``, ``gamma``, ``lambda_d``, ``epsilon``: as of ``dsdf gradient``, where
      ``estimator="fd"`` is no estimator of samples, and is refused here
    - ``background``: a colour, or one colour for each camera; black by default

    The same arguments give the same bits. The methods of the objects are called by this thread
    alone, with whole batches; an exception of theirs ends the pass and passes through.

    The radiance of a record is unbiased, and so is ``backward(delta)`` if ``delta`` does not
    depend on its samples. For a loss, take ``delta`` from the radiance of a record with another
    seed: radiance and adjoint from the same samples are correlated, and their product is biased.
    """
    return _native.record(
        field,
        shader,
        cameras,
        pixels,
        bounds=bounds,
        estimator=estimator,
        seed=seed,
        spp=spp,
        edge_samples=edge_samples,
        background=background,
        **options,
    )


def pose_gradient(pose: Array, eye: Array, turn: Array) -> Array:
    """The gradient by a camera's pose, 4 x 4, of those by its eye and by rotations about it."""
    x, y, z = turn
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    gradient = np.zeros((4, 4))
    # For a rotation about w, its product with cross(w) times the axes is turn . w.
    gradient[:3, :3] = 0.5 * cross @ pose[:3, :3]
    gradient[:3, 3] = eye
    return gradient


def pixels(cameras: Sequence[Union[Camera, dict]]) -> NDArray[np.int64]:
    """All pixels of the cameras, as rows of camera number, column and row.

    The rows of each camera are in the order of ``image.reshape(-1, 3)``.
    """
    cameras = [Camera(**c) if isinstance(c, dict) else c for c in cameras]
    return np.concatenate(
        [
            np.stack(
                [
                    np.full(camera.width * camera.height, number),
                    np.tile(np.arange(camera.width), camera.height),
                    np.repeat(np.arange(camera.height), camera.width),
                ],
                axis=1,
            )
            for number, camera in enumerate(cameras)
        ]
    )


def picture(
    field: Field,
    shader: Union[Shader, ArrayLike],
    camera: Camera,
    *,
    bounds: ArrayLike,
    spp: int = 4,
    seed: int = 0,
    background: Optional[ArrayLike] = None,
    **options: Any,
) -> Array:
    """The image of a field: linear RGB, height x width x 3. The arguments are as of ``record``."""
    rows = pixels([camera])
    step = max(1, _BATCH // max(spp, 1))
    parts = [
        record(
            field,
            shader,
            [camera],
            rows[start : start + step],
            bounds=bounds,
            estimator="interior",
            seed=seed,
            spp=spp,
            background=background,
            **options,
        ).radiance
        for start in range(0, len(rows), step)
    ]
    return np.concatenate(parts).reshape(camera.height, camera.width, 3)


def photographs(
    dataset: Union[str, os.PathLike], downscale: int = 1
) -> tuple[list[Photograph], list[Photograph]]:
    """The photographs of a data set to fit, and the held-out ones.

    They are read at 1/``downscale`` of their width and height. The formats are those of
    ``dsdf fit``.
    """
    train, held_out = _native.read_dataset(dataset, downscale)
    return [Photograph(*view) for view in train], [Photograph(*view) for view in held_out]
