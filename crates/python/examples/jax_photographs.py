"""A JAX function and a shader of its own are fitted to photographs from 12 sides.

    python jax_photographs.py [PICTURE.png]

The photographs have no masks. The shader is a second function: radiance by point, normal and view
direction.
"""

import sys

import jax
import jax.numpy as jnp
from jax_silhouette import distance, fit, perceptron, start
from scenes import BLOCK, BOUNDS, Photographs

import dsdf.jax


def radiance(layers, x, normal, direction):
    """The radiance at points with normals and view directions."""
    return jax.nn.sigmoid(perceptron(layers, jnp.concatenate([x, normal, direction], axis=-1)))


def main(picture="jax_photographs.png"):
    data = Photographs(BLOCK)
    of_field, of_shader = jax.random.split(jax.random.key(0))
    parameters = {"field": start([3, 48, 48, 1], of_field),
                  "shader": start([9, 48, 48, 3], of_shader)}
    parts = lambda parameters: (dsdf.jax.Field(distance, parameters["field"]),
                                dsdf.jax.Shader(radiance, parameters["shader"]))
    see = lambda parameters, pixels, seed: dsdf.jax.render(
        *parts(parameters), data.cameras, pixels, bounds=BOUNDS, seed=seed,
        background=data.scene["background"])
    before = data.judge(*parts(parameters))
    parameters = fit(data, parameters, see, batch=768)
    return data.report(before, data.judge(*parts(parameters)), picture)


if __name__ == "__main__":
    main(*sys.argv[1:])
