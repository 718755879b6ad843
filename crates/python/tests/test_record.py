"""Records of fields in NumPy: values, derivatives, errors."""

import copy
import pickle
import threading

import numpy as np
import pytest
from shapes import BOUNDS, Ball, Lit, camera

import dsdf


class Watched(Ball):
    """A ball that knows the threads that call it."""

    def __init__(self):
        super().__init__()
        self.threads = set()

    def _seen(self):
        self.threads.add(threading.get_ident())
        return super()

    def value(self, x):
        return self._seen().value(x)

    def value_gradient(self, x):
        return self._seen().value_gradient(x)

    def hessian_vector(self, x, p):
        return self._seen().hessian_vector(x, p)


def test_a_motion_of_the_camera_is_that_of_the_ball_backwards():
    """Each sample has these identities: about the centre of a ball, a rotation of the camera changes
    nothing, and a shift of the camera is one of the ball."""
    ball, view = Ball(center=(0, 0, 0)), camera()
    pixels = dsdf.pixels([view])
    delta = np.sin(pixels @ [[1, 2, 0], [3, -1, 1], [1, 2, 2]] / 7)
    record = dsdf.record(ball, (0.9, 0.6, 0.3), [view], pixels, bounds=BOUNDS, seed=4, spp=32)
    eye, turn, focal, principal = record.cameras(delta)
    assert eye.shape == turn.shape == (1, 3) and focal.shape == principal.shape == (1, 2)
    of_ball = ball.parameter_gradient(*record.backward(delta))
    assert np.linalg.norm(eye) > 1 and np.allclose(eye[0], -of_ball[:3], rtol=1e-5, atol=1e-5)
    assert np.linalg.norm(turn) > 1
    assert np.allclose(turn[0], -np.cross(view.pose[:3, 3], eye[0]), rtol=1e-5, atol=1e-5)


def test_the_calling_thread_alone_calls_the_field():
    field, view = Watched(), camera()
    pixels = dsdf.pixels([view])
    for estimator in ("refined", "interior", "paper"):
        scene = (field, Lit(), [view], pixels)
        record = dsdf.record(*scene, bounds=BOUNDS, spp=16, estimator=estimator)
        record.backward(np.ones((len(pixels), 3)))
    assert field.threads == {threading.get_ident()}


class Foreign:
    """An array of another framework, which shares its memory by DLPack and in no other way."""

    def __init__(self, array, device=None):
        self.array, self.device = array, device

    def __dlpack__(self, **options):
        if self.device:
            raise BufferError(f"an array on {self.device}")
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()


def test_arrays_of_any_framework_are_read_by_dlpack():
    class Other(Ball):
        device = None

        def value(self, x):
            return Foreign(super().value(x), self.device)

        def value_gradient(self, x):
            return [Foreign(array) for array in super().value_gradient(x)]

    views, pixels = [camera()], dsdf.pixels([camera()])
    delta = np.ones((len(pixels), 3))
    records = [
        dsdf.record(field, (0.9, 0.6, 0.3), views, pixels, bounds=BOUNDS, seed=4, spp=2)
        for field in (Ball(), Other())
    ]
    own, other = [record.backward(delta) for record in records]
    assert all(np.array_equal(a, b) for a, b in zip(own, other))
    by_dlpack = records[1].backward(Foreign(delta))
    assert all(np.array_equal(a, b) for a, b in zip(own, by_dlpack))
    Other.device = "a GPU"
    wrong("an array on a GPU, expected an array of numbers in the memory of the CPU",
          Other(), (1, 1, 1), views, pixels)


def test_cameras_are_copied_and_pickled_to_the_last_bit():
    view = camera()
    u = np.array([[0.5, 1.5], [3.25, 7.0]])
    for other in (copy.copy(view), copy.deepcopy(view), pickle.loads(pickle.dumps(view))):
        assert (other.width, other.height, other.focal) == (view.width, view.height, view.focal)
        assert np.array_equal(other.pose, view.pose)
        assert np.array_equal(other.directions(u), view.directions(u))
    photograph = dsdf.Photograph("a", view, np.zeros((2, 3, 3), np.float32), None)
    assert pickle.loads(pickle.dumps(photograph)).camera.focal == view.focal


def delta_of(pixels, size):
    """Adjoints that vary slowly over the film."""
    u, v = pixels[:, 1] / size, pixels[:, 2] / size
    return np.stack([np.sin(3 * u + v), np.cos(2 * v - u), u * v], axis=1)


def loss(field, shader, view, delta, **options):
    image = dsdf.picture(field, shader, view, bounds=BOUNDS, spp=400, seed=7, **options)
    return float((delta * image.reshape(-1, 3)).sum())


