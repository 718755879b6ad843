"""PyTorch modules as fields and shaders.

A module is evaluated in double precision by default, whatever the precision of its parameters is:
they are converted on the way, and gradients arrive in their own precision. The module itself is
not changed.
"""

from __future__ import annotations

from typing import Any, Iterator, Optional, Sequence, Union

import numpy as np
import torch

from . import _native, _records
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
        # The same memory where precision and device allow it.
        tensor = torch.as_tensor(array, dtype=self.dtype, device=self.device)
        return tensor.requires_grad_(grad)

    def _parameters(self) -> list[torch.Tensor]:
        """The parameters that take a gradient."""
        return [p for p in self.module.parameters() if p.requires_grad]

    def _add(self, loss: torch.Tensor) -> None:
        """Adds gradients to ``grad`` of the parameters that take one, if there are any."""
        parameters = self._parameters()
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
        if len(x) > 0:
            with torch.enable_grad():
                self._add(self._weighted(x, alpha, c))

    def _weighted(self, x: np.ndarray, alpha: np.ndarray, c: np.ndarray) -> torch.Tensor:
        """sum(alpha f(x) + c . grad f(x)), as a function of the parameters."""
        turns = bool(np.any(c))
        points = self._tensor(x, grad=turns)
        f = self._f(points)
        loss = (self._tensor(alpha) * f).sum()
        if turns:
            (gradient,) = torch.autograd.grad(f.sum(), points, create_graph=True)
            loss = loss + (self._tensor(c) * gradient).sum()
        return loss


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
        if len(x) > 0:
            with torch.enable_grad():
                self._add(self._weighted(x, n, d, adjoint))

    def _weighted(
        self, x: np.ndarray, n: np.ndarray, d: np.ndarray, adjoint: np.ndarray
    ) -> torch.Tensor:
        """sum(adjoint . radiance), as a function of the parameters."""
        return (self(*map(self._tensor, (x, n, d))) * self._tensor(adjoint)).sum()


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


