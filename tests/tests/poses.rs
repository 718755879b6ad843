//! `dsdf poses`: with a script in the place of COLMAP, and with COLMAP where it is installed.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use dataset::{LoadOptions, View};
use image::{Rgb, RgbImage};
use render::Camera;
use serde_json::Value;
use tests::input::Folder;
use tests::{binary, dsdf_json, root};

/// Four photographs in a folder, and a search path with the stand-in for COLMAP.
struct Bench {
    folder: Folder,
}

impl Bench {
    fn new() -> Self {
        let folder = Folder::new();
        for name in ["photos", "bin", "empty"] {
            fs::create_dir(folder.path(name)).unwrap();
        }
        for i in 0..4_u8 {
            let pixel = |x: u32, y: u32| Rgb([x as u8 * 7, y as u8 * 7, 60 * i]);
            let picture = RgbImage::from_fn(32, 32, pixel);
            picture.save(folder.path(&format!("photos/view {i}.png"))).unwrap();
        }
        let script = root().join("tests/fixtures/colmap.sh");
        symlink(script, folder.path("bin/colmap")).unwrap();
        Bench { folder }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path(name)
    }

    /// `dsdf poses` on the photographs, with the stand-in first on the search path.
    fn command(&self, options: &[&str], faults: &[(&str, &str)]) -> Command {
        let mut command = Command::new(binary());
        let old = std::env::var("PATH").unwrap();
        command
            .args(["poses", &self.path("photos"), "-o", &self.path("data"), "--quiet"])
            .args(options)
            .env("PATH", format!("{}:{old}", self.path("bin")))
            .env("FAKE_CALLS", self.path("calls"))
            .envs(faults.iter().copied())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    fn run(&self, options: &[&str], faults: &[(&str, &str)]) -> Output {
        self.command(options, faults).output().unwrap()
    }

    /// A run that succeeds: its JSON, and the commands of COLMAP that it called.
    fn json(&self, options: &[&str], faults: &[(&str, &str)]) -> (Value, Vec<String>) {
        let output = self.run(&[&["--json"], options].concat(), faults);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        (serde_json::from_slice(&output.stdout).unwrap(), self.calls())
    }

    /// The commands of COLMAP since the last look.
    fn calls(&self) -> Vec<String> {
        let text = fs::read_to_string(self.path("calls")).unwrap_or_default();
        let _ = fs::remove_file(self.path("calls"));
        text.lines().map(str::to_owned).collect()
    }
}

/// Checks that a run failed with one line that has all words.
fn failed(output: &Output, status: i32, words: &[&str]) {
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(status), "{message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    for word in words {
        assert!(message.contains(word), "no {word:?} in {message}");
    }
    assert!(output.stdout.is_empty());
}

const ALL: [&str; 4] = ["feature_extractor", "exhaustive_matcher", "mapper", "image_undistorter"];

