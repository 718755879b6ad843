"""Multi-view stereo with OpenCV and Open3D: the surface of an object from posed photographs.

    stereo_opencv.py DATA -o FOLDER --center X Y Z --radius R

DATA is a folder with transforms_train.json or transforms.json and one lens. Each photograph is
rectified with its neighbours, OpenCV's semi-global matcher finds disparities in both directions,
depths that two neighbours and two other photographs agree on are kept, and Open3D makes a mesh of
them in two ways: FOLDER/tsdf.ply by a volume of truncated distances, and FOLDER/poisson.ply by
Poisson's equation. The script prints one JSON object with the seconds and the number of points.
"""

import argparse
import json
import math
import pathlib
import time

import peers

# Photographs that a photograph is matched with.
NEIGHBOURS = 4

# The least angle between the directions of two photographs that are matched, in degrees.
LEAST_ANGLE = 6.0

# The side of the matched blocks, in pixels, and the factor by which photographs are enlarged: the
# matcher's disparities are locked to whole pixels by a part of one.
BLOCK = 5
ENLARGED = 2

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
    """The views of a data set, enlarged."""
    names = ["transforms_train.json", "transforms.json"]
    path = next((folder / name for name in names if (folder / name).exists()), None)
    if path is None:
        raise SystemExit(f"{folder}: no transforms_train.json and no transforms.json")
    scene = json.loads(path.read_text(encoding="utf-8"))
    views = []
    for frame in scene["frames"]:
        name = folder / frame["file_path"]
        name = name if name.suffix else name.with_suffix(".png")
        image = cv2.imread(str(name), cv2.IMREAD_COLOR)
        if image is None:
            raise SystemExit(f"{name}: cannot be read")
        height, width = image.shape[:2]
        focal = scene.get("fl_x") or 0.5 * width / math.tan(0.5 * scene["camera_angle_x"])
        center = scene.get("cx", 0.5 * width), scene.get("cy", 0.5 * height)
        lens = np.array([[focal, 0, center[0] - 0.5], [0, scene.get("fl_y", focal), center[1] - 0.5],
                         [0, 0, 1]])
        enlarge = np.array([[ENLARGED, 0, 0.5 * (ENLARGED - 1)],
                            [0, ENLARGED, 0.5 * (ENLARGED - 1)], [0, 0, 1]])
        size = (width * ENLARGED, height * ENLARGED)
        image = cv2.resize(image, size, interpolation=cv2.INTER_CUBIC)
        views.append(View(image, enlarge @ lens, np.array(frame["transform_matrix"])))
    return views


def neighbours(views, index, center):
    """The views that one is matched with: the nearest ones that are not too near."""
    def direction(view):
        return (view.eye - center) / np.linalg.norm(view.eye - center)

    own = direction(views[index])
    angles = [math.degrees(math.acos(np.clip(own @ direction(view), -1, 1))) for view in views]
    return [k for k in np.argsort(angles) if angles[k] > LEAST_ANGLE][:NEIGHBOURS]


