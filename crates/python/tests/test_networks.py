"""Networks of PyTorch and JAX: gradients against finite differences, and batches."""

import numpy as np
import pytest
from shapes import BOUNDS, camera

import dsdf

SIZE = 16


def setup_scene():
    view = camera(SIZE)
    pixels = dsdf.pixels([view])
    u, v = pixels[:, 1] / SIZE, pixels[:, 2] / SIZE
    target = 0.5 + 0.3 * np.stack([np.sin(3 * u + v), np.cos(2 * v - u), u * v], axis=1)
    return view, pixels, target


class Torch:
    """A network of PyTorch and a shader of its own."""

    def __init__(self, is_lit):
        torch = pytest.importorskip("torch", reason="PyTorch is not installed")
        import dsdf.torch as helpers

        torch.manual_seed(0)
        torch.set_num_threads(1)
        linear, soft = torch.nn.Linear, torch.nn.Softplus

        class Distance(torch.nn.Module):
            def __init__(self):
                super().__init__()
                self.net = torch.nn.Sequential(linear(3, 16), soft(beta=10), linear(16, 1))

            def forward(self, x):
                return x.norm(dim=-1, keepdim=True) - 0.6 + 0.3 * self.net(x)

        class Radiance(torch.nn.Module):
            def __init__(self):
                super().__init__()
                self.net = torch.nn.Sequential(linear(9, 8), soft(), linear(8, 3))

            def forward(self, x, n, d):
                return torch.sigmoid(self.net(torch.cat([x, n, d], dim=-1)))

        self.helpers, self.modules = helpers, [Distance()] + [Radiance()] * is_lit
        self.field = helpers.Field(self.modules[0])
        self.shader = helpers.Shader(self.modules[1]) if is_lit else (0.9, 0.6, 0.3)
        self.parts = [p for module in self.modules for p in module.parameters()]

    def get(self):
        return np.concatenate([p.detach().double().numpy().ravel() for p in self.parts])

    def set(self, values):
        import torch

        at = 0
        with torch.no_grad():
            for p in self.parts:
                part = values[at : at + p.numel()].reshape(p.shape)
                p.copy_(torch.tensor(part))
                at += p.numel()

    def gradient(self, record, delta):
        for p in self.parts:
            p.grad = None
        shader = self.shader if len(self.modules) == 2 else None
        self.helpers.backward(record, delta, self.field, shader)
        assert all(p.grad.dtype == p.dtype for p in self.parts)
        return np.concatenate([p.grad.double().numpy().ravel() for p in self.parts])


class Jax:
    """A function of JAX and a shader of its own."""

    def __init__(self, is_lit):
        jax = pytest.importorskip("jax", reason="JAX is not installed")
        from jax_networks import distance, layers, radiance

        import dsdf.jax as helpers

        self.jax, self.helpers, self.is_lit = jax, helpers, is_lit
        self.field = helpers.Field(distance, layers([3, 16, 1], 1))
        shader = helpers.Shader(radiance, layers([9, 8, 3], 2))
        self.shader = shader if is_lit else (0.9, 0.6, 0.3)
        self.parts = [self.field] + [shader] * is_lit

    def flat(self, trees):
        leaves = self.jax.tree_util.tree_leaves(trees)
        assert all(leaf.dtype == np.float32 for leaf in leaves)
        return np.concatenate([np.asarray(leaf, dtype=float).ravel() for leaf in leaves])

    def get(self):
        return self.flat([part.parameters for part in self.parts])

    def set(self, values):
        at = 0
        for part in self.parts:
            leaves, tree = self.jax.tree_util.tree_flatten(part.parameters)
            new = []
            for leaf in leaves:
                new.append(values[at : at + leaf.size].reshape(leaf.shape).astype(np.float32))
                at += leaf.size
            part.parameters = self.jax.tree_util.tree_unflatten(tree, new)

    def gradient(self, record, delta):
        shader = self.shader if self.is_lit else None
        return self.flat(self.helpers.gradient(record, delta, self.field, shader))