#[test]
fn photographs_become_a_data_set_and_finished_steps_are_kept() {
    let bench = Bench::new();
    let (poses, calls) = bench.json(&[], &[]);
    assert_eq!(calls, ALL);
    assert_eq!((&poses["photographs"], &poses["registered"]), (&4.into(), &4.into()));
    assert_eq!((&poses["points"], &poses["reprojection_error"]), (&6.into(), &0.5.into()));
    assert_eq!(poses["cameras"][0]["model"], "SIMPLE_RADIAL");
    assert_eq!(
        (&poses["missing"], &poses["advice"]),
        (&Value::from([""; 0]), &Value::from([""; 0]))
    );
    // The data set is one for the other commands, and has nothing of COLMAP's own surfaces.
    let seen = dsdf_json(&["inspect", &bench.path("data"), "-o", &bench.path("i.png")]);
    assert_eq!(seen["train_views"].as_u64().unwrap() + seen["test_views"].as_u64().unwrap(), 4);
    assert!(!Path::new(&bench.path("data/colmap/undistortion.partial")).exists());
    let log = fs::read_to_string(bench.path("data/colmap.log")).unwrap();
    assert!(log.contains("$ colmap mapper --database_path") && log.contains("Undistorting image"));
    assert!(log.contains("--SiftExtraction.use_gpu 0 ") && log.contains("single_camera 1 "));

    let (again, calls) = bench.json(&[], &[]);
    assert_eq!((again, calls.len()), (poses, 0), "a finished step is not run again");
    // Without COLMAP, a finished data set is still reported.
    let mut without = bench.command(&["--json"], &[]);
    assert!(without.env("PATH", bench.path("empty")).output().unwrap().status.success());
    let (_, calls) = bench.json(&["--matching", "sequential", "--overlap", "3"], &[]);
    assert_eq!(calls, ["sequential_matcher", "mapper", "image_undistorter"]);
    let (_, calls) = bench.json(&["--matching", "sequential", "--overlap", "3"], &[]);
    assert!(calls.is_empty());
    let (_, calls) = bench.json(&["--matching", "alike"], &[]);
    let matching = ["sequential_matcher", "vocab_tree_builder", "vocab_tree_matcher"];
    assert_eq!(calls, [&matching[..], &ALL[2..]].concat());
    let global = ["--matching", "alike", "--mapper", "global"];
    let (_, calls) = bench.json(&global, &[("FAKE_GLOBAL", "1")]);
    assert_eq!(calls, ["global_mapper", "image_undistorter"]);
    let words = ["arguments: --mapper: found one by `colmap global_mapper`", "COLMAP 4 or later"];
    let other = [&global[..], &["--features", "999"]].concat();
    failed(&bench.run(&other, &[]), 2, &words);
    let (_, calls) = bench.json(&["--max-size", "1600"], &[]);
    assert_eq!(calls, ALL, "other features are for other matches");
}

#[test]
fn a_failed_step_names_its_error_and_is_run_again() {
    let bench = Bench::new();
    let output = bench.run(&[], &[("FAKE_FAIL", "mapper")]);
    let words = ["colmap mapper ended with status 3: ERROR: the fake failed", "data/colmap.log"];
    failed(&output, 1, &words);
    assert_eq!(bench.calls(), &ALL[..3]);
    assert!(!Path::new(&bench.path("data/sparse")).exists());
    let (poses, calls) = bench.json(&[], &[]);
    assert_eq!((calls.as_slice(), &poses["registered"]), (&ALL.map(str::to_owned)[2..], &4.into()));
    // A result that is gone is made again, with all after it.
    fs::remove_dir_all(bench.path("data/sparse")).unwrap();
    assert_eq!(bench.json(&[], &[]).1, ["image_undistorter"]);
    fs::remove_file(bench.path("data/images/view 1.png")).unwrap();
    assert_eq!(bench.json(&[], &[]).1, ["image_undistorter"]);
    let photo = bench.path("photos/view 2.png");
    let mut bytes = fs::read(&photo).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&photo, bytes).unwrap();
    failed(&bench.run(&[], &[]), 2, &["view 2.png has another content"]);
}

#[test]
fn ctrl_c_ends_colmap_and_the_same_command_continues() {
    let bench = Bench::new();
    for (hangs, rest) in [("exhaustive_matcher", &ALL[1..]), ("mapper", &ALL[2..])] {
        let child = bench.command(&[], &[("FAKE_HANG", hangs)]).spawn().unwrap();
        let mark = bench.path("calls.hangs");
        let colmap = hanging(&mark);
        // A second process is refused meanwhile.
        failed(&bench.run(&[], &[]), 2, &["another `dsdf poses`"]);
        let interrupt = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
        assert!(interrupt.unwrap().success());
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(130));
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(message.contains("stopped; the same command continues"), "{message}");
        let is_alive = Command::new("kill").args(["-0", &colmap]).output().unwrap();
        assert!(!is_alive.status.success(), "COLMAP is left behind");
        bench.calls();
        if hangs == "mapper" {
            let (poses, calls) = bench.json(&[], &[]);
            assert_eq!(
                (calls, &poses["registered"]),
                (rest.iter().map(|s| (*s).to_owned()).collect(), &4.into())
            );
        }
    }
}

