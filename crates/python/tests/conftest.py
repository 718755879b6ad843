"""Scenes, a quiet environment, and the program ``dsdf`` for comparisons."""

import os
import pathlib
import shutil

import pytest

os.environ.setdefault("JAX_PLATFORMS", "cpu")

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


@pytest.fixture
def scene():
    return SCENE


@pytest.fixture(scope="session")
def program():
    """The program, whose results the package must repeat bit for bit."""
    found = os.environ.get("DSDF_PROGRAM") or shutil.which("dsdf")
    if found is None or not pathlib.Path(found).is_file():
        pytest.skip("no program dsdf to compare with: DSDF_PROGRAM names none")
    return found
