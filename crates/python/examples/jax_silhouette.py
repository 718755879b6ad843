"""A JAX function is fitted to silhouettes of a jack, seen from 12 sides.

    python jax_silhouette.py [PICTURE.png]

The jack (three crossed capsules) is made and rendered here. The function starts as a ball. The
surface has the same radiance everywhere: all that the pixels tell is their silhouettes.
"""

import sys
import tempfile

import jax
import jax.numpy as jnp
import numpy as np

import dsdf
import dsdf.jax

BOUNDS = (0, 0, 0, 1.4)
JACK = {
    "camera": {"width": 160, "height": 160, "focal": 275, "principal": [80, 80],
               "eye": [1.2, 1.5, 3], "target": [0, 0, 0], "up": [0, 1, 0]},
    "sdf": {"type": "smooth_union", "k": 0.15, "children": [
        {"type": "capsule", "a": [-0.8, 0, 0], "b": [0.8, 0, 0], "radius": 0.2},
        {"type": "capsule", "a": [0, -0.6, 0], "b": [0, 0.6, 0], "radius": 0.2},
        {"type": "capsule", "a": [0, 0, -0.5], "b": [0, 0, 0.5], "radius": 0.25}]},
    "appearance": {"type": "constant", "radiance": [1, 1, 1]},
    "background": [0, 0, 0],
}


def start(sizes, key):
    """The weights of a perceptron, normal with the variance 2/inputs."""
    keys = jax.random.split(key, len(sizes))
    pairs = zip(keys, sizes[:-1], sizes[1:])
    return [(jax.random.normal(k, (m, n)) * np.sqrt(2 / m), jnp.zeros(n)) for k, m, n in pairs]


def perceptron(layers, h):
    for weight, bias in layers[:-1]:
        h = jax.nn.softplus(20 * (h @ weight + bias)) / 20
    weight, bias = layers[-1]
    return h @ weight + bias


def distance(layers, x):
    """The signed distance of a ball, plus a perceptron."""
    return jnp.sqrt((x * x).sum(-1) + 1e-12) - 0.7 + 0.2 * perceptron(layers, x)[:, 0]


def eikonal(layers, x):
    """The mean of (|grad f| - 1)^2."""
    slope = jax.grad(lambda x: distance(layers, x).sum())(x)
    return jnp.mean((jnp.sqrt((slope * slope).sum(-1) + 1e-12) - 1) ** 2)


@jax.jit
def adam(step, rate, state, parameters, gradient):
    """A step of Adam (Kingma and Ba, ICLR 2015)."""
    mean, square = state
    mean = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, mean, gradient)
    square = jax.tree.map(lambda s, g: 0.999 * s + 0.001 * g * g, square, gradient)
    rate = rate * jnp.sqrt(1 - 0.999**step) / (1 - 0.9**step)
    move = lambda p, m, s: p - rate * m / (jnp.sqrt(s) + 1e-8)
    return (mean, square), jax.tree.map(move, parameters, mean, square)


def main(picture="jax_silhouette.png", steps=200):
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        dsdf.synth(JACK, folder, views=12, size="64x64", spp=16)
        views, held_out = dsdf.photographs(folder)
    cameras = [view.camera for view in views]
    pixels = dsdf.pixels(cameras)
    target = np.concatenate([view.image.reshape(-1, 3) for view in views]).astype(np.float64)

    field = dsdf.jax.Field(distance, start([3, 48, 48, 1], jax.random.key(0)))
    zero = jax.tree.map(jnp.zeros_like, field.parameters)
    state, smooth = (zero, zero), jax.jit(jax.grad(eikonal))
    see = lambda camera: dsdf.picture(field, (1, 1, 1), camera, bounds=BOUNDS, spp=16)
    error = lambda: np.mean([np.abs(see(v.camera) - v.image).mean() for v in held_out])
    shown = dsdf.Camera(**JACK["camera"])
    first, before = see(shown), error()
    for step in range(steps):
        chosen = rng.choice(len(pixels), 1024, replace=False)
        batch = (field, (1, 1, 1), cameras, pixels[chosen])
        # The pixel values and their derivatives come from independent samples.
        values = dsdf.record(*batch, bounds=BOUNDS, seed=2 * step, spp=4, estimator="interior")
        delta = (values.radiance - target[chosen]) / len(chosen)
        samples = dsdf.record(*batch, bounds=BOUNDS, seed=2 * step + 1, spp=4)
        gradient = dsdf.jax.gradient(samples, delta, field)
        x = jnp.asarray(rng.uniform(-1, 1, (512, 3)), dtype=jnp.float32)
        add = lambda g, e: g + 0.005 * e
        gradient = jax.tree.map(add, gradient, smooth(field.parameters, x))
        state, field.parameters = adam(step + 1.0, 5e-3, state, field.parameters, gradient)
    after = error()
    print(f"mean error of held-out silhouettes: {before:.4f} before, {after:.4f} after")
    dsdf.write_image(picture, np.concatenate([dsdf.render(JACK), first, see(shown)], axis=1))
    return before, after


if __name__ == "__main__":
    main(*sys.argv[1:])
