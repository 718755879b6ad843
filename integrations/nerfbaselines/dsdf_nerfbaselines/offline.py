"""PSNR and SSIM of nerfbaselines, without LPIPS.

LPIPS needs PyTorch, and downloads the weights of a network. A data set whose ``nb-info.json`` has
``"evaluation_protocol": "psnr-ssim"`` is evaluated without it.
"""

from typing import Any

import numpy as np
from nerfbaselines import metrics
from nerfbaselines.evaluation import DefaultEvaluationProtocol
from nerfbaselines.utils import image_to_srgb


class PsnrSsim(DefaultEvaluationProtocol):
    """The protocol ``default``, without LPIPS."""

    _name = "psnr-ssim"

    def evaluate(self, predictions: Any, dataset: Any) -> dict[str, float]:
        metadata, images = dataset["metadata"], dataset["images"]
        if len(images) != 1:
            raise ValueError(f"data set: found {len(images)} images, expected 1")
        found, truth = (
            image_to_srgb(
                image,
                np.float32,
                color_space=metadata["color_space"],
                background_color=metadata.get("background_color"),
            )
            for image in (predictions["color"], images[0])
        )
        if dataset.get("masks") is not None:
            mask = np.asarray(dataset["masks"][0], dtype=np.float32)[..., None]
            found, truth = found * mask, truth * mask
        error = metrics.mse(found[None], truth[None])
        return {
            "psnr": float(np.mean(metrics.psnr(error))),
            "ssim": float(np.mean(metrics.ssim(truth[None], found[None]))),
            "mae": float(np.mean(metrics.mae(truth[None], found[None]))),
        }
