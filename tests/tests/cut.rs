//! Cuts of a run's mesh: by photographs, by regions and by the plane of a table.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::collections::HashMap;
use std::fs;

use glam::DVec3;
use serde_json::{Value, json};
use tests::input::{Folder, fit_two_iterations, refused};
use tests::{dsdf_json, dsdf_ok};

/// The width and height of the photographs in pixels, and their focal length.
const SIZE: u32 = 64;
const FOCAL: f64 = 106.0;

/// The radius of the masks' discs in pixels.
const DISC: f64 = 10.0;

/// Half the diagonal of the octahedron on the table.
const REACH: f64 = 0.3;

/// The height of the table: its plane is n·x = −HEIGHT.
const HEIGHT: f64 = 0.1;

/// The table's normal, ten degrees off the z axis.
fn normal() -> DVec3 {
    let (sin, cos) = 10f64.to_radians().sin_cos();
    DVec3::new(sin, 0.0, cos)
}

/// The rows right, up, back and the eye of eight cameras, 45 degrees above the centre.
fn cameras() -> Vec<[DVec3; 4]> {
    let camera = |i: u32| {
        let (sin, cos) = (f64::from(i) * 45.0 + 22.5).to_radians().sin_cos();
        let back = DVec3::new(cos, sin, 1.0).normalize();
        let right = DVec3::Z.cross(back).normalize();
        [right, back.cross(right), back, 4.0 * back]
    };
    (0..8).map(camera).collect()
}

/// The film position of a point.
fn project([right, up, back, eye]: &[DVec3; 4], x: DVec3) -> [f64; 2] {
    let r = x - eye;
    let depth = -r.dot(*back);
    let half = f64::from(SIZE) / 2.0;
    [half + FOCAL * r.dot(*right) / depth, half - FOCAL * r.dot(*up) / depth]
}

/// A network of two hidden layers with the field min(table, octahedron): with a = n·x + HEIGHT and
/// b = |x| + |y| + |z − 0.2| − REACH, it is a − max(a − b, 0). The octahedron stands on the table
/// where z = −0.1.
fn model() -> Vec<u8> {
    let n = normal();
    // The first layer has max(±a, 0), max(±x, 0), max(±y, 0) and max(±(z − 0.2), 0).
    let rows = [(n, HEIGHT), (DVec3::X, 0.0), (DVec3::Y, 0.0), (DVec3::Z, -0.2)];
    let both = rows.map(|(row, bias)| [(row, bias), (-row, -bias)]);
    let first: Vec<f64> = both.as_flattened().iter().flat_map(|(r, _)| r.to_array()).collect();
    let first_bias: Vec<f64> = both.as_flattened().iter().map(|(_, bias)| *bias).collect();
    // The second has max(±a, 0) and max(a − b, 0).
    let (mut plus, mut minus, mut inside) = ([0.0; 8], [0.0; 8], [-1.0; 8]);
    (plus[0], plus[1], minus[0], minus[1]) = (1.0, -1.0, -1.0, 1.0);
    (inside[0], inside[1]) = (1.0, -1.0);
    let second = [plus, minus, inside].concat();
    let tensors: [(&str, Vec<usize>, Vec<f64>); 6] = [
        ("layers.0.weight", vec![8, 3], first),
        ("layers.0.bias", vec![8], first_bias),
        ("layers.1.weight", vec![3, 8], second),
        ("layers.1.bias", vec![3], vec![0.0, 0.0, REACH]),
        ("layers.2.weight", vec![1, 3], vec![1.0, -1.0, -1.0]),
        ("layers.2.bias", vec![1], vec![0.0]),
    ];
    let (mut header, mut data) = (serde_json::Map::new(), Vec::new());
    let strings = json!({"dsdf.version": "0.1.0", "activation": "relu", "encoding": "none"});
    header.insert("__metadata__".to_owned(), strings);
    for (name, shape, numbers) in tensors {
        let start = data.len();
        data.extend(numbers.iter().flat_map(|v| (*v as f32).to_le_bytes()));
        let offsets = [start, data.len()];
        let entry = json!({"dtype": "F32", "shape": shape, "data_offsets": offsets});
        header.insert(name.to_owned(), entry);
    }
    let header = Value::Object(header).to_string().into_bytes();
    [&(header.len() as u64).to_le_bytes()[..], &header, &data].concat()
}

