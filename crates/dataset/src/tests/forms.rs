//! Forms of data sets from one set of cameras: each agrees with the NeRF form of the same cameras.
//! The writers here share no code with the readers.

use std::path::PathBuf;

use super::*;

/// The largest difference of a camera's numbers from those of the NeRF form.
const SAME: f64 = 1e-4;

/// Writes the photographs `folder/{i:03}.png` of `size` pixels for cameras of the full size.
pub(super) fn write_photographs(folder: &Path, cameras: &[Camera], size: [u32; 2]) {
    std::fs::create_dir_all(folder).unwrap();
    for (i, camera) in cameras.iter().enumerate() {
        let path = folder.join(format!("{i:03}.png"));
        write_image(&path, &photograph(&resized(camera, size))).unwrap();
    }
}

/// A camera whose film has another number of pixels.
pub(super) fn resized(camera: &Camera, [width, height]: [u32; 2]) -> Camera {
    let x = f64::from(width) / f64::from(camera.width);
    let y = f64::from(height) / f64::from(camera.height);
    let (focal, principal) = (camera.focal * DVec2::new(x, y), camera.principal * DVec2::new(x, y));
    Camera { width, height, focal, principal, ..*camera }
}

/// Checks that a data set has the cameras and the photographs of the NeRF form of `cameras`.
pub(super) fn assert_agrees_with_nerf(path: &Path, cameras: &[Camera]) -> Dataset {
    let nerf = tempfile::tempdir().unwrap();
    write_nerf(nerf.path(), "transforms.json", cameras);
    let expected = load(nerf.path(), &LoadOptions::default()).unwrap();
    let found = load(path, &LoadOptions::default()).unwrap();
    let (expected, views) = (in_order(&expected), in_order(&found));
    assert_eq!(views.len(), expected.len());
    for (a, b) in views.iter().zip(&expected) {
        let (x, y) = (&a.camera, &b.camera);
        assert_eq!((x.width, x.height), (y.width, y.height), "{}", a.name);
        for (p, q) in [(x.focal, y.focal), (x.principal, y.principal)] {
            assert!((p - q).abs().max_element() <= SAME, "{}: {p} for {q}", a.name);
        }
        let axes = |c: &Camera| [c.eye, c.right, c.up, c.forward];
        for (p, q) in axes(x).into_iter().zip(axes(y)) {
            assert!((p - q).abs().max_element() <= SAME, "{}: {p} for {q}", a.name);
        }
        assert_eq!(a.image, b.image, "{}", a.name);
    }
    found
}

/// Cameras with the principal point in the film's centre and one focal length.
pub(super) fn centred(count: usize) -> Vec<Camera> {
    let centre = DVec2::new(f64::from(WIDTH), f64::from(HEIGHT)) / 2.0;
    let change = |c| Camera { principal: centre, focal: DVec2::splat(90.0), ..c };
    cameras(count).into_iter().map(change).collect()
}

/// The numbers of `poses_bounds.npy`, by rows.
pub(super) fn poses_bounds(cameras: &[Camera]) -> Vec<f64> {
    let row = |c: &Camera| {
        let last = [f64::from(c.height), f64::from(c.width), c.focal.x];
        let rows =
            (0..3).flat_map(move |r| [-c.up[r], c.right[r], -c.forward[r], c.eye[r], last[r]]);
        rows.chain([2.0, 4.0]).collect::<Vec<_>>()
    };
    cameras.iter().flat_map(row).collect()
}

pub(super) fn write_array(path: &Path, shape: &[u64], numbers: &[f64]) {
    use npyz::WriterBuilder;
    let file = std::fs::File::create(path).unwrap();
    let options = npyz::WriteOptions::new().default_dtype().shape(shape);
    let mut array = options.writer(file).begin_nd().unwrap();
    array.extend(numbers.iter().copied()).unwrap();
    array.finish().unwrap();
}

