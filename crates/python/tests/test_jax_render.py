"""``dsdf.jax.render``: gradients by all arrays, with and without ``jit``."""

import numpy as np
import pytest
from shapes import BOUNDS, camera

import dsdf

jax = pytest.importorskip("jax", reason="JAX is not installed")
import jax.numpy as jnp  # noqa: E402

from jax_networks import distance, layers, radiance  # noqa: E402

import dsdf.jax  # noqa: E402

SIZE = 16


def look(eye):
    """The pose of a camera that looks at the origin."""
    back = eye / jnp.linalg.norm(eye)
    right = jnp.cross(jnp.array([0.0, 1.0, 0.0]), back)
    right = right / jnp.linalg.norm(right)
    axes = jnp.stack([right, jnp.cross(back, right), back, eye], axis=1)
    return jnp.concatenate([axes, jnp.eye(4)[3:]])


def start(is_lit):
    return {
        "field": layers([3, 16, 1], 1),
        "shader": layers([9, 8, 3], 2) if is_lit else jnp.array([0.9, 0.6, 0.3]),
        "background": jnp.array([0.1, 0.2, 0.3]),
        "eyes": jnp.array([[0.4, 0.6, 3.3], [-2.2, 0.5, 2.4]]),
        "focal": jnp.array(1.7 * SIZE),
        "principal": jnp.array([SIZE / 2, SIZE / 2]),
    }


def shown(p, is_lit, **options):
    field = dsdf.jax.Field(distance, p["field"])
    shader = dsdf.jax.Shader(radiance, p["shader"]) if is_lit else p["shader"]
    lens = {"width": SIZE, "height": SIZE, "focal": p["focal"], "principal": p["principal"]}
    cameras = [{**lens, "pose": look(eye)} for eye in p["eyes"]]
    # A camera that does not move.
    cameras.append(camera(SIZE))
    background = p["background"]
    return dsdf.jax.render(
        field, shader, cameras, bounds=BOUNDS, background=background, **options
    )


def target():
    u = dsdf.pixels([camera(SIZE)] * 3) / SIZE
    return jnp.asarray(0.5 + 0.3 * np.sin(u @ [[1, 2, 0], [3, -1, 1], [1, 2, 2]]))


def norm(tree):
    return float(sum((leaf**2).sum() for leaf in jax.tree_util.tree_leaves(tree)) ** 0.5)


@pytest.mark.parametrize("is_lit", [False, True], ids=["silhouettes", "photographs"])
def test_every_gradient_matches_finite_differences(is_lit):
    goal = target()

    def loss(p, seed, spp):
        return 0.5 * ((shown(p, is_lit, seed=seed, spp=spp) - goal) ** 2).sum()

    p, rounds = start(is_lit), 3
    slope = jax.jit(jax.grad(loss), static_argnums=2)
    found = [slope(p, seed, 64) for seed in range(rounds)]
    gradient = jax.tree_util.tree_map(lambda *g: sum(g) / rounds, *found)
    spp = 192 if is_lit else 512
    steps = {"field": 0.02, "shader": 0.02, "background": 0.05, "eyes": 0.05, "focal": 0.3,
             "principal": 0.1}
    assert set(gradient) == set(steps)
    # Differences of silhouettes take long, and background and lens are the same code there.
    for name, step in steps.items() if is_lit else [("field", 0.02), ("eyes", 0.05)]:
        length = norm(gradient[name])
        moved = []
        for sign in (1, -1):
            along = lambda a, g: a + sign * step * g / length
            other = {**p, name: jax.tree_util.tree_map(along, p[name], gradient[name])}
            moved.append(float(loss(other, 9, spp)))
        # A shift of a tenth of a pixel is a small difference of large sums.
        expected = (moved[0] - moved[1]) / (2 * step)
        tolerance = 0.2 if name == "principal" else 0.04
        assert length == pytest.approx(expected, rel=tolerance), name


def test_jit_has_the_bits_of_a_plain_call_and_a_traced_seed():
    p = start(False)
    plain = shown(p, False, seed=5)
    assert plain.shape == (3 * SIZE * SIZE, 3) and plain.dtype == jnp.float32
    jitted = jax.jit(lambda p, seed: shown(p, False, seed=seed))
    assert np.array_equal(plain, jitted(p, 5)) and not np.array_equal(plain, jitted(p, 6))
    assert not jax.config.jax_enable_x64


def test_a_compiled_step_runs_many_times():
    goal = target()

    @jax.jit
    def step(p, seed):
        def loss(p):
            values = shown(p, True, seed=seed, spp=1)
            # Other work of JAX is under way while Python is called.
            points = jax.random.uniform(jax.random.PRNGKey(seed), (512, 3), minval=-1)
            slopes = jax.vmap(jax.grad(lambda x: distance(p["field"], x[None])[0]))(points)
            eikonal = ((jnp.linalg.norm(slopes, axis=-1) - 1) ** 2).mean()
            return ((values - goal) ** 2).mean() + 0.1 * eikonal

        value, gradient = jax.value_and_grad(loss)(p)
        return value, jax.tree_util.tree_map(lambda a, g: a - 0.01 * g, p, gradient)

    p, values = start(True), []
    for seed in range(25):
        value, p = step(p, seed)
        values.append(float(value))
    assert np.isfinite(values).all() and np.mean(values[-5:]) < np.mean(values[:5])


def test_an_error_of_the_field_arrives():
    def wrong(parameters, x):
        return distance(parameters, x) * jnp.nan

    with pytest.raises(Exception, match="field"):
        field = dsdf.jax.Field(wrong, layers([3, 16, 1], 1))
        dsdf.jax.render(field, (1, 1, 1), [camera(8)], bounds=BOUNDS).block_until_ready()
