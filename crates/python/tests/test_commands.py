"""The commands: bits of the program, errors, progress, interruption."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import dsdf


def cli(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    from conftest import SCENE

    folder = tmp_path_factory.mktemp("data") / "set"
    result = dsdf.synth(SCENE, folder, views=8, size="32x32", spp=8)
    assert result["views"] == 8
    return folder


FORK = """
import os, sys
import dsdf

count = len(dsdf.photographs(sys.argv[1])[0])
child = os.fork()
if child == 0:
    again = len(dsdf.photographs(sys.argv[1])[0]) == len(dsdf.photographs(sys.argv[1])[0]) == count
    report = dsdf.inspect(sys.argv[1])
    os._exit(0 if again and report else 1)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_forked_child_reads_photographs_as_its_parent_did(data):
    done = subprocess.run([sys.executable, "-c", FORK, str(data)], timeout=120)
    assert done.returncode == 0


FIT = {"iterations": 12, "width": 16, "grid": "none", "batch": 256, "stereo": "none",
       "threads": 2, "seed": 3, "quiet": True}


@pytest.fixture(scope="module")
def run(data, tmp_path_factory):
    return dsdf.fit(data, tmp_path_factory.mktemp("runs") / "run", **FIT)


def test_images_and_derivatives_have_the_bits_of_the_program(program, scene, tmp_path):
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(scene))
    assert cli(program, "render", file, "-o", tmp_path / "i.npy", "--spp", 4, "--seed", 5)[0] == 0
    image = dsdf.render(scene, tmp_path / "p.png", spp=4, seed=5)
    assert image.shape == (20, 24, 3) and image.dtype == np.float32
    assert np.array_equal(image, np.load(tmp_path / "i.npy"))
    assert cli(program, "render", file, "-o", tmp_path / "q.png", "--spp", 4, "--seed", 5)[0] == 0
    assert (tmp_path / "p.png").read_bytes() == (tmp_path / "q.png").read_bytes()

    wrt = ["/sdf/children/0/radius", "/background/1"]
    flags = [flag for pointer in wrt for flag in ("--wrt", pointer)]
    assert cli(program, "gradient", file, *flags, "-o", tmp_path / "g.npy", "--spp", 8)[0] == 0
    derivatives = dsdf.Scene(scene).gradient(wrt=wrt, spp=8)
    assert list(derivatives) == wrt
    first = np.load(tmp_path / "g.sdf_children_0_radius.npy")
    assert np.array_equal(derivatives[wrt[0]], first) and first.any()
    assert np.array_equal(dsdf.gradient(file, wrt[1], spp=8), derivatives[wrt[1]])


def test_fits_have_the_bits_of_the_program(program, data, run, tmp_path):
    options = ["--iterations", 12, "--width", 16, "--grid", "none", "--batch", 256]
    options += ["--stereo", "none", "--threads", 1, "--seed", 3, "--quiet"]
    assert cli(program, "fit", data, "-o", tmp_path / "run", *options)[0] == 0
    assert run.model.read_bytes() == (tmp_path / "run/model.safetensors").read_bytes()
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 3))
    np.save(tmp_path / "x.npy", points)
    files = (run.model, tmp_path / "x.npy", "-o", tmp_path / "f.npy", "--gradient")
    assert cli(program, "query", *files)[0] == 0
    assert np.array_equal(run.query(points, gradient=True), np.load(tmp_path / "f.npy"))
    assert run.query(points).shape == (20,)


def test_the_results_of_a_run(run, data, tmp_path):
    assert run.report["iterations"] == 12 and "verdict" in run.report
    assert len(run.metrics()) == 12
    mesh = run.mesh(tmp_path / "m.ply", resolution=24, quiet=True)
    assert mesh.vertices.shape == mesh.colors.shape and mesh.colors.dtype == np.uint8
    assert mesh.faces.max() == len(mesh.vertices) - 1 and (tmp_path / "m.ply").is_file()
    errors = run.evaluate(mesh=tmp_path / "m.ply", resolution=24, quiet=True)
    assert errors["psnr"] > 5 and errors["views"] == 1
    # A mesh compared with itself, by points at random places.
    assert errors["f_score"] == 1 and 0 < errors["chamfer_relative"] < 0.01
    plain = dsdf.mesh(run, resolution=24, color="none", quiet=True)
    assert plain.colors is None and np.array_equal(plain.faces, mesh.faces)
    report = dsdf.inspect(data, quiet=True)
    assert report["train_views"] == 8
    train, held_out = dsdf.photographs(data, downscale=2)
    assert len(train) == 8 and len(held_out) == 1
    assert train[0].image.shape == (16, 16, 3) and train[0].camera.width == 16


def test_the_gradient_of_a_loss_by_the_weights_of_a_network(run, data):
    camera = dsdf.photographs(data)[0][0].camera
    keys = {"width": camera.width, "height": camera.height, "focal": camera.focal}
    scene = {
        "camera": {**keys, "principal": camera.principal, "pose": camera.pose},
        "sdf": {"type": "neural", "weights": "model.safetensors"},
        "appearance": {"type": "constant", "radiance": [1, 1, 1]},
        "background": [0, 0, 0],
    }
    target = np.full((camera.height, camera.width, 3), 0.5)
    tensors = dsdf.Scene(scene, run.folder).gradient(target=target, spp=4)
    assert tensors["layers.0.weight"].shape[0] == 16
    assert all(np.isfinite(tensor).all() for tensor in tensors.values())
    assert any(tensor.any() for tensor in tensors.values())


