//! Hand-written derivatives against dual numbers through a plain perceptron, and against finite
//! differences. Model files and inputs that are not finite.

use approx::assert_relative_eq;
use field::{Dual, Field, Scalar, Shader, SurfaceAdjoint, SurfaceBatch};
use glam::{DVec3, Vec3};
use proptest::prelude::*;
use random::Stream;
use sdf_nn::{
    Activation, Architecture, Degree, Encoding, Network, RadianceHead, SplineSize, Transform,
};

/// σ(z) in the number type `S`.
fn activate<S: Scalar<Real = f64>>(activation: Activation, z: S) -> S {
    let constant = S::constant;
    match activation {
        Activation::Softplus { beta } => {
            let e = (-(z * constant(beta)).abs()).exp();
            z.max(constant(0.0)) + (constant(1.0) + e).ln() * constant(1.0 / beta)
        }
        Activation::Sine { omega } => (z * constant(omega)).sin(),
        Activation::Relu => z.max(constant(0.0)),
    }
}

/// The B-spline number `i` of a degree over the integers, by the recursion of Cox and de Boor.
fn spline<S: Scalar<Real = f64>>(i: usize, degree: usize, x: S) -> S {
    fn at<S: Scalar<Real = f64>>(first: f64, n: usize, x: S) -> S {
        if n == 0 {
            let real = x.real();
            return S::constant(f64::from(u8::from(first <= real && real < first + 1.0)));
        }
        let d = n as f64;
        (x - S::constant(first)) * S::constant(1.0 / d) * at(first, n - 1, x)
            + (S::constant(first + d + 1.0) - x) * S::constant(1.0 / d) * at(first + 1.0, n - 1, x)
    }
    at(i as f64 - degree as f64, degree, x)
}

/// f(x) from the definition of the model file, in the number type `S`.
fn reference<S: Scalar<Real = f64>>(
    a: &Architecture,
    t: &Transform,
    parameters: &[S],
    x: [S; 3],
) -> S {
    let center = t.center.to_array();
    let y: [S; 3] =
        std::array::from_fn(|c| (x[c] - S::constant(center[c])) * S::constant(1.0 / t.radius));
    let mut features = y.to_vec();
    for band in 0..a.encoding.bands() {
        let wave = y.map(|c| c * S::constant(f64::powi(2.0, band as i32)));
        features.extend(wave.map(S::sin));
        features.extend(wave.map(S::cos));
    }
    let weights = parameters.len() - a.grid.coefficient_count();
    for (side, range) in a.grid.levels.iter().zip(a.grid.ranges()) {
        let coefficients = &parameters[weights..][range];
        let at = y.map(|c| {
            (c + S::constant(1.0)) * S::constant(0.5 * (side - a.grid.degree.number()) as f64)
        });
        for f in 0..a.grid.features {
            let sum = coefficients.iter().skip(f).step_by(a.grid.features).enumerate().fold(
                S::constant(0.0),
                |sum, (k, c)| {
                    let index = [k / side / side, k / side % side, k % side];
                    let weight =
                        |axis: usize| spline(index[axis], a.grid.degree.number(), at[axis]);
                    sum + *c * weight(0) * weight(1) * weight(2)
                },
            );
            features.push(sum);
        }
    }
    let (mut h, mut at) = (features.clone(), 0);
    for l in 0..=a.hidden.len() {
        if a.skip.contains(&l) {
            h.extend(&features);
            h.iter_mut().for_each(|v| *v = *v * S::constant(0.5f64.sqrt()));
        }
        let outputs = a.hidden.get(l).copied().unwrap_or(1);
        let bias = at + outputs * h.len();
        let z: Vec<S> = (0..outputs)
            .map(|r| {
                h.iter().enumerate().fold(parameters[bias + r], |sum, (c, v)| {
                    sum + parameters[at + r * h.len() + c] * *v
                })
            })
            .collect();
        at = bias + outputs;
        h = if l < a.hidden.len() {
            z.into_iter().map(|z| activate(a.activation, z)).collect()
        } else {
            z
        };
    }
    h[0] * S::constant(t.radius)
}

