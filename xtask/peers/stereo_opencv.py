"""Multi-view stereo by PatchMatch, with OpenCV and Open3D: a surface from posed photographs.

    stereo_opencv.py DATA -o FOLDER --center X Y Z --radius R

DATA is a folder with transforms_train.json or transforms.json and one lens. Each pixel of each
photograph gets a plane. Planes of several orientations sweep through the sphere first (Gallup et al.,
CVPR 2007); then pixels take planes of their neighbours and change them at random, where the patches
of the best other photographs correlate better (Bleyer et al., BMVC 2011; Galliani et al., ICCV 2015).
Depths that two other photographs have, too, are kept, and Open3D makes a mesh of them in two ways:
FOLDER/tsdf.ply by a volume of truncated distances, and FOLDER/poisson.ply by Poisson's equation. The
script prints one JSON object with the seconds and the number of points.
"""

import argparse
import json
import math
import pathlib
import time

import peers

# Photographs that a photograph is compared with; the best of them count.
NEIGHBOURS, BEST = 4, 2

# The least angle between the directions of two photographs that are compared, in degrees.
LEAST_ANGLE = 8.0

# The side of the compared patches, and the step between their samples, in pixels.
PATCH, STEP = 11, 2

# The planes of an orientation, and the tilts: frontal, and six directions around it.
PLANES, TILT, TILTED = 96, 40.0, 6

# Rounds of changes; the first changes a depth by this part of the radius, and a normal by about this
# angle, in radians; each round by half of the one before.
ROUNDS, DEPTH_CHANGE, NORMAL_CHANGE = 5, 0.02, 0.5

# The variance of a patch that is noise: shades of gray from 0 to 1 have 8 bits.
NOISE = 2e-6

# The least correlation of a depth.
LEAST_SCORE = 0.7

# Depths agree if they differ by less than this part of the radius.
AGREEMENT = 0.01

# Voxels of the volume along the radius, and the depth of Poisson's octree.
VOXELS = 160
OCTREE = 8


class View:
    """A photograph with its camera in OpenCV's convention: x right, y down, z forward."""

    def __init__(self, image, lens, pose):
        self.image, self.lens = image, lens
        self.rotation = (pose[:3, :3] * [1, -1, -1]).T
        self.eye = pose[:3, 3]

    def project(self, points):
        """Pixels and depths of points of the world."""
        local = (points - self.eye) @ self.rotation.T
        pixels = local @ self.lens.T
        return pixels[:, :2] / pixels[:, 2:], local[:, 2]

    def rays(self):
        """The direction of each pixel in the world, with depth 1."""
        height, width = self.image.shape[:2]
        x, y = np.meshgrid(np.arange(width), np.arange(height))
        pixels = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
        return pixels @ np.linalg.inv(self.lens).T @ self.rotation


def read(folder):
    """The views of a data set."""
    names = ["transforms_train.json", "transforms.json"]
    path = next((folder / name for name in names if (folder / name).exists()), None)
    if path is None:
        raise SystemExit(f"{folder}: no transforms_train.json and no transforms.json")
    scene = json.loads(path.read_text(encoding="utf-8"))
    frames = scene["frames"]
    # dsdf keeps each eighth photograph of a set without a split for its own test, from 20 on.
    if path.name == "transforms.json" and len(frames) >= 20:
        frames = [frame for k, frame in enumerate(frames) if k % 8 != 0]
    views = []
    for frame in frames:
        name = folder / frame["file_path"]
        name = name if name.suffix else name.with_suffix(".png")
        image = cv2.imread(str(name), cv2.IMREAD_COLOR)
        if image is None:
            raise SystemExit(f"{name}: cannot be read")
        height, width = image.shape[:2]
        focal = scene.get("fl_x") or 0.5 * width / math.tan(0.5 * scene["camera_angle_x"])
        # Its pixel centres are at halves, OpenCV's are at whole numbers.
        x, y = scene.get("cx", 0.5 * width) - 0.5, scene.get("cy", 0.5 * height) - 0.5
        lens = np.array([[focal, 0, x], [0, scene.get("fl_y", focal), y], [0, 0, 1]])
        views.append(View(image, lens, np.array(frame["transform_matrix"])))
    return views


def neighbours(views, index, center):
    """The views that one is matched with: the nearest ones that are not too near."""
    def direction(view):
        return (view.eye - center) / np.linalg.norm(view.eye - center)

    own = direction(views[index])
    angles = [math.degrees(math.acos(np.clip(own @ direction(view), -1, 1))) for view in views]
    return [k for k in np.argsort(angles) if angles[k] > LEAST_ANGLE][:NEIGHBOURS]