/// A run of the octahedron on its table, in the unit sphere; with masks of a disc if asked.
fn run(folder: &Folder, with_masks: bool) -> String {
    let mut frames = Vec::new();
    fs::create_dir(folder.path("masks")).unwrap();
    for (i, [right, up, back, eye]) in cameras().into_iter().enumerate() {
        let grey = image::RgbImage::from_pixel(SIZE, SIZE, image::Rgb([90; 3]));
        grey.save(folder.path(&format!("{i}.png"))).unwrap();
        let is_in = |x: u32, y: u32| {
            let center = f64::from(SIZE) / 2.0 - 0.5;
            (f64::from(x) - center).hypot(f64::from(y) - center) <= DISC
        };
        if with_masks {
            let disc = |x, y| image::Luma([255 * u8::from(is_in(x, y))]);
            let mask = image::GrayImage::from_fn(SIZE, SIZE, disc);
            mask.save(folder.path(&format!("masks/{i}.png"))).unwrap();
        }
        let row = |k: usize| [right[k], up[k], back[k], eye[k]];
        let matrix = [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]];
        frames.push(json!({"file_path": format!("{i}.png"), "transform_matrix": matrix}));
    }
    let lens = json!({"fl_x": FOCAL, "fl_y": FOCAL, "w": SIZE, "h": SIZE, "frames": frames});
    folder.write("transforms.json", &lens);
    let (data, run) = (folder.path(""), folder.path("run"));
    let options = ["--iterations", "2", "--batch", "16", "--bounds", "0,0,0,1"];
    dsdf_ok(&[&["fit", &data, "-o", &run], &options[..]].concat());
    fs::write(folder.path("run/model.safetensors"), model()).unwrap();
    run
}

/// The vertices and the faces of an OBJ file.
fn read_obj(path: &str) -> (Vec<DVec3>, Vec<[usize; 3]>) {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for line in fs::read_to_string(path).unwrap().lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let number = |i: usize| words[i].parse::<f64>().unwrap();
        let corner = |i: usize| words[i].split('/').next().unwrap().parse::<usize>().unwrap() - 1;
        match words.first() {
            Some(&"v") => vertices.push(DVec3::new(number(1), number(2), number(3))),
            Some(&"f") => faces.push([corner(1), corner(2), corner(3)]),
            _ => {}
        }
    }
    (vertices, faces)
}

/// The report of `dsdf mesh` with these options, and the written file.
fn mesh(folder: &Folder, run: &str, name: &str, options: &[&str]) -> (Value, String) {
    let path = folder.path(name);
    let arguments = [&["mesh", run, "-o", &path, "--resolution", "128"], options].concat();
    (dsdf_json(&arguments), path)
}

/// The step of a report by its name.
fn step<'a>(report: &'a Value, by: &str) -> &'a Value {
    let steps = report["cut"].as_array().unwrap();
    steps.iter().find(|step| step["by"] == by).unwrap_or_else(|| panic!("no {by} in {report}"))
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("no number: {value}"))
}

/// Whether a point of the unit sphere is at an angle of less than acos(`cosine`) to the direction
/// of a camera.
fn is_seen(x: DVec3, cosine: f64) -> bool {
    cameras().iter().any(|camera| x.dot(camera[2]) > cosine)
}

/// The area of the points of the unit sphere that `holds` accepts, by 40,000 of them.
fn total_of_sphere(holds: impl Fn(DVec3) -> bool) -> f64 {
    let (count, golden) = (40_000, std::f64::consts::PI * (3.0 - 5f64.sqrt()));
    let point = |i: u32| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let ((sin, cos), across) = ((golden * f64::from(i)).sin_cos(), (1.0 - z * z).sqrt());
        DVec3::new(across * cos, across * sin, z)
    };
    let found = (0..count).filter(|i| holds(point(*i))).count();
    4.0 * std::f64::consts::PI * found as f64 / f64::from(count)
}

