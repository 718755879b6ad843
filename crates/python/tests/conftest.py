"""Scenes, a quiet environment, and the program ``dsdf`` for comparisons."""

import os
import pathlib
import shutil

import pytest
from shapes import SCENE

os.environ.setdefault("JAX_PLATFORMS", "cpu")


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
