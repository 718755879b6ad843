//! Fits of data sets with a known surface, and of photographs.

use std::fmt::Write;
use std::hash::{DefaultHasher, Hasher};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;

use anyhow::{Context, anyhow, ensure};
use serde_json::{Value, json};
use sweep::measure::plot::{Curve, Panel, svg};
use sweep::measure::{cargo_command, dsdf, workspace_root};

use super::code::short_digest;
use super::measurement::{
    Bench, Measurement, Skipped, environment, python_of, shared, wait_for_orphan,
};
use super::rows::{Planned, Rows, provenance};
use crate::output::write;

/// Fits, of a fixed number of iterations on one thread, so that their results have the same bits
/// again. Their times are those of the machine.
pub(crate) struct Fits;

/// What a fit is compared with.
#[derive(Clone, Copy, PartialEq)]
enum Truth {
    /// A mesh in the folder of the data set, in the frame of its cameras.
    Mesh(&'static str),
    /// A mesh of the object of a room: all surface above the table counts.
    Room,
    /// Points that COLMAP found.
    Points,
    /// Held-out photographs alone.
    Views,
}

/// Where a data set is from.
#[derive(Clone, Copy, PartialEq)]
enum Source {
    /// A folder or a camera file in `shared/data`.
    Shared(&'static str),
    /// A kind of `compose`, made of a folder in `shared/data`.
    Composed(&'static str, &'static str),
    /// A scene of the workspace, with the options of `dsdf synth`.
    Scene(&'static str, &'static [&'static str]),
    /// Photographs in `shared/data`, whose poses `dsdf poses` finds.
    Photographs(&'static str),
}

/// The kind of a capture: how long a fit takes, and which error to expect, depends on it.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// An object in front of one colour.
    Studio,
    /// An object in a room, with exact cameras.
    Room,
    /// Photographs by hand.
    Hand,
}

impl Kind {
    const ALL: [Kind; 3] = [Kind::Studio, Kind::Room, Kind::Hand];

    /// Its name in files.
    fn name(self) -> &'static str {
        match self {
            Kind::Studio => "studio",
            Kind::Room => "room",
            Kind::Hand => "hand",
        }
    }

    /// Its name in plots.
    fn title(self) -> &'static str {
        match self {
            Kind::Studio => "in front of one colour",
            Kind::Room => "in a room, exact cameras",
            Kind::Hand => "photographs by hand",
        }
    }
}

/// The folder of the program that tells what to expect of a fit.
const EXPECTED: &str = "crates/app/src/cli/fit";

/// A data set with its fits.
struct Set {
    /// Its name in tables.
    name: &'static str,
    /// What it is.
    about: &'static str,
    kind: Kind,
    source: Source,
    truth: Truth,
    /// Numbers of iterations, each with its seeds. A table of one line a set has the last one that was measured.
    budgets: &'static [(u32, &'static [u64])],
    /// Further options of `dsdf fit`.
    options: &'static [&'static str],
}

const IGNORE: &[&str] = &["--masks", "ignore"];
const MESH: Truth = Truth::Mesh("mesh_normalized.ply");
const THREE: &[u64] = &[1, 2, 3];
const ONE: &[u64] = &[1];
const LONG: &[(u32, &[u64])] = &[(18_000, ONE)];

impl Set {
    const fn of(name: &'static str, about: &'static str, source: Source, truth: Truth) -> Self {
        let (kind, options) = (Kind::Studio, IGNORE);
        Set { name, about, kind, source, truth, budgets: LONG, options }
    }

    const fn kind(mut self, kind: Kind) -> Self {
        self.kind = kind;
        self
    }

    const fn options(mut self, options: &'static [&'static str]) -> Self {
        self.options = options;
        self
    }

    const fn budgets(mut self, budgets: &'static [(u32, &'static [u64])]) -> Self {
        self.budgets = budgets;
        self
    }

    /// All its fits: iterations and seeds.
    fn fits(&self) -> impl Iterator<Item = (u32, u64)> {
        self.budgets.iter().flat_map(|(n, seeds)| seeds.iter().map(|seed| (*n, *seed)))
    }
}