class Camera:
    """A pinhole camera whose numbers may be tensors that take gradients.

    - ``focal``: one focal length, or two (x, y), in pixels
    - ``principal``: the principal point (x, y), in pixels
    - ``pose``: the camera-to-world matrix, 4 x 4: x right, y up, looking along -z

    The gradient of a pose is that along rotations and shifts: what would stretch its axes is 0.
    """

    def __init__(self, *, width: int, height: int, focal: Any, principal: Any, pose: Any):
        self.width, self.height = width, height
        self.focal, self.principal, self.pose = map(torch.as_tensor, (focal, principal, pose))

    def _native(self) -> _native.Camera:
        focal, principal, pose = map(_array, (self.focal, self.principal, self.pose))
        return _native.Camera(width=self.width, height=self.height, focal=focal.ravel()
                              if focal.ndim else focal, principal=principal, pose=pose)

    def _gradients(
        self, eye: np.ndarray, turn: np.ndarray, focal: np.ndarray, principal: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The gradients of ``focal``, ``principal`` and ``pose``."""
        pose = _records.pose_gradient(_array(self.pose), eye, turn)
        if self.focal.numel() == 1:
            focal = focal.sum()
        return focal, principal, pose


class _Scene:
    """The arguments of ``render``, and the tensors in them that take gradients."""

    def __init__(
        self,
        field: Union[Field, torch.nn.Module],
        shader: Any,
        cameras: Sequence[Any],
        pixels: Any,
        background: Any,
        seed: int,
        estimator: str,
        options: dict,
    ):
        self.field = field if isinstance(field, Field) else Field(field)
        self.shader = Shader(shader) if isinstance(shader, torch.nn.Module) else shader
        self.cameras, self.background = list(cameras), background
        self.seed, self.estimator, self.options = seed, estimator, options
        self.native = [c._native() if isinstance(c, Camera) else c for c in self.cameras]
        if pixels is None:
            pixels = _records.pixels(self.native)
        self.pixels = pixels.cpu().numpy() if isinstance(pixels, torch.Tensor) else pixels
        first = next(self.field.module.parameters(), torch.empty(0))
        self.kind = {"dtype": first.dtype, "device": self.field.device}

    def tensors(self) -> list[torch.Tensor]:
        """All tensors that the pixel values may depend on."""
        return [tensor for _, group in self._groups() for tensor in group]

    def _groups(self) -> Iterator[tuple[str, list[torch.Tensor]]]:
        yield "field", self.field._parameters()
        if isinstance(self.shader, Shader):
            yield "shader", self.shader._parameters()
        elif isinstance(self.shader, torch.Tensor):
            yield "colour", [self.shader]
        if isinstance(self.background, torch.Tensor):
            yield "background", [self.background]
        for camera in self.cameras:
            if isinstance(camera, Camera):
                yield "camera", [camera.focal, camera.principal, camera.pose]

    def _record(self, seed: int, estimator: str) -> Record:
        plain = lambda v: _array(v) if isinstance(v, torch.Tensor) else v
        return _records.record(
            self.field, plain(self.shader), self.native, self.pixels, seed=seed,
            estimator=estimator, background=plain(self.background), **self.options,
        )

    def values(self) -> torch.Tensor:
        """The pixel values, by samples of their own."""
        return torch.as_tensor(self._record(2 * self.seed, "interior").radiance, **self.kind)

    def gradients(self, delta: np.ndarray, wanted: Sequence[bool]) -> list[Any]:
        """The gradient of sum(delta . pixel values) by each tensor, by samples of their own."""
        record = self._record(2 * self.seed + 1, self.estimator)
        found: list[Any] = []
        cameras = None
        numbers = (i for i, c in enumerate(self.cameras) if isinstance(c, Camera))
        for kind, group in self._groups():
            is_wanted = any(wanted[len(found) : len(found) + len(group)])
            number = next(numbers) if kind == "camera" else 0
            if not is_wanted:
                found += [None] * len(group)
            elif kind == "field":
                found += self._of(self.field, group, record.backward(delta))
            elif kind == "shader":
                found += self._of(self.shader, group, record.shading(delta))
            elif kind == "colour":
                found.append(record.shading(delta)[3].sum(0))
            elif kind == "background":
                found.append(record.background(delta))
            else:
                cameras = cameras or record.cameras(delta)
                found += self.cameras[number]._gradients(*(part[number] for part in cameras))
        tensors = self.tensors()
        return [
            gradient
            if gradient is None or isinstance(gradient, torch.Tensor)
            else torch.as_tensor(gradient).to(tensor).reshape(tensor.shape)
            for gradient, tensor in zip(found, tensors)
        ]

    @staticmethod
    def _of(module: Union[Field, Shader], group: list, columns: tuple) -> list[Any]:
        if len(columns[0]) == 0:
            return [None] * len(group)
        with torch.enable_grad():
            loss = module._weighted(*columns)
            if not loss.requires_grad:
                return [None] * len(group)
            return list(torch.autograd.grad(loss, group, allow_unused=True))


class _Render(torch.autograd.Function):
    @staticmethod
    def forward(context: Any, scene: _Scene, *tensors: torch.Tensor) -> torch.Tensor:
        context.scene = scene
        # PyTorch refuses a gradient after a change of these.
        context.save_for_backward(*tensors)
        return scene.values()

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(context: Any, delta: torch.Tensor) -> tuple:
        _ = context.saved_tensors
        wanted = context.needs_input_grad[1:]
        return (None, *context.scene.gradients(_array(delta), wanted))


def render(
    field: Union[Field, torch.nn.Module],
    shader: Union[Shader, torch.nn.Module, torch.Tensor, Sequence[float]],
    cameras: Sequence[Any],
    pixels: Any = None,
    *,
    bounds: Any,
    seed: int = 0,
    spp: int = 4,
    background: Any = None,
    estimator: str = "refined",
    **options: Any,
) -> torch.Tensor:
    """The values of pixels, n x 3 linear RGB, with gradients by everything that takes one.

    ``loss.backward()`` gives the exact gradient of the silhouettes, too, in the mean over seeds: to
    the parameters of ``field`` and ``shader``, to a ``shader`` that is a colour, to ``background``,
    and to the numbers of cameras that are ``dsdf.torch.Camera``.

    - ``field``, ``shader``: modules, as of ``Field`` and ``Shader``; a shader may be a colour
    - ``cameras``: ``dsdf.torch.Camera``, ``dsdf.Camera`` or dictionaries
    - ``pixels``: rows of camera, column and row; all pixels of all cameras by default
    - ``seed``: another one for each step. Values and gradients have samples of their own (2 ``seed``
      and 2 ``seed`` + 1): the gradient of a loss that is quadratic in the values has no bias
    - ``bounds``, ``spp``, ``background``, ``estimator`` and the other options: as of ``dsdf.record``

    The tensor has the precision and the device of the first parameter of ``field``. Second
    derivatives are refused.
    """
    options = {"bounds": bounds, "spp": spp, **options}
    scene = _Scene(field, shader, cameras, pixels, background, seed, estimator, options)
    return _Render.apply(scene, *scene.tensors())