@pytest.mark.parametrize("shader", [(0.9, 0.6, 0.3), Lit()], ids=["silhouettes", "shader"])
def test_backward_matches_finite_differences(shader):
    view, ball = camera(), Ball()
    pixels = dsdf.pixels([view])
    delta = delta_of(pixels, view.width)
    options = {"background": [0.1, 0.2, 0.3]}
    record = dsdf.record(ball, shader, [view], pixels, bounds=BOUNDS, spp=256, **options)
    found = ball.parameter_gradient(*record.backward(delta))
    h = 0.01
    for i in range(4):
        moved = []
        for sign in (1, -1):
            step = np.zeros(4)
            step[i] = sign * h
            other = Ball(ball.center + step[:3], ball.radius + step[3])
            moved.append(loss(other, shader, view, delta, **options))
        expected = (moved[0] - moved[1]) / (2 * h)
        assert abs(found[i] - expected) < 0.01 * np.abs(found).max(), (i, found, expected)


def test_shading_and_background_are_the_derivatives_of_the_radiance():
    view, ball = camera(), Ball()
    pixels = dsdf.pixels([view])
    delta = delta_of(pixels, view.width)
    record = dsdf.record(
        ball, Lit(), [view], pixels, bounds=BOUNDS, spp=64, estimator="interior",
        background=[0.1, 0.2, 0.3],
    )
    x, n, d, adjoint = record.shading(delta)
    # The pixel values are linear in the radiance of the hits and of the background.
    whole = (adjoint * Lit().radiance(x, n, d)).sum() + record.background(delta) @ [0.1, 0.2, 0.3]
    assert whole == pytest.approx((delta * record.radiance).sum(), rel=1e-12)
    assert np.allclose(np.linalg.norm(n, axis=1), 1) and np.allclose(np.linalg.norm(d, axis=1), 1)


def test_the_area_of_a_disc():
    view, ball = camera(), Ball((0, 0, 0), 0.7)
    record = dsdf.record(ball, (1, 1, 1), [view], dsdf.pixels([view]), bounds=BOUNDS, spp=64)
    assert record.radiance[:, 0] == pytest.approx(record.coverage, abs=0.1)
    x, alpha, c = record.backward(np.ones((len(record.radiance), 3)) / 3)
    assert np.median(np.abs(ball.value(x))) < 1e-4 and not c.any()
    # The apparent area is about pi f^2 r^2 / (e^2 - r^2); a larger ball covers more.
    e2, r, f = 0.4**2 + 0.6**2 + 3.3**2, 0.7, 1.7 * 24
    area = np.pi * f**2 * r**2 / (e2 - r**2)
    assert record.radiance[:, 0].sum() == pytest.approx(area, rel=0.01)
    assert -alpha.sum() == pytest.approx(2 * np.pi * f**2 * r * e2 / (e2 - r**2) ** 2, rel=0.01)


def test_one_background_for_each_camera_and_the_same_bits_twice():
    views = [camera(12), camera(10)]
    pixels = dsdf.pixels(views)
    colours = [[0.1, 0.2, 0.3], [0.5, 0.6, 0.7]]
    options = {"bounds": BOUNDS, "spp": 8, "seed": 3, "background": colours}
    first = dsdf.record(Ball(), Lit(), views, pixels, **options)
    second = dsdf.record(Ball(), Lit(), views, pixels, **options)
    assert np.array_equal(first.radiance, second.radiance)
    delta = np.ones((len(pixels), 3))
    for one, other in zip(first.backward(delta), second.backward(delta)):
        assert np.array_equal(one, other)
    corner = first.radiance[[0, 144]]
    assert np.allclose(corner, colours)
    assert first.background(delta).shape == (2, 3)


class Failing(Ball):
    """Raises at one of its calls."""

    def __init__(self, method, after, error):
        super().__init__()
        self.failing, self.left, self.error, self.calls = method, after, error, 0

    def __getattribute__(self, name):
        get = super().__getattribute__
        if name in ("value", "value_gradient", "hessian_vector") and name == get("failing"):
            self.calls += 1
            self.left -= 1
            if self.left < 0:
                raise get("error")
        return get(name)


class Custom(Exception):
    pass


@pytest.mark.parametrize("method, after", [("value", 0), ("value", 5), ("value_gradient", 1)])
def test_an_exception_of_a_field_passes_through_and_ends_the_pass(method, after):
    error = Custom("mine")
    field = Failing(method, after, error)
    with pytest.raises(Custom) as raised:
        dsdf.record(field, (1, 1, 1), [camera()], dsdf.pixels([camera()]), bounds=BOUNDS, spp=16)
    assert raised.value is error
    assert field.calls == after + 1


def test_exceptions_in_backward_pass_through():
    field = Failing("hessian_vector", 1000, KeyboardInterrupt())
    pixels = dsdf.pixels([camera()])
    record = dsdf.record(field, Lit(), [camera()], pixels, bounds=BOUNDS, spp=4)
    field.left = 0
    with pytest.raises(KeyboardInterrupt):
        record.backward(np.ones((len(pixels), 3)))


