"""The commands of the program ``dsdf``, in this process.

Keywords are the options of the command line: ``time="60s"`` is ``--time 60s``, ``top_k=7`` is
``--top-k 7``, True is a flag, a list repeats the option, and the numbers of a tuple are joined by
commas. ``dsdf COMMAND --help`` lists the options. Errors have the texts of the program.

A command runs on threads of its own and does not hold the GIL. ``progress`` is called with the
fraction that is done and a text, about twenty times a second at most. Ctrl-C, and an exception of
``progress``, stop a command at the next step of its progress, and a fit after its checkpoint.
"""

from __future__ import annotations

import contextlib
import html
import json
import os
import pathlib
import sys
import tempfile
from typing import Any, Callable, Iterator, NamedTuple, Optional, Sequence, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native

Path = Union[str, "os.PathLike[str]"]
#: A function of the fraction that is done and a text, or True for a line on ``sys.stderr``.
Progress = Union[Callable[[float, str], None], bool]


class Mesh(NamedTuple):
    """A surface of triangles, in the units of the data set."""

    #: Positions, n x 3.
    vertices: NDArray[np.float64]
    #: The numbers of the three vertices of each face, m x 3.
    faces: NDArray[np.uint32]
    #: sRGB colours of the vertices, n x 3; None if the file has no colours at vertices.
    colors: Optional[NDArray[np.uint8]]


class Scene:
    """A scene: the path of a scene file, or its content as a dictionary.

    Relative paths of model files in a dictionary start at ``folder``.
    """

    def __init__(self, content: Union[Path, dict], folder: Path = "."):
        self.content = content
        self.folder = folder

    def render(self, output: Optional[Path] = None, **options: Any) -> NDArray[np.float32]:
        """As ``dsdf.render``."""
        return render(self, output, **options)

    def gradient(self, *arguments: Any, **options: Any) -> Any:
        """As ``dsdf.gradient``."""
        return gradient(self, *arguments, **options)

    def synth(self, output: Path, **options: Any) -> dict:
        """As ``dsdf.synth``."""
        return synth(self, output, **options)

    @contextlib.contextmanager
    def _file(self) -> Iterator[str]:
        """The path of a scene file, for as long as the context lasts."""
        if not isinstance(self.content, dict):
            yield os.fspath(self.content)
            return
        with _temporary("scene.json") as path:
            try:
                content = self._absolute(self.content)
                text = json.dumps(content, default=_plain, allow_nan=False)
            except (TypeError, ValueError) as error:
                expected = "numbers that are finite, texts, lists and dictionaries"
                raise _native.InputError(f"scene: found {error}, expected {expected}") from None
            pathlib.Path(path).write_text(text, encoding="utf-8")
            yield path

    def _absolute(self, value: Any) -> Any:
        """The content with absolute paths of model files."""
        if isinstance(value, dict):
            return {
                key: os.path.abspath(os.path.join(self.folder, inner))
                if key == "weights" and isinstance(inner, (str, os.PathLike))
                else self._absolute(inner)
                for key, inner in value.items()
            }
        if isinstance(value, (list, tuple)):
            return [self._absolute(inner) for inner in value]
        return value


class Run(os.PathLike):
    """The folder of a fit."""

    def __init__(self, folder: Path, report: Optional[dict] = None):
        self.folder = pathlib.Path(folder)
        #: The result of ``dsdf fit``: iterations, seconds, loss, psnr and verdict. None for a run
        #: that this process did not fit.
        self.report = report

    def __fspath__(self) -> str:
        return os.fspath(self.folder)

    def __repr__(self) -> str:
        return f"Run({str(self.folder)!r})"

    @property
    def model(self) -> pathlib.Path:
        """The model file."""
        return self.folder / "model.safetensors"

    def metrics(self) -> list[dict]:
        """The lines of ``metrics.jsonl``, one for each iteration."""
        with open(self.folder / "metrics.jsonl", encoding="utf-8") as file:
            return [json.loads(line) for line in file]

    def mesh(self, output: Optional[Path] = None, **options: Any) -> Mesh:
        """As ``dsdf.mesh``."""
        return mesh(self, output, **options)

    def evaluate(self, **options: Any) -> dict:
        """As ``dsdf.evaluate``."""
        return evaluate(self, **options)

    def query(self, points: ArrayLike, **options: Any) -> NDArray[np.float32]:
        """As ``dsdf.query``."""
        return query(self, points, **options)

    def render(self, output: Optional[Path] = None, **options: Any) -> NDArray[np.float32]:
        """As ``dsdf.render``: views from around the object, and their normals."""
        return render(self, output, **options)

    def inspect(self, output: Optional[Path] = None, **options: Any) -> dict:
        """As ``dsdf.inspect``, with the verdict."""
        return inspect(self, output, **options)


