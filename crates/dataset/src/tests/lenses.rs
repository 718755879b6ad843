//! Photographs through lenses: the undistorted image is that of a pinhole camera. The projections
//! here are written from the documentation of OpenCV, COLMAP and Metashape; they share no code with
//! the reader, and are inverted by Newton's method with differences.

use super::*;

/// The least PSNR of an undistorted photograph against the pinhole image, in decibels. All have
/// more than 75.
const LEAST_PSNR: f64 = 70.0;

/// Film of the photographs, in pixels.
const SIZE: [u32; 2] = [120, 90];

/// Where a lens shows the direction (x, y, z), in tangents or angles; y down, z forward.
type Projection = fn(DVec3) -> DVec2;

/// An environment that is smooth in the direction, in linear RGB.
fn radiance(direction: DVec3) -> [f32; 3] {
    let d = direction.normalize();
    let wave = |phase: f64| 0.5 + 0.3 * (3.0 * d.x + 2.0 * d.y - d.z + phase).sin();
    [wave(0.0), wave(2.0) * (0.8 + 0.2 * d.z), wave(4.0 * d.y)].map(|v| v as f32)
}

/// The photograph of the environment through a lens, exact at each pixel's centre.
fn photograph_through(camera: &Camera, projection: Projection) -> Film {
    let mut film = Film::new(camera.width, camera.height);
    // Directions are parametrised by angle and azimuth, so that none is out of reach.
    let direction = |a: DVec2| {
        let angle = a.length().max(1e-9);
        DVec3::new(a.x / angle * angle.sin(), a.y / angle * angle.sin(), angle.cos())
    };
    for (i, pixel) in film.pixels.iter_mut().enumerate() {
        let (x, y) = (i as u32 % camera.width, i as u32 / camera.width);
        let u = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let q = (u - camera.principal) / camera.focal;
        let mut a = q * 0.8;
        for _ in 0..50 {
            let h = 1e-6;
            let at = |a: DVec2| projection(direction(a));
            let columns = [DVec2::X, DVec2::Y].map(|e| (at(a + h * e) - at(a - h * e)) / (2.0 * h));
            a -= glam::DMat2::from_cols(columns[0], columns[1]).inverse() * (at(a) - q);
        }
        assert!((projection(direction(a)) - q).length() < 1e-9, "no convergence at {u}");
        let d = direction(a);
        *pixel = radiance(camera.right * d.x - camera.up * d.y + camera.forward * d.z);
    }
    film
}

fn psnr(a: &Film, b: &Film) -> f64 {
    let errors = a.pixels.as_flattened().iter().zip(b.pixels.as_flattened());
    let sum: f64 = errors.map(|(a, b)| f64::from(a - b).powi(2)).sum();
    -10.0 * (sum / a.pixels.as_flattened().len() as f64).log10()
}

fn pinhole(d: DVec3) -> DVec2 {
    DVec2::new(d.x / d.z, d.y / d.z)
}

/// k1 = −0.1, k2 = 0.05, k3 = −0.005, p1 = 0.003, p2 = −0.002, as OpenCV's `projectPoints`.
fn brown(d: DVec3) -> DVec2 {
    let DVec2 { x, y } = pinhole(d);
    let r2 = x * x + y * y;
    let radial = 1.0 - 0.1 * r2 + 0.05 * r2.powi(2) - 0.005 * r2.powi(3);
    DVec2::new(
        x * radial + 2.0 * 0.003 * x * y - 0.002 * (r2 + 2.0 * x * x),
        y * radial + 0.003 * (r2 + 2.0 * y * y) - 2.0 * 0.002 * x * y,
    )
}

/// The same with k4 = 0.02 as the coefficient of r⁸ (nerfstudio, Metashape).
fn brown_with_r8(d: DVec3) -> DVec2 {
    let tangents = pinhole(d);
    brown(d) + tangents * 0.02 * tangents.length_squared().powi(4)
}

/// k1, k2, k3 = −0.1, 0.05, −0.005 over k4, k5, k6 = 0.03, 0.01, 0.001.
fn rational(d: DVec3) -> DVec2 {
    let p = pinhole(d);
    let r2 = p.length_squared();
    let above = 1.0 - 0.1 * r2 + 0.05 * r2.powi(2) - 0.005 * r2.powi(3);
    p * above / (1.0 + 0.03 * r2 + 0.01 * r2.powi(2) + 0.001 * r2.powi(3))
}

/// The angle to the axis, in the direction of the azimuth.
fn equidistant(d: DVec3) -> DVec2 {
    let across = DVec2::new(d.x, d.y);
    across * (across.length().atan2(d.z) / across.length())
}

/// k1 to k4 = 0.05, −0.02, 0.004, −0.0002 of OpenCV's fisheye model.
fn fisheye(d: DVec3) -> DVec2 {
    let a = equidistant(d);
    let t2 = a.length_squared();
    a * (1.0 + 0.05 * t2 - 0.02 * t2.powi(2) + 0.004 * t2.powi(3) - 0.0002 * t2.powi(4))
}

