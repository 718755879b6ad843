"""Differentiable rendering of signed distance fields.

Two things are here:

- ``record`` differentiates images of a field and a shader that are Python objects: a network of
  any framework. ``dsdf.torch`` and ``dsdf.jax`` make such objects.
- ``render``, ``gradient``, ``fit``, ``mesh``, ``evaluate``, ``query``, ``inspect``, ``report`` and
  ``synth`` run the commands of the program ``dsdf`` in this process, with its options, errors and
  bits. ``command`` runs the others, such as ``poses``.

Arrays are NumPy arrays. Radiance is linear RGB, lengths are in world units, f is negative inside.
"""

from ._commands import (
    Mesh,
    Page,
    Run,
    Scene,
    command,
    evaluate,
    fit,
    gradient,
    inspect,
    mesh,
    query,
    render,
    report,
    show,
    synth,
)
from ._native import Camera, InputError, Record, read_image, write_image
from ._records import Photograph, photographs, picture, pixels, record

__all__ = [
    "Camera",
    "InputError",
    "Mesh",
    "Page",
    "Photograph",
    "Record",
    "Run",
    "Scene",
    "command",
    "evaluate",
    "fit",
    "gradient",
    "inspect",
    "mesh",
    "photographs",
    "picture",
    "pixels",
    "query",
    "read_image",
    "record",
    "render",
    "report",
    "show",
    "synth",
    "write_image",
]
