"""Files of meshes, read and judged by the validators of their formats."""

import json
import os
import pathlib
import shutil
import subprocess

import numpy as np
import pytest

import dsdf


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    from conftest import SCENE

    folder = tmp_path_factory.mktemp("files")
    dsdf.synth(SCENE, folder / "data", views=8, size="32x32", spp=8)
    options = {"grid": "none", "batch": 256, "stereo": "none", "seed": 3, "quiet": True}
    return dsdf.fit(folder / "data", folder / "run", iterations=30, width=16, **options)


WAYS = {"texture": {"texture": 256}, "colours": {"color": "auto"}, "neither": {"color": "none"}}


def written(run, folder, name, way):
    options = {"decimate": 2000, "resolution": 48, "scale": 0.5, "quiet": True, **WAYS[way]}
    file = folder / name
    report = dsdf.command("mesh", run, output=file, **options)
    return file, report


@pytest.mark.parametrize("way", ["texture", "neither"])
def test_usd_reads_a_usdz_without_a_complaint(run, tmp_path, way):
    Usd = pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
    from pxr import UsdGeom, UsdShade, UsdValidation

    file, report = written(run, tmp_path, "shape.usdz", way)
    stage = Usd.Stage.Open(str(file))
    registry = UsdValidation.ValidationRegistry()
    names = [metadata.name for metadata in registry.GetAllValidatorMetadata()]
    assert len(names) > 20
    validators = [registry.GetOrLoadValidatorByName(name) for name in names]
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [f"{error.GetName()}: {error.GetMessage()}" for error in errors] == []

    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    prim = stage.GetPrimAtPath("/object/surface")
    mesh = UsdGeom.Mesh(prim)
    assert len(mesh.GetFaceVertexCountsAttr().Get()) == report["faces"]
    place = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prim))
    points = np.array(mesh.GetPointsAttr().Get()) @ place[:3, :3] + place[3, :3]
    # The same vertices as in a .glb, which stands upright too.
    vertices, _ = dsdf._native.read_mesh(written(run, tmp_path, "shape.ply", "neither")[0])
    up = np.array(report["up"])
    assert np.isclose(points[:, 1].min(), (vertices @ up).min() , atol=1e-5)
    assert np.isclose(points[:, 1].max(), (vertices @ up).max(), atol=1e-5)
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    assert bool(material) == (way == "texture")
    if way == "texture":
        image = stage.GetPrimAtPath("/object/material/image").GetAttribute("inputs:file").Get()
        assert image.resolvedPath.endswith("shape.usdz[texture.png]")


VALIDATE = """
const validator = require("gltf-validator");
const bytes = new Uint8Array(require("fs").readFileSync(process.argv[1]));
validator.validateBytes(bytes).then((report) => console.log(JSON.stringify(report)));
"""


@pytest.mark.parametrize("way", list(WAYS))
def test_the_validator_of_khronos_has_no_complaint_about_a_glb(run, tmp_path, way):
    modules = pathlib.Path(os.environ.get("DSDF_NODE_MODULES", ""))
    if shutil.which("node") is None or not (modules / "gltf-validator").is_dir():
        pytest.skip("no gltf-validator: npm is not installed, or DSDF_NODE_MODULES names no folder")
    file, _ = written(run, tmp_path, "shape.glb", way)
    call = ["node", "-e", VALIDATE, str(file)]
    done = subprocess.run(call, capture_output=True, text=True, timeout=60,
                          env={**os.environ, "NODE_PATH": str(modules)})
    issues = json.loads(done.stdout)["issues"]
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]


def test_a_usdz_is_not_read_back(run, tmp_path):
    with pytest.raises(dsdf.InputError, match="dsdf.command"):
        dsdf.mesh(run, tmp_path / "shape.usdz")
    assert not (tmp_path / "shape.usdz").exists()


def test_tensorboard_reads_the_events_of_a_fit_that_was_stopped(run, tmp_path):
    pytest.importorskip("tensorboard", reason="TensorBoard is not installed")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    options = {"grid": "none", "batch": 64, "stereo": "none", "seed": 3, "quiet": True, "width": 16}
    data, out = pathlib.Path(os.fspath(run)).parent / "data", tmp_path / "run"
    dsdf.fit(data, out, iterations=12, stop_after=8, log="tensorboard", **options)
    again = dsdf.fit(None, out, resume=True, log="tensorboard", quiet=True)
    files = sorted((out / "tensorboard").iterdir())
    assert len(files) == 2
    # A killed process leaves a half record.
    with files[0].open("ab") as file:
        file.write(b"\x30\0\0")
    events = EventAccumulator(str(out / "tensorboard"))
    events.Reload()
    tags = events.Tags()["scalars"]
    assert {"loss", "eikonal", "psnr/training pixels", "rays per second"} <= set(tags)
    lines = again.metrics()
    assert len(lines) == 12
    for tag, key in [("loss", "loss"), ("psnr/training pixels", "train_psnr")]:
        found = [(event.step, event.value) for event in events.Scalars(tag)]
        assert found == [(line["iteration"], float(np.float32(line[key]))) for line in lines]
