"""A distance and a radiance of JAX: small networks."""

import jax
import jax.numpy as jnp
import numpy as np


def layers(sizes, seed):
    rng = np.random.default_rng(seed)
    scale = [rng.normal(size=s) / np.sqrt(s[0]) for s in zip(sizes, sizes[1:])]
    return [(jnp.asarray(w, jnp.float32), jnp.zeros(w.shape[1])) for w in scale]


def net(weights, h):
    for weight, bias in weights[:-1]:
        h = jax.nn.softplus(10 * (h @ weight + bias)) / 10
    return h @ weights[-1][0] + weights[-1][1]


def distance(weights, x):
    return jnp.linalg.norm(x + 1e-9, axis=-1) - 0.6 + 0.3 * net(weights, x)[:, 0]


def radiance(weights, x, n, d):
    return jax.nn.sigmoid(net(weights, jnp.concatenate([x, n, d], axis=-1)))