def command(
    name: str, *paths: Path, progress: Optional[Progress] = None, **options: Any
) -> Optional[dict]:
    """Runs any command of ``dsdf`` and returns its result, that of ``--json``.

    Warnings and notes go to ``sys.stderr``, unless ``quiet=True``.
    Raises ``InputError`` for wrong arguments and wrong input, ``RuntimeError`` for other errors.
    """
    line = _Line()
    if progress is True:
        progress = line.show
    elif progress is False:
        progress = None
    if progress is not None and not callable(progress):
        raise TypeError(f"progress: found {progress!r}, expected a function, a bool or None")
    arguments = [name, *_flags(options), "--", *map(os.fspath, paths)]
    try:
        result = _native.run(arguments, progress, line.note)
    finally:
        line.clear()
    return None if result is None else json.loads(result)


class _Line:
    """A line of progress on ``sys.stderr``, which the next one replaces, in notebooks too."""

    def __init__(self) -> None:
        self.width = 0

    def show(self, fraction: float, text: str) -> None:
        line = f"{100 * fraction:5.1f} %  {text}"[:100]
        print("\r" + line.ljust(self.width), end="", file=sys.stderr, flush=True)
        self.width = len(line)

    def note(self, line: str) -> None:
        self.clear()
        print(line, file=sys.stderr)

    def clear(self) -> None:
        if self.width:
            print("\r" + " " * self.width + "\r", end="", file=sys.stderr, flush=True)
        self.width = 0


class Page:
    """The page of a run, as HTML. A notebook shows it."""

    def __init__(self, text: str, height: int):
        #: The content of the file that ``dsdf report`` writes.
        self.html = text
        self.height = height

    def _repr_html_(self) -> str:
        source = html.escape(self.html, quote=True)
        style = f"width:100%;height:{self.height}px;border:0"
        return f'<iframe sandbox="allow-scripts" srcdoc="{source}" style="{style}"></iframe>'


def show(run: Union[Run, Path], *, height: int = 900, **options: Any) -> Page:
    """The page of a run (``dsdf report``): as the last value of a cell, a notebook shows it, with the
    surface to turn. ``height`` is in pixels."""
    with _temporary("report.html") as file:
        report(run, file, **options)
        return Page(pathlib.Path(file).read_text(encoding="utf-8"), height)


def render(
    scene: Union[Scene, Run, Path, dict],
    output: Optional[Path] = None,
    *,
    progress: Optional[Progress] = None,
    **options: Any,
) -> NDArray[np.float32]:
    """``dsdf render``: the image of a scene, or of a run from all sides.

    The result is height x width x 3, linear. The image is written to ``output`` too, if that is given.
    """
    if output is not None:
        _native.check_image(output)
    with _scene(scene) as path, _temporary("image.npy") as image:
        command("render", path, progress=progress, output=image, **options)
        pixels = np.load(image)
    if output is not None:
        _native.write_image(output, pixels)
    return pixels