/// The data sets, in the order of the table.
const SETS: &[Set] = &[
    Set::of("spot", "32 views of 256 × 256, no masks", Source::Shared("spot"), MESH).budgets(&[
        (1_000, ONE),
        (2_000, ONE),
        (6_000, ONE),
        (18_000, THREE),
        (36_000, THREE),
    ]),
    Set::of("bob", "32 views of 256 × 256, no masks", Source::Shared("bob"), MESH).budgets(&[
        (1_000, ONE),
        (2_000, ONE),
        (6_000, ONE),
        (18_000, THREE),
        (36_000, THREE),
    ]),
    Set::of("ridged", "40 views of 320 × 320, fine ridges", Source::Shared("ridged"), MESH)
        .budgets(&[(1_000, ONE), (2_000, ONE), (6_000, ONE), (27_000, THREE)]),
    Set::of(
        "slab",
        "a plain slab with ridges, 32 views of 256 × 256",
        Source::Scene("xtask/sweeps/scenes/ridges.json", &["--views", "32", "--size", "256x256"]),
        Truth::Mesh("truth.ply"),
    )
    .budgets(&[(2_000, ONE), (6_000, ONE), (18_000, ONE)]),
    Set::of(
        "demo",
        "the scene of `dsdf demo`, 24 views of 128 × 128",
        Source::Scene(
            "crates/app/src/cli/demo_scene.json",
            &["--views", "24", "--size", "128x128"],
        ),
        Truth::Mesh("truth.ply"),
    )
    .budgets(&[(1_000, ONE), (2_000, ONE), (6_000, ONE), (18_000, THREE)]),
    Set::of("bananas", "16 photographs by hand", Source::Photographs("banana"), Truth::Points)
        .kind(Kind::Hand)
        .budgets(&[(1_000, ONE), (3_000, &[1, 2]), (9_000, ONE)]),
    Set::of(
        "spot_room",
        "a cow in a room, 48 views of 320 × 240",
        Source::Shared("spot_room"),
        Truth::Room,
    )
    .kind(Kind::Room)
    .budgets(&[(2_000, ONE), (6_000, ONE), (18_000, THREE)]),
    Set::of(
        "bob_room",
        "a shiny ring in a room, 18 views of 640 × 480",
        Source::Shared("bob_room"),
        Truth::Room,
    )
    .kind(Kind::Room)
    .budgets(&[(2_000, ONE), (6_000, ONE), (18_000, THREE)]),
    Set::of(
        "spot_room, noisy poses",
        "poses off by 0.4°",
        Source::Shared("spot_room/transforms_noisy.json"),
        Truth::Room,
    )
    .kind(Kind::Room),
    Set::of(
        "spot_room, exposures",
        "exposures that differ",
        Source::Shared("spot_room/transforms_exposure.json"),
        Truth::Room,
    )
    .kind(Kind::Room),
    Set::of(
        "dinoSparseRing",
        "16 photographs of 640 × 480",
        Source::Shared("dinoSparseRing"),
        Truth::Views,
    )
    .budgets(&[(40_000, ONE)]),
    Set::of(
        "DTU scan 65",
        "49 photographs of 400 × 300",
        Source::Shared("dtu_scan65_400x300"),
        Truth::Views,
    )
    .kind(Kind::Room)
    .budgets(&[(55_000, ONE)]),
    Set::of("spot, panorama", "in front of a panorama", Source::Composed("panorama", "spot"), MESH)
        .kind(Kind::Room),
    Set::of("spot, noise", "in front of noise", Source::Composed("noise", "spot"), MESH)
        .kind(Kind::Room),
    Set::of(
        "spot, grey",
        "in front of grey, exposures within 0.7 stops",
        Source::Composed("grey-exposure", "spot"),
        MESH,
    ),
    Set::of("spot, alpha", "renders with alpha", Source::Composed("alpha", "spot"), MESH)
        .options(&["--masks", "auto"]),
];

/// What a fit and the measurement of its result depend on.
pub(super) const MEASURED: &[&str] = &[
    "fit",
    "inspect",
    "metrics",
    "mesh",
    "poses",
    "export",
    "scene",
    "crates/app/src/cli/fit/mod.rs",
    "crates/app/src/cli/fit/growth.rs",
    "crates/app/src/cli/fit/options.rs",
    "crates/app/src/cli/fit/prepare_run.rs",
    "crates/app/src/cli/fit/start.rs",
    "crates/app/src/cli/eval/",
    "crates/app/src/cli/eval.rs",
    "crates/app/src/cli/common.rs",
    "crates/app/src/cli/mesh.rs",
    "crates/app/src/cli/synth.rs",
    "crates/app/src/cli/demo_scene.json",
    "xtask/sweeps/scenes/ridges.json",
];