/// The process of the fake that hangs, once there is one.
fn hanging(mark: &str) -> String {
    let start = Instant::now();
    loop {
        let colmap = fs::read_to_string(mark).unwrap_or_default();
        if colmap.ends_with('\n') {
            fs::remove_file(mark).unwrap();
            return colmap.trim().to_owned();
        }
        assert!(start.elapsed() < Duration::from_secs(60), "it never started");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_colmap_whose_dsdf_was_killed_keeps_the_folder() {
    let bench = Bench::new();
    let mut child = bench.command(&[], &[("FAKE_HANG", "mapper")]).spawn().unwrap();
    let colmap = hanging(&bench.path("calls.hangs"));
    child.kill().unwrap();
    child.wait().unwrap();
    failed(&bench.run(&[], &[]), 2, &["or a COLMAP that it started, at work in this folder"]);
    assert!(Command::new("kill").args(["-KILL", &colmap]).status().unwrap().success());
    bench.calls();
    // The end of a process takes a moment.
    let start = Instant::now();
    while bench.run(&[], &[]).status.code() == Some(2) {
        assert!(start.elapsed() < Duration::from_secs(60), "the folder stays locked");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(bench.calls(), &ALL[2..]);
}

#[test]
fn photographs_of_each_size_have_a_lens() {
    let bench = Bench::new();
    RgbImage::new(16, 32).save(bench.path("photos/view 8.png")).unwrap();
    let (poses, calls) = bench.json(&[], &[]);
    assert_eq!(calls, [&ALL[..1], &ALL].concat(), "features of two sizes");
    assert_eq!(poses["photographs"], 5);
    let list =
        |i: u32| fs::read_to_string(bench.path(&format!("data/colmap/features/images-{i}.txt")));
    assert_eq!(list(0).unwrap().lines().count(), 4);
    assert_eq!(list(1).unwrap(), "view 8.png\n");
}

#[test]
fn few_poses_have_advice_and_none_is_an_error_with_it() {
    let bench = Bench::new();
    let (poses, _) = bench.json(&[], &[("FAKE_FEW", "3"), ("FAKE_SPLIT", "1")]);
    assert_eq!(poses["missing"], Value::from(["view 3.png"]));
    assert_eq!(poses["models"], Value::from([3, 1]), "the larger of two models is used");
    assert!(poses["advice"][0].as_str().unwrap().contains("more photographs:"));
    let text = bench.run(&[], &[]).stdout;
    let text = String::from_utf8(text).unwrap();
    for row in
        ["registered   3 of 4 photographs (75 %)", "missing      view 3.png", "ADVICE       "]
    {
        assert!(text.contains(row), "no {row:?} in {text}");
    }
    let output = bench.run(&["--seed", "1"], &[("FAKE_NONE", "1")]);
    failed(&output, 1, &["found no pose: it", "the 4 photographs", "newspaper", "data/colmap.log"]);
    let seen = dsdf_json(&["inspect", &bench.path("data"), "-o", &bench.path("i.png")]);
    let views = ["train_views", "test_views"].map(|views| seen[views].as_u64().unwrap());
    assert_eq!(views[0] + views[1], 3, "a data set is lost before the new one exists");
    // It counts as unfinished, and the new one takes its place.
    bench.calls();
    let (poses, calls) = bench.json(&["--seed", "1"], &[]);
    assert_eq!((calls.as_slice(), &poses["registered"]), (&ALL.map(str::to_owned)[2..], &4.into()));
    let models = fs::read_dir(bench.path("data")).unwrap().flatten();
    let models = models.filter(|entry| entry.file_name().to_string_lossy().starts_with("sparse"));
    assert_eq!(models.count(), 1);
}

#[test]
fn matching_begins_again_with_a_guide_if_few_photographs_have_a_pose() {
    let again = ["exhaustive_matcher", "mapper", "image_undistorter"];
    for fault in [("FAKE_FEW", "3"), ("FAKE_NONE", "1")] {
        let bench = Bench::new();
        let faults = [fault, ("FAKE_GUIDED", "4")];
        let (poses, calls) = bench.json(&[], &faults);
        assert_eq!(calls, [&ALL[..3], &again].concat(), "{fault:?}");
        assert_eq!(poses["registered"], 4);
        let log = fs::read_to_string(bench.path("data/colmap.log")).unwrap();
        assert_eq!(log.matches("SiftMatching.guided_matching 1").count(), 1);
        // It is not run again, and a search without a guide is.
        assert!(bench.json(&[], &faults).1.is_empty());
        assert!(bench.json(&["--guided", "always"], &faults).1.is_empty());
    }
    let bench = Bench::new();
    let faults = [("FAKE_FEW", "3"), ("FAKE_GUIDED", "4")];
    let (poses, calls) = bench.json(&["--guided", "never"], &faults);
    assert_eq!((calls.len(), &poses["registered"]), (4, &3.into()));
    let (_, calls) = bench.json(&["--guided", "always"], &faults);
    assert_eq!(calls, again);
    // Stopped in the guided part, it continues there.
    let bench = Bench::new();
    let hangs = [faults[0], faults[1], ("FAKE_FAIL", "image_undistorter")];
    failed(&bench.run(&[], &hangs), 1, &["the fake failed"]);
    bench.calls();
    let (poses, calls) = bench.json(&[], &faults);
    assert_eq!(
        (calls.as_slice(), &poses["registered"]),
        (&["image_undistorter".to_owned()][..], &4.into())
    );
    // Enough have a pose at once, or a guide does not help either.
    let bench = Bench::new();
    assert_eq!(bench.json(&[], &[("FAKE_GUIDED", "3")]).1, ALL);
    let bench = Bench::new();
    let (poses, calls) = bench.json(&[], &[("FAKE_FEW", "2"), ("FAKE_GUIDED", "3")]);
    assert_eq!((calls.len(), &poses["registered"]), (6, &3.into()));
    assert!(poses["advice"][0].as_str().unwrap().contains("more photographs:"));
    // With fewer poses, or none, those before are kept.
    for guided in ["2", "0"] {
        let bench = Bench::new();
        let faults = [("FAKE_FEW", "3"), ("FAKE_GUIDED", guided)];
        let (poses, calls) = bench.json(&[], &faults);
        assert_eq!((calls.len(), &poses["registered"]), (6, &3.into()), "{guided}");
        assert!(bench.json(&[], &faults).1.is_empty(), "done");
        assert!(!Path::new(&bench.path("data/colmap/mapping.first")).exists());
    }
}

#[test]
fn without_colmap_one_line_says_how_to_get_it() {
    let bench = Bench::new();
    let mut command = bench.command(&[], &[]);
    let output = command.env("PATH", bench.path("empty")).output().unwrap();
    failed(&output, 1, &["colmap: found no such program", "apt install colmap", "brew", "conda"]);
    let output = bench.run(&["--colmap", "/no/such/colmap"], &[]);
    failed(&output, 2, &["/no/such/colmap: --colmap: found no such program"]);
    let output = bench.run(&["--colmap", "/"], &[]);
    failed(&output, 2, &["/: --colmap: found no program that can be started"]);
    let output = bench.run(&["--colmap", "/bin/false"], &[]);
    failed(&output, 2, &["/bin/false: help: found no text, expected the help of COLMAP"]);
    assert!(!Path::new(&bench.path("data")).exists(), "nothing is written");
}

#[test]
fn wrong_input_is_refused_in_one_line_before_a_file_is_written() {
    let bench = Bench::new();
    let refused = |photos: &str, output: &str, words: &[&str]| {
        let mut command = Command::new(binary());
        command.args(["poses", &bench.path(photos), "-o", &bench.path(output), "--quiet"]);
        command.env("PATH", bench.path("bin")).env("FAKE_CALLS", bench.path("calls"));
        failed(&command.output().unwrap(), 2, words);
    };
    refused("none", "data", &["none: photographs: found no such folder", "3 or more"]);
    refused("photos/view 1.png", "data", &["found a file"]);
    refused("empty", "data", &["empty: photographs: found none"]);
    refused("bin", "data", &["found none (1 other files; first: colmap)"]);
    refused("photos", "photos", &["found a folder with other files (view 0.png)"]);
    refused("photos", "photos/view 1.png", &["found a file"]);
    refused("photos", "bin/colmap/data", &["output folder: found a file"]);
    let photo = bench.path("photos/view 2.png");
    let whole = fs::read(&photo).unwrap();
    fs::write(&photo, &whole[..whole.len() - 20]).unwrap();
    refused("photos", "data", &["view 2.png: image: found an image that is cut short"]);
    fs::write(&photo, whole).unwrap();
    assert!(!Path::new(&bench.path("data")).exists() && bench.calls().is_empty());
    bench.json(&[], &[]);
    fs::copy(bench.path("photos/view 1.png"), bench.path("photos/view 9.png")).unwrap();
    refused("photos", "data", &["poses.json: photographs: found 5", "view 9.png is new", "the 4"]);
    fs::remove_file(bench.path("photos/view 9.png")).unwrap();
    fs::write(bench.path("data/poses.json"), "{\"colmap\": 3}").unwrap();
    refused("photos", "data", &["poses.json: state: found", "a state of `dsdf poses`"]);
    for (option, word) in [("--overlap=0", "overlap"), ("--matching=some", "exhaustive")] {
        let output = bench.run(&[option], &[]);
        failed(&output, 2, &[word]);
    }
    RgbImage::new(16, 32).save(bench.path("photos/view 8.png")).unwrap();
    failed(
        &bench.run(&["--cameras", "one"], &[]),
        2,
        &["--cameras: found one, for photographs of"],
    );
}

/// The angle between two cameras, degrees, and the distance of their eyes.
fn between(a: &Camera, b: &Camera) -> (f64, f64) {
    let axes = |c: &Camera| glam::DMat3::from_cols(c.right, c.up, -c.forward);
    let turn = axes(a).transpose() * axes(b);
    let angle = glam::DQuat::from_mat3(&turn).to_axis_angle().1.to_degrees();
    (angle.min(360.0 - angle), (a.eye - b.eye).length())
}

/// The cameras of a data set, by the names of their photographs.
fn cameras(path: &Path) -> BTreeMap<String, Camera> {
    let dataset = dataset::load(path, &LoadOptions::default()).unwrap();
    let name = |view: &View| view.path.file_name().unwrap().to_string_lossy().into_owned();
    let views = dataset.train.iter().chain(&dataset.test);
    views.map(|view| (name(view), view.camera)).collect()
}

/// Runs COLMAP on photographs with known poses. Checks that most get a pose, that the poses are
/// right, and that `dsdf inspect` reads them.
fn check_poses(photos: &str, data: &str, truth: &BTreeMap<String, Camera>, fewest: usize) {
    let poses = dsdf_json(&["poses", photos, "-o", data]);
    assert!(poses["registered"].as_u64().unwrap() as usize >= fewest, "{poses}");
    assert!(poses["reprojection_error"].as_f64().unwrap() < 1.0, "{poses}");
    let found = cameras(Path::new(data));
    assert_eq!(found.len() as u64, poses["registered"].as_u64().unwrap());
    // The unit of length is arbitrary: the median of all pairs with the first camera.
    let (first, first_camera) = found.first_key_value().unwrap();
    let pair = |(name, camera): (&String, &Camera)| {
        let (true_first, true_camera) = (&truth[first], &truth[name]);
        (name.clone(), between(first_camera, camera), between(true_first, true_camera))
    };
    let pairs: Vec<_> = found.iter().skip(1).map(pair).collect();
    let mut scales: Vec<f64> = pairs.iter().map(|(_, found, truth)| found.1 / truth.1).collect();
    scales.sort_by(f64::total_cmp);
    let unit = scales[scales.len() / 2];
    for (name, (angle, distance), (true_angle, true_distance)) in pairs {
        assert!((angle - true_angle).abs() < 1.5, "{name}: {angle} {true_angle}");
        let part = distance / (unit * true_distance);
        assert!((part - 1.0).abs() < 0.08, "{name}: distance {part}");
    }
    let seen = dsdf_json(&["inspect", data, "-o", &format!("{data}/inspect.png")]);
    let views = ["train_views", "test_views"].map(|views| seen[views].as_u64().unwrap());
    assert_eq!((views[0] + views[1]) as usize, found.len());
}

/// Whether COLMAP is installed.
fn has_colmap() -> bool {
    // Its help is printed without a screen then.
    let call = ["env", "QT_QPA_PLATFORM=offscreen", "colmap", "help"];
    tests::installed("COLMAP", &[&call]).is_some()
}

#[test]
fn colmap_finds_the_poses_of_a_patterned_corner() {
    if !has_colmap() {
        return;
    }
    let folder = Folder::new();
    fs::create_dir(folder.path("photos")).unwrap();
    let mut truth = BTreeMap::new();
    for (i, camera) in tests::corner::cameras(8).into_iter().enumerate() {
        let name = format!("{i}.png");
        let picture = tests::corner::photograph(&camera);
        picture.save(folder.path(&format!("photos/{name}"))).unwrap();
        truth.insert(name, camera);
    }
    let (photos, data) = (folder.path("photos"), folder.path("data"));
    check_poses(&photos, &data, &truth, 7);
    // The same by a vocabulary: each photograph with its neighbours, then with those alike.
    let alike = ["poses", &photos, "-o", &data, "--matching", "alike", "--overlap", "1"];
    let poses = dsdf_json(&alike);
    assert!(poses["registered"].as_u64().unwrap() >= 7, "{poses}");
    let log = fs::read_to_string(folder.path("data/colmap.log")).unwrap();
    assert!(log.contains("visual words") && log.contains("Indexing image"), "{log}");
}

/// Views of the room that are next to each other.
const NEIGHBOURS: [u32; 14] = [1, 3, 14, 16, 17, 19, 21, 29, 31, 32, 34, 36, 44, 47];

#[test]
fn colmap_finds_the_poses_of_rendered_photographs() {
    let Some(room) = tests::shared("data/spot_room") else { return };
    if !has_colmap() {
        return;
    }
    let folder = Folder::new();
    fs::create_dir(folder.path("photos")).unwrap();
    for i in NEIGHBOURS {
        let name = format!("{i:03}.jpg");
        let photo = folder.path(&format!("photos/{name}"));
        fs::copy(room.join("images").join(&name), photo).unwrap();
    }
    check_poses(&folder.path("photos"), &folder.path("data"), &cameras(&room), 10);
}

/// No true poses are known of these. Small pictures of a few of them save time.
#[test]
fn colmap_finds_poses_of_photographs_by_hand() {
    let Some(banana) = tests::shared("data/banana") else { return };
    if !has_colmap() {
        return;
    }
    let folder = Folder::new();
    fs::create_dir(folder.path("photos")).unwrap();
    for i in 423..429 {
        let name = format!("DSC_0{i}.JPG");
        fs::copy(banana.join(&name), folder.path(&format!("photos/{name}"))).unwrap();
    }
    let (photos, data) = (folder.path("photos"), folder.path("data"));
    let poses = dsdf_json(&["poses", &photos, "-o", &data, "--max-size", "500"]);
    assert_eq!(poses["photographs"], 6);
    assert!(poses["registered"].as_u64().unwrap() >= 5, "{poses}");
    assert!(poses["reprojection_error"].as_f64().unwrap() < 1.0, "{poses}");
    let seen = dsdf_json(&["inspect", &data, "-o", &folder.path("i.png")]);
    let views = ["train_views", "test_views"].map(|views| seen[views].as_u64().unwrap());
    assert_eq!(views[0] + views[1], poses["registered"].as_u64().unwrap());
}
