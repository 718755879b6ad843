//! Derivatives at extreme settings, in single and double precision: they are finite and correct, or
//! one clear error.

use crate::fields::{Altered, Constant, White};
use estimate::gradient::{Direction, Sampling, differentiate};
use estimate::{EstimatorOptions, EstimatorPrecision, Registry, SampleCounts};
use field::{Csg, Field, Kind, Operation, Shape, Sphere, Vector3};
use field::{Precision, UniformBackground};
use glam::{DVec2, DVec3};
use render::{Camera, Scene};
use warp::WarpOptions;

/// The solid of a row.
#[derive(Clone, Copy)]
enum Solid {
    Ball,
    /// A torus seen along its axis, where ∇f is undefined.
    Torus,
    /// Two balls that meet in an edge.
    Lens,
    /// A box. The eye lies in the plane of its top.
    EdgeOn,
    /// f is this number everywhere.
    Constant(f64),
}

/// The expected sum, over the film, of the derivative by the parameter.
#[derive(Clone, Copy, Debug)]
enum Expected {
    /// A finite image.
    Finite,
    /// A sum.
    Sum(f64),
    /// An error.
    Error,
}

/// One setting: a row of the table.
#[derive(Clone)]
struct Row {
    name: String,
    solid: Solid,
    /// The radius of the ball, in world units before `scale`.
    radius: f64,
    /// The index of the parameter.
    index: usize,
    /// f is multiplied by this.
    factor: f64,
    /// f is a NaN where z is below this.
    nan_below: f64,
    /// All lengths are multiplied by this.
    scale: f64,
    /// Pixels along each side of the film.
    size: u32,
    /// In pixels.
    focal: f64,
    eye: DVec3,
    /// The bounding radius.
    bounds: f64,
    /// Lengths are in bounding radii.
    warp: WarpOptions,
    spp: u32,
    expected: Expected,
    /// The same for `paper`. Many rows violate its assumptions, so that only finite numbers are
    /// expected.
    paper: Expected,
}

/// Options with lengths in bounding radii, from `options` with lengths in world units.
fn lengths_in_world_units(options: WarpOptions, radius: f64) -> WarpOptions {
    let WarpOptions { lambda_d, epsilon, .. } = options;
    WarpOptions { lambda_d: lambda_d / radius, epsilon: epsilon / radius, ..options }
}

fn row(name: &str) -> Row {
    Row {
        name: name.to_owned(),
        solid: Solid::Ball,
        radius: 0.7,
        index: 3,
        factor: 1.0,
        nan_below: f64::MIN,
        scale: 1.0,
        size: 12,
        focal: 24.0,
        eye: DVec3::new(0.0, 0.0, 4.0),
        bounds: 1.4,
        warp: lengths_in_world_units(WarpOptions::IMAGE, 1.4),
        spp: 64,
        expected: Expected::Sum(disc(0.7, 4.0, 24.0)),
        paper: Expected::Finite,
    }
}

/// The derivative of a ball's area on the film by its radius, in square pixels per world unit.
fn disc(radius: f64, distance: f64, focal: f64) -> f64 {
    let square = distance * distance - radius * radius;
    let outline = focal * radius / square.sqrt();
    std::f64::consts::TAU * outline * focal * distance * distance / square.powf(1.5)
}

fn build<R: Precision>(row: &Row) -> Box<dyn Field<R>> {
    let s = row.scale;
    let inner: Box<dyn Field<R>> = match row.solid {
        Solid::Ball => Box::new(Shape::sphere([0.0; 3], row.radius * s)),
        Solid::Torus => {
            Box::new(Shape::new(Kind::Torus, &[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.6 * s, 0.2 * s]))
        }
        Solid::Lens => {
            let ball =
                |x: f64| Box::new(Shape::sphere([x * s, 0.0, 0.0], 0.8 * s)) as Box<dyn Field<R>>;
            Box::new(Csg::new(Operation::Intersection, vec![ball(-0.4), ball(0.4)]))
        }
        Solid::EdgeOn => {
            Box::new(Shape::new(Kind::Box, &[0.0, -0.4 * s, 0.0, 0.4 * s, 0.4 * s, 0.4 * s]))
        }
        Solid::Constant(value) => return Box::new(Constant(value)),
    };
    Box::new(Altered { inner, factor: row.factor, nan_below: row.nan_below })
}

