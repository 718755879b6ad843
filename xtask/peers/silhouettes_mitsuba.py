"""Measures derivative images of silhouettes in Mitsuba 3 and in dsdf, where a closed form exists.

    python silhouettes_mitsuba.py --dsdf PROGRAM [--threads N] [--spp N ...] [--seeds N]

Mitsuba's integrators are `direct_projective` and `prb_projective`, in forward mode, each with all
of its terms ("all", the default) and with the primarily visible silhouettes only ("primary": `sppc`
and `sppi` are 0). The other terms have the expectation 0 in every case here. dsdf runs its
estimator `refined` with a box filter, as `dsdf gradient` does by default. All images have 64 × 64
pixels.

The camera is at z = 4 and looks at the origin, with the focal length F in pixels. The objects have
one radiance, on a background of another; L is the difference. Only the outline has a derivative
then. It moves with the speed v along its outward normal, and the derivative of a pixel is the
integral of L v over the length of the outline in the pixel. With d = 4 and the radius r:

- `sphere-radius`, `sphere-depth`: the outline is a circle with the radius R = F r/sqrt(d² − r²).
  dR/dr = F d²/(d² − r²)^(3/2), and moving towards the camera dR/dz = F r d/(d² − r²)^(3/2). The sum
  over the image is 2 π R L dR.
- `sphere-across`: a point p of the film, in units of F, is on the outline of a ball at c if (p·c)²
  = (|c|² − r²) |p|². Differentiating by c_x at c = (0, 0, d) gives the speed v = F d/(d² − r²) cos
  φ at the angle φ: the circle is translated. The sum over the half of the image to which it moves
  is 2 R L F d/(d² − r²); the other half has its negative, the sum is 0.
- `cube-depth`, after mitsuba3 issue 1895: an axis-aligned cube with the half size h at the origin
  moves towards the camera. Its side faces are hidden by the front face, whose image is a square
  with the half size s = F h/(d − h). ds/dz = F h/(d − h)², and the area is 4 s², so the sum is 8 s
  L ds/dz. As in the issue the cube is diffuse, in an environment of one radiance E: it is convex,
  so its radiance is its albedo times E.
- `ball-vertical`, after mitsuba3 issue 1648: an object is translated upwards, and its mesh has a
  seam of texture coordinates, where its surface is open. Issue 1648 sees it in a mirror; here it is
  seen directly, since dsdf models neither reflections nor the edges of shadows. The object is a
  ball, and the closed form is that of `sphere-across` with the upper half of the image.

Meshes: `cube` is Mitsuba's own, with 24 vertices and so with open edges; `welded` has shared
vertices and no open edge; `seam` is a ball of triangles whose vertices are doubled along a
meridian.

The error of the sum is relative to the closed form of the sum, or of the sum over a half. The error
of the image is its L2 distance to the reference over the norm of the reference. The reference has
the length in each pixel: exact for the square, from 2^22 points for the circle. The triangles of a
ball are inside it: their outline of 256 edges is at most 8e-5 of the radius inside the circle.

`seconds` is the wall time of one derivative image after a call with other seeds has compiled its
kernels; it includes the tracing of Python by Dr.Jit, and `kernel_seconds` is the time within
kernels. `compiled` counts kernels that were compiled in spite of that. dsdf reports its own
seconds, without start-up and file access.
"""

import argparse
import json
import math
import pathlib
import tempfile
import time

import peers

SIZE = 64
DISTANCE = 4.0
CENTRE = SIZE / 2
ALBEDO = 0.5
SPP = [16, 64, 256, 1024]
# The circle has a radius of 17.51 pixels. Its sides are halfway between two rows or columns, where
# an error of its radius changes the image least.
BALL_FOCAL = 98.5
ARC = 2**22
CASES = ["sphere-radius", "sphere-depth", "sphere-across", "cube-depth", "ball-vertical"]