/// k1 = 0.05 alone.
fn simple_fisheye(d: DVec3) -> DVec2 {
    let a = equidistant(d);
    a * (1.0 + 0.05 * a.length_squared())
}

/// k1 = 0.05, k2 = −0.02.
fn radial_fisheye(d: DVec3) -> DVec2 {
    let a = equidistant(d);
    a * (1.0 + 0.05 * a.length_squared() - 0.02 * a.length_squared().powi(2))
}

/// k1, k2, k3, k4 as [`fisheye`], p1 = 0.003, p2 = −0.002, sx1 = 0.004, sy1 = −0.001.
fn thin_prism(d: DVec3) -> DVec2 {
    let (DVec2 { x, y }, r2) = (equidistant(d), equidistant(d).length_squared());
    fisheye(d)
        + DVec2::new(
            2.0 * 0.003 * x * y - 0.002 * (r2 + 2.0 * x * x) + 0.004 * r2,
            0.003 * (r2 + 2.0 * y * y) - 2.0 * 0.002 * x * y - 0.001 * r2,
        )
}

/// Cameras of half-angles 50 and 40 degrees in tangents.
fn wide_cameras() -> Vec<Camera> {
    let (focal, principal) = (DVec2::new(70.0, 71.0), DVec2::new(58.5, 46.0));
    let change = |c: Camera| Camera { width: SIZE[0], height: SIZE[1], focal, principal, ..c };
    cameras(3).into_iter().map(change).collect()
}

/// Checks the undistorted photographs of a data set of three views.
fn assert_undistorted(path: &Path, what: &str) -> Dataset {
    let dataset = load(path, &LoadOptions::default()).unwrap();
    assert_eq!(dataset.train.len() + dataset.test.len(), 3, "{what}");
    for view in dataset.train.iter().chain(&dataset.test) {
        let mut expected = Film::new(view.camera.width, view.camera.height);
        for (i, pixel) in expected.pixels.iter_mut().enumerate() {
            let (x, y) = (i as u32 % view.camera.width, i as u32 / view.camera.width);
            let u = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            *pixel = radiance(view.camera.direction(u));
        }
        let found = psnr(&view.image, &expected);
        assert!(found > LEAST_PSNR, "{what}: {found:.1} dB");
    }
    dataset
}

fn write_through(folder: &Path, cameras: &[Camera], projection: Projection) {
    std::fs::create_dir_all(folder.join("images")).unwrap();
    for (i, camera) in cameras.iter().enumerate() {
        let film = photograph_through(camera, projection);
        write_image(&folder.join(format!("images/{i:03}.exr")), &film).unwrap();
    }
}