#[test]
fn llff_agrees_with_nerf_at_full_and_reduced_size() {
    let folder = tempfile::tempdir().unwrap();
    let all = centred(9);
    let file = folder.path().join("poses_bounds.npy");
    write_array(&file, &[9, 17], &poses_bounds(&all));
    refused(folder.path(), &["images", "no such folder", "images_4"]);
    write_photographs(&folder.path().join("images_4"), &all, [12, 10]);
    let small: Vec<Camera> = all.iter().map(|c| resized(c, [12, 10])).collect();
    let found = assert_agrees_with_nerf(folder.path(), &small);
    assert_eq!(found.notes.len(), 1);
    assert!(found.notes[0].contains("images_4") && found.notes[0].contains("48 x 40 to 12 x 10"));
    write_photographs(&folder.path().join("images"), &all, [WIDTH, HEIGHT]);
    assert!(assert_agrees_with_nerf(folder.path(), &all).notes.is_empty());
    // The numbers in the names tell which image is missing, but not without the first one.
    std::fs::remove_dir_all(folder.path().join("images_4")).unwrap();
    std::fs::remove_file(folder.path().join("images/004.png")).unwrap();
    let found = load(folder.path(), &LoadOptions::default()).unwrap();
    assert!(found.notes[0].starts_with("1 of 9 images is missing"), "{:?}", found.notes);
    for (view, camera) in in_order(&found).into_iter().zip(all[..4].iter().chain(&all[5..])) {
        assert_same_camera(&view.camera, camera, 1e-9);
    }
    std::fs::remove_file(folder.path().join("images/000.png")).unwrap();
    refused(folder.path(), &["poses_bounds.npy", "9 rows", "7, one for each image"]);
}

#[test]
fn poses_of_llff_may_be_stored_by_columns() {
    use npyz::WriterBuilder;
    let folder = tempfile::tempdir().unwrap();
    let all = centred(9);
    write_photographs(&folder.path().join("images"), &all, [WIDTH, HEIGHT]);
    let numbers = poses_bounds(&all);
    let file = std::fs::File::create(folder.path().join("poses_bounds.npy")).unwrap();
    let options = npyz::WriteOptions::new().default_dtype().shape(&[9, 17]);
    let mut array = options.order(npyz::Order::Fortran).writer(file).begin_nd().unwrap();
    let by_columns = (0..17).flat_map(|c| (0..9).map(move |r| 17 * r + c));
    array.extend(by_columns.map(|i| numbers[i])).unwrap();
    array.finish().unwrap();
    assert_agrees_with_nerf(folder.path(), &all);
}

#[test]
fn wrong_poses_of_llff_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let all = centred(3);
    let file = folder.path().join("poses_bounds.npy");
    write_photographs(&folder.path().join("images"), &all, [WIDTH, HEIGHT]);
    let good = poses_bounds(&all);
    let with = |at: usize, value: f64| {
        let mut numbers = good.clone();
        numbers[at] = value;
        write_array(&file, &[3, 17], &numbers);
    };
    for (at, value, words) in [
        (21, -48.0, ["row 1 size", "height -48"]),
        (31, 0.0, ["row 1 size", "focal length 0"]),
        (0, 5.0, ["row 0 pose", "determinant"]),
    ] {
        with(at, value);
        refused(folder.path(), &words);
    }
    write_array(&file, &[3, 15], &good[..45]);
    refused(folder.path(), &["shape [3, 15]", "N x 17"]);
    with(0, good[0]);
    let whole = std::fs::read(&file).unwrap();
    for length in [0, 5, 60, whole.len() - 1] {
        std::fs::write(&file, &whole[..length]).unwrap();
        refused(folder.path(), &["poses_bounds.npy", "N x 17"]);
    }
}

/// Writes `cams/` and the photographs in `images`.
pub(super) fn write_cams(folder: &Path, cameras: &[Camera], images: &str) {
    std::fs::create_dir_all(folder.join("cams")).unwrap();
    for (i, c) in cameras.iter().enumerate() {
        let (r, t) = world_to_camera(c);
        let m = r.transpose();
        let mut text = "extrinsic\n".to_owned();
        for (row, t) in [m.x_axis, m.y_axis, m.z_axis].into_iter().zip(t.to_array()) {
            text += &format!("{} {} {} {t}\n", row.x, row.y, row.z);
        }
        text += &format!("0.0 0.0 0.0 1.0\n\nintrinsic\n{} 0 {}\n", c.focal.x, c.principal.x);
        text += &format!("0.0 {} {}\n0 0 1\n\n2.0 0.1 128 4.0\n", c.focal.y, c.principal.y);
        std::fs::write(folder.join(format!("cams/{i:03}_cam.txt")), text).unwrap();
    }
    std::fs::write(folder.join("cams/pair.txt"), "0\n").unwrap();
    write_photographs(&folder.join(images), cameras, [WIDTH, HEIGHT]);
}