def pair_depths(a, b, center, radius):
    """The depth of each pixel of `a`, from its disparities with `b`; 0 where there is none."""
    height, width = a.image.shape[:2]
    baseline = b.eye - a.eye
    x = baseline / np.linalg.norm(baseline)
    y = np.cross(a.rotation[2] + b.rotation[2], x)
    y /= np.linalg.norm(y)
    rotation = np.stack([x, y, np.cross(x, y)])
    focal = a.lens[0, 0]

    def rectified(view):
        """The photograph on the common plane, with the object in the middle."""
        place = rotation @ (center - view.eye)
        lens = np.array([[focal, 0, 0.5 * width - focal * place[0] / place[2]],
                         [0, focal, 0.5 * height - focal * place[1] / place[2]], [0, 0, 1]])
        homography = lens @ rotation @ view.rotation.T @ np.linalg.inv(view.lens)
        return cv2.warpPerspective(view.image, homography, (width, height)), homography, lens, place[2]

    left, to_left, lens_a, middle = rectified(a)
    right, _, lens_b, _ = rectified(b)
    shift, length = lens_a[0, 2] - lens_b[0, 2], np.linalg.norm(baseline)
    near, far = max(middle - radius, 0.05 * middle), middle + radius
    least = math.floor(focal * length / far + shift)
    count = 16 * math.ceil((focal * length / near + shift - least) / 16)
    matcher = cv2.StereoSGBM_create(
        minDisparity=least, numDisparities=count, blockSize=BLOCK, P1=8 * 3 * BLOCK**2,
        P2=32 * 3 * BLOCK**2, uniquenessRatio=5, speckleWindowSize=50, speckleRange=2)
    forward = matcher.compute(left, right) / 16.0
    backward = matcher.compute(right[:, ::-1].copy(), left[:, ::-1].copy())[:, ::-1] / 16.0
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    other = np.round(columns - forward).astype(int)
    inside = (forward >= least) & (other >= 0) & (other < width)
    agrees = np.abs(backward[rows, np.clip(other, 0, width - 1)] - forward) <= 1.0
    is_known = inside & agrees & (forward - shift > 0)
    depth = np.where(is_known, focal * length / np.where(is_known, forward - shift, 1.0), 0.0)
    # Both frames have the same eye: a pixel of `a` is looked up by the homography.
    pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1).reshape(-1, 3) @ to_left.T
    maps = (pixels[:, :2] / pixels[:, 2:]).astype(np.float32).reshape(height, width, 2)
    depth = cv2.remap(depth.astype(np.float32), maps, None, cv2.INTER_NEAREST, borderValue=0)
    # The depth along the axis of `a`.
    directions = a.rays()
    along = (directions @ rotation.T)[:, 2].reshape(height, width)
    return np.where(along > 0, depth / np.where(along > 0, along, 1.0), 0.0)


def view_depths(views, index, center, radius):
    """The depths of a view that at least two neighbours agree on."""
    others = neighbours(views, index, center)
    all_depths = [pair_depths(views[index], views[k], center, radius) for k in others]
    stack = np.stack(all_depths)
    stack[stack == 0] = np.nan
    with np.errstate(all="ignore"):
        middle = np.nanmedian(np.nan_to_num(stack, nan=np.nan), axis=0)
        close = np.abs(stack - middle) < AGREEMENT * radius
        mean = np.nanmean(np.where(close, stack, np.nan), axis=0)
    return np.where(close.sum(axis=0) >= 2, mean, 0.0)


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


def by_volume(views, depths, radius):
    """The mesh of a volume of truncated distances."""
    voxel = radius / VOXELS
    volume = open3d.pipelines.integration.ScalableTSDFVolume(
        voxel_length=voxel, sdf_trunc=4 * voxel,
        color_type=open3d.pipelines.integration.TSDFVolumeColorType.RGB8)
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


def by_poisson(views, depths, radius):
    """The closed mesh by Poisson's equation, and the number of points."""
    cloud = open3d.geometry.PointCloud()
    for view, depth in zip(views, depths):
        own = open3d.geometry.PointCloud()
        kept = depth.ravel() > 0
        points = view.eye + view.rays()[kept] * depth.ravel()[kept, None]
        own.points = open3d.utility.Vector3dVector(points)
        search = open3d.geometry.KDTreeSearchParamHybrid(radius=0.04 * radius, max_nn=40)
        own.estimate_normals(search)
        own.orient_normals_towards_camera_location(view.eye)
        cloud += own
    cloud = cloud.voxel_down_sample(0.5 * radius / VOXELS)
    mesh, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        cloud, depth=OCTREE, n_threads=1)
    return mesh, len(cloud.points)


def main():
    start = time.perf_counter()
    views = read(options.data)
    center, radius = np.array(options.center), options.radius
    indices = range(len(views))
    first = []
    for k in indices:
        first.append(view_depths(views, k, center, radius))
        peers.progress(f"depths of {k + 1} of {len(views)} photographs")
    depths = [consistent(views, first, k, center, radius) for k in indices]
    matched = time.perf_counter() - start
    options.output.mkdir(parents=True, exist_ok=True)
    rows = []
    for name in ["tsdf", "poisson"]:
        begin, points = time.perf_counter(), None
        if name == "tsdf":
            mesh = by_volume(views, depths, radius)
        else:
            mesh, points = by_poisson(views, depths, radius)
        if len(mesh.triangles) == 0:
            peers.progress(f"{name}: no surface")
            continue
        path = options.output / f"{name}.ply"
        open3d.io.write_triangle_mesh(str(path), mesh)
        seconds = matched + time.perf_counter() - begin
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