/// What tells one build of a program from another.
fn fingerprint(program: &Path) -> anyhow::Result<u64> {
    let mut hasher = DefaultHasher::new();
    hasher.write(&std::fs::read(program)?);
    Ok(hasher.finish())
}

/// Held while a data set is made.
static MAKING: Mutex<()> = Mutex::new(());

impl Source {
    /// The file or folder that it needs outside of the repository.
    fn needs(self) -> Option<PathBuf> {
        match self {
            Source::Shared(path) | Source::Composed(_, path) | Source::Photographs(path) => {
                Some(data_set(path))
            }
            Source::Scene(..) => None,
        }
    }

    /// The data set in a command line, as a person would type it.
    fn shown(self) -> String {
        match self {
            Source::Shared(path) => path.to_owned(),
            Source::Composed(kind, _) => format!("{kind}_data"),
            Source::Scene(path, _) => {
                path.rsplit('/').next().unwrap_or_default().replace(".json", "_data")
            }
            Source::Photographs(path) => format!("{path}_data"),
        }
    }

    /// The commands that make the data set, as a person would type them.
    fn made_by(self) -> Option<String> {
        let data = self.shown();
        match self {
            Source::Shared(_) => None,
            Source::Composed(kind, path) => Some(format!(
                "cargo run --release -p tests --example compose -- {kind} {path} {data}"
            )),
            Source::Scene(path, options) => {
                Some(format!("dsdf synth {path} -o {data} {}", options.join(" ")))
            }
            Source::Photographs(path) => Some(format!("dsdf poses {path} -o {data}")),
        }
    }

    /// The data set, made if it is not there.
    fn data(self, program: &Path) -> anyhow::Result<PathBuf> {
        if let Source::Shared(path) = self {
            return Ok(data_set(path));
        }
        // Rows that are measured side by side can share it.
        let _one_at_a_time = MAKING.lock().map_err(|_| anyhow!("another data set failed"))?;
        let place = workspace_root().join("target/record/data");
        std::fs::create_dir_all(&place)?;
        let by = short_digest(&format!("{:?} {}", self.made_by(), fingerprint(program)?))?;
        let data = place.join(format!("{}-{by}", self.shown()));
        if data.exists() {
            return Ok(data);
        }
        // A data set that was begun and not finished does not count.
        let begun = place.join("begun");
        if begun.exists() {
            std::fs::remove_dir_all(&begun)?;
        }
        let out = begun.to_string_lossy().into_owned();
        match self {
            Source::Shared(_) => {}
            Source::Composed(kind, path) => {
                let path = data_set(path);
                let of_cargo =
                    ["run", "--release", "-p", "tests", "--example", "compose", "--", kind];
                let status = cargo_command(&of_cargo).arg(path).arg(&out).status()?;
                ensure!(status.success(), "compose {kind} failed");
            }
            Source::Scene(path, options) => {
                let scene = workspace_root().join(path).to_string_lossy().into_owned();
                dsdf::run_json(program, &[&["synth", &scene, "-o", &out], options].concat())?;
            }
            Source::Photographs(path) => {
                if Command::new("colmap").arg("help").output().is_err() {
                    return Err(
                        Skipped("COLMAP is not installed: apt install colmap".into()).into()
                    );
                }
                let photographs = data_set(path).to_string_lossy().into_owned();
                dsdf::run_json(program, &["poses", &photographs, "-o", &out])?;
            }
        }
        std::fs::rename(&begun, &data)?;
        Ok(data)
    }

    /// The folder of the truth.
    fn folder(self, data: &Path) -> PathBuf {
        match self {
            Source::Composed(_, path) => data_set(path),
            _ if data.is_file() => data.parent().unwrap_or(data).to_owned(),
            _ => data.to_owned(),
        }
    }
}

/// A data set that is not in the repository.
fn data_set(path: &str) -> PathBuf {
    shared().join("data").join(path)
}

impl Truth {
    /// The options of `dsdf eval`, as a person would type them.
    fn shown(self) -> String {
        match self {
            Truth::Mesh(name) => format!("dsdf eval RUN --mesh {name}"),
            Truth::Points => "dsdf eval RUN --points auto".to_owned(),
            Truth::Views => "dsdf eval RUN".to_owned(),
            Truth::Room => "dsdf mesh RUN -o shape.ply; room_eval.py shape.ply DATA".to_owned(),
        }
    }
}

/// The name of a row.
fn row_name(set: &Set, iterations: u32, seed: u64) -> String {
    format!("{}, {}, seed {seed}", set.name, thousands(iterations))
}