#[test]
fn blended_mvs_agrees_with_nerf_and_wrong_files_are_refused() {
    let all = cameras(9);
    for images in ["blended_images", "images"] {
        let folder = tempfile::tempdir().unwrap();
        write_cams(folder.path(), &all, images);
        // The copy with a mask is not another view.
        let copy = folder.path().join(images).join("000_masked.png");
        std::fs::copy(folder.path().join(images).join("001.png"), copy).unwrap();
        assert!(assert_agrees_with_nerf(folder.path(), &all).notes.is_empty());
        std::fs::remove_file(folder.path().join(images).join("003.png")).unwrap();
        let found = load(folder.path(), &LoadOptions::default()).unwrap();
        assert_eq!(found.notes, [format!("1 of 9 images is missing and left out: {images}/003")]);
    }
    let folder = tempfile::tempdir().unwrap();
    write_cams(folder.path(), &all, "blended_images");
    let file = folder.path().join("cams/004_cam.txt");
    let good = std::fs::read_to_string(&file).unwrap();
    let first = good.split_whitespace().nth(1).unwrap();
    let cases = [
        (good.replace("extrinsic", "intrinsic"), ["004_cam.txt", "found intrinsic"]),
        (good.replace("0.0 0.0 0.0 1.0", "0 0 1 1"), ["extrinsic", "last row"]),
        (good.replace("90 0", "NaN 0"), ["intrinsic", "found [NaN"]),
        (good.replace("90 0", "-90 0"), ["intrinsic", "fx and fy above 0"]),
        (good.replace("0 0 1\n", "0 0 2\n"), ["intrinsic", "K = [fx"]),
        (good[..good.len() / 4].to_owned(), ["extrinsic", "the file's end"]),
        (good[..good.find("90 0").unwrap() + 4].to_owned(), ["intrinsic", "the file's end"]),
        (good.replacen(first, "3", 1), ["extrinsic", "determinant"]),
    ];
    for (text, words) in cases {
        std::fs::write(&file, text).unwrap();
        refused(folder.path(), &words);
    }
}

/// A similarity of the world, as `rotation · x · scale + translation`.
pub(super) struct World {
    pub(super) rotation: DMat3,
    pub(super) scale: f64,
    pub(super) translation: DVec3,
}

fn text(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

/// The camera file of Metashape of these cameras. `world` is that of the component if
/// `has_components`, else that of the chunk.
pub(super) fn metashape(cameras: &[Camera], world: &World, has_components: bool) -> String {
    let c = &cameras[0];
    let (width, height) = (c.width, c.height);
    let [cx, cy] =
        [c.principal.x - f64::from(width) / 2.0, c.principal.y - f64::from(height) / 2.0];
    let (f, b1) = (c.focal.y, c.focal.x - c.focal.y);
    let transform = format!(
        "<transform><rotation locked=\"false\">{}</rotation><translation>{}</translation>\
         <scale>{}</scale></transform>",
        text(&world.rotation.transpose().to_cols_array()),
        text(&world.translation.to_array()),
        world.scale
    );
    let (of_component, of_chunk) =
        if has_components { (transform, String::new()) } else { (String::new(), transform) };
    let mut list = String::new();
    for (i, c) in cameras.iter().enumerate() {
        let to_chunk = world.rotation.transpose();
        let axes = [c.right, -c.up, c.forward].map(|axis| to_chunk * axis);
        let eye = to_chunk * (c.eye - world.translation) / world.scale;
        let rows = (0..3).flat_map(|r| [axes[0][r], axes[1][r], axes[2][r], eye[r]]);
        let numbers = text(&rows.chain([0.0, 0.0, 0.0, 1.0]).collect::<Vec<_>>());
        let camera = format!(
            "<camera id=\"{i}\" sensor_id=\"0\" component_id=\"0\" label=\"{i:03}\">\
             <transform>{numbers}</transform><orientation>1</orientation></camera>\n"
        );
        // Cameras may be in groups.
        list += &if i == 2 { format!("<group label=\"g\">{camera}</group>") } else { camera };
    }
    let resolution = format!("<resolution width=\"{width}\" height=\"{height}\"/>");
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<document version=\"2.0.0\">\n\
         <chunk label=\"Chunk 1\" enabled=\"true\">\n<sensors next_id=\"1\">\n\
         <sensor id=\"0\" label=\"unknown\" type=\"frame\">{resolution}\n\
         <calibration type=\"frame\" class=\"initial\">{resolution}<f>1</f></calibration>\n\
         <calibration type=\"frame\" class=\"adjusted\">{resolution}\n\
         <f>{f}</f><cx>{cx}</cx><cy>{cy}</cy><b1>{b1}</b1></calibration>\n</sensor></sensors>\n\
         <components next_id=\"1\"><component id=\"0\">{of_component}</component></components>\n\
         <cameras next_id=\"9\">{list}\
         <camera id=\"99\" sensor_id=\"0\" label=\"blurred\"/></cameras>\n\
         {of_chunk}\n</chunk></document>\n"
    )
}

