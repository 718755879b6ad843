"""A PyTorch network is fitted to silhouettes of a jack, seen from 12 sides.

    python torch_silhouette.py [PICTURE.png]

The jack (three crossed capsules) is made and rendered here. The network starts as a ball. The
surface has the same radiance everywhere: all that the pixels tell is their silhouettes.
"""

import sys
import tempfile

import numpy as np
import torch

import dsdf
import dsdf.torch

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


def perceptron(inputs, outputs, width=48):
    """Two hidden layers; weights are normal with the variance 2/inputs."""
    sizes = (inputs, width), (width, width), (width, outputs)
    linear = [torch.nn.Linear(*size) for size in sizes]
    for layer in linear:
        torch.nn.init.normal_(layer.weight, std=(2 / layer.in_features) ** 0.5)
        torch.nn.init.zeros_(layer.bias)
    soft = torch.nn.Softplus(beta=20)
    return torch.nn.Sequential(linear[0], soft, linear[1], soft, linear[2])


class Network(torch.nn.Module):
    """The signed distance of a ball, plus a perceptron."""

    def __init__(self):
        super().__init__()
        self.layers = perceptron(3, 1)

    def forward(self, x):
        return x.norm(dim=-1) - 0.7 + 0.2 * self.layers(x).squeeze(-1)


def main(picture="torch_silhouette.png", steps=200):
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        dsdf.synth(JACK, folder, views=12, size="64x64", spp=16)
        views, held_out = dsdf.photographs(folder)
    cameras = [view.camera for view in views]
    pixels = dsdf.pixels(cameras)
    target = np.concatenate([view.image.reshape(-1, 3) for view in views]).astype(np.float64)

    network = Network()
    field = dsdf.torch.Field(network)
    optimizer = torch.optim.Adam(network.parameters(), lr=5e-3)
    scene = {"shader": (1, 1, 1), "bounds": BOUNDS}
    see = lambda camera: dsdf.picture(field, camera=camera, spp=16, **scene)
    error = lambda: np.mean([np.abs(see(v.camera) - v.image).mean() for v in held_out])
    shown = dsdf.Camera(**JACK["camera"])
    first, before = see(shown), error()
    for step in range(steps):
        chosen = rng.choice(len(pixels), 1024, replace=False)
        batch = (field, scene["shader"], cameras, pixels[chosen])
        # The pixel values and their derivatives come from independent samples.
        values = dsdf.record(*batch, bounds=BOUNDS, seed=2 * step, spp=4, estimator="interior")
        delta = (values.radiance - target[chosen]) / len(chosen)
        samples = dsdf.record(*batch, bounds=BOUNDS, seed=2 * step + 1, spp=4)
        optimizer.zero_grad()
        field.backward(*samples.backward(delta))
        x = torch.tensor(rng.uniform(-1, 1, (512, 3)), dtype=torch.float32, requires_grad=True)
        (slope,) = torch.autograd.grad(network(x).sum(), x, create_graph=True)
        (0.005 * (slope.norm(dim=-1) - 1).square().mean()).backward()
        optimizer.step()
    after = error()
    print(f"mean error of held-out silhouettes: {before:.4f} before, {after:.4f} after")
    dsdf.write_image(picture, np.concatenate([dsdf.render(JACK), first, see(shown)], axis=1))
    return before, after


if __name__ == "__main__":
    main(*sys.argv[1:])