@pytest.mark.parametrize("is_lit", [False, True], ids=["silhouettes", "photographs"])
@pytest.mark.parametrize("framework", [Torch, Jax])
def test_the_gradient_of_an_image_loss_matches_finite_differences(framework, is_lit):
    network = framework(is_lit)
    view, pixels, target = setup_scene()
    scene = (network.field, network.shader, [view], pixels)
    options = {"bounds": BOUNDS, "background": [0.1, 0.2, 0.3]}

    # A silhouette that moves is a difference of few samples.
    spp = 400 if is_lit else 1024

    def loss():
        image = dsdf.record(*scene, seed=9, spp=spp, estimator="interior", **options).radiance
        return 0.5 * ((image - target) ** 2).sum()

    # Values and derivatives from independent samples: their product has no bias.
    values = dsdf.record(*scene, seed=1, spp=256, estimator="interior", **options)
    samples = dsdf.record(*scene, seed=2, spp=128, **options)
    assert samples.unmodelled == []
    gradient = network.gradient(samples, values.radiance - target)
    start, rng = network.get(), np.random.default_rng(0)
    # All parameters at once, and a random half of them, along their gradient.
    for mask in (1, rng.integers(0, 2, len(start))):
        along = mask * gradient / np.linalg.norm(mask * gradient)
        h, moved = 0.02, []
        for sign in (1, -1):
            network.set(start + sign * h * along)
            moved.append(loss())
        network.set(start)
        expected = (moved[0] - moved[1]) / (2 * h)
        assert gradient @ along == pytest.approx(expected, rel=0.015)


def test_torch_modules_are_not_changed_and_serve_any_precision():
    network = Torch(is_lit=False)
    import torch

    module = network.modules[0]
    x = np.random.default_rng(0).normal(size=(50, 3))
    double = network.field.value(x)
    single = network.helpers.Field(module, dtype=torch.float32).value(x)
    assert single.dtype == double.dtype == np.float64
    assert next(module.parameters()).dtype == torch.float32
    assert 0 < np.abs(single - double).max() < 1e-5
    g, product = network.field.hessian_vector(x, np.ones_like(x))
    h = 1e-5
    ahead, behind = (network.field.value_gradient(x + s * h)[1] for s in (1, -1))
    assert np.abs((ahead - behind) / (2 * h) - product).max() < 1e-6
    assert np.array_equal(g, network.field.value_gradient(x)[1])


def test_a_linear_torch_field_has_no_second_derivatives():
    torch = pytest.importorskip("torch")
    import dsdf.torch as helpers

    field = helpers.Field(torch.nn.Linear(3, 1))
    gradient, product = field.hessian_vector(np.ones((4, 3)), np.ones((4, 3)))
    assert gradient.shape == product.shape == (4, 3) and not product.any()
    field.backward(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)))


def test_jax_functions_need_no_derivatives_at_zero():
    pytest.importorskip("jax")
    import jax.numpy as jnp

    import dsdf.jax as helpers

    def distance(parameters, x):
        return jnp.linalg.norm(x - parameters["c"], axis=-1) - parameters["r"]

    def radiance(parameters, x, n, d):
        return parameters["a"] * (n / jnp.linalg.norm(n, axis=-1, keepdims=True)) + 0.5

    field = helpers.Field(distance, {"c": jnp.zeros(3), "r": 0.7})
    shader = helpers.Shader(radiance, {"a": 0.3})
    view = camera(12)
    pixels = dsdf.pixels([view])
    record = dsdf.record(field, shader, [view], pixels, bounds=BOUNDS, spp=4)
    delta = np.ones((len(pixels), 3))
    of_field, of_shader = helpers.gradient(record, delta, field, shader)
    # By hand: a moved centre has the gradient -n, and -(product of the Hessian with c).
    x, alpha, c = record.backward(delta)
    length = np.linalg.norm(x, axis=1, keepdims=True)
    n = x / length
    turned = (c - n * (n * c).sum(1, keepdims=True)) / length
    expected = -(alpha[:, None] * n + turned).sum(0)
    assert np.allclose(of_field["c"], expected, rtol=1e-4, atol=1e-4 * np.abs(alpha).sum())
    assert of_field["r"] == pytest.approx(-alpha.sum(), rel=1e-4)
    _, normals, _, adjoint = record.shading(delta)
    assert of_shader["a"] == pytest.approx((normals * adjoint).sum(), rel=1e-4)


def test_jax_batches_are_cut_and_padded_without_effect():
    network = Jax(is_lit=True)
    x = np.random.default_rng(0).normal(size=(70, 3))
    small = network.helpers.Field.__new__(network.helpers.Field)
    small.__dict__.update(network.field.__dict__)
    small.lengths = [8, 32]
    for one, other in zip(network.field.value_gradient(x), small.value_gradient(x)):
        assert one.dtype == np.float64 and len(one) == 70
        assert np.abs(one - other).max() < 1e-12
    alpha, c = np.arange(70.0), np.ones((70, 3))
    one, other = network.field.gradient(x, alpha, c), small.gradient(x, alpha, c)
    assert np.allclose(network.flat(one), network.flat(other), rtol=1e-4, atol=1e-4)
    import jax

    assert not jax.config.jax_enable_x64
