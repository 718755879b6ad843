"""The method of nerfbaselines: a fit of dsdf, its images and its mesh."""

import json
import logging
import pathlib
import shutil
import tempfile
import tomllib
import weakref
from typing import Any, Optional

import dsdf
import numpy as np
from nerfbaselines import Cameras, Dataset, Method, MethodInfo, ModelInfo

from . import cameras as convert, dataset as datasets
from .errors import Refused, in_one_line
from .running_fit import RunningFit

#: Options of the method that are none of ``dsdf fit``, and the default number of iterations.
OWN = {"iterations": 6000, "render_spp": 4}
#: Options of ``dsdf fit`` that nerfbaselines decides, or that its presets are for.
RESERVED = (
    "check", "held_out", "json", "log", "output", "preset", "quiet", "report", "resume", "serve",
    "stop_after", "time",
)  # fmt: skip

logger = logging.getLogger(__name__)


class Dsdf(Method):
    """A fit of dsdf. ``config_overrides`` are options of ``dsdf fit``, and those of ``OWN``."""

    def __init__(
        self,
        *,
        checkpoint: Optional[str] = None,
        train_dataset: Optional[Dataset] = None,
        config_overrides: Optional[dict[str, Any]] = None,
    ):
        self._checkpoint = None if checkpoint is None else pathlib.Path(checkpoint)
        self._step = 0
        self._background: Optional[list[float]] = None
        saved: dict[str, Any] = {}
        if self._checkpoint is not None:
            state = _read_state(self._checkpoint)
            saved, self._step, self._background = (
                state["options"], state["step"], state["background"],
            )  # fmt: skip
        self._options = OWN | saved | (config_overrides or {})
        self._loaded_step = None if checkpoint is None else self._step
        with in_one_line():
            _check(self._options)

        self._fit: Optional[RunningFit] = None
        if train_dataset is None:
            if self._checkpoint is None:
                raise Refused("method: found neither a checkpoint nor a data set, expected one")
            self._run = self._checkpoint / "run"
            return
        work = pathlib.Path(tempfile.mkdtemp(prefix="dsdf-nerfbaselines-"))
        self._run = work / "run"
        # The options of ``dsdf fit``. The views that are held out stay with nerfbaselines.
        options = _fit_options(self._options) | {"held_out": "none"}
        self._fit = RunningFit(work / "data", self._run, options)
        # It is called at the end of the process, too.
        self._close = weakref.finalize(self, _close, self._fit, work)
        datasets.write(train_dataset, self._fit.dataset)
        self._background = _background(train_dataset)
        if self._checkpoint is not None:
            shutil.copytree(self._checkpoint / "run", self._run)

    @classmethod
    def get_method_info(cls) -> MethodInfo:
        return MethodInfo(
            method_id="",  # nerfbaselines fills it in
            # The points place the bounding sphere. A data set without points has none.
            required_features=frozenset(("color", "points3D_xyz", "points3D_rgb")),
            supported_camera_models=frozenset(convert.LENSES),
            supported_outputs=("color", "normal"),
            can_resume_training=True,
            viewer_default_resolution=128,
        )

    def get_info(self) -> ModelInfo:
        return ModelInfo(
            **self.get_method_info(),
            num_iterations=int(self._options["iterations"]),
            loaded_step=self._loaded_step,
            loaded_checkpoint=None if self._checkpoint is None else str(self._checkpoint),
            hparams=dict(self._options),
        )

    def train_iteration(self, step: int) -> dict[str, float]:
        """Waits until the fit has done iteration ``step``, counted from 0."""
        if self._fit is None:
            raise Refused("train: found no data set, expected that of the checkpoint")
        with in_one_line():
            metrics = self._fit.wait_for(step + 1)
        self._step = step + 1
        if self._fit.verdict is not None:
            logger.info("verdict of dsdf: %s", self._fit.verdict)
            self._fit.verdict = None
        return {"loss": metrics["loss"], "psnr": metrics["train_psnr"]}

    def save(self, path: str) -> None:
        """Writes the run folder, and the step, into a folder."""
        self._pause()
        folder = pathlib.Path(path)
        folder.mkdir(parents=True, exist_ok=True)
        target = folder / "run"
        if not (target.exists() and target.samefile(self._run)):
            ignored = shutil.ignore_patterns("lock")
            shutil.copytree(self._run, target, ignore=ignored, dirs_exist_ok=True)
        state = {"step": self._step, "options": self._options, "background": self._background}
        (folder / "dsdf.json").write_text(json.dumps(state, indent=1) + "\n", encoding="utf-8")

    def render(self, camera: Cameras, *, options: Optional[Any] = None) -> dict[str, np.ndarray]:
        """An image in sRGB, and the normals if ``options`` asks for them."""
        self._pause()
        camera = camera.item()
        outputs = (options or {}).get("outputs") or ("color",)
        result = {}
        if "color" in outputs:
            appearance = {"type": "neural", "weights": self._run / "radiance.safetensors"}
            result["color"] = srgb(self._image(camera, appearance, self._scene_background()))
        if "normal" in outputs:
            # n/2 + 1/2, and the middle where there is no surface.
            result["normal"] = self._image(camera, {"type": "normal"}, [0.5, 0.5, 0.5])
        return result

    def export_mesh(
        self,
        path: str,
        train_dataset: Optional[Dataset] = None,
        options: Optional[dict[str, Any]] = None,
        **_: Any,
    ) -> None:
        """Writes ``mesh.ply`` into a folder. ``options`` are those of ``dsdf mesh``; ``file`` is
        another name, whose ending is the format. Vertices have colours with a data set only."""
        self._pause()
        given = dict(options or {})
        # These two are of nerfbaselines.
        given.pop("embedding", None)
        given.pop("dataset_metadata", None)
        name = str(given.pop("file", "mesh.ply"))
        folder = pathlib.Path(path)
        if "output" in given or pathlib.Path(name).name != name:
            raise Refused(f"file: found {given.get('output', name)}, expected the name of a file")
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="dsdf-nerfbaselines-") as work, in_one_line():
            data = None if self._fit is None else self._fit.dataset
            if data is None and train_dataset is not None:
                data = pathlib.Path(work) / "data"
                datasets.write(train_dataset, data)
            if data is None:
                given.setdefault("color", "none")
            given |= {"dataset": data, "output": folder / name}
            dsdf.command("mesh", self._run, **self._threads(), **given)
        logger.info("mesh written to %s", folder / name)

    def close(self) -> None:
        """Stops the fit and removes its files. Saved checkpoints stay."""
        if self._fit is not None:
            self._close()

    def _pause(self) -> None:
        """Stops the fit after a checkpoint, so that the model files are those of now."""
        if self._fit is not None:
            with in_one_line():
                self._fit.stop()
                self._fit.first_model()

    def _image(self, camera: Any, appearance: dict, background: Any) -> np.ndarray:
        seen = convert.covering(camera) if convert.has_distortion(camera) else camera
        scene = {
            "camera": convert.pinhole(seen),
            "sdf": {"type": "neural", "weights": self._run / "model.safetensors"},
            "appearance": appearance,
            "background": background,
        }
        with in_one_line():
            image = dsdf.render(scene, spp=self._options["render_spp"], **self._threads())
        return image if seen is camera else convert.warped(image, seen, camera)

    def _scene_background(self) -> Any:
        """The background of the run, in the words of a scene file."""
        run = tomllib.loads((self._run / "fit.toml").read_text(encoding="utf-8"))
        weights = self._run / "background.safetensors"
        kind, (*center, radius) = run["background_kind"], run["bounds"]
        if kind == "direction":
            return {"type": "direction", "weights": weights}
        if kind == "volume":
            return {"type": "volume", "weights": weights, "center": center, "radius": radius}
        if kind in ("picture", "per-view"):
            logger.warning("the background is a %s one: renders have one colour there", kind)
        # With masks of the object, nothing is known of the background but what nerfbaselines tells.
        return self._background if run["masks"] == "coverage" else run["background"]

    def _threads(self) -> dict[str, Any]:
        threads = self._options.get("threads")
        return {} if threads is None else {"threads": threads}