fn architecture() -> impl Strategy<Value = Architecture> {
    let activation = prop_oneof![
        (1.0..30.0f64).prop_map(|beta| Activation::Softplus { beta }),
        (0.5..4.0f64).prop_map(|omega| Activation::Sine { omega }),
        Just(Activation::Relu),
    ];
    let hidden = prop::collection::vec(1usize..21, 1..4);
    let degree = prop_oneof![Just(Degree::Quadratic), Just(Degree::Cubic)];
    let grid = (prop::collection::vec(4usize..7, 0..3), 1usize..4, degree)
        .prop_map(|(levels, features, degree)| SplineSize { levels, features, degree });
    (hidden, activation, 0usize..4, any::<bool>(), grid).prop_map(
        |(hidden, activation, bands, skip, grid)| Architecture {
            encoding: if bands == 0 { Encoding::None } else { Encoding::Frequency { bands } },
            grid,
            skip: if skip && hidden.len() > 1 { vec![hidden.len() - 1] } else { vec![] },
            hidden,
            activation,
        },
    )
}

/// A small architecture with two octaves.
fn small(activation: Activation) -> Architecture {
    let encoding = Encoding::Frequency { bands: 2 };
    let grid = SplineSize::none();
    Architecture { encoding, grid, hidden: vec![8, 8], skip: vec![], activation }
}

const TRANSFORM: Transform = Transform { center: DVec3::new(0.2, -0.1, 0.3), radius: 1.7 };

/// A network with random parameters, also in the last layer and the biases.
fn network(a: &Architecture, seed: u64) -> Network<f64> {
    let mut network = Network::<f64>::geometric(a.clone(), TRANSFORM, 0.5, Stream::of_seed(seed));
    let random: Vec<f64> = network
        .parameters()
        .iter()
        .enumerate()
        .map(|(i, p)| p * 0.5 + 0.3 * (i as f64 * 1.7 + seed as f64).sin())
        .collect();
    network.set_parameters(&random);
    network
}