#[test]
fn the_table_is_cut_off_by_its_plane_and_the_unseen_part_by_the_cameras() {
    let folder = Folder::new();
    let run = run(&folder, false);
    let (whole, _) = mesh(&folder, &run, "whole.obj", &[]);
    assert_eq!((&whole["closed"], &whole["cut"]), (&json!(true), &json!([])));
    // The disc, the cap of the sphere below it, and the octahedron.
    let pi = std::f64::consts::PI;
    let (disc, cap) = (pi * (1.0 - HEIGHT * HEIGHT), 2.0 * pi * (1.0 - HEIGHT));
    let solid = 4.0 * 3f64.sqrt() * REACH * REACH;
    let total = disc + cap + solid;
    // The views see the points of the cap at which the normal is at an angle of less than acos(1/4)
    // to their direction: they are at the distance 4. Of the disc and the octahedron they see all.
    let seen_cap = total_of_sphere(|x| x.dot(normal()) < -HEIGHT && is_seen(x, 0.25));
    let seen_area = disc + seen_cap + solid;
    assert!((number(&whole["area"]) / total - 1.0).abs() < 0.01, "{whole} and {total}");

    let (above, path) = mesh(&folder, &run, "above.obj", &["--above", "auto"]);
    let cut = step(&above, "above");
    let plane = &cut["plane"];
    let up = cameras().iter().map(|camera| camera[1]).sum::<DVec3>().normalize();
    let degrees = up.dot(normal()).acos().to_degrees();
    assert!((number(&plane["degrees"]) - degrees).abs() < 0.1, "{plane} and {degrees}");
    let found = [0, 1, 2].map(|k| number(&plane["normal"][k]));
    assert!(DVec3::from(found).distance(normal()) < 2e-3, "{plane}");
    let point = DVec3::from([0, 1, 2].map(|k| number(&plane["point"][k])));
    assert!((point.dot(normal()) + HEIGHT).abs() < 1e-3, "{plane}");
    let share = disc / seen_area;
    assert!((number(&plane["share"]) - share).abs() < 0.02, "{plane} and {share}");
    assert!((number(&above["area"]) / solid - 1.0).abs() < 0.03, "{above} and {solid}");
    let (vertices, faces) = read_obj(&path);
    assert!(vertices.iter().all(|v| v.dot(normal()) + HEIGHT > 0.009), "below the table");
    let removed = number(&cut["faces"]) + number(&step(&above, "pieces")["faces"]);
    assert_eq!(faces.len() as f64 + removed, number(&whole["faces"]));
    // Another height, and the same on another number of threads.
    let (higher, _) = mesh(&folder, &run, "higher.obj", &["--above", "0.2"]);
    assert!(number(&higher["area"]) < 0.8 * number(&above["area"]), "{higher}");
    let (again, other) = mesh(&folder, &run, "again.obj", &["--above", "auto", "--threads", "1"]);
    assert_eq!(again, above);
    assert_eq!(fs::read(path).unwrap(), fs::read(other).unwrap());

    let (seen, path) = mesh(&folder, &run, "seen.obj", &["--cull", "seen"]);
    let share = number(&step(&seen, "seen")["area"]);
    let expected = (cap - seen_cap) / total;
    // Faces that touch the edge stay: a cell around the cap.
    assert!((0.0..0.02).contains(&(expected - share)), "{share} and {expected}");
    let (vertices, _) = read_obj(&path);
    let on_cap = |v: &&DVec3| v.dot(normal()) < -HEIGHT - 0.02;
    assert!(vertices.iter().filter(on_cap).all(|v| is_seen(*v, 0.22)), "the cap is unseen");
}

#[test]
fn masks_cut_as_projections_by_hand_do() {
    let folder = Folder::new();
    let run = run(&folder, true);
    let (_, path) = mesh(&folder, &run, "whole.obj", &[]);
    let (vertices, faces) = read_obj(&path);
    for (options, margin) in [(&[][..], 2.0), (&["--mask-margin", "0.1"], 6.4)] {
        let options = [&["--cull", "masks"], options].concat();
        let (report, _) = mesh(&folder, &run, "masks.obj", &options);
        // A pixel is in the dilated disc if a pixel of the disc is within the margin. The pixels
        // of the disc are few, so this is by brute force.
        let center = f64::from(SIZE) / 2.0 - 0.5;
        let all = |i: u32| (f64::from(i % SIZE), f64::from(i / SIZE));
        let disc: Vec<(f64, f64)> = (0..SIZE * SIZE)
            .map(all)
            .filter(|(x, y)| (x - center).hypot(y - center) <= DISC)
            .collect();
        let mut known = HashMap::new();
        let mut is_near = |x: f64, y: f64| {
            let near = || disc.iter().any(|(a, b)| (x - a).hypot(y - b) <= margin);
            *known.entry((x as i64, y as i64)).or_insert_with(near)
        };
        let views = cameras();
        let inside: Vec<bool> = vertices
            .iter()
            .map(|v| {
                views.iter().all(|view| {
                    let [x, y] = project(view, *v).map(f64::floor);
                    let film = 0.0..f64::from(SIZE);
                    !film.contains(&x) || !film.contains(&y) || is_near(x, y)
                })
            })
            .collect();
        let outside = faces.iter().filter(|f| f.iter().all(|v| !inside[*v])).count() as f64;
        let found = number(&step(&report, "masks")["faces"]);
        assert!(outside > 1000.0 && (found - outside).abs() < 30.0, "{found} and {outside}");
    }
}

