"""Tests the method by the commands of nerfbaselines, on a small data set that dsdf renders.

    pip install nerfbaselines pytest WHEEL        # WHEEL: dsdf
    pytest -rs integrations/nerfbaselines

Without nerfbaselines or dsdf, all tests are skipped, with the reason.
"""

import json
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

reason = "SKIPPED: the method of nerfbaselines is not tested: a package is missing"
pytest.importorskip("nerfbaselines", reason=f"{reason}, nerfbaselines")
dsdf = pytest.importorskip("dsdf", reason=f"{reason}, dsdf")
plyfile = pytest.importorskip("plyfile", reason=f"{reason}, plyfile")

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "crates/python/tests")]

import shapes  # noqa: E402
from dsdf_nerfbaselines import cameras as convert, dataset as datasets  # noqa: E402
from dsdf_nerfbaselines.errors import Refused  # noqa: E402
from dsdf_nerfbaselines.method import Dsdf, srgb  # noqa: E402
from dsdf_nerfbaselines.running_fit import RunningFit  # noqa: E402
from nerfbaselines import camera_model_to_int, new_cameras, new_dataset  # noqa: E402
from nerfbaselines.datasets import load_dataset  # noqa: E402

SCENE = shapes.SCENE | {
    "camera": {"width": 64, "height": 64, "focal": 110, "principal": [32, 32],
               "eye": [0.6, 0.8, 3.2], "target": [0, 0, 0], "up": [0, 1, 0]},
}  # fmt: skip
ITERATIONS = 400


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A data set in a form that nerfbaselines reads; its images have 64 x 64 pixels."""
    folder = tmp_path_factory.mktemp("data")
    dsdf.synth(SCENE, folder, views=24, size="64x64", spp=16, quiet=True)
    for path in folder.glob("transforms_*.json"):
        content = json.loads(path.read_text())
        path.write_text(json.dumps(content | {"w": 64, "h": 64}))
    loader = "nerfbaselines.datasets.blender:load_blender_dataset"
    info = {"loader": loader, "evaluation_protocol": "psnr-ssim"}
    (folder / "nb-info.json").write_text(json.dumps(info))
    return folder


def nerfbaselines(*arguments, status=0):
    """Runs a command of nerfbaselines, and returns what it prints."""
    environment = os.environ | {
        "NERFBASELINES_BACKEND": "python",
        "NERFBASELINES_NO_UPDATE_CHECK": "1",
        "NERFBASELINES_REGISTER": str(HERE / "dsdf_nerfbaselines" / "spec.py"),
        "PYTHONPATH": os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")]),
    }
    command = [sys.executable, "-m", "nerfbaselines", *map(str, arguments)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    text = done.stdout + done.stderr
    assert done.returncode == status, text
    return text


def train(data, output, *more, status=0):
    options = ["--method", "dsdf", "--data", data, "--output", output, "--logger", "none"]
    options += ["--set", f"iterations={ITERATIONS}"]
    return nerfbaselines("train", *options, *more, status=status)


@pytest.fixture(scope="module")
def trained(data, tmp_path_factory):
    """The output of a training that is saved in its middle, and rendered there."""
    output = tmp_path_factory.mktemp("trained")
    text = train(data, output, "--save-iters", 200, "--eval-few-iters", 200)
    assert "verdict of dsdf:" in text, text
    return output


def metrics(path):
    return json.loads(path.read_text())["metrics"]


def test_the_views_that_are_held_out_look_like_their_photographs(trained):
    found = metrics(trained / f"results-{ITERATIONS}.json")
    assert found["psnr"] > 32 and found["ssim"] > 0.95, found


def test_a_checkpoint_renders_and_is_evaluated_alike(data, trained, tmp_path):
    checkpoint = trained / f"checkpoint-{ITERATIONS}"
    nerfbaselines(
        "render", "--checkpoint", checkpoint, "--data", data, "--output", tmp_path / "images"
    )
    nerfbaselines("evaluate", tmp_path / "images", "--output", tmp_path / "errors.json")
    expected = metrics(trained / f"results-{ITERATIONS}.json")
    assert metrics(tmp_path / "errors.json") == pytest.approx(expected, abs=1e-6)


def test_the_mesh_is_that_of_the_scene_and_has_colours(data, trained, tmp_path):
    export = ["export-mesh", "--checkpoint", trained / f"checkpoint-{ITERATIONS}"]
    nerfbaselines(*export, "--data", data, "--output", tmp_path, "--set", "resolution=64")
    vertices = plyfile.PlyData.read(tmp_path / "mesh.ply")["vertex"]
    points = np.stack([vertices[axis] for axis in "xyz"], axis=1).astype(np.float64)
    # The scene itself tells the distances.
    sphere = np.linalg.norm(points - [0.1, 0, 0], axis=1) - 0.6
    outside = np.abs(points - [-0.3, 0, 0.1]) - [0.4, 0.3, 0.3]
    box = np.linalg.norm(np.maximum(outside, 0), axis=1) + np.minimum(outside.max(1), 0)
    # The union is rounded by less than k/4.
    distance = np.minimum(sphere, box)
    assert -0.06 < np.median(distance) < 0.06 and np.abs(distance).max() < 0.2
    assert len({tuple(color) for color in zip(vertices["red"], vertices["green"])}) > 20
    # Without the data set, there are no colours; other names are other formats.
    nerfbaselines(
        *export, "--output", tmp_path, "--set", "resolution=32", "--set", "file=mesh.obj"
    )
    assert (tmp_path / "mesh.obj").read_text().count("\nf ") > 500


def test_a_training_that_is_resumed_ends_with_the_same_bits(data, trained, tmp_path):
    # The fit runs on while nerfbaselines looks at it: a checkpoint is a few iterations later.
    lines = (trained / "checkpoint-200/run/metrics.jsonl").read_text().splitlines()
    assert 200 <= len(lines) < 300
    train(data, tmp_path, "--checkpoint", trained / "checkpoint-200")
    model = f"checkpoint-{ITERATIONS}/run/model.safetensors"
    assert (tmp_path / model).read_bytes() == (trained / model).read_bytes()


def test_nerfbaselines_finds_the_method_complete(data):
    steps = ["--steps", 40, "--set", "iterations=100"]
    text = nerfbaselines("test-method", "--method", "dsdf", "--data", data, *steps, status=7)
    marks = [line for line in text.splitlines() if "\u2717" in line]
    # There is no checkpoint of dsdf in the results that nerfbaselines publishes.
    assert len(marks) == 1 and "Public checkpoint validation fails" in marks[0], text
    assert text.count("\u2713") >= 18, text


@pytest.mark.parametrize(
    ("option", "expected"),
    [
        ("widht=3", "--widht"),
        ("width=-3", "width"),
        ("time=5m", "time: found an option that nerfbaselines decides"),
        ("render_spp=0", "render_spp: found 0, expected a number of 1 or more"),
    ],
)
def test_a_wrong_option_is_refused_in_one_line(data, tmp_path, option, expected):
    text = train(data, tmp_path, "--set", option, status=1)
    assert "Traceback" not in text
    assert expected in text.strip().splitlines()[-1], text


def small(**changes):
    """A data set of two views in memory."""
    poses = np.eye(4)[None, :3].repeat(2, axis=0).astype(np.float32)
    poses[:, 2, 3] = [-3, -4]
    cameras = new_cameras(
        poses=poses,
        intrinsics=np.array([[40, 41, 12, 10]] * 2, dtype=np.float32),
        camera_models=np.zeros(2, dtype=np.int32),
        image_sizes=np.array([[24, 20]] * 2, dtype=np.int32),
    )
    noise = np.random.default_rng(0)
    images = [noise.integers(256, size=(20, 24, 3), dtype=np.uint8) for _ in range(2)]
    made = new_dataset(
        cameras=cameras,
        images=images,
        image_paths=["/a/0.png", "/a/1.png"],
        masks=[np.arange(480).reshape(20, 24) % 7 > 0] * 2,
        points3D_xyz=np.arange(12.0).reshape(4, 3),
        points3D_rgb=np.arange(12, dtype=np.uint8).reshape(4, 3),
        metadata={"color_space": "srgb"},
    )
    return made | changes


def test_a_data_set_is_written_without_loss(tmp_path):
    made = small()
    datasets.write(made, tmp_path / "data")
    seen, held_out = dsdf.photographs(tmp_path / "data")
    assert len(seen) == 2 and not held_out
    for photograph, image, camera in zip(seen, made["images"], made["cameras"]):
        assert np.abs(srgb(photograph.image) * 255 - image).max() < 1e-3
        assert np.allclose(photograph.camera.pose, convert.pose(camera), atol=1e-7)
        assert photograph.camera.focal == (40, 41) and photograph.camera.principal == (12, 10)
    points = plyfile.PlyData.read(tmp_path / "data" / "points.ply")["vertex"]
    assert points["y"].tolist() == [1, 4, 7, 10] and points["green"].tolist() == [1, 4, 7, 10]
    report = dsdf.inspect(tmp_path / "data", quiet=True)
    assert report["train_views"] == 2 and report["masks"] == 2


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"metadata": {"color_space": "linear"}}, "color_space: found linear, expected srgb"),
        ({"images": [np.zeros((20, 24, 3))] * 2}, "/a/0.png: image: found float64"),
        ({"images": [np.zeros((20, 24), np.uint8)] * 2}, "/a/0.png: image: found uint8, (20, 24)"),
        ({"images": [np.zeros((8, 9, 3), np.uint8)] * 2}, "/a/0.png: image: found 9 x 8 pixels"),
        ({"masks": [np.zeros((20, 24, 1))] * 2}, "/a/0.png: mask: found (20, 24, 1)"),
    ],
)
def test_a_wrong_data_set_is_refused_in_one_line(tmp_path, changes, expected):
    with pytest.raises(Refused) as refused:
        Dsdf(train_dataset=small(**changes))
    text = str(refused.value)
    assert expected in text and "\n" not in text


def test_a_wrong_checkpoint_is_refused_in_one_line(tmp_path):
    for arguments in ({"checkpoint": str(tmp_path)}, {}):
        with pytest.raises(Refused) as refused:
            Dsdf(**arguments)
        assert "\n" not in str(refused.value)
    (tmp_path / "dsdf.json").write_text('{"step": 1')
    with pytest.raises(Refused):
        Dsdf(checkpoint=str(tmp_path))


def test_a_fit_that_begins_again_in_a_larger_sphere_is_followed(tmp_path):
    """Its metrics begin again, too."""
    fit = RunningFit(tmp_path / "data", tmp_path, {"iterations": 9})
    lines = [json.dumps({"iteration": i + 1, "loss": 0.5 - 0.1 * i}) + "\n" for i in range(3)]
    (tmp_path / "metrics.jsonl").write_text("".join(lines) + '{"iter')
    fit._follow()
    assert [line["iteration"] for line in fit._metrics] == [1, 2, 3]
    (tmp_path / "metrics.jsonl").write_text(lines[0])
    fit._follow()
    assert [line["iteration"] for line in fit._metrics] == [1]


@pytest.mark.parametrize(
    ("model", "distortion"),
    [
        ("opencv", [-0.2, 0.05, 0.01, -0.01]),
        ("opencv_fisheye", [0.02, 0.01, 0, 0, 0, 0]),
        ("full_opencv", [0.1, 0.02, 0.001, 0.002, 0.01, 0.1, 0.01, 0.01]),
    ],
)
def test_distortion_is_read_and_rendered(data, trained, tmp_path, model, distortion):
    """dsdf's lens and the images of the method follow nerfbaselines' own functions."""
    views = load_dataset(str(data), "train", features=frozenset(("color",)))
    straight = views["cameras"]
    number = camera_model_to_int(model)
    bent = straight.replace(
        camera_models=np.full(len(straight), number, dtype=np.int32),
        distortion_parameters=np.tile(np.float32(distortion), (len(straight), 1)),
    )
    method = Dsdf(checkpoint=str(trained / f"checkpoint-{ITERATIONS}"))
    expected = method.render(straight[0])["color"]
    known = convert.warped(np.ones_like(expected), straight[0], bent[0])[..., 0] > 0.99
    image = method.render(bent[0])["color"]
    assert image.shape == expected.shape and image.min() > 0.2
    difference = image - convert.warped(expected, straight[0], bent[0])
    assert known.mean() > 0.85 and np.abs(difference[known]).mean() < 0.01

    # dsdf takes the distortion out of a photograph of the bent camera.
    films = [image[..., :3] for image in views["images"][:2]]
    photographs = [convert.warped(film, straight[i], bent[i]) for i, film in enumerate(films)]
    names = views["image_paths"][:2]
    content = views | {"cameras": bent[:2], "images": photographs, "image_paths": names}
    datasets.write(content, tmp_path / "data")
    seen_views, _ = dsdf.photographs(tmp_path / "data")
    for i, seen in enumerate(seen_views):
        own = straight[i].replace(
            intrinsics=np.array([*seen.camera.focal, *seen.camera.principal]),
            image_sizes=np.array([seen.camera.width, seen.camera.height]),
        )
        expected = convert.warped(films[i] / 255.0, straight[i], own)
        inner = (slice(12, -12), slice(12, -12))
        assert np.abs(srgb(seen.image) - expected)[inner].mean() < 0.02


def test_distortion_of_zero_changes_nothing(data, trained):
    camera = load_dataset(str(data), "test", features=frozenset(("color",)))["cameras"][0]
    zero = camera.replace(
        camera_models=np.full_like(camera.camera_models, camera_model_to_int("opencv")),
        distortion_parameters=np.zeros(6, dtype=np.float32),
    )
    method = Dsdf(checkpoint=str(trained / f"checkpoint-{ITERATIONS}"))
    images = [method.render(each)["color"] for each in (camera, zero)]
    assert np.array_equal(*images)
    normals = method.render(camera, options={"outputs": ("normal",)})["normal"]
    assert normals.shape == (64, 64, 3) and normals.max() <= 1


def test_images_with_alpha_are_rendered_in_front_of_the_colour_of_the_data_set(data):
    views = load_dataset(str(data), "train", features=frozenset(("color",)))
    masks = sorted((data / "masks" / "train").iterdir())
    from PIL import Image

    images = [
        np.dstack([image[..., :3], np.asarray(Image.open(mask).convert("L"))])
        for image, mask in zip(views["images"], masks)
    ]
    white = {"color_space": "srgb", "background_color": np.array([255, 255, 255], np.uint8)}
    method = Dsdf(train_dataset=views | {"images": images, "metadata": white})
    image = method.render(views["cameras"][0])["color"]
    assert image[0, 0].tolist() == pytest.approx([1, 1, 1], abs=1e-6) and image.min() < 0.9
    assert method.train_iteration(2)["loss"] > 0
    method.close()