fn points(n: usize) -> Vec<DVec3> {
    (0..n)
        .map(|i| {
            DVec3::new((i as f64).sin(), (2.3 * i as f64).cos(), (0.7 * i as f64 + 1.0).sin()) * 0.9
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn spatial_derivatives_match_dual_numbers(
        a in architecture(),
        seed in 0u64..1000,
        p in prop::array::uniform3(-1.0..1.0f64),
        n in 1usize..20,
    ) {
        let network = network(&a, seed);
        let (x, p) = (points(n), DVec3::from(p));
        let (mut value, mut f, mut g) = (vec![0.0; n], vec![0.0; n], vec![DVec3::ZERO; n]);
        let (mut g2, mut hp) = (vec![DVec3::ZERO; n], vec![DVec3::ZERO; n]);
        network.value(&x, &mut value);
        network.value_gradient(&x, &mut f, &mut g);
        network.hessian_vector(&x, &vec![p; n], &mut g2, &mut hp);
        for i in 0..n {
            let at: [_; 3] = std::array::from_fn(|c| {
                Dual::<Dual<f64, 1>, 3>::variable(Dual { value: x[i][c], d: [p[c]] }, c)
            });
            let parameters: Vec<_> =
                network.parameters().iter().map(|v| Dual::constant(*v)).collect();
            let y = reference(&a, &TRANSFORM, &parameters, at);
            let close = |got: f64, want: f64| (got - want).abs() <= 1e-10 * (1.0 + want.abs());
            let want = y.value.value;
            prop_assert!(close(value[i], want), "value {}, dual numbers give {want}", value[i]);
            prop_assert!(close(f[i], want));
            for c in 0..3 {
                let (slope, product) = (y.d[c].value, y.d[c].d[0]);
                prop_assert!(
                    close(g[i][c], slope),
                    "{a:?}: gradient {}, dual numbers give {slope}",
                    g[i][c]
                );
                prop_assert!(close(g2[i][c], slope));
                prop_assert!(
                    close(hp[i][c], product),
                    "{a:?}: Hessian–vector product {}, dual numbers give {product}",
                    hp[i][c]
                );
            }
        }
    }

    #[test]
    fn parameter_vjp_matches_dual_numbers(
        a in architecture(),
        seed in 0u64..1000,
        n in 1usize..20,
    ) {
        let network = network(&a, seed);
        let x = points(n);
        let alpha: Vec<f64> = (0..n).map(|i| (i as f64 + 0.5).cos()).collect();
        let c: Vec<DVec3> = points(n + 3)[3..].to_vec();
        let mut adjoint = vec![0.0; network.parameter_count()];
        network.parameter_vjp(&x, &alpha, &c, &mut adjoint);
        for j in (0..adjoint.len()).step_by(1 + adjoint.len() / 40) {
            let mut want = 0.0;
            for i in 0..n {
                let at = std::array::from_fn(|k| {
                    Dual::<Dual<f64, 1>, 1>::lift(Dual { value: x[i][k], d: [c[i][k]] })
                });
                let seed = |k: usize| [Dual::lift(f64::from(u8::from(k == j)))];
                let parameters: Vec<_> = network
                    .parameters()
                    .iter()
                    .enumerate()
                    .map(|(k, v)| Dual { value: Dual::lift(*v), d: seed(k) })
                    .collect();
                let y = reference(&a, &TRANSFORM, &parameters, at).d[0];
                want += alpha[i] * y.value + y.d[0];
            }
            prop_assert!(
                (adjoint[j] - want).abs() <= 1e-9 * (1.0 + want.abs()),
                "{a:?}: adjoint of parameter {j} is {}, dual numbers give {want}",
                adjoint[j]
            );
        }
    }

    #[test]
    fn results_do_not_depend_on_the_batch(a in architecture(), seed in 0u64..1000) {
        let network = network(&a, seed);
        let x = points(37);
        let (mut f, mut g) = (vec![0.0; 37], vec![DVec3::ZERO; 37]);
        network.value_gradient(&x, &mut f, &mut g);
        for i in 0..37 {
            let (mut one, mut gradient) = ([0.0], [DVec3::ZERO]);
            network.value_gradient(&x[i..=i], &mut one, &mut gradient);
            prop_assert_eq!(one[0].to_bits(), f[i].to_bits());
            prop_assert_eq!(gradient[0], g[i]);
        }
    }

    /// A part of a block after a whole one: the lanes without a point have numbers of the block
    /// before.
    #[test]
    fn passes_with_tangents_do_not_depend_on_the_batch(
        a in architecture(),
        seed in 0u64..1000,
        kept in 1usize..9,
    ) {
        let mut network = network(&a, seed);
        for (level, side) in a.grid.levels.iter().enumerate() {
            let is_free = (0..side.pow(3)).map(|node| node % kept == 0).collect::<Vec<_>>();
            network.set_free_nodes(level, &is_free);
        }
        let (x, p) = (points(37), points(40)[3..].to_vec());
        let alpha: Vec<f64> = (0..37).map(|i| f64::from(i).cos()).collect();
        let (mut g, mut h) = (vec![DVec3::ZERO; 37], vec![DVec3::ZERO; 37]);
        network.hessian_vector(&x, &p, &mut g, &mut h);
        let mut adjoint = vec![0.0; network.parameter_count()];
        let mut sum = adjoint.clone();
        network.parameter_vjp(&x, &alpha, &p, &mut adjoint);
        for i in 0..37 {
            let (mut one, mut product) = ([DVec3::ZERO], [DVec3::ZERO]);
            network.hessian_vector(&x[i..=i], &p[i..=i], &mut one, &mut product);
            prop_assert_eq!((one[0], product[0]), (g[i], h[i]));
            network.parameter_vjp(&x[i..=i], &alpha[i..=i], &p[i..=i], &mut sum);
        }
        for (all, sum) in adjoint.iter().zip(&sum) {
            prop_assert!((all - sum).abs() <= 1e-10 * (1.0 + sum.abs()), "{all} and {sum}");
        }
    }

    #[test]
    fn a_file_keeps_the_function_with_its_octave_weights(
        a in architecture(),
        seed in 0u64..1000,
        w in 0.0..1.0f64,
    ) {
        let mut network = network(&a, seed);
        let bands = a.encoding.bands();
        network.set_band_weights(&vec![w; bands]);
        let bytes = network.to_safetensors().unwrap();
        prop_assert!(
            bytes == network.to_safetensors().unwrap(),
            "two files of one model differ"
        );
        let again = Network::<f64>::from_safetensors(&bytes).unwrap();
        let x = points(5);
        let (mut f, mut g) = ([0.0; 5], [0.0; 5]);
        network.value(&x, &mut f);
        again.value(&x, &mut g);
        for i in 0..5 {
            assert_relative_eq!(f[i], g[i], epsilon = 1e-12, max_relative = 1e-12);
        }
        // The parameter VJP takes the octave weights into account.
        let mut adjoint = vec![0.0; network.parameter_count()];
        network.parameter_vjp(&x[..1], &[1.0], &[DVec3::ZERO], &mut adjoint);
        let (j, h) = (3 + adjoint.len() / 7, 1e-6);
        let moved = |h: f64| {
            let (mut n, mut p, mut f) = (network.clone(), network.parameters().to_vec(), [0.0]);
            p[j] += h;
            n.set_parameters(&p);
            n.value(&x[..1], &mut f);
            f[0]
        };
        let difference = (moved(h) - moved(-h)) / (2.0 * h);
        prop_assert!(
            (adjoint[j] - difference).abs() < 1e-5 * (1.0 + difference.abs()),
            "adjoint of parameter {j} is {}, the finite difference {difference}",
            adjoint[j]
        );
    }

    #[test]
    fn damaged_files_do_not_panic_and_truncated_ones_are_errors(
        at in 0usize..4000,
        byte in any::<u8>(),
        cut in 0usize..4000,
    ) {
        let a = small(Activation::Relu);
        let bytes = network(&a, 1).to_safetensors().unwrap();
        let mut damaged = bytes.clone();
        let at = at % bytes.len();
        damaged[at] = byte;
        let _ = Network::<f32>::from_safetensors(&damaged);
        prop_assert!(Network::<f32>::from_safetensors(&bytes[..cut % bytes.len()]).is_err());
    }

    #[test]
    fn points_that_are_not_finite_give_nan(
        coordinate in prop::sample::select(vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY]),
        i in 0usize..3,
    ) {
        for activation in [
            Activation::Softplus { beta: 100.0 },
            Activation::Sine { omega: 30.0 },
            Activation::Relu,
        ] {
            let (small, stream) = (small(activation), Stream::of_seed(3));
            let network = Network::<f32>::geometric(small, Transform::default(), 0.5, stream);
            let mut x = Vec3::new(0.1, 0.2, 0.3);
            x[i] = coordinate;
            let (mut f, mut g, mut h) = ([0.0], [Vec3::ZERO], [Vec3::ZERO]);
            network.value(&[x], &mut f);
            prop_assert!(f[0].is_nan(), "{activation:?}: the value is {}", f[0]);
            network.hessian_vector(&[x], &[Vec3::X], &mut g, &mut h);
            let mut adjoint = vec![0.0; network.parameters().len()];
            network.parameter_vjp(&[x], &[1.0], &[Vec3::X], &mut adjoint);
        }
    }
}

#[test]
fn geometric_initialisation_is_close_to_a_sphere() {
    for (width, bands, beta) in [(64, 6, 100.0), (32, 0, 100.0), (128, 4, 30.0)] {
        let a = Architecture {
            encoding: if bands == 0 { Encoding::None } else { Encoding::Frequency { bands } },
            grid: SplineSize::none(),
            hidden: vec![width; 3],
            skip: vec![],
            activation: Activation::Softplus { beta },
        };
        let network = Network::<f64>::geometric(
            a,
            Transform { center: DVec3::ONE, radius: 2.0 },
            0.5,
            Stream::of_seed(11),
        );
        let x: Vec<DVec3> =
            points(200).into_iter().filter(|p| p.length() < 1.0 && p.length() > 0.2).collect();
        let world: Vec<DVec3> = x.iter().map(|p| *p * 2.0 + DVec3::ONE).collect();
        let (mut f, mut g) = (vec![0.0; x.len()], vec![DVec3::ZERO; x.len()]);
        network.value_gradient(&world, &mut f, &mut g);
        let error = |i: usize| (f[i] - 2.0 * (x[i].length() - 0.5)).abs() / 2.0;
        let average = (0..x.len()).map(error).sum::<f64>() / x.len() as f64;
        assert!(average < 0.05, "width {width}: mean error of f {average} ball radii");
        // Few random features can leave single directions badly covered. From width 64 on, the
        // limit is tighter.
        let worst = (0..x.len()).map(error).fold(0.0, f64::max);
        assert!(
            worst < if width < 64 { 0.2 } else { 0.1 },
            "width {width}: largest error of f {worst} ball radii"
        );
        let mean = g.iter().map(|g| (g.length() - 1.0).abs()).sum::<f64>() / g.len() as f64;
        assert!(mean < 0.1, "width {width}: mean error of |∇f| {mean}");
    }
}

#[test]
fn single_precision_agrees_with_double_precision() {
    let a = Architecture {
        encoding: Encoding::Frequency { bands: 6 },
        grid: SplineSize::none(),
        hidden: vec![64; 3],
        skip: vec![2],
        activation: Activation::Softplus { beta: 100.0 },
    };
    let double = network(&a, 5);
    let mut single = Network::<f32>::geometric(a, TRANSFORM, 0.5, Stream::of_seed(5));
    single.set_parameters(&double.parameters().iter().map(|p| *p as f32).collect::<Vec<_>>());
    let x = points(50);
    let y: Vec<Vec3> = x.iter().map(|p| p.as_vec3()).collect();
    let (mut f, mut g) = (vec![0.0; 50], vec![DVec3::ZERO; 50]);
    let (mut f32s, mut g32s) = (vec![0.0; 50], vec![Vec3::ZERO; 50]);
    double.value_gradient(&x, &mut f, &mut g);
    single.value_gradient(&y, &mut f32s, &mut g32s);
    for i in 0..50 {
        assert_relative_eq!(f64::from(f32s[i]), f[i], epsilon = 2e-4, max_relative = 2e-4);
        assert!(
            (g32s[i].as_dvec3() - g[i]).length() < 5e-3 * (1.0 + g[i].length()),
            "gradient {} in single precision, {} in double precision",
            g32s[i],
            g[i]
        );
    }
}

type Inputs = [Vec<DVec3>; 3];

/// `Σ_i adjoint_i · RGB_i` of a head at points, normals and directions.
fn total(head: &RadianceHead<f64>, inputs: &Inputs, adjoint: &[DVec3]) -> f64 {
    let mut rgb = vec![DVec3::ZERO; adjoint.len()];
    let [x, normal, direction] = inputs;
    head.radiance(&SurfaceBatch { x, normal, direction }, &mut rgb);
    assert!(rgb.iter().all(|c| c.min_element() >= 0.0 && c.max_element() <= 1.0));
    rgb.iter().zip(adjoint).map(|(c, a)| c.dot(*a)).sum::<f64>()
}

fn assert_close(adjoint: f64, f: impl Fn(f64) -> f64) {
    let h = 1e-6;
    let difference = (f(h) - f(-h)) / (2.0 * h);
    assert_relative_eq!(adjoint, difference, epsilon = 1e-7, max_relative = 1e-5);
}

/// A radiance head with random parameters, also in the last layer and the biases.
///
/// The last level of its details has more corners than entries.
fn head(activation: Activation) -> RadianceHead<f64> {
    let (encoding, details) = (Encoding::Frequency { bands: 3 }, [3, 7, 50]);
    let hidden = vec![13, 9];
    let mut head = RadianceHead::<f64>::new(
        encoding,
        &details,
        hidden,
        activation,
        TRANSFORM,
        Stream::of_seed(3),
    );
    let random: Vec<f64> =
        head.parameters().iter().enumerate().map(|(i, p)| p + 0.2 * (i as f64).sin()).collect();
    head.set_parameters(&random);
    head
}

#[test]
fn adjoints_of_the_head_match_finite_differences() {
    for activation in [Activation::Softplus { beta: 5.0 }, Activation::Relu] {
        let head = head(activation);
        let n = 18;
        let inputs = [points(n), points(n + 1)[1..].to_vec(), points(n + 2)[2..].to_vec()];
        let rgb_adjoint = points(n + 5)[5..].to_vec();
        let (mut surface, mut theta) =
            (SurfaceAdjoint::zeros(n), vec![0.0; head.parameters().len()]);
        let [x, normal, direction] = &inputs;
        let batch = SurfaceBatch { x, normal, direction };
        head.vjp(&batch, &rgb_adjoint, &mut surface, &mut theta);
        let adjoints = [&surface.x, &surface.normal, &surface.direction];
        for (input, adjoint) in adjoints.into_iter().enumerate() {
            for c in 0..3 {
                assert_close(adjoint[7][c], |h| {
                    let mut inputs = inputs.clone();
                    inputs[input][7][c] += h;
                    total(&head, &inputs, &rgb_adjoint)
                });
            }
        }
        // Most features belong to no point.
        let weights = theta.len() - head.detail_count();
        let met = (weights..theta.len()).filter(|j| theta[*j] != 0.0);
        let met: Vec<usize> = met.collect();
        assert!(met.len() > 500 && met.last().is_some_and(|j| *j > theta.len() - 10_000));
        for j in (0..weights).step_by(7).chain(met.into_iter().step_by(5)) {
            assert_close(theta[j], |h| {
                let (mut head, mut p) = (head.clone(), head.parameters().to_vec());
                p[j] += h;
                head.set_parameters(&p);
                total(&head, &inputs, &rgb_adjoint)
            });
        }
    }
}

#[test]
fn a_file_of_a_head_keeps_its_parameters_and_is_no_network() {
    for activation in [Activation::Softplus { beta: 5.0 }, Activation::Relu] {
        let head = head(activation);
        let again = RadianceHead::<f64>::from_safetensors(&head.to_safetensors().unwrap()).unwrap();
        assert_eq!(again.parameters(), head.parameters());
        assert!(Network::<f64>::from_safetensors(&head.to_safetensors().unwrap()).is_err());
    }
}

/// All passes over `n` points: their numbers one after the other.
fn all_passes(network: &Network<f64>, x: &[DVec3]) -> Vec<f64> {
    let n = x.len();
    let (mut f, mut g, mut h) = (vec![0.0; n], vec![DVec3::ZERO; n], vec![DVec3::ZERO; n]);
    let mut theta = vec![0.0; network.parameters().len()];
    let (alpha, p) = (vec![0.7; n], points(n));
    let mut all = Vec::new();
    network.value(x, &mut f);
    all.extend(&f);
    network.value_gradient(x, &mut f, &mut g);
    all.extend(f.iter().copied().chain(g.iter().flat_map(|g| g.to_array())));
    network.hessian_vector(x, &p, &mut g, &mut h);
    all.extend(g.into_iter().chain(h).flat_map(|g| g.to_array()));
    network.parameter_vjp(x, &alpha, &p, &mut theta);
    all.extend(theta);
    all
}

/// Calls use the working memory of earlier ones again, also of those that met a NaN.
#[test]
fn calls_after_others_have_the_bits_of_first_calls() {
    let side = 12;
    let architecture = Architecture {
        encoding: Encoding::Frequency { bands: 2 },
        grid: SplineSize { levels: vec![side], features: 1, degree: Degree::Quadratic },
        hidden: vec![19, 23, 17],
        skip: vec![2],
        activation: Activation::Softplus { beta: 20.0 },
    };
    let mut used = network(&architecture, 3);
    let (mut parameters, first) = (used.parameters().to_vec(), used.weight_count());
    for node in 0..side.pow(3) {
        let [x, y, z] = [node / side / side, node / side % side, node % side];
        if x.max(y).max(z) < side / 2 - 1 {
            parameters[first + node] = f64::NAN;
        }
    }
    used.set_parameters(&parameters);
    let near = |x: DVec3| TRANSFORM.center + (x - TRANSFORM.center).abs() * 0.5;
    for n in [40, 1, 32, 7, 16, 21] {
        let corner = TRANSFORM.center - DVec3::splat(0.5 * TRANSFORM.radius);
        assert!(all_passes(&used, &[corner; 64])[0].is_nan());
        let x: Vec<DVec3> = points(n).into_iter().map(near).collect();
        let found = all_passes(&used, &x);
        // A clone has no memory of calls.
        let expected = all_passes(&used.clone(), &x);
        let bits = |all: &[f64]| all.iter().map(|v| v.to_bits()).collect::<Vec<u64>>();
        assert_eq!(bits(&found), bits(&expected), "{n} points");
        assert!(found.iter().all(|v| v.is_finite()));
    }
}
