"""``dsdf.torch.render``: gradients of all that takes one, against finite differences."""

import pathlib

import numpy as np
import pytest
from shapes import BOUNDS

import dsdf

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
import dsdf.torch  # noqa: E402

SIZE = 16


class Distance(torch.nn.Module):
    """A ball with dents: the distance is not exact."""

    def __init__(self):
        super().__init__()
        self.net = torch.nn.Sequential(
            torch.nn.Linear(3, 16), torch.nn.Softplus(beta=10), torch.nn.Linear(16, 1)
        )

    def forward(self, x):
        return x.norm(dim=-1, keepdim=True) - 0.6 + 0.3 * self.net(x)


class Radiance(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.net = torch.nn.Sequential(
            torch.nn.Linear(9, 8), torch.nn.Softplus(), torch.nn.Linear(8, 3)
        )

    def forward(self, x, n, d):
        return torch.sigmoid(self.net(torch.cat([x, n, d], dim=-1)))


def look(eye):
    """The pose of a camera that looks at the origin."""
    back = eye / eye.norm()
    right = torch.linalg.cross(torch.tensor([0.0, 1.0, 0.0], dtype=eye.dtype), back)
    right = right / right.norm()
    axes = torch.stack([right, torch.linalg.cross(back, right), back, eye], dim=1)
    return torch.cat([axes, torch.eye(4, dtype=eye.dtype)[3:]])


class Setup:
    """A scene of which every number is a tensor, by name."""

    def __init__(self, is_lit):
        torch.manual_seed(0)
        torch.set_num_threads(1)
        self.distance = Distance()
        self.shader = Radiance() if is_lit else torch.tensor([0.9, 0.6, 0.3], requires_grad=True)
        double = {"dtype": torch.float64, "requires_grad": True}
        self.eyes = torch.tensor([[0.4, 0.6, 3.3], [-2.2, 0.5, 2.4]], **double)
        self.focal = torch.tensor(1.7 * SIZE, **double)
        self.principal = torch.tensor([SIZE / 2, SIZE / 2], **double)
        self.background = torch.tensor([0.1, 0.2, 0.3], **double)
        shading = list(self.shader.parameters()) if is_lit else [self.shader]
        self.groups = {
            "field": list(self.distance.parameters()), "shader": shading,
            "background": [self.background], "eyes": [self.eyes],
            "focal": [self.focal], "principal": [self.principal],
        }

    def cameras(self):
        size = {"width": SIZE, "height": SIZE}
        lens = {"focal": self.focal, "principal": self.principal}
        poses = [look(eye) for eye in self.eyes]
        return [dsdf.torch.Camera(**size, **lens, pose=pose) for pose in poses]

    def render(self, **options):
        return dsdf.torch.render(
            self.distance, self.shader, self.cameras(), bounds=BOUNDS,
            background=self.background, **options,
        )

    def target(self):
        u = dsdf.pixels([camera._native() for camera in self.cameras()]) / SIZE
        return torch.tensor(0.5 + 0.3 * np.sin(u @ [[1, 2, 0], [3, -1, 1], [1, 2, 2]]))


@pytest.mark.parametrize("is_lit", [False, True], ids=["silhouettes", "photographs"])
def test_every_gradient_matches_finite_differences(is_lit):
    setup = Setup(is_lit)
    target = setup.target()

    def loss(**options):
        return 0.5 * (setup.render(**options) - target).square().sum()

    tensors = [tensor for group in setup.groups.values() for tensor in group]
    total = [torch.zeros_like(tensor) for tensor in tensors]
    rounds = 3
    for seed in range(rounds):
        found = torch.autograd.grad(loss(seed=seed, spp=96), tensors)
        assert all(g.dtype == t.dtype and g.shape == t.shape for g, t in zip(found, tensors))
        total = [a + g / rounds for a, g in zip(total, found)]
    gradients = dict(zip(map(id, tensors), total))
    # A silhouette that moves is a difference of few samples.
    spp = 192 if is_lit else 512
    steps = {"field": 0.02, "shader": 0.02, "background": 0.05, "eyes": 0.05, "focal": 0.3,
             "principal": 0.1}
    # Differences of silhouettes take long, and background and lens are the same code there.
    names = setup.groups if is_lit else ("field", "shader", "eyes")
    for name in names:
        group = setup.groups[name]
        start = [tensor.detach().clone() for tensor in group]
        gradient = [gradients[id(tensor)] for tensor in group]
        norm = torch.sqrt(sum(g.double().square().sum() for g in gradient))
        moved = []
        for sign in (1, -1):
            with torch.no_grad():
                for tensor, at, g in zip(group, start, gradient):
                    tensor.copy_(at + sign * steps[name] * (g / norm).to(tensor))
                moved.append(float(loss(seed=9, spp=spp)))
        with torch.no_grad():
            for tensor, at in zip(group, start):
                tensor.copy_(at)
        # A shift of a tenth of a pixel is a small difference of large sums.
        expected = (moved[0] - moved[1]) / (2 * steps[name])
        tolerance = 0.2 if name == "principal" else 0.04
        assert float(norm) == pytest.approx(expected, rel=tolerance), name


def test_only_what_takes_a_gradient_gets_one():
    setup = Setup(is_lit=True)
    for parameter in setup.distance.parameters():
        parameter.requires_grad_(False)
    setup.render(seed=3).sum().backward()
    assert all(p.grad is None for p in setup.distance.parameters())
    assert all(p.grad is not None for p in setup.shader.parameters())
    assert setup.eyes.grad is not None and setup.focal.grad.shape == ()
    with torch.no_grad():
        assert not setup.render(seed=3).requires_grad


def test_the_same_seed_has_the_same_bits_and_a_changed_network_no_gradient():
    setup = Setup(is_lit=False)
    one, other = setup.render(seed=5), setup.render(seed=5)
    assert torch.equal(one, other) and not torch.equal(one, setup.render(seed=6))
    assert one.dtype == torch.float32 and one.shape == (2 * SIZE * SIZE, 3)
    with pytest.raises(RuntimeError, match="once_differentiable|differentiate twice"):
        loss = other.square().sum()
        (slope,) = torch.autograd.grad(loss, [setup.background], create_graph=True)
        slope.sum().backward()
    with torch.no_grad():
        next(setup.distance.parameters()).add_(0.1)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        one.sum().backward()


def test_an_estimator_without_derivatives_by_cameras_is_refused():
    setup = Setup(is_lit=False)
    value = setup.render(seed=1, estimator="paper")
    with pytest.raises(dsdf.InputError, match="estimator: found one that has none"):
        value.sum().backward()


def test_the_silhouettes_of_the_manual_are_fitted():
    manual = pathlib.Path(__file__).parents[3] / "docs/python.md"
    blocks = manual.read_text(encoding="utf-8").split("```python\n")[1:]
    (code,) = [block.split("```")[0] for block in blocks if "class Box" in block]
    assert sum(bool(line.strip()) for line in code.splitlines()) <= 25
    found = {}
    exec(code, found)
    assert found["error"] < 0.04, found["error"]