/// The sum of the derivative's first channel over the film, and whether all numbers are finite; or
/// the text of the error.
fn measure<R: EstimatorPrecision>(row: &Row, estimator: &str) -> Result<(f64, bool), String> {
    let field = build::<R>(row);
    let (focal, principal) = (DVec2::splat(row.focal), DVec2::splat(f64::from(row.size) / 2.0));
    let eye = row.eye * row.scale;
    let camera =
        Camera::look_at(row.size, row.size, focal, principal, eye, eye - DVec3::Z, DVec3::Y)
            .unwrap();
    let (cameras, bounds) =
        ([camera], Sphere { center: DVec3::ZERO, radius: row.bounds * row.scale });
    let background = UniformBackground(R::Vec3::zero());
    let scene = Scene::<R>::new(&*field, &White, &cameras, &bounds, &background);
    let options = EstimatorOptions { warp: row.warp, ..EstimatorOptions::default() };
    let edge_samples = if estimator == "refined" { 64 } else { row.spp };
    let counts = SampleCounts { spp: row.spp, edge_samples };
    let estimator = Registry::default().get(estimator).unwrap().estimator::<R>(&options);
    let (directions, sampling) = ([Direction::Field(row.index)], Sampling { counts, seed: 1 });
    let image = differentiate(&scene, &directions, &*estimator, sampling, &|_| {})
        .map_err(|e| e.to_string())?;
    let pixels = &image[0].film.pixels;
    let finite = pixels.iter().flatten().all(|v| v.is_finite());
    Ok((pixels.iter().map(|p| f64::from(p[0])).sum::<f64>() * row.scale, finite))
}

/// Checks one row with one estimator, and returns the cell of the table.
fn cell<R: EstimatorPrecision>(
    row: &Row,
    estimator: &str,
    expected: Expected,
    slack: f64,
) -> String {
    let context = format!("{}, {estimator}", row.name);
    match (expected, measure::<R>(row, estimator)) {
        (Expected::Error, Err(text)) => {
            assert!(text.contains("NaN") || text.contains("finite"), "{context}: {text}");
            "error".to_owned()
        }
        (Expected::Finite, Ok((sum, true))) => format!("{sum:.4}"),
        (Expected::Sum(want), Ok((sum, true))) => {
            let off = (sum - want).abs() / if want == 0.0 { 1.0 } else { want.abs() };
            assert!(off < slack, "{context}: {sum} instead of {want}");
            if want == 0.0 { format!("{sum:.1e}") } else { format!("off by {off:.1e}") }
        }
        (_, found) => panic!("{context}: {found:?} instead of {expected:?}"),
    }
}