/// All fits: a data set, iterations and a seed.
fn all() -> impl Iterator<Item = (&'static Set, u32, u64)> {
    SETS.iter().flat_map(|set| set.fits().map(move |(iterations, seed)| (set, iterations, seed)))
}

impl Measurement for Fits {
    fn name(&self) -> &'static str {
        "fits"
    }

    fn measured(&self) -> &'static [&'static str] {
        MEASURED
    }

    fn plan(&self) -> anyhow::Result<Vec<Planned>> {
        let row = |(set, iterations, seed): (&Set, u32, u64)| {
            let made = set.source.made_by().map_or(String::new(), |line| line + "; ");
            let (data, options) = (set.source.shown(), set.options.join(" "));
            Planned {
                name: row_name(set, iterations, seed),
                command: format!(
                    "{made}dsdf fit {data} -o RUN --iterations {iterations} --threads 1 --seed \
                     {seed} {options}; {}",
                    set.truth.shown()
                ),
                seeds: vec![seed],
                is_single: true,
                needs: set.source.needs(),
            }
        };
        Ok(all().map(row).collect())
    }

    fn measure(&self, row: &Planned, bench: &Bench<'_>) -> anyhow::Result<Value> {
        let Bench { program, scratch, .. } = *bench;
        let found = all().find(|(set, n, seed)| row_name(set, *n, *seed) == row.name);
        let (set, iterations, seed) = found.context("a fit of this name")?;
        let data = set.source.data(program)?;
        let run = scratch.join("run");
        let text = |path: &Path| path.to_string_lossy().into_owned();
        let (data_name, run_name) = (text(&data), text(&run));
        let (iterations, seed) = (iterations.to_string(), seed.to_string());
        let mut fit = vec!["fit", &data_name, "-o", &run_name, "--iterations", &iterations];
        fit.extend(["--threads", "1", "--seed", &seed]);
        fit.extend(set.options);
        wait_for_orphan(&run)?;
        // A row that was killed goes on from its checkpoint.
        let is_resumed = run.join("checkpoint/state.safetensors").exists();
        if is_resumed {
            fit.push("--resume");
        }
        let (report, seconds) = dsdf::run_json_timed(program, &fit)?;
        // The time of the process that was killed is in the wall time only.
        let seconds = seconds.filter(|_| !is_resumed);
        let mut values = json!({
            "wall_seconds": report["seconds"],
            "core_seconds": seconds.or(report["seconds"].as_f64()),
        });
        let folder = set.source.folder(&data);
        let truth = match set.truth {
            Truth::Mesh(name) => text(&folder.join(name)),
            _ => "auto".to_owned(),
        };
        let mut eval = vec!["eval", &run_name];
        match set.truth {
            Truth::Mesh(_) => eval.extend(["--mesh", &truth]),
            Truth::Points => eval.extend(["--points", &truth]),
            Truth::Room | Truth::Views => {}
        }
        let found = dsdf::run_json(program, &eval)?;
        for key in ["psnr", "mask_iou", "chamfer_relative", "normal_error", "points_median"] {
            if !found[key].is_null() {
                values[key] = found[key].clone();
            }
        }
        if set.truth == Truth::Room {
            let shape = text(&scratch.join("shape.ply"));
            dsdf::run_json(program, &["mesh", &run_name, "-o", &shape])?;
            for (key, value) in room(&shape, &folder)? {
                values[key] = json!(value);
            }
        }
        Ok(values)
    }

    fn write(&self, rows: &Rows, folder: &Path) -> anyhow::Result<()> {
        let last = |set: &Set, n| {
            let measured =
                |n: &&(u32, &[u64])| !of_seeds(rows, set, n.0, "core_seconds").is_empty();
            set.budgets.iter().rfind(measured).is_some_and(|(last, _)| *last == n)
        };
        let (first, all) = (table(rows, last), table(rows, |_, _| true));
        let source = provenance(rows);
        write(folder, "fits.md", format!("{first}\n## All of them\n\n{all}\n{source}\n"))?;
        let panels = Kind::ALL.map(|kind| panel(rows, kind));
        let plot = svg(&panels, "seconds of one core", "distance, % of the radius");
        write(folder, "trade.svg", plot)?;
        write(&workspace_root().join(EXPECTED), "expected.csv", expected(rows))
    }
}