def mean(image):
    """The mean of each patch."""
    return cv2.boxFilter(image, -1, (PATCH, PATCH))


def of_best(scores):
    """The mean of the best photographs' scores."""
    return np.sort(scores, axis=0)[-BEST:].mean(axis=0)


def off_zero(divisor):
    """Numbers to divide by: those at zero are small ones."""
    return np.where(np.abs(divisor) > 1e-6, divisor, 1e-6)


class Sweep:
    """The best plane of each pixel of a view so far."""

    def __init__(self, view, others, center, radius):
        self.view, self.radius = view, radius
        self.gray = gray(view)
        self.center = view.rotation @ (center - view.eye)
        self.mean = mean(self.gray)
        self.deviation = np.sqrt(np.maximum(mean(self.gray**2) - self.mean**2, 0))
        # The other cameras: a point X of this one is rotation X + shift there.
        self.others = [(gray(other), other.lens, other.rotation @ view.rotation.T,
                        other.rotation @ (view.eye - other.eye)) for other in others]
        self.shape = self.gray.shape
        self.directions = (self.view.rays() @ self.view.rotation.T).reshape(*self.shape, 3)
        self.score = np.full(self.shape, -1.0, np.float32)
        self.depth = np.zeros(self.shape)
        self.normal = np.zeros((*self.shape, 3))

    def correlation(self, normal, offset):
        """The correlation of each patch with the best others, on the plane normal · X = offset."""
        scores = []
        for image, lens, rotation, shift in self.others:
            homography = (lens @ (rotation + np.outer(shift, normal) / offset)
                          @ np.linalg.inv(self.view.lens))
            warped = cv2.warpPerspective(image, homography, self.shape[::-1],
                                         flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
            middle = mean(warped)
            deviation = np.sqrt(np.maximum(mean(warped**2) - middle**2, 0))
            product = mean(self.gray * warped) - self.mean * middle
            # Patches without texture correlate with nothing.
            scores.append(product / (self.deviation * deviation + NOISE))
        return of_best(np.stack(scores))

    def sweep(self, normal):
        """Sweeps planes of one orientation through the sphere."""
        offsets = normal @ self.center + np.linspace(-1, 1, PLANES) * self.radius
        step = offsets[1] - offsets[0]
        slope = self.directions @ normal
        before = two_before = None
        for k, offset in enumerate(offsets):
            score = self.correlation(normal, offset)
            if two_before is not None:
                is_peak = (before >= two_before) & (before >= score) & (before > self.score)
                # The top of a parabola through three planes.
                curvature = two_before - 2 * before + score
                part = 0.5 * (two_before - score) / np.where(curvature < 0, curvature, -1)
                depth = (offsets[k - 1] + np.clip(part, -0.5, 0.5) * step) / slope
                self.score = np.where(is_peak, before, self.score)
                self.depth = np.where(is_peak, depth, self.depth)
                self.normal = np.where(is_peak[..., None], normal, self.normal)
            two_before, before = before, score


class Refinement:
    """The planes of the pixels with texture, improved in rounds."""

    def __init__(self, sweep, random):
        self.sweep, self.random = sweep, random
        self.rows, self.columns = np.nonzero((sweep.score > 0) & (sweep.deviation > NOISE**0.5))
        self.index = np.full(sweep.shape, -1)
        self.index[self.rows, self.columns] = np.arange(len(self.rows))
        self.ray = self.at(sweep.directions)
        self.depth, self.normal = self.at(sweep.depth), self.at(sweep.normal)
        self.score = self.correlation(self.depth, self.normal)

    def at(self, image):
        """The values of an image at the pixels."""
        return image[self.rows, self.columns]

    def correlation(self, depth, normal):
        """The correlation of each pixel's patch with the best others, on its own plane."""
        sweep, half = self.sweep, PATCH // 2
        height, width = sweep.shape
        steps = range(-half, half + 1, STEP)
        offset = depth * (normal * self.ray).sum(axis=1)
        sums = np.zeros((len(sweep.others), 3, len(depth)))
        own, count = np.zeros((2, len(depth))), 0
        inverse = np.linalg.inv(sweep.view.lens)
        for down in steps:
            for right in steps:
                rows = np.clip(self.rows + down, 0, height - 1)
                columns = np.clip(self.columns + right, 0, width - 1)
                a = sweep.gray[rows, columns].astype(float)
                own += [a, a * a]
                count += 1
                ray = self.ray + inverse @ [right, down, 0]
                toward = (normal * ray).sum(axis=1)
                points = ray * (offset / off_zero(toward))[:, None]
                for (image, lens, rotation, shift), total in zip(sweep.others, sums):
                    place = (points @ rotation.T + shift) @ lens.T
                    z = np.where(place[:, 2] > 1e-6, place[:, 2], 1e-6)
                    b = look_up(image, place[:, 0] / z, place[:, 1] / z)
                    total += [b, b * b, a * b]
        mean_a, square_a = own / count
        deviation = np.sqrt(np.maximum(square_a - mean_a**2, 0))
        mean_b, square_b, product = (sums / count).transpose(1, 0, 2)
        deviations = deviation * np.sqrt(np.maximum(square_b - mean_b**2, 0))
        scores = (product - mean_a * mean_b) / (deviations + NOISE)
        return of_best(scores)

    def take(self, depth, normal):
        """Takes planes where they correlate better."""
        # A plane that is seen from its back, or edge-on, is none.
        is_seen = (normal * self.ray).sum(axis=1) > 0.1 * np.linalg.norm(self.ray, axis=1)
        score = np.where(is_seen & (depth > 0), self.correlation(depth, normal), -1)
        better = score > self.score
        self.score = np.where(better, score, self.score)
        self.depth = np.where(better, depth, self.depth)
        self.normal = np.where(better[:, None], normal, self.normal)

    def round(self, change):
        """Planes of the neighbours, and changed ones; `change` is 1 in the first round."""
        for down, right in [(0, 1), (1, 0), (0, -1), (-1, 0)]:
            rows = np.clip(self.rows + down, 0, self.sweep.shape[0] - 1)
            columns = np.clip(self.columns + right, 0, self.sweep.shape[1] - 1)
            other = self.index[rows, columns]
            other = np.where(other < 0, np.arange(len(other)), other)
            normal = self.normal[other]
            # The neighbour's plane, at the ray of this pixel.
            offset = self.depth[other] * (normal * self.ray[other]).sum(axis=1)
            toward = (normal * self.ray).sum(axis=1)
            self.take(offset / off_zero(toward), normal)
        for _ in range(3):
            size = len(self.depth)
            depth = self.depth + change * DEPTH_CHANGE * self.sweep.radius * self.random.normal(size=size)
            normal = self.normal + change * NORMAL_CHANGE * self.random.normal(size=(size, 3))
            self.take(depth, normal / np.linalg.norm(normal, axis=1)[:, None])

    def result(self):
        """The images of depths, 0 where the patches do not correlate, and of normals."""
        depth, normal = np.zeros(self.sweep.shape), np.zeros((*self.sweep.shape, 3))
        depth[self.rows, self.columns] = np.where(self.score > LEAST_SCORE, self.depth, 0)
        normal[self.rows, self.columns] = -self.normal
        return depth, normal @ self.sweep.view.rotation


def look_up(image, x, y):
    """The values of an image between its pixels."""
    # OpenCV's maps have less than 32768 rows.
    columns = 1024
    padded = -(-len(x) // columns) * columns
    maps = [np.pad(v.astype(np.float32), (0, padded - len(v))).reshape(-1, columns) for v in (x, y)]
    return cv2.remap(image, *maps, cv2.INTER_LINEAR).ravel()[: len(x)]


def gray(view):
    """The photograph in shades of gray, from 0 to 1."""
    return cv2.cvtColor(view.image, cv2.COLOR_BGR2GRAY).astype(np.float32) / 255


def planes(views, index, center, radius):
    """The depth of each pixel of a view, 0 where patches do not correlate, and its normal."""
    others = [views[k] for k in neighbours(views, index, center)]
    sweep = Sweep(views[index], others, center, radius)
    tilt = math.radians(TILT)
    around = [2 * math.pi * k / TILTED for k in range(TILTED)]
    tilted = [[math.sin(tilt) * math.cos(a), math.sin(tilt) * math.sin(a), math.cos(tilt)]
              for a in around]
    for normal in [[0, 0, 1], *tilted]:
        sweep.sweep(np.array(normal))
    refinement = Refinement(sweep, np.random.default_rng(index))
    for k in range(ROUNDS):
        refinement.round(0.5**k)
    return refinement.result()


def consistent(views, depths, index, center, radius):
    """The depths of a view that two others have, too, and that are inside of the sphere."""
    view, depth = views[index], depths[index]
    points = view.eye + view.rays() * depth.reshape(-1, 1)
    count = np.zeros(len(points), int)
    for k in neighbours(views, index, center):
        pixels, z = views[k].project(points)
        height, width = depths[k].shape
        i, j = np.round(np.nan_to_num(pixels, posinf=-1, neginf=-1)).astype(int).T
        inside = (z > 0) & (i >= 0) & (i < width) & (j >= 0) & (j < height)
        found = np.zeros(len(points))
        found[inside] = depths[k][j[inside], i[inside]]
        count += (found > 0) & (np.abs(found - z) < AGREEMENT * radius)
    kept = (depth.ravel() > 0) & (count >= 2)
    kept &= np.linalg.norm(points - center, axis=1) < radius
    return np.where(kept.reshape(depth.shape), depth, 0.0)


def by_volume(views, depths, center, radius):
    """The mesh of a volume of truncated distances."""
    volume = open3d.pipelines.integration.UniformTSDFVolume(
        length=2 * radius, resolution=2 * VOXELS, sdf_trunc=4 * radius / VOXELS,
        color_type=open3d.pipelines.integration.TSDFVolumeColorType.NoColor, origin=center - radius)
    for view, depth in zip(views, depths):
        height, width = depth.shape
        rgbd = open3d.geometry.RGBDImage.create_from_color_and_depth(
            open3d.geometry.Image(np.ascontiguousarray(view.image)),
            open3d.geometry.Image(depth.astype(np.float32)),
            depth_scale=1.0, depth_trunc=1e9, convert_rgb_to_intensity=False)
        lens = open3d.camera.PinholeCameraIntrinsic(
            width, height, view.lens[0, 0], view.lens[1, 1], view.lens[0, 2], view.lens[1, 2])
        world = np.eye(4)
        world[:3, :3], world[:3, 3] = view.rotation, -view.rotation @ view.eye
        volume.integrate(rgbd, lens, world)
    return volume.extract_triangle_mesh()


def by_poisson(views, depths, normals, radius):
    """The closed mesh by Poisson's equation, and the number of points."""
    cloud = open3d.geometry.PointCloud()
    for view, depth, normal in zip(views, depths, normals):
        own = open3d.geometry.PointCloud()
        kept = depth.ravel() > 0
        points = view.eye + view.rays()[kept] * depth.ravel()[kept, None]
        own.points = open3d.utility.Vector3dVector(points)
        own.normals = open3d.utility.Vector3dVector(normal.reshape(-1, 3)[kept])
        cloud += own
    cloud = cloud.voxel_down_sample(0.5 * radius / VOXELS)
    mesh, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        cloud, depth=OCTREE, n_threads=1)
    return mesh, len(cloud.points)


def main():
    # Processor time: the process has one core, and others may share it.
    start = time.process_time()
    views = read(options.data)
    center, radius = np.array(options.center), options.radius
    indices = range(len(views))
    first, normals = [], []
    for k in indices:
        depth, normal = planes(views, k, center, radius)
        first.append(depth)
        normals.append(normal)
        peers.progress(f"planes of {k + 1} of {len(views)} photographs")
    depths = [consistent(views, first, k, center, radius) for k in indices]
    matched = time.process_time() - start
    options.output.mkdir(parents=True, exist_ok=True)
    rows = []
    for name in ["tsdf", "poisson"]:
        begin, points = time.process_time(), None
        if name == "tsdf":
            mesh = by_volume(views, depths, center, radius)
        elif any((depth > 0).any() for depth in depths):
            mesh, points = by_poisson(views, depths, normals, radius)
        if len(mesh.triangles) == 0:
            peers.progress(f"{name}: no surface")
            continue
        path = options.output / f"{name}.ply"
        open3d.io.write_triangle_mesh(str(path), mesh)
        seconds = matched + time.process_time() - begin
        rows.append({"method": name, "mesh": str(path), "seconds": seconds, "points": points})
    peers.write({"script": "stereo_opencv.py", "machine": peers.machine(),
                 "versions": peers.versions("opencv-python-headless", "open3d-cpu", "numpy"),
                 "views": len(views), "rows": rows})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=pathlib.Path, metavar="DATA", help="folder of a data set")
    parser.add_argument("-o", "--output", type=pathlib.Path, required=True, metavar="FOLDER",
                        help="folder of the meshes")
    parser.add_argument("--center", type=float, nargs=3, required=True,
                        help="centre of the sphere around the object")
    parser.add_argument("--radius", type=float, required=True, help="its radius")
    options = parser.parse_args()
    peers.pin(1)
    try:
        import cv2
        import numpy as np
        import open3d
    except ImportError as error:
        peers.skip(f"{error}: run install.py, and use the Python of its folder")
    cv2.setNumThreads(1)
    main()
