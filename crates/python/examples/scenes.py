"""The scenes of the examples, their photographs, and the pictures of results."""

import tempfile

import numpy as np

import dsdf

BOUNDS = (0, 0, 0, 1.4)
CAMERA = {"width": 160, "height": 160, "focal": 275, "principal": [80, 80],
          "eye": [1.2, 1.5, 3], "target": [0, 0, 0], "up": [0, 1, 0]}

#: Three crossed capsules, of the same radiance everywhere: a silhouette.
JACK = {
    "camera": CAMERA,
    "sdf": {"type": "smooth_union", "k": 0.15, "children": [
        {"type": "capsule", "a": [-0.8, 0, 0], "b": [0.8, 0, 0], "radius": 0.2},
        {"type": "capsule", "a": [0, -0.6, 0], "b": [0, 0.6, 0], "radius": 0.2},
        {"type": "capsule", "a": [0, 0, -0.5], "b": [0, 0, 0.5], "radius": 0.25}]},
    "appearance": {"type": "constant", "radiance": [1, 1, 1]},
    "background": [0, 0, 0],
}

#: A lit block with a ball.
BLOCK = {
    "camera": CAMERA,
    "sdf": {"type": "smooth_union", "k": 0.2, "children": [
        {"type": "box", "center": [-0.1, -0.1, 0], "half_size": [0.6, 0.3, 0.4]},
        {"type": "sphere", "center": [0.35, 0.35, 0], "radius": 0.4}]},
    "appearance": {"type": "lambert", "albedo": [0.8, 0.6, 0.4], "ambient": [0.3, 0.3, 0.35],
                   "lights": [{"type": "directional", "direction": [0.4, 0.8, 0.5],
                               "radiance": [0.9, 0.85, 0.8]}]},
    "background": [0.02, 0.02, 0.03],
}


class Photographs:
    """Twelve photographs of a scene to fit, and others for judgement."""

    def __init__(self, scene):
        self.scene = scene
        with tempfile.TemporaryDirectory() as folder:
            dsdf.synth(scene, folder, views=12, size="64x64", spp=16)
            views, self.held_out = dsdf.photographs(folder)
        self.cameras = [view.camera for view in views]
        self.pixels = dsdf.pixels(self.cameras)
        self.target = np.concatenate([view.image.reshape(-1, 3) for view in views])

    def judge(self, field, shader):
        """The mean error of the held-out images of a field, and its picture."""
        options = {"bounds": BOUNDS, "background": self.scene["background"], "spp": 8}
        see = lambda camera: dsdf.picture(field, shader, camera, **options)
        errors = [np.abs(see(view.camera) - view.image).mean() for view in self.held_out]
        return np.mean(errors), see(dsdf.Camera(**CAMERA))

    def report(self, before, after, picture):
        """Prints both errors, and writes the target, the start and the result."""
        print(f"mean error of held-out images: {before[0]:.4f} before, {after[0]:.4f} after")
        images = [dsdf.render(self.scene), before[1], after[1]]
        dsdf.write_image(picture, np.concatenate(images, axis=1))
        return before[0], after[0]
