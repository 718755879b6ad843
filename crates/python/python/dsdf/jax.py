"""JAX functions as fields and shaders.

Functions are evaluated in double precision, whatever the precision of their parameters is: these
are converted on the way, and gradients have their precision. The setting ``jax_enable_x64`` of
the program is not changed: it is on inside these methods only.

JAX compiles a function once for each shape of its arguments. So batches are cut and padded to a
few lengths.
"""

from __future__ import annotations

import functools
from typing import Any, Callable, Optional, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from . import _native, _records
from ._native import Record

try:
    _x64 = jax.enable_x64  # The name from JAX 0.8 on.
except AttributeError:
    from jax.experimental import enable_x64 as _x64

#: The lengths of batches: more rows than the last are cut.
LENGTHS = (64, 512, 4096)


def _double(parameters: Any) -> Any:
    def cast(leaf: Any) -> Any:
        leaf = jnp.asarray(leaf)
        return leaf.astype(jnp.float64) if jnp.issubdtype(leaf.dtype, jnp.floating) else leaf

    return jax.tree_util.tree_map(cast, parameters)


class _Function:
    """A function of parameters and rows, in batches of a few lengths."""

    def __init__(self, parameters: Any, lengths: Sequence[int]):
        #: A tree of arrays. It may be replaced by one of the same structure at any time.
        self.parameters = parameters
        self.lengths = sorted(lengths)

    def _parts(self, rows: Sequence[np.ndarray], weights: Sequence[np.ndarray] = ()):
        """Slices of the rows and the weights, padded to a length: rows by copies of the last one,
        at which a function is as good as there, weights by zeros."""
        count, most = len(rows[0]), self.lengths[-1]
        for start in range(0, count, most):
            n = min(most, count - start)
            length = next(length for length in self.lengths if length >= n)

            def padded(array: np.ndarray, mode: str) -> np.ndarray:
                width = [(0, length - n)] + [(0, 0)] * (array.ndim - 1)
                return np.pad(array[start : start + n], width, mode=mode)

            yield n, [padded(a, "edge") for a in rows] + [padded(a, "constant") for a in weights]

    def _map(self, function: Callable, *rows: np.ndarray) -> tuple[np.ndarray, ...]:
        """The results for all rows."""
        with _x64(True):
            parts = [
                [np.asarray(result)[:n] for result in function(self.parameters, *padded)]
                for n, padded in self._parts(rows)
            ]
        return tuple(np.concatenate(results) for results in zip(*parts))

    def _sum(
        self, function: Callable, rows: Sequence[np.ndarray], weights: Sequence[np.ndarray]
    ) -> Any:
        """The sum of the gradients by the parameters over all rows with their weights."""
        total = jax.tree_util.tree_map(lambda p: jnp.zeros_like(p), self.parameters)
        with _x64(True):
            for _, padded in self._parts(rows, weights):
                part = function(self.parameters, *padded)
                total = jax.tree_util.tree_map(jnp.add, total, part)
        return total


# JAX compiles for each of these functions anew, so each function has them once.
@functools.lru_cache(maxsize=64)
def _of_field(function: Callable[[Any, Any], Any]) -> tuple:
    """What a field needs of its function, compiled."""

    def values(parameters: Any, x: Any) -> Any:
        return function(_double(parameters), x).reshape(len(x))

    def slopes(parameters: Any, x: Any) -> Any:
        return jax.grad(lambda x: values(parameters, x).sum())(x)

    def value_gradient(parameters: Any, x: Any) -> tuple:
        f, pull = jax.vjp(lambda x: values(parameters, x), x)
        return f, pull(jnp.ones_like(f))[0]

    def hessian_vector(parameters: Any, x: Any, p: Any) -> tuple:
        return jax.jvp(lambda x: slopes(parameters, x), (x,), (p,))

    def weighted(parameters: Any, x: Any, alpha: Any, c: Any) -> Any:
        f, gradient = value_gradient(parameters, x)
        return (alpha * f).sum() + (c * gradient).sum()

    def weighted_values(parameters: Any, x: Any, alpha: Any) -> Any:
        return (alpha * values(parameters, x)).sum()

    return (
        jax.jit(lambda parameters, x: (values(parameters, x),)),
        jax.jit(value_gradient),
        jax.jit(hessian_vector),
        jax.jit(jax.grad(weighted)),
        jax.jit(jax.grad(weighted_values)),
    )


@functools.lru_cache(maxsize=64)
def _of_shader(function: Callable[[Any, Any, Any, Any], Any]) -> tuple:
    """What a shader needs of its function, compiled."""

    def radiance(parameters: Any, *surface: Any) -> Any:
        return function(_double(parameters), *surface)

    def weighted(parameters: Any, x: Any, n: Any, d: Any, adjoint: Any) -> Any:
        return (radiance(parameters, x, n, d) * adjoint).sum()

    return (
        jax.jit(lambda *arguments: (radiance(*arguments),)),
        jax.jit(jax.grad(weighted, argnums=(1, 2, 3))),
        jax.jit(jax.grad(weighted)),
    )