class Case:
    """A scene, its parameter, and the exact derivative.

    `speed` is the derivative image for the radiance difference 1; `part` selects the pixels of the
    sum; `exact` is that sum in closed form.
    """

    def __init__(self, name, pointer, shapes, sdf, focal, object_radiance, background, image, part,
                 exact):
        self.name, self.pointer, self.shapes, self.sdf = name, pointer, shapes, sdf
        self.focal, self.object_radiance, self.background = focal, object_radiance, background
        contrast = object_radiance - background
        self.image, self.part, self.exact = contrast * image, part, contrast * exact

    def errors(self, image):
        """The errors of a derivative image, of the sum and of the pixels."""
        import numpy as np

        total = float(image[self.part].sum(dtype=np.float64))
        distance = np.linalg.norm(image.astype(np.float64) - self.image)
        return {"sum": total, "sum_error": abs(total / self.exact - 1),
                "image_error": float(distance / np.linalg.norm(self.image))}

    def scene(self):
        """The scene file of dsdf."""
        return {
            "camera": {"width": SIZE, "height": SIZE, "focal": self.focal,
                       "principal": [CENTRE, CENTRE], "eye": [0, 0, DISTANCE],
                       "target": [0, 0, 0], "up": [0, 1, 0]},
            "sdf": self.sdf,
            "appearance": {"type": "constant", "radiance": [self.object_radiance] * 3},
            "background": [self.background] * 3}


def circle(radius, speed):
    """The integral of `speed`(cos φ, sin φ) over the arc of a circle in each pixel."""
    import numpy as np

    angles = (np.arange(ARC) + 0.5) * (2 * math.pi / ARC)
    right, up = np.cos(angles), np.sin(angles)
    columns = np.floor(CENTRE + radius * right).astype(np.int64)
    rows = np.floor(CENTRE - radius * up).astype(np.int64)
    weight = np.broadcast_to(speed(right, up), angles.shape) * (radius * 2 * math.pi / ARC)
    return np.bincount(rows * SIZE + columns, weight, SIZE * SIZE).reshape(SIZE, SIZE)


def square(half, speed):
    """`speed` times the length of the outline of a centred square in each pixel."""
    import numpy as np

    low, high = CENTRE - half, CENTRE + half
    starts = np.arange(SIZE)
    overlap = np.clip(np.minimum(high, starts + 1) - np.maximum(low, starts), 0, None)
    image = np.zeros((SIZE, SIZE))
    for edge in (int(low), int(high)):
        image[edge, :] += overlap
        image[:, edge] += overlap
    return speed * image