#[test]
fn metashape_agrees_with_nerf_and_wrong_files_are_refused() {
    let all = cameras(9);
    let folder = tempfile::tempdir().unwrap();
    let file: PathBuf = folder.path().join("cameras.xml");
    write_photographs(&folder.path().join("images"), &all, [WIDTH, HEIGHT]);
    let world = World {
        rotation: DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(-1.1),
        scale: 2.5,
        translation: DVec3::new(1.0, -2.0, 30.0),
    };
    for has_components in [false, true] {
        std::fs::write(&file, metashape(&all, &world, has_components)).unwrap();
        for path in [folder.path(), &file] {
            let found = assert_agrees_with_nerf(path, &all);
            assert_eq!(found.notes, ["cameras that Metashape did not align, left out: 1"]);
        }
    }
    let good = std::fs::read_to_string(&file).unwrap();
    let cases = [
        (good[..good.len() / 2].to_owned(), ["cameras.xml", "XML of Metashape"]),
        (good.replace("<sensors", &"<a>".repeat(200_000)), ["cameras.xml", "XML of Metashape"]),
        (good.replace("<f>88</f>", "<f>-8</f>"), ["sensor 0 f", "focal lengths"]),
        (good.replace("<f>88</f>", "<f>NaN</f>"), ["sensor 0 f", "1 finite numbers"]),
        (good.replace("<f>88</f>", ""), ["sensor 0 f", "above 0"]),
        (good.replace("<b1>", "<p3>0.1</p3><b1>"), ["sensor 0 p3", "found 0.1"]),
        (good.replace("width=\"48\"", "width=\"x\""), ["resolution width", "found x"]),
        (good.replace("sensor_id=\"0\"", "sensor_id=\"3\""), ["sensor 3", "no such sensor"]),
        (
            good.replace("calibration type=\"frame\"", "calibration type=\"spherical\""),
            ["cameras", "spherical or cylindrical sensors"],
        ),
        (good.replace("<scale>2.5", "<scale>0"), ["component/transform/scale", "above 0"]),
        (good.replace("0 0 0 1</", "0 0 0 2</"), ["camera \"000\" transform", "last row"]),
        (good.replace("0 0 0 1</", "</"), ["camera \"000\" transform", "16 finite numbers"]),
        (good.replace("label=\"00", "title=\"00"), ["cameras", "without a label"]),
        (
            good.replace("<camera ", "<camera_ ").replace("</camera>", "</camera_>"),
            ["cameras", "none with a transform"],
        ),
    ];
    for (text, words) in cases {
        std::fs::write(&file, text).unwrap();
        refused(folder.path(), &words);
    }
    std::fs::write(&file, metashape(&all, &world, true)).unwrap();
    for i in [1, 5] {
        std::fs::remove_file(folder.path().join(format!("images/{i:03}.png"))).unwrap();
    }
    let found = load(folder.path(), &LoadOptions::default()).unwrap();
    let note = "2 of 9 images are missing and left out: images/001, images/005";
    assert!(found.notes.iter().any(|n| n == note), "{:?}", found.notes);
}

#[test]
fn forms_without_a_reader_are_named_with_a_way_to_convert_them() {
    let cases = [
        ("keyframes/corrected_cameras/1.json", "ns-process-data polycam"),
        ("scan.r3d", "ns-process-data record3d"),
        ("sfm_data.json", "openMVG_main_openMVG2Colmap"),
        ("reconstruction.json", "opensfm export_colmap"),
        ("opensfm/reconstruction.json", "ns-process-data odm"),
        ("scan.psx", "Export Cameras"),
        ("database.db", "colmap mapper"),
        ("bundle.out", "Bundler"),
        ("a.nvm", "VisualSFM"),
        ("views/view_0000.mve/meta.ini", "MVE"),
        ("a.mg", "Meshroom"),
        ("pose/0.txt", "ScanNet"),
        ("images/a.jpg", "docs/captures.md"),
    ];
    for (name, word) in cases {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join(name);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::create_dir_all(folder.path().join("color")).unwrap();
        std::fs::write(file, "x").unwrap();
        refused(folder.path(), &["no camera file", word]);
    }
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.csv"), "#name,x,y,alt,heading,pitch,roll,f\n").unwrap();
    refused(folder.path(), &["ns-process-data realitycapture"]);
}

#[test]
fn folders_without_cameras_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    refused(folder.path(), &["no camera file", "transforms.json", "COLMAP"]);
    refused(&folder.path().join("nowhere"), &["nowhere"]);
}