/// The errors of the object of a room: Chamfer distance of all surface above the table, of that
/// inside the masks, and the area of sails.
pub(super) fn room(shape: &str, folder: &Path) -> anyhow::Result<Vec<(&'static str, f64)>> {
    let script = shared().join("tools/room_eval.py");
    let output = Command::new(python()?).arg(script).arg(shape).arg(folder).output()?;
    let text = String::from_utf8_lossy(&output.stdout);
    let error = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "room_eval.py: {}", error.trim());
    let number = |line: &str, word: &str| -> anyhow::Result<f64> {
        let line = text.lines().find(|text| text.starts_with(line)).context("a line")?;
        let after = line.split_once(word).context("a number")?.1;
        Ok(after.split_whitespace().next().context("a number")?.trim_end_matches(',').parse()?)
    };
    Ok(vec![
        ("room_raw", number("raw", "Chamfer")?),
        ("room_cut", number("cut", "Chamfer")?),
        ("sails", number("sails", "sails")?),
    ])
}

/// A Python with the packages of the scripts, in an environment of its own, made if it is not there.
fn python() -> anyhow::Result<PathBuf> {
    let run = |program: &Path, arguments: &[&str]| {
        let status = Command::new(program).args(arguments).status();
        let status = status.with_context(|| program.display().to_string())?;
        ensure!(status.success(), "{} {} failed", program.display(), arguments.join(" "));
        Ok(())
    };
    let _one_at_a_time = MAKING.lock().map_err(|_| anyhow!("another row failed"))?;
    let packages = ["numpy", "scipy", "trimesh", "pillow"];
    environment("python", &packages.join(" "), |folder| {
        // One that was begun and not finished does not count.
        run(Path::new("python3"), &["-m", "venv", "--clear", &folder.to_string_lossy()])?;
        run(&python_of(folder), &[&["-m", "pip", "install", "--quiet"][..], &packages].concat())
    })
}

/// The values of a data set after some iterations, of all seeds that were measured, sorted.
fn of_seeds(rows: &Rows, set: &Set, iterations: u32, value: &str) -> Vec<f64> {
    let own = set.fits().filter(|(n, _)| *n == iterations);
    let number = |(n, seed)| rows.number(&row_name(set, n, seed), value);
    let mut all: Vec<f64> = own.filter_map(number).collect();
    all.sort_by(f64::total_cmp);
    all
}

/// The table of fits: a line for each data set and number of iterations, with the medians over its
/// seeds. `is_shown` picks the lines.
fn table(rows: &Rows, is_shown: impl Fn(&Set, u32) -> bool) -> String {
    let mut out = String::from(
        "| data | iterations | time on one core | seeds | result |\n| --- | --- | --- | --- | --- |\n",
    );
    for set in SETS {
        for (iterations, _) in set.budgets.iter().filter(|(n, _)| is_shown(set, *n)) {
            let of = |value: &str| of_seeds(rows, set, *iterations, value);
            let times = of("core_seconds");
            let Some(seconds) = median(&times) else { continue };
            let _ = writeln!(
                out,
                "| `{}`, {} | {} | {} | {} | {} |",
                set.name,
                set.about,
                thousands(*iterations),
                duration(seconds),
                times.len(),
                result(set.truth, &of)
            );
        }
    }
    out
}

/// A time in the unit that people use for it.
pub(super) fn duration(seconds: f64) -> String {
    if seconds < 90.0 { format!("{seconds:.0} s") } else { format!("{:.1} min", seconds / 60.0) }
}

/// The distance to the surface that a row of a data set has, in radii: of all surface, of the object
/// of a room, or of points.
fn distance(rows: &Rows, set: &Set, iterations: u32) -> Option<f64> {
    let value = match set.truth {
        Truth::Mesh(_) => "chamfer_relative",
        Truth::Room => "room_raw",
        Truth::Points => "points_median",
        Truth::Views => return None,
    };
    median(&of_seeds(rows, set, iterations, value))
}

/// The seconds of one core and the distance of the fits of a data set with this number of iterations.
pub(super) fn time_and_distance(rows: &Rows, name: &str, iterations: u32) -> Option<(f64, f64)> {
    let set = SETS.iter().find(|set| set.name == name)?;
    let seconds = median(&of_seeds(rows, set, iterations, "core_seconds"))?;
    Some((seconds, distance(rows, set, iterations)?))
}

/// A data set with several budgets: the seconds of one core and the distance of each.
fn curve(rows: &Rows, set: &Set) -> Vec<(u32, f64, f64)> {
    let point = |(iterations, _): &(u32, &[u64])| {
        let (seconds, distance) = time_and_distance(rows, set.name, *iterations)?;
        Some((*iterations, seconds, distance))
    };
    set.budgets.iter().filter_map(point).collect()
}

