"""The native part of dsdf."""

import os
from typing import Any, Callable, Optional, Sequence, Union, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

Path = Union[str, os.PathLike[str]]
Array = NDArray[np.float64]
Image = NDArray[np.float32]

class InputError(ValueError):
    """Wrong arguments or wrong input, in one line."""

class Camera:
    """A pinhole camera; the keywords are the keys of ``camera`` in a scene file."""

    @overload
    def __init__(
        self,
        *,
        width: int,
        height: int,
        focal: ArrayLike,
        principal: ArrayLike,
        eye: ArrayLike,
        target: ArrayLike,
        up: ArrayLike,
    ) -> None: ...
    @overload
    def __init__(
        self,
        *,
        width: int,
        height: int,
        focal: ArrayLike,
        principal: ArrayLike,
        pose: ArrayLike,
    ) -> None: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def focal(self) -> tuple[float, float]: ...
    @property
    def principal(self) -> tuple[float, float]: ...
    @property
    def pose(self) -> Array:
        """The camera-to-world matrix, 4 x 4: x right, y up, looking along -z."""

    def directions(self, u: ArrayLike) -> Array:
        """The unit directions through film positions, n x 2 in pixels."""

class Record:
    """Samples of pixels, from which derivatives of any function of the pixels follow."""

    @property
    def radiance(self) -> Array:
        """The value of every pixel, n x 3, linear RGB."""

    @property
    def coverage(self) -> Array:
        """An estimate of the part of every pixel in which the object is visible, n numbers."""

    @property
    def rays(self) -> int: ...
    @property
    def unmodelled(self) -> list[str]:
        """The terms that the estimator leaves out for this scene."""

    def backward(self, delta: ArrayLike) -> tuple[Array, Array, Array]:
        """(x, alpha, c), k x 3, k and k x 3: the derivative of sum(delta . pixel values) by any
        parameter of the field is that of sum(alpha f(x) + c . grad f(x)), with x fixed."""

    def shading(self, delta: ArrayLike) -> tuple[Array, Array, Array, Array]:
        """(x, n, d, adjoint), each k x 3: the derivative of sum(delta . pixel values) by any
        parameter of the shader is that of sum(adjoint . radiance(x, n, d))."""

    def cameras(self, delta: ArrayLike) -> tuple[Array, Array, Array, Array]:
        """The derivative of sum(delta . pixel values) by all m cameras: by their eyes, m x 3, by
        rotations about their eyes in world space, m x 3 (vectors along the axes, per radian), by
        their focal lengths and their principal points, m x 2 each. It takes as long as
        ``backward``."""

    def background(self, delta: ArrayLike) -> Array:
        """The derivative by the colour of the background, or by the colours of all cameras."""

def record(
    field: Any,
    shader: Any,
    cameras: Sequence[Union[Camera, dict]],
    pixels: ArrayLike,
    *,
    bounds: ArrayLike,
    estimator: str = ...,
    seed: int,
    spp: int,
    edge_samples: Optional[int] = ...,
    background: Optional[ArrayLike] = ...,
    relaxation: float = ...,
    hit_tolerance: Optional[float] = ...,
    steps: int = ...,
    top_k: int = ...,
    gamma: float = ...,
    lambda_d: float = ...,
    epsilon: float = ...,
) -> Record: ...
def run(
    arguments: list[str],
    progress: Optional[Callable[[float, str], Any]],
    line: Callable[[str], Any],
) -> Optional[str]: ...
def read_image(path: Path) -> Image:
    """Reads an image as linear RGB, height x width x 3."""

def write_image(path: Path, image: ArrayLike) -> None:
    """Writes an image, height x width x 3 linear RGB: .png as sRGB, .exr and .npy linear."""

def check_image(path: Path) -> None: ...
def read_mesh(path: Path) -> tuple[Array, NDArray[np.uint32]]: ...
def read_dataset(
    path: Path, downscale: int
) -> tuple[
    list[tuple[str, Camera, Image, Optional[Image]]],
    list[tuple[str, Camera, Image, Optional[Image]]],
]: ...