def gradient(
    scene: Union[Scene, Path, dict],
    wrt: Union[str, Sequence[str], None] = None,
    target: Union[Path, NDArray, None] = None,
    output: Optional[Path] = None,
    *,
    progress: Optional[Progress] = None,
    **options: Any,
) -> Any:
    """``dsdf gradient``: derivative images, or the gradient of an image loss.

    - ``wrt``: a JSON pointer gives its derivative image, height x width x 3; a list of pointers
      gives a dictionary of images
    - ``target``: an image, as a file or height x width x 3, gives the gradient of
      ½ Σ (I − target)² by the weights of a neural scene: a dictionary of arrays
    """
    pointers = [wrt] if isinstance(wrt, str) else list(wrt or [])
    own = "gradient.npy" if target is None else "gradient.safetensors"
    with contextlib.ExitStack() as stack:
        path = stack.enter_context(_scene(scene))
        file = os.fspath(output) if output is not None else stack.enter_context(_temporary(own))
        if target is not None and not isinstance(target, (str, os.PathLike)):
            saved = stack.enter_context(_temporary("target.npy"))
            np.save(saved, np.ascontiguousarray(target, dtype=np.float32))
            target = saved
        options |= {"wrt": pointers, "target": target, "output": file}
        result = command("gradient", path, progress=progress, **options)
        outputs = result["outputs"] if result else []
        if target is not None:
            return _tensors(outputs[0])
        images = [_native.read_image(path) for path in outputs]
    return images[0] if isinstance(wrt, str) else dict(zip(pointers, images))


def fit(
    dataset: Optional[Path],
    output: Path,
    *,
    progress: Optional[Progress] = None,
    **options: Any,
) -> Run:
    """``dsdf fit``: reconstructs the shape of posed photographs, in the run folder ``output``.

    Ctrl-C writes a checkpoint and raises KeyboardInterrupt; ``resume=True`` continues. With
    ``check=True`` nothing is written, and the folder of the result does not exist.
    """
    paths = [] if dataset is None else [dataset]
    return Run(output, command("fit", *paths, progress=progress, output=output, **options))


def mesh(
    run: Union[Run, Path],
    output: Optional[Path] = None,
    *,
    progress: Optional[Progress] = None,
    **options: Any,
) -> Mesh:
    """``dsdf mesh``: the surface of a run; written to ``output`` too, if that is given.

    The arrays are those of the file. Files other than .ply give no colours here. A .usdz cannot be
    read back: ``dsdf.command("mesh", run, output="shape.usdz")`` writes one.
    """
    if output is not None and os.fspath(output).lower().endswith(".usdz"):
        raise _native.InputError(f"{output}: a .usdz cannot be read back: dsdf.command(\"mesh\", ...)")
    with contextlib.ExitStack() as stack:
        file = output if output is not None else stack.enter_context(_temporary("mesh.ply"))
        command("mesh", run, progress=progress, output=file, **options)
        vertices, faces = _native.read_mesh(file)
        is_ply = os.fspath(file).lower().endswith(".ply")
        return Mesh(vertices, faces, _ply_colors(file) if is_ply else None)


def evaluate(
    run: Union[Run, Path], *, progress: Optional[Progress] = None, **options: Any
) -> dict:
    """``dsdf eval``: the errors of a run. The keys are those of ``dsdf eval --json``."""
    return command("eval", run, progress=progress, **options) or {}


def query(
    model: Union[Run, Path],
    points: ArrayLike,
    *,
    progress: Optional[Progress] = None,
    **options: Any,
) -> NDArray[np.float32]:
    """``dsdf query``: the values of a model at points, n x 3; with ``gradient=True``, n x 4."""
    model = model.model if isinstance(model, Run) else model
    with _temporary("points.npy") as file, _temporary("values.npy") as output:
        np.save(file, np.ascontiguousarray(points, dtype=np.float64))
        command("query", model, file, progress=progress, **({"output": output} | options))
        return np.load(options.get("output", output))


def inspect(
    dataset: Union[Run, Path],
    output: Optional[Path] = None,
    *,
    progress: Optional[Progress] = None,
    **options: Any,
) -> dict:
    """``dsdf inspect``: cameras, units and bounding sphere of a data set, or the verdict on a run.

    The keys are those of ``dsdf inspect --json``. The picture is kept if ``output`` is given.
    """
    with contextlib.ExitStack() as stack:
        file = output if output is not None else stack.enter_context(_temporary("inspect.png"))
        return command("inspect", dataset, progress=progress, output=file, **options) or {}