class Field(_Function):
    """A function (parameters, points n x 3) to signed distances, n or n x 1, as a field.

    The activations must have continuous derivatives, for example softplus: at the creases of a
    ReLU network the normal jumps, and records leave out the motion of these jumps. The function
    must give each point its own value, whatever the other points are.
    """

    def __init__(
        self,
        function: Callable[[Any, Any], Any],
        parameters: Any,
        lengths: Sequence[int] = LENGTHS,
    ):
        super().__init__(parameters, lengths)
        self.function = function
        compiled = _of_field(function)
        self._value, self._value_gradient, self._hessian_vector = compiled[:3]
        self._weighted, self._weighted_values = compiled[3:]

    def value(self, x: np.ndarray) -> np.ndarray:
        return self._map(self._value, x)[0]

    def value_gradient(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        f, gradient = self._map(self._value_gradient, x)
        return f, gradient

    def hessian_vector(self, x: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        gradient, product = self._map(self._hessian_vector, x, p)
        return gradient, product

    def gradient(self, x: np.ndarray, alpha: np.ndarray, c: np.ndarray) -> Any:
        """The gradient of sum(alpha f(x) + c . grad f(x)) by the parameters, as their tree."""
        if np.any(c):
            return self._sum(self._weighted, [x], [alpha, c])
        return self._sum(self._weighted_values, [x], [alpha])


class Shader(_Function):
    """A function (parameters, points, unit normals, unit view directions, each k x 3) to radiance,
    k x 3 linear RGB, as a shader."""

    def __init__(
        self,
        function: Callable[[Any, Any, Any, Any], Any],
        parameters: Any,
        lengths: Sequence[int] = LENGTHS,
    ):
        super().__init__(parameters, lengths)
        self.function = function
        self._radiance, self._bars, self._weighted = _of_shader(function)

    def radiance(self, x: np.ndarray, n: np.ndarray, d: np.ndarray) -> np.ndarray:
        return self._map(self._radiance, x, n, d)[0]

    def vjp(
        self, x: np.ndarray, n: np.ndarray, d: np.ndarray, adjoint: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        x_bar, n_bar, d_bar = self._map(self._bars, x, n, d, adjoint)
        return x_bar, n_bar, d_bar

    def gradient(self, x: np.ndarray, n: np.ndarray, d: np.ndarray, adjoint: np.ndarray) -> Any:
        """The gradient of sum(adjoint . radiance) by the parameters, as their tree."""
        return self._sum(self._weighted, [x, n, d], [adjoint])


def gradient(record: Record, delta: np.ndarray, field: Field, shader: Any = None) -> Any:
    """The gradient of sum(delta . pixel values) by the parameters of the field; with a shader, a
    pair of those by the parameters of both."""
    of_field = field.gradient(*record.backward(delta))
    if shader is None:
        return of_field
    return of_field, shader.gradient(*record.shading(delta))


class _Scene:
    """What ``render`` needs beside its arrays, and its two passes."""

    def __init__(self, functions: tuple, lengths: tuple, fixed: list, count: int, options: dict):
        self.functions, self.lengths = functions, lengths
        #: A camera, or the width and the height of one whose numbers are arrays.
        self.fixed = fixed
        self.count, self.options = count, options

    def _record(self, seed: int, arrays: dict, **options: Any) -> tuple:
        """A record of the arrays, with its field and its shader."""
        plain = functools.partial(jax.tree_util.tree_map, np.asarray)
        parts = [
            kind(function, plain(arrays[name]), lengths)
            for kind, name, function, lengths in zip(
                (Field, Shader), ("field", "shader"), self.functions, self.lengths
            )
            if function is not None
        ]
        shader = parts[1] if len(parts) > 1 else plain(arrays["shader"])
        cameras = [
            _native.Camera(width=fixed[0], height=fixed[1], **plain(camera)) if camera else fixed
            for fixed, camera in zip(self.fixed, arrays["cameras"])
        ]
        record = _records.record(
            parts[0], shader, cameras, np.asarray(arrays["pixels"]), seed=seed,
            background=np.asarray(arrays["background"]), **{**self.options, **options},
        )
        return record, parts, cameras

    def values(self, seed: Any, arrays: dict) -> np.ndarray:
        """The pixel values, by samples of their own."""
        record, _, _ = self._record(2 * int(seed), arrays, estimator="interior")
        return record.radiance.astype(np.float32)

    def gradients(self, seed: Any, arrays: dict, delta: Any) -> dict:
        """The gradient of sum(delta . pixel values) by each array, by samples of their own."""
        record, parts, cameras = self._record(2 * int(seed) + 1, arrays)
        delta = np.asarray(delta, dtype=np.float64)
        of_cameras: list[dict] = [{} for _ in cameras]
        moving = [i for i, camera in enumerate(arrays["cameras"]) if camera]
        sums = record.cameras(delta) if moving else ()
        for i in moving:
            eye, turn, focal, principal = (part[i] for part in sums)
            pose = _records.pose_gradient(cameras[i].pose, eye, turn)
            of_cameras[i] = {"focal": focal, "principal": principal, "pose": pose}
            if np.ndim(arrays["cameras"][i]["focal"]) == 0:
                of_cameras[i]["focal"] = focal.sum()
        shading = record.shading(delta)
        found = {
            "field": parts[0].gradient(*record.backward(delta)),
            "shader": parts[1].gradient(*shading) if len(parts) > 1 else shading[3].sum(0),
            "background": record.background(delta),
            "cameras": of_cameras,
        }
        like = lambda g, a: np.asarray(g, dtype=np.asarray(a).dtype).reshape(np.shape(a))
        return jax.tree_util.tree_map(like, found, {name: arrays[name] for name in found})


@functools.partial(jax.custom_vjp, nondiff_argnums=(0,))
def _render(scene: _Scene, seed: Any, arrays: dict) -> Any:
    shape = jax.ShapeDtypeStruct((scene.count, 3), jnp.float32)
    return jax.pure_callback(scene.values, shape, seed, arrays, vmap_method="sequential")


def _forwards(scene: _Scene, seed: Any, arrays: dict) -> tuple:
    return _render(scene, seed, arrays), (seed, arrays)


def _backwards(scene: _Scene, kept: tuple, delta: Any) -> tuple:
    seed, arrays = kept
    wanted = {name: tree for name, tree in arrays.items() if name != "pixels"}
    like = lambda a: jax.ShapeDtypeStruct(jnp.shape(a), jnp.result_type(a))
    shapes = jax.tree_util.tree_map(like, wanted)
    found = jax.pure_callback(
        scene.gradients, shapes, seed, arrays, delta, vmap_method="sequential"
    )
    none = lambda a: np.zeros(jnp.shape(a), dtype=jax.dtypes.float0)
    return none(seed), {**found, "pixels": none(arrays["pixels"])}


_render.defvjp(_forwards, _backwards)


def render(
    field: Field,
    shader: Any,
    cameras: Sequence[Any],
    pixels: Any = None,
    *,
    bounds: Any,
    seed: Any = 0,
    spp: int = 4,
    background: Any = (0.0, 0.0, 0.0),
    estimator: str = "refined",
    **options: Any,
) -> Any:
    """The values of pixels, n x 3 linear RGB in single precision, with gradients by all arrays.

    ``jax.grad`` gives the exact gradient of the silhouettes, too, in the mean over seeds: by the
    parameters of ``field`` and ``shader``, a ``shader`` that is a colour, ``background``, and
    ``focal``, ``principal`` and ``pose`` of cameras. It works under ``jax.jit``, with
    ``jax.pure_callback``. Make ``field`` and ``shader`` inside the function that is differentiated,
    from functions that stay the same: ``Field(distance, parameters)``.

    - ``cameras``: ``dsdf.Camera``, which gets no gradient, or dictionaries with ``width``,
      ``height``, ``focal``, ``principal`` and ``pose``, a camera-to-world matrix (x right, y up,
      looking along -z). The gradient of a pose is that along rotations and shifts
    - ``pixels``: rows of camera, column and row; all pixels of all cameras by default
    - ``seed``: another one for each step, which may be traced. Values and gradients have samples of
      their own (2 ``seed`` and 2 ``seed`` + 1): the gradient of a loss that is quadratic in the
      values has no bias
    - ``bounds``, ``spp``, ``background``, ``estimator`` and the other options: as of ``dsdf.record``
    """
    fixed: list[Any] = []
    numbers: list[dict] = []
    for camera in cameras:
        if isinstance(camera, dict) and "pose" in camera:
            fixed.append((camera["width"], camera["height"]))
            names = ("focal", "principal", "pose")
            numbers.append({name: jnp.asarray(camera[name], float) for name in names})
        else:
            fixed.append(_native.Camera(**camera) if isinstance(camera, dict) else camera)
            numbers.append({})
    if pixels is None:
        plain = {"focal": 1, "principal": [0, 0], "pose": np.eye(4)}
        sizes = [(c.width, c.height) if isinstance(c, _native.Camera) else c for c in fixed]
        pixels = _records.pixels([_native.Camera(width=w, height=h, **plain) for w, h in sizes])
    is_function = isinstance(shader, Shader)
    arrays = {
        "field": jax.tree_util.tree_map(jnp.asarray, field.parameters),
        "shader": jax.tree_util.tree_map(jnp.asarray, shader.parameters)
        if is_function
        else jnp.asarray(shader, float),
        "background": jnp.asarray(background, float),
        "cameras": numbers,
        "pixels": jnp.asarray(pixels, jnp.int32),
    }
    functions = (field.function, shader.function if is_function else None)
    lengths = (tuple(field.lengths), tuple(shader.lengths) if is_function else ())
    options = {"bounds": bounds, "spp": spp, "estimator": estimator, **options}
    scene = _Scene(functions, lengths, fixed, len(arrays["pixels"]), options)
    return _render(scene, jnp.asarray(seed, jnp.int32), arrays)
