"""Fields and shaders in NumPy, with derivatives by hand, and a scene."""

import numpy as np

import dsdf

BOUNDS = (0, 0, 0, 1.5)

SCENE = {
    "camera": {"width": 24, "height": 20, "focal": 40, "principal": [12, 10],
               "eye": [0.6, 0.8, 3.2], "target": [0, 0, 0], "up": [0, 1, 0]},
    "sdf": {"type": "smooth_union", "k": 0.2, "children": [
        {"type": "sphere", "center": [0.1, 0, 0], "radius": 0.6},
        {"type": "box", "center": [-0.3, 0, 0.1], "half_size": [0.4, 0.3, 0.3]}]},
    "appearance": {"type": "lambert", "albedo": [0.8, 0.6, 0.4], "ambient": [0.3, 0.3, 0.3],
                   "lights": [{"type": "directional", "direction": [0.3, 0.5, 0.8],
                               "radiance": [0.7, 0.7, 0.7]}]},
    "background": [0.1, 0.2, 0.3],
}


def camera(size=24):
    return dsdf.Camera(
        width=size, height=size, focal=1.7 * size, principal=[size / 2, size / 2],
        eye=[0.4, 0.6, 3.3], target=[0, 0, 0], up=[0, 1, 0],
    )


class Ball:
    """The distance to a sphere: its parameters are centre and radius."""

    def __init__(self, center=(0.05, -0.1, 0.02), radius=0.7):
        self.center, self.radius = np.array(center, dtype=float), radius

    def value(self, x):
        return np.linalg.norm(x - self.center, axis=1) - self.radius

    def value_gradient(self, x):
        r = x - self.center
        length = np.linalg.norm(r, axis=1)
        return length - self.radius, r / length[:, None]

    def hessian_vector(self, x, p):
        r = x - self.center
        length = np.linalg.norm(r, axis=1)[:, None]
        n = r / length
        return n, (p - n * (n * p).sum(1, keepdims=True)) / length

    def parameter_gradient(self, x, alpha, c):
        """The derivatives of sum(alpha f + c . grad f) by centre (3) and radius."""
        n, turned = self.hessian_vector(x, c)
        return np.append(-(alpha[:, None] * n + turned).sum(0), -alpha.sum())


class Lit:
    """Radiance by point and normal, with a view-dependent part."""

    light = np.array([0.3, 0.5, 0.8])

    def radiance(self, x, n, d):
        shade = 0.5 + 0.4 * (n @ self.light) + 0.2 * x[:, 0]
        return shade[:, None] * np.array([0.9, 0.6, 0.3]) + 0.05 * d

    def vjp(self, x, n, d, adjoint):
        shade = adjoint @ np.array([0.9, 0.6, 0.3])
        x_bar = np.zeros_like(x)
        x_bar[:, 0] = 0.2 * shade
        return x_bar, 0.4 * shade[:, None] * self.light, 0.05 * adjoint
