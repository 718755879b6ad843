"""A JAX function and a shader of its own are fitted to photographs from 12 sides.

    python jax_photographs.py [PICTURE.png]

The photographs are of a lit block that is made and rendered here, without masks. The shader is a
second network: radiance by point, normal and view direction.
"""

import sys
import tempfile

import jax
import jax.numpy as jnp
import numpy as np
from jax_silhouette import adam, distance, eikonal, perceptron, start

import dsdf
import dsdf.jax

BOUNDS = (0, 0, 0, 1.4)
BLOCK = {
    "camera": {"width": 160, "height": 160, "focal": 275, "principal": [80, 80],
               "eye": [1.2, 1.5, 3], "target": [0, 0, 0], "up": [0, 1, 0]},
    "sdf": {"type": "smooth_union", "k": 0.2, "children": [
        {"type": "box", "center": [-0.1, -0.1, 0], "half_size": [0.6, 0.3, 0.4]},
        {"type": "sphere", "center": [0.35, 0.35, 0], "radius": 0.4}]},
    "appearance": {"type": "lambert", "albedo": [0.8, 0.6, 0.4], "ambient": [0.3, 0.3, 0.35],
                   "lights": [{"type": "directional", "direction": [0.4, 0.8, 0.5],
                               "radiance": [0.9, 0.85, 0.8]}]},
    "background": [0.02, 0.02, 0.03],
}


def radiance(layers, x, normal, direction):
    """The radiance at points with normals and view directions."""
    return jax.nn.sigmoid(perceptron(layers, jnp.concatenate([x, normal, direction], axis=-1)))


def main(picture="jax_photographs.png", steps=200):
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        dsdf.synth(BLOCK, folder, views=12, size="64x64", spp=16)
        views, held_out = dsdf.photographs(folder)
    cameras = [view.camera for view in views]
    pixels = dsdf.pixels(cameras)
    target = np.concatenate([view.image.reshape(-1, 3) for view in views]).astype(np.float64)

    key, other = jax.random.split(jax.random.key(0))
    field = dsdf.jax.Field(distance, start([3, 48, 48, 1], key))
    shader = dsdf.jax.Shader(radiance, start([9, 48, 48, 3], other))
    parameters = field.parameters, shader.parameters
    zero = jax.tree.map(jnp.zeros_like, parameters)
    state, smooth = (zero, zero), jax.jit(jax.grad(eikonal))
    scene = {"bounds": BOUNDS, "background": BLOCK["background"]}
    see = lambda camera: dsdf.picture(field, shader, camera, spp=8, **scene)
    error = lambda: np.mean([np.abs(see(v.camera) - v.image).mean() for v in held_out])
    shown = dsdf.Camera(**BLOCK["camera"])
    first, before = see(shown), error()
    for step in range(steps):
        chosen = rng.choice(len(pixels), 768, replace=False)
        batch = (field, shader, cameras, pixels[chosen])
        # The pixel values and their derivatives come from independent samples.
        values = dsdf.record(*batch, seed=2 * step, spp=4, estimator="interior", **scene)
        delta = (values.radiance - target[chosen]) / len(chosen)
        samples = dsdf.record(*batch, seed=2 * step + 1, spp=4, **scene)
        of_field, of_shader = dsdf.jax.gradient(samples, delta, field, shader)
        x = jnp.asarray(rng.uniform(-1, 1, (512, 3)), dtype=jnp.float32)
        of_field = jax.tree.map(lambda g, e: g + 0.005 * e, of_field, smooth(field.parameters, x))
        gradient = (of_field, of_shader)
        state, parameters = adam(step + 1.0, 5e-3, state, parameters, gradient)
        field.parameters, shader.parameters = parameters
    after = error()
    print(f"mean error of held-out photographs: {before:.4f} before, {after:.4f} after")
    dsdf.write_image(picture, np.concatenate([dsdf.render(BLOCK), first, see(shown)], axis=1))
    return before, after


if __name__ == "__main__":
    main(*sys.argv[1:])
