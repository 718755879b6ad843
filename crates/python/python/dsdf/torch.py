"""PyTorch modules as fields and shaders.

A module is evaluated in double precision by default, whatever the precision of its parameters is:
they are converted on the way, and gradients arrive in their own precision. The module itself is
not changed.
"""

from __future__ import annotations

from typing import Optional, Union

import numpy as np
import torch

from ._native import Record


class _Module:
    """A module that is called in a precision and on a device of choice."""

    def __init__(
        self,
        module: torch.nn.Module,
        dtype: torch.dtype = torch.float64,
        device: Optional[torch.device] = None,
    ):
        self.module = module
        self.dtype = dtype
        first = next(module.parameters(), None)
        self.device = device or (first.device if first is not None else torch.device("cpu"))

    def __call__(self, *inputs: torch.Tensor) -> torch.Tensor:
        """The result of the module for tensors of the precision."""
        tensors = dict(self.module.named_parameters()) | dict(self.module.named_buffers())
        cast = {
            name: tensor.to(self.dtype) if tensor.is_floating_point() else tensor
            for name, tensor in tensors.items()
        }
        return torch.func.functional_call(self.module, cast, inputs)

    def _tensor(self, array: np.ndarray, grad: bool = False) -> torch.Tensor:
        tensor = torch.tensor(array, dtype=self.dtype, device=self.device)
        return tensor.requires_grad_(grad)


def _backward(loss: torch.Tensor, module: torch.nn.Module) -> None:
    """Adds gradients to ``grad`` of the parameters that take one, if there are any."""
    parameters = [p for p in module.parameters() if p.requires_grad]
    if parameters and loss.requires_grad:
        loss.backward(inputs=parameters)


def _array(tensor: torch.Tensor) -> np.ndarray:
    return tensor.detach().to("cpu", torch.float64).numpy()


class Field(_Module):
    """A module that maps points, n x 3, to signed distances, n or n x 1, as a field.

    The activations must have continuous derivatives, for example softplus: at the creases of a
    ReLU network the normal jumps, and records leave out the motion of these jumps.
    """

    def _f(self, x: torch.Tensor) -> torch.Tensor:
        return self(x).reshape(len(x), -1).squeeze(1)

    def value(self, x: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return _array(self._f(self._tensor(x)))

    def value_gradient(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        with torch.enable_grad():
            points = self._tensor(x, grad=True)
            f = self._f(points)
            (gradient,) = torch.autograd.grad(f.sum(), points)
        return _array(f), _array(gradient)

    def hessian_vector(self, x: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        with torch.enable_grad():
            points = self._tensor(x, grad=True)
            (gradient,) = torch.autograd.grad(self._f(points).sum(), points, create_graph=True)
            along = (gradient * self._tensor(p)).sum()
            product = torch.zeros_like(points)
            if along.requires_grad:
                found = torch.autograd.grad(along, points, allow_unused=True)[0]
                product = product if found is None else found
        return _array(gradient), _array(product)

    def backward(self, x: np.ndarray, alpha: np.ndarray, c: np.ndarray) -> None:
        """Adds the gradient of sum(alpha f(x) + c . grad f(x)) to ``grad`` of the parameters."""
        if len(x) == 0:
            return
        turns = bool(np.any(c))
        with torch.enable_grad():
            points = self._tensor(x, grad=turns)
            f = self._f(points)
            loss = (self._tensor(alpha) * f).sum()
            if turns:
                (gradient,) = torch.autograd.grad(f.sum(), points, create_graph=True)
                loss = loss + (self._tensor(c) * gradient).sum()
            _backward(loss, self.module)


class Shader(_Module):
    """A module that maps points, unit normals and unit view directions, each k x 3, to radiance,
    k x 3 linear RGB, as a shader."""

    def radiance(self, x: np.ndarray, n: np.ndarray, d: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return _array(self(*map(self._tensor, (x, n, d))))

    def vjp(
        self, x: np.ndarray, n: np.ndarray, d: np.ndarray, adjoint: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        with torch.enable_grad():
            inputs = [self._tensor(v, grad=True) for v in (x, n, d)]
            loss = (self(*inputs) * self._tensor(adjoint)).sum()
            bars = torch.autograd.grad(loss, inputs, allow_unused=True)
        found = [torch.zeros_like(v) if bar is None else bar for v, bar in zip(inputs, bars)]
        return _array(found[0]), _array(found[1]), _array(found[2])

    def backward(
        self, x: np.ndarray, n: np.ndarray, d: np.ndarray, adjoint: np.ndarray
    ) -> None:
        """Adds the gradient of sum(adjoint . radiance) to ``grad`` of the parameters."""
        if len(x) == 0:
            return
        with torch.enable_grad():
            loss = (self(*map(self._tensor, (x, n, d))) * self._tensor(adjoint)).sum()
            _backward(loss, self.module)


def backward(
    record: Record,
    delta: Union[np.ndarray, torch.Tensor],
    field: Field,
    shader: Optional[Shader] = None,
) -> None:
    """Adds the gradient of sum(delta . pixel values) to ``grad`` of the parameters.

    Frozen parameters get none.
    """
    if isinstance(delta, torch.Tensor):
        delta = _array(delta)
    field.backward(*record.backward(delta))
    if shader is not None:
        shader.backward(*record.shading(delta))