/// The data sets of a kind that were measured with several budgets.
fn curves(rows: &Rows, kind: Kind) -> impl Iterator<Item = (&'static Set, Vec<(u32, f64, f64)>)> {
    let sets = SETS.iter().filter(move |set| set.kind == kind);
    sets.map(|set| (set, curve(rows, set))).filter(|(_, curve)| curve.len() > 1)
}

/// The distance over the time of each data set of a kind.
fn panel(rows: &Rows, kind: Kind) -> Panel {
    let of_set = |(set, points): (&Set, Vec<(u32, f64, f64)>)| Curve {
        name: set.name.to_owned(),
        points: points
            .into_iter()
            .map(|(_, seconds, distance)| (seconds, 100.0 * distance))
            .collect(),
    };
    let curves = curves(rows, kind).map(of_set).collect();
    Panel { title: kind.title().to_owned(), curves, front: false }
}

/// The times and distances from which `dsdf fit --check` tells what to expect.
fn expected(rows: &Rows) -> String {
    let mut out = String::from("kind,set,iterations,core_seconds,distance\n");
    for kind in Kind::ALL {
        for (set, points) in curves(rows, kind) {
            for (iterations, seconds, distance) in points {
                let (kind, set) = (kind.name(), set.name);
                let _ = writeln!(out, "{kind},{set},{iterations},{seconds:.1},{distance:.6}");
            }
        }
    }
    out
}

/// The median of sorted numbers; none of no numbers.
fn median(sorted: &[f64]) -> Option<f64> {
    let middle = sorted.len() / 2;
    match sorted.len() % 2 {
        _ if sorted.is_empty() => None,
        1 => Some(sorted[middle]),
        _ => Some(0.5 * (sorted[middle - 1] + sorted[middle])),
    }
}

/// The values of a line: medians, with the range of distances if there are several seeds.
fn result(truth: Truth, of: &dyn Fn(&str) -> Vec<f64>) -> String {
    let per_cent = |name: &str, value: &str, digits: usize| {
        let all = of(value);
        let middle = 100.0 * median(&all)?;
        let range = match all[..] {
            [first, .., last] => {
                format!(" ({:.digits$} to {:.digits$})", 100.0 * first, 100.0 * last)
            }
            _ => String::new(),
        };
        Some(format!("{name}{middle:.digits$} %{range}"))
    };
    let number = |value: &str, shown: &dyn Fn(f64) -> String| median(&of(value)).map(shown);
    let psnr = number("psnr", &|v| format!("{v:.1} dB"));
    let parts = match truth {
        Truth::Mesh(_) => vec![
            per_cent("Chamfer ", "chamfer_relative", 3),
            number("normal_error", &|v| format!("normals {v:.1}°")),
            psnr,
        ],
        Truth::Room => vec![
            per_cent("Chamfer ", "room_raw", 2),
            per_cent("inside the masks ", "room_cut", 2),
            number("sails", &|v| format!("sails {v:.3}")),
        ],
        Truth::Points => vec![per_cent("points ", "points_median", 3)],
        Truth::Views => vec![psnr],
    };
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// A number with a comma in front of three digits.
pub(super) fn thousands(n: u32) -> String {
    if n < 1000 { n.to_string() } else { format!("{},{:03}", n / 1000, n % 1000) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_have_different_names_and_commands() {
        let plan = Fits.plan().unwrap();
        let distinct = |of: fn(&Planned) -> &str| {
            plan.iter().map(of).collect::<std::collections::BTreeSet<_>>().len()
        };
        assert_eq!(distinct(|row| &row.name), plan.len());
        assert_eq!(distinct(|row| &row.command), plan.len());
        assert!(plan[0].command.starts_with("dsdf fit spot -o RUN --iterations 1000"));
    }

    #[test]
    fn a_line_has_medians_and_ranges() {
        let of = |value: &str| match value {
            "chamfer_relative" => vec![0.0007, 0.0008, 0.001],
            "psnr" => vec![40.0, 41.0],
            _ => vec![],
        };
        let expected = "Chamfer 0.080 % (0.070 to 0.100), 40.5 dB";
        assert_eq!(result(MESH, &of), expected);
        assert_eq!(result(Truth::Views, &|_| vec![30.0]), "30.0 dB");
        assert_eq!((thousands(800), thousands(18_000)), ("800".into(), "18,000".into()));
    }
}