def wrong(text, *arguments, **options):
    with pytest.raises(dsdf.InputError) as raised:
        dsdf.record(*arguments, **({"bounds": BOUNDS} | options))
    message = str(raised.value)
    assert text in message and "\n" not in message, message
    assert isinstance(raised.value, ValueError)


def test_wrong_arguments_are_named():
    ball, views, pixels = Ball(), [camera()], [[0, 1, 2]]
    wrong("pixels[0]", ball, (1, 1, 1), views, [[0, 24, 2]])
    wrong("pixels[1]", ball, (1, 1, 1), views, [[0, 1, 2], [1, 0, 0]])
    wrong("shape (n, 3)", ball, (1, 1, 1), views, [[0, 1]])
    wrong("bounds", ball, (1, 1, 1), views, pixels, bounds=(0, 0, 0, -1))
    wrong("estimator", ball, (1, 1, 1), views, pixels, estimator="unknown")
    wrong("spp", ball, (1, 1, 1), views, pixels, spp=0)
    wrong("relaxation", ball, (1, 1, 1), views, pixels, relaxation=2.0)
    wrong("top_k", ball, (1, 1, 1), views, pixels, estimator="paper", top_k=1)
    wrong("shader", ball, "red", views, pixels)
    wrong("background", ball, (1, 1, 1), views, pixels, background=[1, 2])
    wrong("cameras[0]: /focal", ball, (1, 1, 1), [{"width": 1, "height": 1}], pixels)
    wrong("cameras", ball, (1, 1, 1), [], pixels)
    nan = {"width": 1, "height": 1, "focal": float("nan"), "principal": [0, 0]}
    wrong("cameras[0]: /focal: found nan", ball, (1, 1, 1), [nan], pixels)
    wrong("spp: found -1", ball, (1, 1, 1), views, pixels, spp=-1)
    wrong("seed: found -1", ball, (1, 1, 1), views, pixels, seed=-1)
    wrong("shader: found", ball, (1, float("nan"), 1), views, pixels)
    wrong("pixels: array", ball, (1, 1, 1), views, [[0, 1, 2], [0, 1]])
    masked = np.ma.masked_array([[0, 1, 2]], mask=[[0, 1, 0]])
    wrong("pixels: array: found a masked", ball, (1, 1, 1), views, masked)
    wrong("cameras[0]: found str", ball, (1, 1, 1), ["camera"], pixels)
    record = dsdf.record(ball, (1, 1, 1), views, pixels, bounds=BOUNDS)
    for delta in ([[1, 2, 3], [1, 2, 3]], [[1, np.nan, 3]], [["a", "b", "c"]]):
        with pytest.raises(dsdf.InputError, match="delta"):
            record.backward(delta)


def test_wrong_results_of_callbacks_are_named():
    class Column(Ball):
        def value(self, x):
            return super().value(x)[:, None]

    class Single(Ball):
        def value_gradient(self, x):
            return self.value(x)

    class Hole(Ball):
        def value(self, x):
            return np.full(len(x), np.nan)

    class Dark(Lit):
        def radiance(self, x, n, d):
            return np.full_like(x, np.inf)

    class Inside(Ball):
        def value(self, x):
            return super().value(x) < 0

    class Lists(Ball):
        def value_gradient(self, x):
            return list(super().value_gradient(x))

    views, pixels = [camera()], dsdf.pixels([camera()])
    wrong("field.value: dtype: found bool", Inside(), (1, 1, 1), views, pixels)
    dsdf.record(Lists(), Lit(), views, pixels, bounds=BOUNDS, spp=1)
    wrong("field.value: shape", Column(), (1, 1, 1), views, pixels)
    wrong("field.value_gradient: result", Single(), (1, 1, 1), views, pixels)
    wrong("not finite along the ray", Hole(), (1, 1, 1), views, pixels)
    wrong("shader.radiance", Ball(), Dark(), views, pixels)


def test_rays_that_start_inside_the_solid_are_told():
    class Inverted(Ball):
        def value(self, x):
            return -super().value(x)

    views, pixels = [camera()], dsdf.pixels([camera()])
    wrong("field: value: found -", Inverted(), (1, 1, 1), views, pixels)
    # A ball that reaches out of the bounds.
    wrong("bounds that hold", Ball(radius=2.0), (1, 1, 1), views, pixels)
    # A ball of which a part does.
    out = Ball(center=(0.8, 0.0, 0.0), radius=0.5)
    with pytest.warns(RuntimeWarning, match="they see nothing"):
        dsdf.record(out, (1, 1, 1), views, pixels, bounds=(0, 0, 0, 1), spp=1)


def test_unknown_terms_are_listed():
    views, pixels = [camera()], [[0, 12, 12]]
    record = dsdf.record(Ball(), Lit(), views, pixels, bounds=BOUNDS, estimator="interior")
    assert record.unmodelled == ["silhouettes"]
    assert record.rays > 0