def synth(
    scene: Union[Scene, Path, dict],
    output: Path,
    *,
    progress: Optional[Progress] = None,
    **options: Any,
) -> dict:
    """``dsdf synth``: posed images of a scene in the folder ``output``, with its true mesh."""
    with _scene(scene) as path:
        return command("synth", path, progress=progress, output=output, **options) or {}


def report(
    run: Union[Run, Path],
    output: Path,
    *,
    progress: Optional[Progress] = None,
    **options: Any,
) -> dict:
    """``dsdf report``: the run as one page for a browser."""
    return command("report", run, progress=progress, output=output, **options) or {}


def _flags(options: dict[str, Any]) -> list[str]:
    """The options of the command line."""
    flags = []
    for name, value in options.items():
        if name in ("help", "version"):
            raise _native.InputError(f"{name}: found an argument, expected an option of the command")
        flag = "--" + name.replace("_", "-")
        for item in value if isinstance(value, list) else [value]:
            if item is True:
                flags.append(flag)
            elif item is not None and item is not False:
                flags.append(f"{flag}={_text(item)}")
    return flags


def _text(value: Any) -> str:
    """A value as the command line has it."""
    if isinstance(value, (tuple, np.ndarray)):
        return ",".join(map(_text, value))
    if isinstance(value, np.generic):
        value = value.item()
    return os.fspath(value) if isinstance(value, (str, os.PathLike)) else repr(value)


def _plain(value: Any) -> Any:
    """Arrays and numbers of NumPy, and paths, for JSON."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    return os.fspath(value)


@contextlib.contextmanager
def _scene(scene: Any) -> Iterator[Path]:
    """The path of a scene file or of a run."""
    if isinstance(scene, dict):
        scene = Scene(scene)
    if isinstance(scene, Scene):
        with scene._file() as path:
            yield path
    else:
        yield scene


@contextlib.contextmanager
def _temporary(name: str) -> Iterator[str]:
    """The path of a file in a folder that is removed at the end.

    A message about the file has its name without the ending: that of an argument.
    """
    with tempfile.TemporaryDirectory(prefix="dsdf-") as folder:
        path = os.path.join(folder, name)
        try:
            yield path
        except _native.InputError as error:
            text = str(error).replace(path, os.path.splitext(name)[0])
            raise _native.InputError(text) from None


def _tensors(path: Path) -> dict[str, NDArray]:
    """The arrays of a .safetensors file of numbers in single or double precision."""
    content = pathlib.Path(path).read_bytes()
    start = 8 + int.from_bytes(content[:8], "little")
    header = json.loads(content[8:start])
    header.pop("__metadata__", None)
    types = {"F32": "<f4", "F64": "<f8"}
    return {
        name: np.frombuffer(
            content[start + entry["data_offsets"][0] : start + entry["data_offsets"][1]],
            dtype=types[entry["dtype"]],
        ).reshape(entry["shape"])
        for name, entry in header.items()
    }


def _ply_colors(path: Path) -> Optional[NDArray[np.uint8]]:
    """The colours of the vertices of a binary .ply file that ``dsdf`` wrote."""
    content = pathlib.Path(path).read_bytes()
    header, _, body = content.partition(b"end_header\n")
    types = {"float": "<f4", "double": "<f8", "uchar": "u1"}
    count, fields = 0, []
    for line in header.decode("ascii").splitlines():
        words = line.split()
        if words[:2] == ["element", "vertex"]:
            count = int(words[2])
        elif words[:2] == ["element", "face"]:
            break
        elif words[0] == "property":
            fields.append((words[2], types[words[1]]))
    vertices = np.frombuffer(body, dtype=fields, count=count)
    names = vertices.dtype.names or ()
    if "red" not in names:
        return None
    return np.stack([vertices[name] for name in ("red", "green", "blue")], axis=1)