fn coefficients(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

#[test]
fn colmap_lenses_are_undistorted() {
    let all = wide_cameras();
    let (f, c) = (70.0, all[0].principal);
    let k = [0.05, -0.02, 0.004, -0.0002];
    let two = [f, 71.0, c.x, c.y];
    let cases: [(&str, Projection, bool, Vec<f64>); 5] = [
        ("SIMPLE_RADIAL_FISHEYE", simple_fisheye, true, vec![f, c.x, c.y, 0.05]),
        ("RADIAL_FISHEYE", radial_fisheye, true, vec![f, c.x, c.y, 0.05, -0.02]),
        ("OPENCV_FISHEYE", fisheye, false, [&two[..], &k].concat()),
        ("FULL_OPENCV", rational, false, {
            let radial = [-0.1, 0.05, 0.0, 0.0, -0.005, 0.03, 0.01, 0.001];
            [&two[..], &radial].concat()
        }),
        ("THIN_PRISM_FISHEYE", thin_prism, false, {
            let rest = [0.05, -0.02, 0.003, -0.002, 0.004, -0.0002, 0.004, -0.001];
            [&two[..], &rest].concat()
        }),
    ];
    for (model, projection, is_square, parameters) in cases {
        let focal = if is_square { DVec2::splat(f) } else { DVec2::new(f, 71.0) };
        let all: Vec<Camera> = all.iter().map(|c| Camera { focal, ..*c }).collect();
        let folder = tempfile::tempdir().unwrap();
        write_through(folder.path(), &all, projection);
        let [w, h] = SIZE;
        let text = format!("1 {model} {w} {h} {}\n", coefficients(&parameters));
        std::fs::write(folder.path().join("cameras.txt"), text).unwrap();
        let mut text = String::new();
        for (i, c) in all.iter().enumerate() {
            let (r, t) = world_to_camera(c);
            let q = glam::DQuat::from_mat3(&r);
            let numbers = coefficients(&[q.w, q.x, q.y, q.z, t.x, t.y, t.z]);
            text += &format!("{i} {numbers} 1 {i:03}.exr\n\n");
        }
        std::fs::write(folder.path().join("images.txt"), text).unwrap();
        let dataset = assert_undistorted(folder.path(), model);
        assert_eq!(dataset.notes.len(), usize::from(model.contains("FISHEYE")), "{model}");
    }
}

#[test]
fn nerfstudio_lenses_are_undistorted_and_fisheyes_reach_55_degrees() {
    let fisheye_keys = || json!({"k1": 0.05, "k2": -0.02, "k3": 0.004, "k4": -0.0002});
    let brown_keys = || json!({"k1": -0.1, "k2": 0.05, "k3": -0.005, "p1": 0.003, "p2": -0.002});
    let with = |keys: Value, more: Value| {
        let mut keys = keys;
        more.as_object().unwrap().iter().for_each(|(key, value)| keys[key] = value.clone());
        keys
    };
    let cases: [(Projection, Value); 5] = [
        (brown, with(brown_keys(), json!({"camera_model": "OPENCV"}))),
        (brown_with_r8, with(brown_keys(), json!({"k4": 0.02, "camera_model": "PERSPECTIVE"}))),
        (
            rational,
            json!({"k1": -0.1, "k2": 0.05, "k3": -0.005, "k4": 0.03, "k5": 0.01, "k6": 0.001}),
        ),
        (fisheye, with(fisheye_keys(), json!({"camera_model": "OPENCV_FISHEYE"}))),
        (fisheye, with(fisheye_keys(), json!({"is_fisheye": true}))),
    ];
    for (number, (projection, keys)) in cases.into_iter().enumerate() {
        // A fisheye film that ends 77 degrees from the axis.
        let is_fisheye = number > 2;
        let focal = DVec2::splat(if is_fisheye { 46.0 } else { 70.0 });
        let all: Vec<Camera> = wide_cameras().iter().map(|c| Camera { focal, ..*c }).collect();
        let folder = tempfile::tempdir().unwrap();
        write_through(folder.path(), &all, projection);
        let mut root = write_nerf(folder.path(), "transforms.json", &all);
        for i in 0..3 {
            root["frames"][i]["file_path"] = json!(format!("images/{i:03}.exr"));
            // The coefficients are those of the frame, or of the file.
            for (key, value) in keys.as_object().unwrap().iter().filter(|_| number % 2 == 0) {
                root["frames"][i][key] = value.clone();
                root[key] = if value.is_number() { json!(9) } else { Value::Null };
            }
        }
        if number % 2 == 1 {
            root = with(root, keys);
        }
        write_json(&folder.path().join("transforms.json"), &root);
        let dataset = assert_undistorted(folder.path(), &format!("case {number}"));
        if is_fisheye {
            let camera = dataset.train[0].camera;
            let reach =
                (camera.principal.x.max(120.0 - camera.principal.x) / camera.focal.x).atan();
            assert!((reach.to_degrees() - 55.0).abs() < 0.01, "{}", reach.to_degrees());
            assert!(dataset.notes[0].contains("109 x 9"), "{:?}", dataset.notes);
        } else {
            assert!(dataset.notes.is_empty(), "{:?}", dataset.notes);
        }
    }
}

#[test]
fn metashape_lenses_are_undistorted() {
    for (kind, projection, keys) in [
        // Metashape's p1 and p2 stand in the other order than OpenCV's.
        (
            "frame",
            brown_with_r8 as Projection,
            "<k1>-0.1</k1><k2>0.05</k2><k3>-0.005</k3><k4>0.02</k4><p1>-0.002</p1><p2>0.003</p2>",
        ),
        ("fisheye", fisheye, "<k1>0.05</k1><k2>-0.02</k2><k3>0.004</k3><k4>-0.0002</k4>"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let all: Vec<Camera> =
            wide_cameras().iter().map(|c| Camera { focal: DVec2::splat(70.0), ..*c }).collect();
        write_through(folder.path(), &all, projection);
        let mut list = String::new();
        for (i, c) in all.iter().enumerate() {
            let rows = (0..3).flat_map(|r| [c.right[r], -c.up[r], c.forward[r], c.eye[r]]);
            let numbers = rows.chain([0.0, 0.0, 0.0, 1.0]).collect::<Vec<_>>();
            let transform = format!("<transform>{}</transform>", coefficients(&numbers));
            list += &format!("<camera sensor_id=\"7\" label=\"{i:03}.exr\">{transform}</camera>");
        }
        let text = format!(
            "<document><chunk><sensors><sensor id=\"7\" type=\"{kind}\">\
             <resolution width=\"120\" height=\"90\"/><calibration><f>70</f><cx>-1.5</cx>\
             <cy>1</cy>{keys}</calibration></sensor></sensors><cameras>{list}</cameras>\
             </chunk></document>"
        );
        std::fs::write(folder.path().join("a.xml"), text).unwrap();
        assert_undistorted(folder.path(), kind);
    }
}

#[test]
fn lenses_of_no_camera_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let json = write_nerf(folder.path(), "transforms.json", &cameras(9));
    for (key, number, words) in [
        ("fl_x", 1e300, ["focal length", "1e300"]),
        ("fl_x", 1e-9, ["focal length", "1e-9"]),
        ("cx", 1e30, ["principal point", "1e30"]),
    ] {
        let mut json = json.clone();
        json[key] = number.into();
        write_json(&folder.path().join("transforms.json"), &json);
        refused(folder.path(), &[&words[..], &["pixels"]].concat());
    }
}
