//! The memory that an iteration asks the allocator for. A steady iteration allocates no large
//! vector: the system would have to clear pages for it.
#![allow(
    unsafe_code,
    reason = "the trait of an allocator is unsafe; this one counts, and calls that of the system"
)]
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use dataset::{Dataset, View};
use estimate::Registry;
use film::Film;
use fit::{Fit, FitOptions, GridLevels, RefineCameras, RunFile, StereoChoice, Workspace};
use glam::{DVec2, DVec3};
use render::Camera;

/// Bytes from which on a vector counts as large. Sums over the weights of the field, or of the radiance
/// head, have 44 KB or more.
const LARGE: usize = 44_000;

/// Allocations of at least [`LARGE`] bytes, all allocations, and their bytes.
static COUNTS: [AtomicU64; 3] = [const { AtomicU64::new(0) }; 3];

/// The system's allocator, which counts in [`COUNTS`].
struct Counting;

impl Counting {
    fn count(size: usize) {
        let added = [u64::from(size >= LARGE), 1, size as u64];
        COUNTS.iter().zip(added).for_each(|(count, added)| {
            count.fetch_add(added, Ordering::Relaxed);
        });
    }
}

// SAFETY: all calls go to the allocator of the system.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        Self::count(layout.size());
        // SAFETY: the caller keeps the promises of this function.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        Self::count(layout.size());
        // SAFETY: the caller keeps the promises of this function.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        Self::count(size);
        // SAFETY: the caller keeps the promises of this function.
        unsafe { System.realloc(place, layout, size) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the promises of this function.
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Pixels along a side of a photograph, and the number of photographs.
const SIDE: u32 = 64;
const VIEWS: usize = 8;

/// The radius of the ball in the photographs. That of the bounding sphere is 1.
const BALL: f64 = 0.6;

/// A photograph of a ball with stripes.
fn view(number: usize) -> View {
    let (turn, height) = (2.4 * number as f64, 1.0 - (2.0 * number as f64 + 1.0) / VIEWS as f64);
    let across = (1.0 - height * height).sqrt();
    let eye = DVec3::new(turn.cos() * across, height, turn.sin() * across) * 3.0;
    let side = f64::from(SIDE);
    let (focal, middle) = (DVec2::splat(1.3 * side), DVec2::splat(0.5 * side));
    let camera = Camera::look_at(SIDE, SIDE, focal, middle, eye, DVec3::ZERO, DVec3::Y).unwrap();
    let color = |i: u32| {
        let center = DVec2::new(f64::from(i % SIDE) + 0.5, f64::from(i / SIDE) + 0.5);
        let d = camera.direction(center);
        let along = eye.dot(d);
        let square = along * along - eye.length_squared() + BALL * BALL;
        if square < 0.0 {
            return [0.0; 3];
        }
        let n = (eye - d * (along + square.sqrt())) / BALL;
        ((n * 0.3 + 0.5) * (1.0 + 0.3 * (9.0 * n.x).sin())).as_vec3().to_array()
    };
    let pixels = (0..SIDE * SIDE).map(color).collect();
    let (name, path) = (number.to_string(), PathBuf::from(format!("{number}.png")));
    View { name, path, camera, image: Film { width: SIDE, height: SIDE, pixels }, mask: None }
}

/// A fit before its first iteration.
fn start(iterations: u64, soft: f64) -> Fit {
    let dataset = Dataset {
        path: PathBuf::from("balls"),
        format: String::new(),
        train: (0..VIEWS).map(view).collect(),
        test: Vec::new(),
        bounds: None,
        points: Vec::new(),
        is_sure: Vec::new(),
        notes: Vec::new(),
    };
    let options = FitOptions {
        iterations: Some(iterations),
        soft: Some(soft),
        bounds: Some([0.0, 0.0, 0.0, 1.0]),
        stereo: StereoChoice::None,
        refine_cameras: RefineCameras::None,
        grid: GridLevels(vec![16]),
        batch: 256,
        ..FitOptions::default()
    };
    let (file, _) = RunFile::of_dataset("balls".into(), &dataset, &options).unwrap();
    let dataset = file.prepare(dataset);
    Fit::new(dataset, file, &Registry::default(), Path::new("options")).unwrap()
}

/// The counts of the iterations that `step` takes, one after the other.
fn counted<T>(iterations: usize, mut step: impl FnMut() -> T) -> [u64; 3] {
    let now = || COUNTS.each_ref().map(|count| count.load(Ordering::Relaxed));
    let before = now();
    for _ in 0..iterations {
        step();
    }
    let after = now();
    std::array::from_fn(|i| after[i] - before[i])
}

/// Iterations before the first that counts, and those of each of two counts.
const WARM_UP: usize = 40;
const COUNTED: usize = 20;

/// The most large vectors in [`COUNTED`] iterations: the sums of a part grow where it has more points
/// than ever before. Measured: 1.
const MOST_LARGE: u64 = 4;

/// The most allocations of a steady iteration: measured 1,430 with a soft surface, and 1,350 with a
/// sharp one. Each part of a batch has some vectors, and each step of the tracer.
const MOST: u64 = 2500;

/// The most bytes of these: measured 2.9 MB and 3.5 MB. The products of matrices of Muon are 2.3 MB of
/// them: each has a copy of its factors.
const MOST_BYTES: u64 = 5_000_000;

#[test]
fn a_steady_iteration_allocates_no_large_vector_and_not_more_than_the_one_before() {
    // Counts of one thread do not depend on timing.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    // The finest level of the pyramid begins at a quarter of the budget: all iterations are on the
    // coarse ones, or all on the finest.
    for (name, iterations, soft) in [("soft", 1000, 0.9), ("sharp", 1000, 0.0)] {
        pool.install(|| {
            let (mut fit, mut work) = (start(iterations, soft), Workspace::default());
            fit.clock.iteration = iterations * 3 / 10;
            let mut step = || fit.step(&mut work).unwrap();
            counted(WARM_UP, &mut step);
            let [first, second] = [(); 2].map(|()| counted(COUNTED, &mut step));
            println!("{name}: {first:?}, then {second:?}");
            let each = second.map(|count| count / COUNTED as u64);
            assert!(second[0] <= MOST_LARGE, "{name}: {} large vectors", second[0]);
            assert!(each[1] <= MOST, "{name}: {} allocations", each[1]);
            assert!(each[2] <= MOST_BYTES, "{name}: {} bytes", each[2]);
            for (first, second) in first.into_iter().zip(second) {
                // The number of rays near silhouettes is another in each iteration.
                assert!(4 * second <= 5 * first + 4, "{name}: {first}, then {second}");
            }

            // Without the memory of earlier iterations, each has large vectors.
            let [large, ..] = counted(1, || fit.step(&mut Workspace::default()).unwrap());
            assert!(large >= 17, "{name}: {large} large vectors");
        });
    }
}
