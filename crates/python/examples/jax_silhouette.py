"""A JAX function is fitted to silhouettes of a jack, seen from 12 sides.

    python jax_silhouette.py [PICTURE.png]
"""

import sys

import jax
import jax.numpy as jnp
import numpy as np
from scenes import BOUNDS, JACK, Photographs

import dsdf.jax


def start(sizes, key):
    """The weights of a perceptron, normal with the variance 2/inputs."""
    keys = jax.random.split(key, len(sizes))
    pairs = zip(keys, sizes[:-1], sizes[1:])
    return [(jax.random.normal(k, (m, n)) * np.sqrt(2 / m), jnp.zeros(n)) for k, m, n in pairs]


def perceptron(layers, h):
    for weight, bias in layers[:-1]:
        h = jax.nn.softplus(20 * (h @ weight + bias)) / 20
    return h @ layers[-1][0] + layers[-1][1]


def distance(layers, x):
    """The signed distance of a ball, plus a perceptron."""
    return jnp.sqrt((x * x).sum(-1) + 1e-12) - 0.7 + 0.2 * perceptron(layers, x)[:, 0]


def eikonal(layers, x):
    """The mean of (|grad f| - 1)^2."""
    slope = jax.grad(lambda x: distance(layers, x).sum())(x)
    return jnp.mean((jnp.sqrt((slope * slope).sum(-1) + 1e-12) - 1) ** 2)


def fit(data, parameters, see, batch, steps=200):
    """Fits parameters by Adam (Kingma and Ba, ICLR 2015); `see` renders pixels."""

    @jax.jit
    def step(number, state, pixels, target, x):
        def loss(parameters):
            values = see(parameters, pixels, jnp.int32(number))
            error = 0.5 * ((values - target) ** 2).sum(1).mean()
            return error + 0.005 * eikonal(parameters["field"], x)

        parameters, mean, square = state
        gradient = jax.grad(loss)(parameters)
        mean = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, mean, gradient)
        square = jax.tree.map(lambda s, g: 0.999 * s + 0.001 * g * g, square, gradient)
        rate = 5e-3 * jnp.sqrt(1 - 0.999**number) / (1 - 0.9**number)
        move = lambda p, m, s: p - rate * m / (jnp.sqrt(s) + 1e-8)
        return jax.tree.map(move, parameters, mean, square), mean, square

    rng = np.random.default_rng(0)
    zero = jax.tree.map(jnp.zeros_like, parameters)
    state = (parameters, zero, zero)
    for number in range(1, steps + 1):
        chosen = rng.choice(len(data.pixels), batch, replace=False)
        x = rng.uniform(-1, 1, (512, 3)).astype(np.float32)
        state = step(float(number), state, data.pixels[chosen], data.target[chosen], x)
    return state[0]


def main(picture="jax_silhouette.png"):
    data, white = Photographs(JACK), (1.0, 1.0, 1.0)
    parameters = {"field": start([3, 48, 48, 1], jax.random.key(0))}
    field = lambda parameters: dsdf.jax.Field(distance, parameters["field"])
    see = lambda parameters, pixels, seed: dsdf.jax.render(
        field(parameters), white, data.cameras, pixels, bounds=BOUNDS, seed=seed)
    before = data.judge(field(parameters), white)
    parameters = fit(data, parameters, see, batch=1024)
    return data.report(before, data.judge(field(parameters), white), picture)


if __name__ == "__main__":
    main(*sys.argv[1:])
