//! Splines against the recursion of their basis and against differences.

use approx::assert_relative_eq;
use field::TableSum;
use lanes::{GROUP, Portable, Row};

use crate::grids::splines::*;
use crate::grids::{Bars, Jet, Points};

fn splines(degree: Degree, features: usize) -> (Splines, Vec<f64>) {
    let splines = Splines::new(SplineSize { levels: vec![5, 9], features, degree });
    let count = splines.size().coefficient_count();
    let mut table = splines.table();
    for (i, c) in table[..count].iter_mut().enumerate() {
        *c = (0.7 * i as f64 + 0.1 * (i / 3) as f64).sin();
    }
    (splines, table)
}

/// All sizes that take another way through the code.
fn all() -> Vec<(Splines, Vec<f64>)> {
    [Degree::Quadratic, Degree::Cubic]
        .into_iter()
        .flat_map(|degree| [1, 2, 3].map(|features| splines(degree, features)))
        .collect()
}

/// A group with this point alone, as its third point.
fn alone(y: [f64; 3], p: [f64; 3]) -> Points<f64> {
    let mut points = Points { y: [[0.2; GROUP]; 3], p: [[1.0; GROUP]; 3], count: 3 };
    for a in 0..3 {
        (points.y[a][2], points.p[a][2]) = (y[a], p[a]);
    }
    points
}

fn jets(splines: &Splines, c: &[f64], y: [f64; 3], p: [f64; 3]) -> Vec<Jet<f64>> {
    splines.jets(c, y, p)
}

/// The VJP to the coefficients at a point.
fn vjp(
    splines: &Splines,
    y: [f64; 3],
    p: [f64; 3],
    adjoint: impl Fn(usize) -> [f64; 2],
    sums: &mut [f64],
) {
    let mut sides = [0, 1].map(|_| vec![Row::zero(); splines.size().feature_count()]);
    for (f, side) in (0..sides[0].len()).flat_map(|f| [(f, 0), (f, 1)]) {
        sides[side][f].0[GROUP + 2] = adjoint(f)[side];
    }
    let bars = Bars { sides: [&sides[0], &sides[1]], lane: GROUP };
    let mut sums = TableSum::Vector(sums);
    splines.encode_vjp::<f64, Portable>(&alone(y, p), bars, &mut sums);
}

/// Values by the recursion of Cox and de Boor over all coefficients of a level.
fn by_recursion(splines: &Splines, c: &[f64], y: [f64; 3]) -> Vec<f64> {
    let SplineSize { levels, features, degree } = splines.size();
    let mut values = Vec::new();
    for (side, range) in levels.iter().zip(splines.size().ranges()) {
        let n = degree.number();
        let cells = (side - n) as f64;
        let basis = |i: usize, coordinate: f64| {
            fn spline(i: f64, n: usize, x: f64) -> f64 {
                if n == 0 {
                    return f64::from(u8::from(i <= x && x < i + 1.0));
                }
                let d = n as f64;
                (x - i) / d * spline(i, n - 1, x)
                    + (i + d + 1.0 - x) / d * spline(i + 1.0, n - 1, x)
            }
            spline(i as f64 - n as f64, n, 0.5 * (coordinate + 1.0) * cells)
        };
        for f in 0..*features {
            let mut sum = 0.0;
            for (k, c) in c[range.clone()].iter().skip(f).step_by(*features).enumerate() {
                let index = [k / side / side, k / side % side, k % side];
                sum += c * (0..3).map(|a| basis(index[a], y[a])).product::<f64>();
            }
            values.push(sum);
        }
    }
    values
}

const POINTS: [[f64; 3]; 4] =
    [[0.31, -0.47, 0.83], [-0.99, 0.02, 0.999], [0.5, 0.25, -0.61], [-0.123, 0.77, 0.013]];

#[test]
fn values_match_the_recursion_of_de_boor() {
    for (splines, c) in all() {
        for y in POINTS {
            let values = by_recursion(&splines, &c, y);
            for (jet, value) in jets(&splines, &c, y, [0.0; 3]).iter().zip(values) {
                assert_relative_eq!(jet.value, value, epsilon = 1e-12);
            }
        }
    }
}

#[test]
fn derivatives_match_differences() {
    let (h, p) = (1e-5, [0.3, -0.8, 0.5]);
    for (splines, c) in all() {
        for y in POINTS {
            let exact = jets(&splines, &c, y, p);
            for axis in 0..3 {
                let moved = |h: f64| {
                    let mut y = y;
                    y[axis] += h;
                    jets(&splines, &c, y, p)
                };
                for ((jet, up), down) in exact.iter().zip(moved(h)).zip(moved(-h)) {
                    let slope = (up.value - down.value) / (2.0 * h);
                    assert_relative_eq!(jet.slope[axis], slope, epsilon = 1e-7);
                    let along = |jet: &Jet<f64>| (0..3).map(|a| jet.slope[a] * p[a]).sum::<f64>();
                    let bend = (along(&up) - along(&down)) / (2.0 * h);
                    assert_relative_eq!(jet.bend[axis], bend, epsilon = 1e-6);
                }
            }
        }
    }
}

