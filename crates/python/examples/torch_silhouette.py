"""A PyTorch network is fitted to silhouettes of a jack, seen from 12 sides.

    python torch_silhouette.py [PICTURE.png]
"""

import sys

import torch
from scenes import BOUNDS, JACK, Photographs

import dsdf.torch


def perceptron(inputs, outputs, width=48):
    """Two hidden layers; weights are normal with the variance 2/inputs."""
    linear = [torch.nn.Linear(*size) for size in ((inputs, width), (width, width), (width, outputs))]
    for layer in linear:
        torch.nn.init.normal_(layer.weight, std=(2 / layer.in_features) ** 0.5)
        torch.nn.init.zeros_(layer.bias)
    soft = torch.nn.Softplus(beta=20)
    return torch.nn.Sequential(linear[0], soft, linear[1], soft, linear[2])


class Distance(torch.nn.Module):
    """The signed distance of a ball, plus a perceptron."""

    def __init__(self):
        super().__init__()
        self.layers = perceptron(3, 1)

    def forward(self, x):
        return x.norm(dim=-1) - 0.7 + 0.2 * self.layers(x).squeeze(-1)


def fit(data, distance, shader, parameters, batch, steps=200):
    """Fits a network, and a shader or a colour, to pixels and to a slope of 1."""
    target = torch.as_tensor(data.target)
    optimizer = torch.optim.Adam(parameters, lr=5e-3)
    for step in range(steps):
        chosen = torch.randint(len(target), (batch,))
        values = dsdf.torch.render(
            distance, shader, data.cameras, data.pixels[chosen], bounds=BOUNDS, seed=step,
            background=data.scene["background"])
        x = (2 * torch.rand(512, 3) - 1).requires_grad_()
        (slope,) = torch.autograd.grad(distance(x).sum(), x, create_graph=True)
        loss = 0.5 * (values - target[chosen]).square().sum(1).mean()
        loss = loss + 0.005 * (slope.norm(dim=-1) - 1).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()


def main(picture="torch_silhouette.png"):
    torch.manual_seed(0)
    torch.set_num_threads(1)  # Batches are small.
    data, distance, white = Photographs(JACK), Distance(), (1.0, 1.0, 1.0)
    before = data.judge(dsdf.torch.Field(distance), white)
    fit(data, distance, white, distance.parameters(), batch=1024)
    return data.report(before, data.judge(dsdf.torch.Field(distance), white), picture)


if __name__ == "__main__":
    main(*sys.argv[1:])