fn rows() -> Vec<Row> {
    let published = row("").warp;
    let mut rows = vec![row("as usual")];
    let warp = |name: String, warp: WarpOptions| Row { warp, ..row(&name) };
    rows.extend(
        [1.0, 2.0, 8.0, 64.0]
            .map(|gamma| warp(format!("γ = {gamma}"), WarpOptions { gamma, ..published })),
    );
    rows.extend([0.0, 1e-12, 1.0].map(|epsilon| {
        let options = WarpOptions { epsilon: epsilon / 1.4, ..published };
        warp(format!("ε = {epsilon:e}"), options)
    }));
    rows.extend(
        [2, 22, 1000].map(|top_k| {
            warp(format!("k = {top_k} of N = 22"), WarpOptions { top_k, ..published })
        }),
    );
    rows.extend([0.0, 1e3].map(|lambda_d| {
        let options = WarpOptions { lambda_d: lambda_d / 1.4, ..published };
        warp(format!("λ_d = {lambda_d:e}"), options)
    }));
    rows.extend([(1, 64), (2, 64), (4096, 2)].map(|(steps, spp)| {
        let options = WarpOptions { steps, ..published };
        Row { spp, ..warp(format!("N = {steps}"), options) }
    }));
    rows.extend(
        [1e-6, 0.1, 10.0, 1e6].map(|factor| Row { factor, ..row(&format!("f times {factor:e}")) }),
    );
    rows.extend(
        [1e-4, 1e5].map(|scale| Row { scale, ..row(&format!("everything times {scale:e}")) }),
    );
    rows.extend(views());
    let constant = |value: f64| Row {
        solid: Solid::Constant(value),
        expected: Expected::Sum(0.0),
        ..row(&format!("f = {value} everywhere"))
    };
    rows.extend([1.0, 0.0, -1.0].map(constant));
    let nan = Row {
        nan_below: 0.3,
        expected: Expected::Error,
        paper: Expected::Error,
        ..row("f is a NaN somewhere")
    };
    rows.push(nan);
    rows
}

/// Rows with other solids, cameras and bounds.
fn views() -> Vec<Row> {
    // The outline has a radius of exactly four pixels: rays through corners of pixels touch it.
    let tangent = 4.0 * 4.0 / f64::hypot(24.0, 4.0);
    let small = 1e-3 / 12.0;
    let (on, within) = (DVec3::new(0.0, 0.0, 1.4), DVec3::new(0.0, 0.0, 1.2));
    let nothing = Expected::Sum(0.0);
    vec![
        Row {
            radius: tangent,
            expected: Expected::Sum(disc(tangent, 4.0, 24.0)),
            ..row("rays exactly tangent")
        },
        Row {
            solid: Solid::Torus,
            index: 7,
            expected: Expected::Finite,
            ..row("rays through a medial axis")
        },
        Row { solid: Solid::Lens, expected: Expected::Finite, ..row("rays through a CSG edge") },
        Row {
            solid: Solid::EdgeOn,
            index: 4,
            expected: Expected::Finite,
            ..row("a face seen edge-on")
        },
        Row {
            radius: small,
            bounds: 2.0 * small,
            expected: Expected::Finite,
            ..row("an object 1e-3 pixels across")
        },
        Row { focal: 24e3, expected: nothing, ..row("an object 1e4 pixels across") },
        Row {
            eye: on,
            focal: 6.0,
            size: 16,
            expected: Expected::Sum(disc(0.7, 1.4, 6.0)),
            ..row("the eye on the bounds")
        },
        Row {
            eye: within,
            focal: 6.0,
            size: 20,
            expected: Expected::Sum(disc(0.7, 1.2, 6.0)),
            ..row("the eye inside the bounds")
        },
        Row {
            eye: DVec3::new(0.0, 0.0, 0.3),
            expected: nothing,
            ..row("the eye inside the object")
        },
        Row {
            size: 1,
            focal: 2.0,
            expected: Expected::Sum(disc(0.7, 4.0, 2.0)),
            ..row("one pixel")
        },
        Row { eye: DVec3::new(0.0, 9.0, 4.0), expected: nothing, ..row("nothing in sight") },
        Row { focal: 200.0, expected: nothing, ..row("nothing but the object in sight") },
    ]
}

#[test]
fn derivatives_at_extremes_are_finite_and_correct_or_an_error() {
    println!(
        "| setting | refined, f64 | refined, f32 | paper, f64 | paper, f32 |\n|---|---|---|---|---|"
    );
    for row in rows() {
        let cells = [
            cell::<f64>(&row, "refined", row.expected, 0.02),
            cell::<f32>(&row, "refined", row.expected, 0.03),
            cell::<f64>(&row, "paper", row.paper, 1.0),
            cell::<f32>(&row, "paper", row.paper, 1.0),
        ];
        println!("| {} | {} |", row.name, cells.join(" | "));
    }
}