def _fit_options(options: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in options.items() if key != "render_spp"}


def _check(options: dict[str, Any]) -> None:
    """Refuses options before a file is written."""
    for key in options:
        if key.replace("-", "_") in RESERVED:
            found = "an option that nerfbaselines decides"
            raise Refused(f"{key}: found {found}, expected another one")
    for key in OWN:
        text = str(options[key])
        if not (text.isascii() and text.isdigit() and int(text) > 0):
            raise Refused(f"{key}: found {text}, expected a number of 1 or more")
    with tempfile.TemporaryDirectory(prefix="dsdf-nerfbaselines-") as folder:
        dsdf.fit(None, pathlib.Path(folder) / "run", check=True, **_fit_options(options))


def _read_state(checkpoint: pathlib.Path) -> dict[str, Any]:
    path = checkpoint / "dsdf.json"
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise Refused(f"{path}: found {error}, expected the state of a checkpoint") from None


def _background(dataset: Dataset) -> list[float]:
    """The colour behind images with an alpha channel, linear."""
    color = dataset["metadata"].get("background_color")
    color = np.zeros(3) if color is None else np.asarray(color, dtype=np.float64) / 255
    return np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4).tolist()


def srgb(linear: np.ndarray) -> np.ndarray:
    """Display values of linear RGB, 0 to 1."""
    linear = np.clip(linear, 0, 1)
    curve = 1.055 * np.power(linear, 1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, curve).astype(np.float32)


def _close(fit: RunningFit, work: pathlib.Path) -> None:
    try:
        fit.stop()
    except Exception as error:  # nobody waits for the fit any more
        logger.error("the fit failed: %s", error)
    shutil.rmtree(work, ignore_errors=True)