def all_cases():
    d, r, f = DISTANCE, 0.7, BALL_FOCAL
    gap = d * d - r * r
    radius, across = f * r / math.sqrt(gap), f * d / gap
    everything = (slice(None), slice(None))
    right = (slice(None), slice(SIZE // 2, None))
    upper = (slice(0, SIZE // 2), slice(None))
    ball = {"type": "sphere", "center": [0, 0, 0], "radius": r}
    cases = []
    for name, pointer, growth in [
        ("sphere-radius", "/sdf/radius", f * d * d / gap**1.5),
        ("sphere-depth", "/sdf/center/2", f * r * d / gap**1.5),
    ]:
        image = circle(radius, lambda right, up, growth=growth: growth)
        cases.append(Case(name, pointer, ["sphere"], ball, f, 1.0, 0.0, image, everything,
                          2 * math.pi * radius * growth))
    image = circle(radius, lambda right, up: across * right)
    cases.append(Case("sphere-across", "/sdf/center/0", ["sphere"], ball, f, 1.0, 0.0, image, right,
                      2 * radius * across))
    h, f = 1.0, 50.0
    half, growth = f * h / (d - h), f * h / (d - h) ** 2
    cube = {"type": "box", "center": [0, 0, 0], "half_size": [h, h, h]}
    cases.append(Case("cube-depth", "/sdf/center/2", ["cube", "welded"], cube, f, ALBEDO, 1.0,
                      square(half, growth), everything, 8 * half * growth))
    image = circle(radius, lambda right, up: across * up)
    cases.append(Case("ball-vertical", "/sdf/center/1", ["seam", "welded"], ball, BALL_FOCAL, 1.0,
                      0.0, image, upper, 2 * radius * across))
    return cases


def ball_mesh(radius, rows, columns, seam):
    """Vertices, triangles and texture coordinates of a ball; its seam faces the camera."""
    import numpy as np

    meridians = columns + 1 if seam else columns
    polar = np.pi * np.arange(1, rows) / rows
    angle = 2 * np.pi * np.arange(meridians) / columns
    ring = np.stack([np.outer(np.sin(polar), np.sin(angle)),
                     np.outer(np.cos(polar), np.ones(meridians)),
                     np.outer(np.sin(polar), np.cos(angle))], -1).reshape(-1, 3)
    points = radius * np.concatenate([ring, [[0, 1, 0], [0, -1, 0]]])
    coordinates = np.stack(np.meshgrid(np.arange(meridians) / columns, polar / np.pi), -1)
    coordinates = np.concatenate([coordinates.reshape(-1, 2), [[0.5, 0], [0.5, 1]]])
    top, bottom = len(ring), len(ring) + 1
    index = lambda row, column: row * meridians + column % meridians
    faces = []
    for column in range(columns):
        faces.append((top, index(0, column), index(0, column + 1)))
        faces.append((bottom, index(rows - 2, column + 1), index(rows - 2, column)))
        for row in range(rows - 2):
            corners = [index(row, column), index(row + 1, column), index(row + 1, column + 1),
                       index(row, column + 1)]
            faces += [(corners[0], corners[1], corners[2]), (corners[0], corners[2], corners[3])]
    return points, np.array(faces), coordinates


def cube_mesh():
    """Vertices and triangles of the cube [−1, 1]³, with eight shared vertices."""
    import numpy as np

    points = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return points, np.array(faces), None


class Mitsuba:
    """The scene of a case in Mitsuba, with its parameter attached to a number."""

    def __init__(self, mi, dr, case, shape):
        self.mi, self.dr, self.case = mi, dr, case
        glows = case.background == 0
        field = 2 * math.degrees(math.atan(SIZE / 2 / case.focal))
        look = mi.ScalarTransform4f().look_at([0, 0, DISTANCE], [0, 0, 0], [0, 1, 0])
        scene = {
            "type": "scene",
            "sensor": {
                "type": "perspective", "fov": field, "fov_axis": "x", "to_world": look,
                "near_clip": 0.1, "far_clip": 100.0,
                "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE, "pixel_format": "rgb",
                         "component_format": "float32", "rfilter": {"type": "box"},
                         "sample_border": False},
                "sampler": {"type": "independent", "sample_count": 1}}}
        if glows:
            material = {"emitter": self.radiance("area", case.object_radiance)}
        else:
            albedo = case.object_radiance / case.background
            material = {"bsdf": {"type": "diffuse", "reflectance": self.colour(albedo)}}
            scene["environment"] = self.radiance("constant", case.background)
        mesh = self.mesh(case, shape)
        scene["object"] = {"type": "sphere", "radius": case.sdf["radius"], **material} if (
            mesh is None and shape == "sphere") else {"type": "cube", **material}
        if mesh is not None:
            scene["object"] = self.build(mesh, material)
        self.scene = mi.load_dict(scene)
        self.params = mi.traverse(self.scene)
        key = [key for key in self.params.keys() if key.startswith("object")]
        self.key = next(k for k in key if k.endswith(
            "to_world" if shape == "sphere" else "vertex_positions"))
        value = self.params[self.key]
        self.start = mi.Transform4f(value) if shape == "sphere" else mi.Float(value)

    def colour(self, value):
        return {"type": "rgb", "value": [value] * 3}

    def radiance(self, kind, value):
        return {"type": kind, "radiance": self.colour(value)}

    def mesh(self, case, shape):
        """The triangles of a shape, or None for a shape of Mitsuba's own."""
        if shape in ("sphere", "cube"):
            return None
        if case.sdf["type"] == "box":
            return cube_mesh()
        return ball_mesh(case.sdf["radius"], 128, 256, shape == "seam")

    def build(self, mesh, material):
        mi = self.mi
        points, faces, coordinates = mesh
        properties = mi.Properties()
        for name, part in material.items():
            properties[name] = mi.load_dict(part)
        built = mi.Mesh("object", len(points), len(faces), props=properties,
                        has_vertex_texcoords=coordinates is not None)
        params = mi.traverse(built)
        params["vertex_positions"] = mi.Float(points.astype("float32").ravel())
        params["faces"] = mi.UInt32(faces.astype("uint32").ravel())
        if coordinates is not None:
            params["vertex_texcoords"] = mi.Float(coordinates.astype("float32").ravel())
        params.update()
        return built

    def attach(self):
        """Sets the object as a function of a number, and returns that number."""
        mi, dr = self.mi, self.dr
        step = mi.Float(0)
        dr.enable_grad(step)
        if self.case.pointer == "/sdf/radius":
            radius = mi.Float(self.case.sdf["radius"])
            ratio = (radius + step) / radius
            self.params[self.key] = mi.Transform4f().scale(mi.Vector3f(ratio)) @ self.start
        else:
            axis = int(self.case.pointer[-1])
            if self.key.endswith("to_world"):
                motion = [step if a == axis else mi.Float(0) for a in range(3)]
                moved = mi.Transform4f().translate(mi.Vector3f(*motion))
                self.params[self.key] = moved @ self.start
            else:
                points = dr.unravel(mi.Point3f, self.start)
                points[axis] = points[axis] + step
                self.params[self.key] = dr.ravel(points)
        self.params.update()
        return step

    def image(self):
        """The image, of 256 samples."""
        import numpy as np

        integrator = self.mi.load_dict({"type": "direct"})
        return np.array(self.mi.render(self.scene, integrator=integrator, spp=256, seed=9))[..., 0]

    def derivative(self, integrator, seed, spp):
        """The derivative image, its seconds, the seconds in kernels, and the kernels compiled."""
        import numpy as np

        mi, dr = self.mi, self.dr
        dr.kernel_history_clear()
        dr.sync_thread()
        start = time.perf_counter()
        step = self.attach()
        # The image itself takes one sample, as only its derivative counts.
        image = mi.render(self.scene, self.params, integrator=integrator, spp=1, spp_grad=spp,
                          seed=dr.opaque(mi.UInt32, 2 * seed),
                          seed_grad=dr.opaque(mi.UInt32, 2 * seed + 1))
        dr.forward(step)
        image = dr.grad(image)
        dr.eval(image)
        dr.sync_thread()
        seconds = time.perf_counter() - start
        history = [e for e in dr.kernel_history() if e["type"] == dr.KernelType.JIT]
        compiled = sum(not e["cache_hit"] for e in history)
        inside = sum(e["execution_time"] for e in history) / 1000
        return np.array(image)[..., 0], seconds, inside, compiled


def row(case, images, seconds, **more):
    """The errors of the images of several seeds, root mean squares, and the shortest time.

    The errors are None where a pixel of some image is not a number, or infinite.
    """
    import numpy as np

    more = {"seconds": min(seconds), "seconds_of_seeds": list(seconds), **more,
            "not_finite": int(sum((~np.isfinite(image)).sum() for image in images))}
    if more["not_finite"]:
        names = ("sum", "sum_error", "sum_error_of_mean", "image_error", "image_error_of_mean")
        return {**dict.fromkeys(names), **more}
    found = [case.errors(image) for image in images]
    square_mean = lambda key: math.sqrt(sum(e[key] ** 2 for e in found) / len(found))
    # The mean of the images has less noise. What remains of its error with more seeds is bias.
    mean = case.errors(sum(images) / len(images))
    return {"sum": mean["sum"], "sum_error": square_mean("sum_error"),
            "sum_error_of_mean": mean["sum_error"], "image_error": square_mean("image_error"),
            "image_error_of_mean": mean["image_error"], **more}


def run_mitsuba(mi, dr, case, options):
    rows = []
    for shape in case.shapes:
        scene = Mitsuba(mi, dr, case, shape)
        for name in ("direct_projective", "prb_projective"):
            for terms in ("all", "primary"):
                kind = {"type": name}
                if terms == "primary":
                    kind.update(sppc=0, sppi=0)
                for spp in options.spp:
                    integrator = mi.load_dict(kind)
                    label = {"program": "mitsuba", "estimator": name, "terms": terms,
                             "shape": shape, "precision": "f32", "spp": spp}
                    try:
                        scene.derivative(integrator, 1000, spp)
                        runs = [scene.derivative(integrator, seed, spp)
                                for seed in range(options.seeds)]
                    except Exception as error:  # The peer's errors have many types.
                        rows.append({**label, "failed": peers.failed(error)["reason"]})
                        peers.progress(f"{case.name}: {rows[-1]}")
                        continue
                    images, seconds, inside, compiled = zip(*runs)
                    rows.append({**label, **row(case, images, seconds, kernel_seconds=min(inside),
                                                compiled=sum(compiled))})
                    report(case, rows[-1])
    return rows


def run_dsdf(case, options):
    import numpy as np

    rows = []
    with tempfile.TemporaryDirectory() as folder:
        scene, output = pathlib.Path(folder, "scene.json"), pathlib.Path(folder, "out.npy")
        scene.write_text(json.dumps(case.scene()), encoding="utf-8")
        for precision in ("f64", "f32"):
            for spp in options.spp:
                images, seconds = [], []
                for seed in range(options.seeds):
                    done = peers.run_dsdf(options.dsdf, [
                        "gradient", str(scene), "--wrt", case.pointer, "--spp", str(spp), "--seed",
                        str(seed), "--filter", "box", "--threads", str(options.threads),
                        "--precision", precision, "-o", str(output)])
                    images.append(np.load(output)[..., 0])
                    seconds.append(done["seconds"])
                rows.append({"program": "dsdf", "estimator": "refined", "terms": "all",
                             "shape": case.sdf["type"], "precision": precision, "spp": spp,
                             **row(case, images, seconds)})
                report(case, rows[-1])
    return rows


def report(case, row):
    errors = "{sum_error:.2e} of the sum, {image_error:.2e} of the image".format(**row) if (
        row["sum"] is not None) else "{not_finite} pixels are not finite".format(**row)
    label = "{program} {estimator} {terms} {shape} {precision}, {spp} spp, {seconds:.3f} s"
    peers.progress(f"{case.name}: {label.format(**row)}: {errors}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dsdf", required=True, metavar="PROGRAM", help="the program dsdf")
    parser.add_argument("--threads", type=peers.number, default=1, help="threads [default: 1]")
    parser.add_argument("--spp", type=peers.number, nargs="+", default=SPP,
                        help="samples per pixel, one or more [default: 16 64 256 1024]")
    parser.add_argument("--seeds", type=peers.number, default=3, help="seeds [default: 3]")
    parser.add_argument("--case", nargs="+", choices=CASES, default=CASES, help="cases to run")
    options = parser.parse_args()
    peers.pin(options.threads)
    dr = peers.import_drjit()
    cases = [case for case in all_cases() if case.name in options.case]
    try:
        import mitsuba as mi
    except ImportError as error:
        peers.skip(f"{error}: run install.py, and use the Python of its folder")
    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    dr.set_thread_count(options.threads)
    dr.set_flag(dr.JitFlag.KernelHistory, True)
    result = {
        "peer": "Mitsuba 3, llvm_ad_rgb",
        "versions": {**peers.versions("mitsuba", "drjit", "numpy"),
                     "llvm": ".".join(map(str, dr.detail.llvm_version()))},
        "machine": peers.machine(),
        "threads": options.threads,
        "seeds": options.seeds,
        "notes": {
            "cube-depth": "mitsuba3 issue 1895; `cube` has 24 vertices, `welded` has 8",
            "ball-vertical": "mitsuba3 issue 1648, but seen directly: dsdf models neither"
                             " reflections nor the edges of shadows",
            "primary": "sppc and sppi are 0: both terms have the expectation 0 in these cases",
        },
        "cases": []}
    for case in cases:
        # The reference and the closed form are independent: they agree but for rounding.
        check = abs(float(case.image[case.part].sum()) / case.exact - 1)
        rows = run_dsdf(case, options) + run_mitsuba(mi, dr, case, options)
        result["cases"].append({"case": case.name, "wrt": case.pointer, "exact_sum": case.exact,
                                "reference_error": check, "rows": rows})
    peers.write(result)


if __name__ == "__main__":
    main()
