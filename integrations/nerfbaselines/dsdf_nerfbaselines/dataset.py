"""Writes a data set of nerfbaselines as one that dsdf reads, without loss.

The result is a ``transforms.json`` in the form of nerfstudio, with photographs and masks as PNG,
and the points of the data set. Numbers are written with all of their digits.
"""

import json
import pathlib
from typing import Any, Optional

import numpy as np
from PIL import Image

from . import cameras as convert
from .errors import Refused


def write(dataset: Any, folder: pathlib.Path) -> None:
    """Writes a data set with loaded images into a new folder."""
    color_space = dataset["metadata"].get("color_space", "srgb")
    if color_space != "srgb":
        raise Refused(f"data set: color_space: found {color_space}, expected srgb")
    cameras, images, masks = dataset["cameras"], dataset["images"], dataset.get("masks")
    names = [str(path) for path in dataset["image_paths"]]
    # All of the input is checked before the first file is written.
    films = [_film(*each) for each in zip(images, cameras, names)]
    used = None if masks is None else [_used(*each) for each in zip(masks, cameras, names)]

    (folder / "images").mkdir(parents=True)
    frames = []
    for number, (camera, film) in enumerate(zip(cameras, films)):
        file = f"images/{number:05}.png"
        Image.fromarray(film).save(folder / file, compress_level=1)
        numbers = [*camera.image_sizes.tolist(), *camera.intrinsics.tolist()]
        frame = {"file_path": file, "camera_model": convert.model_of(camera).upper()}
        frame |= dict(zip(("w", "h", "fl_x", "fl_y", "cx", "cy"), numbers)) | convert.lens(camera)
        frame["transform_matrix"] = convert.pose(camera)
        if used is not None:
            # nerfstudio leaves out the pixels where a mask is black.
            frame["mask_path"] = f"masks/{number:05}.png"
            (folder / "masks").mkdir(exist_ok=True)
            mask = np.where(used[number], 255, 0).astype(np.uint8)
            Image.fromarray(mask).save(folder / frame["mask_path"])
        frames.append(frame)
    content = {"frames": frames}
    points = dataset.get("points3D_xyz")
    if points is not None and len(points) > 0:
        _write_points(folder / "points.ply", points, dataset.get("points3D_rgb"))
        content["ply_file_path"] = "points.ply"
    text = json.dumps(content, indent=1, allow_nan=False)
    (folder / "transforms.json").write_text(text, encoding="utf-8")


def _film(image: Any, camera: Any, name: str) -> np.ndarray:
    """The pixels of an image, without the padding of a batch."""
    image = np.asarray(image)
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] not in (3, 4):
        expected = "uint8, height x width x 3 or 4"
        raise Refused(f"{name}: image: found {image.dtype}, {image.shape}, expected {expected}")
    return _cut(image, camera, name, "image")


def _used(mask: Any, camera: Any, name: str) -> np.ndarray:
    """The pixels that a mask leaves, without the padding of a batch."""
    mask = np.asarray(mask)
    if mask.ndim != 2:
        raise Refused(f"{name}: mask: found {mask.shape}, expected height x width")
    return _cut(mask, camera, name, "mask") > 0


def _cut(pixels: np.ndarray, camera: Any, name: str, what: str) -> np.ndarray:
    width, height = (int(side) for side in camera.image_sizes)
    if pixels.shape[0] < height or pixels.shape[1] < width:
        found = f"{pixels.shape[1]} x {pixels.shape[0]} pixels"
        expected = f"{width} x {height}, as its camera has"
        raise Refused(f"{name}: {what}: found {found}, expected {expected}")
    return np.ascontiguousarray(pixels[:height, :width])


def _write_points(path: pathlib.Path, points: Any, colors: Optional[Any]) -> None:
    """Writes points and their colours as a binary .ply file."""
    fields = [(axis, "<f4") for axis in "xyz"]
    if colors is not None:
        fields += [(name, "u1") for name in ("red", "green", "blue")]
    columns = [*np.asarray(points).T, *([] if colors is None else np.asarray(colors).T)]
    rows = np.empty(len(points), dtype=fields)
    for (name, _), column in zip(fields, columns):
        rows[name] = column
    kinds = {"<f4": "float", "u1": "uchar"}
    properties = "".join(f"property {kinds[kind]} {name}\n" for name, kind in fields)
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n{properties}"
    path.write_bytes((head + "end_header\n").encode("ascii") + rows.tobytes())
