"""A PyTorch network and a shader of its own are fitted to photographs from 12 sides.

    python torch_photographs.py [PICTURE.png]

The photographs have no masks. The shader is a second network: radiance by point, normal and view
direction.
"""

import sys

import torch
from scenes import BLOCK, Photographs
from torch_silhouette import Distance, fit, perceptron

import dsdf.torch


class Radiance(torch.nn.Module):
    """The radiance at points with normals and view directions."""

    def __init__(self):
        super().__init__()
        self.layers = perceptron(9, 3)

    def forward(self, x, normal, direction):
        return torch.sigmoid(self.layers(torch.cat([x, normal, direction], dim=-1)))


def main(picture="torch_photographs.png"):
    torch.manual_seed(0)
    torch.set_num_threads(1)  # Batches are small.
    data, distance, radiance = Photographs(BLOCK), Distance(), Radiance()
    judge = lambda: data.judge(dsdf.torch.Field(distance), dsdf.torch.Shader(radiance))
    before = judge()
    fit(data, distance, radiance, [*distance.parameters(), *radiance.parameters()], batch=768)
    return data.report(before, judge(), picture)


if __name__ == "__main__":
    main(*sys.argv[1:])