def test_errors_are_exceptions_with_the_texts_of_the_program(program, scene, tmp_path):
    wrong = {**scene, "background": [1, 2]}
    file = tmp_path / "wrong.json"
    file.write_text(json.dumps(wrong))
    output = tmp_path / "i.npy"
    cases = [
        (("render", file), {"output": output}, 2),
        (("render", tmp_path / "none.json"), {"output": output}, 2),
        (("render", file), {"output": output, "spp": "many"}, 2),
        (("render", file), {"output": output, "unknown": 1}, 2),
        (("render", file), {"output": tmp_path / "i.txt"}, 2),
        (("fit", tmp_path), {"output": tmp_path / "run", "gamma": -1.0}, 2),
    ]
    for paths, options, status in cases:
        flags = [f"--{name}={value}" for name, value in options.items()]
        code, _, error = cli(program, paths[0], *flags, "--", *paths[1:])
        with pytest.raises(dsdf.InputError) as raised:
            dsdf.command(*paths, **options)
        assert code == status and error == f"error: {raised.value}\n"
    assert not (tmp_path / "run").exists() and not output.exists()


def test_progress_is_called_in_the_thread_of_the_caller(scene):
    seen, threads = [], set()

    def progress(fraction, text):
        seen.append((fraction, text))
        threads.add(threading.get_ident())

    big = {**scene, "camera": {**scene["camera"], "width": 200, "height": 200}}
    dsdf.render(big, spp=64, progress=progress)
    assert threads == {threading.get_ident()}
    fractions = [fraction for fraction, _ in seen]
    assert fractions and all(0 <= f <= 1 for f in fractions) and seen[0][1] == "render"


def test_an_exception_of_progress_stops_a_command(scene, tmp_path):
    class Enough(Exception):
        pass

    def progress(fraction, text):
        raise Enough

    big = {**scene, "camera": {**scene["camera"], "width": 2000, "height": 2000}}
    start = time.monotonic()
    with pytest.raises(Enough):
        dsdf.command("render", *scene_file(big, tmp_path), progress=progress,
                     output=tmp_path / "i.npy", spp=4096)
    assert time.monotonic() - start < 20
    assert list(tmp_path.glob("*i.npy*")) == []


def scene_file(scene, folder):
    path = folder / "scene.json"
    path.write_text(json.dumps(scene))
    return [path]


def test_other_threads_run_meanwhile(scene):
    ticks, over = [0], threading.Event()

    def tick():
        while not over.is_set():
            ticks[0] += 1
            time.sleep(0.001)

    other = threading.Thread(target=tick)
    other.start()
    big = {**scene, "camera": {**scene["camera"], "width": 200, "height": 200}}
    dsdf.render(big, spp=64, threads=1)
    over.set()
    other.join()
    assert ticks[0] > 20


def test_ctrl_c_stops_a_fit_with_a_checkpoint_and_resume_continues(data, tmp_path):
    folder = tmp_path / "run"

    def progress(fraction, text):
        if text.startswith("fit") and fraction > 0:
            os.kill(os.getpid(), signal.SIGINT)

    options = {**FIT, "iterations": 100_000}
    # A process that was started in the background ignores the signal.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with pytest.raises(KeyboardInterrupt):
        dsdf.fit(data, folder, progress=progress, **options)
    signal.signal(signal.SIGINT, before)
    assert (folder / "checkpoint/state.safetensors").is_file()
    done = len(dsdf.Run(folder).metrics())
    assert 0 < done < 100_000
    run = dsdf.fit(None, folder, resume=True, iterations=done + 20, quiet=True)
    assert run.report["iterations"] == done + 20


def test_notes_go_to_standard_error_unless_quiet(data, tmp_path, capsys):
    dsdf.fit(data, tmp_path / "a", **{**FIT, "iterations": 2, "quiet": False})
    assert "views: 8 to fit" in capsys.readouterr().err
    dsdf.fit(data, tmp_path / "b", **{**FIT, "iterations": 2})
    assert capsys.readouterr() == ("", "")


def test_a_notebook_shows_the_page_of_a_run(run):
    import html.parser

    page = dsdf.show(run, quiet=True)
    assert page.html.startswith("<!doctype html>") and "<canvas" in page.html
    found = []

    class Parser(html.parser.HTMLParser):
        def handle_starttag(self, tag, attributes):
            found.append((tag, dict(attributes)))

    Parser().feed(page._repr_html_())
    [(tag, attributes)] = found
    assert tag == "iframe" and attributes["srcdoc"] == page.html
    # The page runs its own scripts, and reaches nothing of the notebook.
    assert attributes["sandbox"] == "allow-scripts"


def test_progress_is_a_line_on_request(scene, capsys):
    dsdf.render({**scene, "camera": {**scene["camera"], "width": 64, "height": 64}}, spp=64, progress=True)
    text = capsys.readouterr().err
    assert "100.0 %" in text and text.endswith("\r") and "\n" not in text
    with pytest.raises(TypeError, match="progress: found 3"):
        dsdf.render(scene, progress=3)
