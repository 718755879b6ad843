"""Cameras of nerfbaselines, as dsdf has them."""

from typing import Any

import numpy as np
from nerfbaselines import camera_model_from_int, camera_model_to_int, cameras as functions

#: OpenCV's axes (y down, z forward) in those of OpenGL (y up, z backward), and the reverse.
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])

#: The numbers of each camera model, in the order of nerfbaselines. None is not used.
LENSES = {
    "pinhole": (),
    "opencv": ("k1", "k2", "p1", "p2"),
    "opencv_fisheye": ("k1", "k2", None, None, "k3", "k4"),
    "full_opencv": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}

#: The largest tangent of an angle to the optical axis that an image shows: that of 55 degrees, as
#: in dsdf's own images of fisheye lenses.
WIDEST = 1.43


def model_of(camera: Any) -> str:
    """The name of the camera's model."""
    return camera_model_from_int(int(camera.camera_models))


def pose(camera: Any) -> list[list[float]]:
    """The camera-to-world matrix, 4 x 4, as dsdf has it: y up, looking along -z."""
    matrix = np.eye(4)
    matrix[:3] = np.asarray(camera.poses, dtype=np.float64)[:3, :4]
    return (matrix @ FLIP).tolist()


def lens(camera: Any) -> dict[str, float]:
    """The distortion, by the names of a ``transforms.json``."""
    numbers = np.ravel(camera.distortion_parameters).tolist()
    return {name: number for name, number in zip(LENSES[model_of(camera)], numbers) if name}


def has_distortion(camera: Any) -> bool:
    """Whether the image differs from that of a pinhole camera."""
    return model_of(camera) == "opencv_fisheye" or any(lens(camera).values())


def pinhole(camera: Any) -> dict[str, Any]:
    """The camera of a scene file, without the distortion."""
    width, height = (int(side) for side in camera.image_sizes)
    fl_x, fl_y, cx, cy = (float(value) for value in camera.intrinsics)
    film = {"width": width, "height": height, "focal": [fl_x, fl_y], "principal": [cx, cy]}
    return film | {"pose": pose(camera)}


def covering(camera: Any) -> Any:
    """A pinhole camera of the same focal length, whose film has what a camera with distortion sees,
    up to an angle of 55 degrees."""
    width, height = (int(side) for side in camera.image_sizes)
    x, y = np.linspace(0, width, width + 1), np.linspace(0, height, height + 1)
    border = [np.stack(np.broadcast_arrays(x, end), -1) for end in (0.0, float(height))]
    border += [np.stack(np.broadcast_arrays(end, y), -1) for end in (0.0, float(width))]
    standing = camera.replace(poses=np.eye(4)[:3])
    border = np.concatenate(border)
    _, directions = functions.unproject(standing[None], border)
    ends = np.clip(directions[:, :2] / directions[:, 2:], -WIDEST, WIDEST)
    focal = np.asarray(camera.intrinsics, dtype=np.float64)[:2]
    # A pixel more on each side, for the interpolation.
    principal = np.ceil(-focal * ends.min(0)) + 2
    size = principal + np.ceil(focal * ends.max(0)) + 2
    return camera.replace(
        camera_models=np.full_like(camera.camera_models, camera_model_to_int("pinhole")),
        distortion_parameters=np.zeros_like(camera.distortion_parameters),
        intrinsics=np.concatenate([focal, principal]),
        image_sizes=size.astype(np.int32),
    )


def warped(image: np.ndarray, found: Any, wanted: Any) -> np.ndarray:
    """An image of the camera ``found`` as the camera ``wanted`` sees it, from the same place."""
    return functions.warp_image_between_cameras(found, wanted, image)