/// Jets are linear in the coefficients, so the VJP of each must be exact.
#[test]
fn the_reverse_mode_matches_the_coefficients() {
    let p = [0.3, -0.8, 0.5];
    for (splines, c) in all() {
        let adjoint = |f: usize| [1.0 + f as f64, 0.5 - f as f64];
        let total = |c: &[f64], y| {
            let along = |jet: &Jet<f64>| (0..3).map(|a| jet.slope[a] * p[a]).sum::<f64>();
            let jets = jets(&splines, c, y, p).into_iter().enumerate();
            jets.map(|(f, jet)| adjoint(f)[0] * jet.value + adjoint(f)[1] * along(&jet)).sum()
        };
        for y in POINTS {
            let mut sums = vec![0.0; c.len()];
            vjp(&splines, y, p, adjoint, &mut sums);
            let product: f64 = sums.iter().zip(&c).map(|(s, c)| s * c).sum();
            let expected: f64 = total(&c, y);
            assert_relative_eq!(product, expected, max_relative = 1e-10);
            let met: Vec<usize> = (0..sums.len()).filter(|i| sums[*i] != 0.0).collect();
            let taps = splines.size().degree.taps();
            assert!(met.len() <= splines.size().feature_count() * taps.pow(3));
            for i in met.into_iter().step_by(17) {
                let mut moved = c.clone();
                moved[i] += 1.0;
                assert_relative_eq!(sums[i], total(&moved, y) - expected, epsilon = 1e-9);
            }
        }
    }
}

#[test]
fn points_outside_have_the_features_of_the_nearest_point_of_the_cube() {
    for (splines, c) in all() {
        let far = jets(&splines, &c, [7.0, -9.0, 0.3], [1.0; 3]);
        let near = jets(&splines, &c, [1.0, -1.0, 0.3], [1.0; 3]);
        for (far, near) in far.iter().zip(near) {
            assert_relative_eq!(far.value, near.value, max_relative = 1e-12);
            assert!(far.slope[0] == 0.0 && far.slope[1] == 0.0 && far.slope[2] != 0.0);
        }
    }
}

/// With some nodes free, features are those of a table without the others, and the adjoints of the
/// free coefficients are the same.
#[test]
fn nodes_that_are_not_free_have_no_part() {
    let p = [0.3, -0.8, 0.5];
    for (all, c) in all() {
        let (mut some, size) = (all.clone(), all.size().clone());
        let is_free = |i: usize| i.is_multiple_of(3) && i < 400;
        let flags: Vec<bool> = (0..9 * 9 * 9).map(is_free).collect();
        some.set_free_nodes(1, &flags);
        assert_eq!((some.free_nodes(0), some.free_nodes(1)), (vec![true; 125], flags.clone()));
        let free = some.gather(&c);
        assert_eq!(free.len(), some.free_count());
        let mut table = vec![0.0; c.len()];
        some.expand(&free, &mut table);
        let second = size.ranges().nth(1).unwrap();
        for (i, (found, original)) in table.iter().zip(&c).enumerate() {
            let is_kept = !second.contains(&i) || flags[(i - second.start) / size.features];
            assert_eq!(*found, if is_kept { *original } else { 0.0 });
        }
        for y in POINTS {
            for (a, b) in jets(&some, &table, y, p).iter().zip(jets(&all, &table, y, p)) {
                assert_eq!((a.value, a.slope, a.bend), (b.value, b.slope, b.bend));
            }
            let adjoint = |f: usize| [1.0 + f as f64, 0.5 - f as f64];
            let (mut of_free, mut of_all) = (vec![0.0; free.len()], vec![0.0; c.len()]);
            vjp(&some, y, p, adjoint, &mut of_free);
            vjp(&all, y, p, adjoint, &mut of_all);
            for (a, b) in of_free.iter().zip(some.gather(&of_all)) {
                assert_relative_eq!(*a, b, epsilon = 1e-12);
            }
        }
    }
}

#[test]
fn a_spline_is_largest_at_its_node_and_ends_at_its_reach() {
    for degree in [Degree::Quadratic, Degree::Cubic] {
        let splines = Splines::new(SplineSize { levels: vec![8], features: 1, degree });
        let node = (3 * 8 + 4) * 8 + 4;
        let mut c = splines.table();
        c[node] = 1.0;
        let (middle, reach) = (splines.node(0, node), splines.reach(0));
        for axis in 0..3 {
            let at = |offset: f64| {
                let mut y = middle;
                y[axis] += offset;
                jets(&splines, &c, y, [0.0; 3])[0].value
            };
            assert!(at(0.0) > at(0.05 * reach) && at(0.0) > at(-0.05 * reach));
            assert_relative_eq!(at(0.3 * reach), at(-0.3 * reach), max_relative = 1e-9);
            assert!(at(0.99 * reach) > 0.0 && at(1.01 * reach) == 0.0 && at(-1.01 * reach) == 0.0);
        }
    }
}
