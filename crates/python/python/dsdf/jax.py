"""JAX functions as fields and shaders.

Functions are evaluated in double precision, whatever the precision of their parameters is: these
are converted on the way, and gradients have their precision. The setting ``jax_enable_x64`` of
the program is not changed: it is on inside these methods only.

JAX compiles a function once for each shape of its arguments. So batches are cut and padded to a
few lengths.
"""

from __future__ import annotations

from typing import Any, Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np

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

        self._value = jax.jit(lambda parameters, x: (values(parameters, x),))
        self._value_gradient = jax.jit(value_gradient)
        self._hessian_vector = jax.jit(hessian_vector)
        self._weighted = jax.jit(jax.grad(weighted))
        self._weighted_values = jax.jit(jax.grad(weighted_values))

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

        def radiance(parameters: Any, *surface: Any) -> Any:
            return function(_double(parameters), *surface)

        def weighted(parameters: Any, x: Any, n: Any, d: Any, adjoint: Any) -> Any:
            return (radiance(parameters, x, n, d) * adjoint).sum()

        self._radiance = jax.jit(lambda *arguments: (radiance(*arguments),))
        self._bars = jax.jit(jax.grad(weighted, argnums=(1, 2, 3)))
        self._weighted = jax.jit(jax.grad(weighted))

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