#[test]
fn regions_cut_at_their_surface() {
    let folder = Folder::new();
    let run = run(&folder, false);
    let crops = ["--crop", "sphere:0,0,0.2,0.5", "--crop", "box:-0.2,-1,-0.05,1,1,1"];
    let (report, path) = mesh(&folder, &run, "crop.obj", &crops);
    let (vertices, faces) = read_obj(&path);
    assert!(!faces.is_empty() && faces.len() as f64 == number(&report["faces"]));
    for v in &vertices {
        assert!(v.distance(DVec3::Z * 0.2) <= 0.5 + 1e-6 && v.x >= -0.2 - 1e-6 && v.z >= -0.0501);
    }
    let steps = report["cut"].as_array().unwrap();
    assert_eq!(steps.iter().filter(|step| step["by"] == "crop").count(), 2);
    let left = 1.0 - steps.iter().map(|step| number(&step["area"])).sum::<f64>();
    let (whole, _) = mesh(&folder, &run, "whole.obj", &[]);
    let expected = number(&report["area"]) / number(&whole["area"]);
    assert!((left - expected).abs() < 1e-6, "{left} and {expected}");
    // The photographs are not needed for it.
    fs::remove_file(folder.path("transforms.json")).unwrap();
    mesh(&folder, &run, "crop.obj", &crops);
    let out = folder.path("seen.obj");
    refused(&["mesh", &run, "-o", &out, "--cull", "seen"], 2, &["data set"]);
}

#[test]
fn wrong_cuts_are_refused_and_write_nothing() {
    let folder = Folder::new();
    let run = fit_two_iterations(&folder);
    let out = folder.path("out.ply");
    let mesh = |flags: &[&str], words: &[&str]| {
        let fixed = ["mesh", &run, "-o", &out, "--resolution", "32"];
        refused(&[&fixed[..], flags].concat(), 2, words);
        assert!(!std::path::Path::new(&out).exists());
    };
    mesh(&["--crop", "box:0,0,0,1,nan,1"], &["--crop", "box:0,0,0,1,nan,1", "expected box:"]);
    mesh(&["--crop", "box:0,0,0,1,-1,1"], &["--crop", "below the second"]);
    mesh(&["--crop", "sphere:0,0,0,-1"], &["--crop", "a radius above 0"]);
    mesh(&["--crop", "cylinder:0,0,0,1"], &["--crop", "sphere:x,y,z,radius"]);
    mesh(&["--crop", "sphere:9,9,9,1"], &["--crop", "no face left of", "cuts that leave"]);
    mesh(&["--above", "high"], &["--above", "high", "0 to 1"]);
    mesh(&["--above", "nan"], &["--above", "0 to 1"]);
    mesh(&["--above", "-0.1"], &["--above", "0 to 1"]);
    // The run is a ball, and its cameras are all at one place.
    mesh(&["--above", "auto"], &["--above", "no flat part", "a table"]);
    mesh(&["--cull", "hidden"], &["--cull", "hidden", "seen, masks"]);
    mesh(&["--cull", "masks"], &["masks: found no view with a mask of the object"]);
    mesh(&["--cull", "masks", "--mask-margin", "2"], &["--mask-margin", "0 to 1"]);
    mesh(&["--cull", "seen", "--dataset", "none"], &["none"]);
    // One camera at the distance 4 sees the part (1 − r/4)/2 of the ball of radius r.
    let flags = ["mesh", &run, "-o", &out, "--resolution", "128", "--cull", "seen"];
    let report = dsdf_json(&flags);
    let seen = 1.0 - number(&report["cut"][0]["area"]);
    assert!((seen - 0.5 * (1.0 - 0.5 / 4.0)).abs() < 0.03, "{report}");
    assert_eq!(report["closed"], json!(false));
}
