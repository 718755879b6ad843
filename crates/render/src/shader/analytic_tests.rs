//! The derivatives of the formulas against dual numbers, and their cost by counted operations.

use std::cell::Cell;
use std::ops::{Add, Div, Mul, Neg, Sub};

use approx::assert_relative_eq;

use super::*;

thread_local! {
    static OPERATIONS: Cell<usize> = const { Cell::new(0) };
}

/// A number that counts the operations on it.
#[derive(Clone, Copy)]
struct Counting(f64);

impl Counting {
    fn counted(value: f64) -> Self {
        OPERATIONS.set(OPERATIONS.get() + 1);
        Counting(value)
    }
}

macro_rules! count {
    ($trait:ident, $function:ident) => {
        impl $trait for Counting {
            type Output = Self;
            fn $function(self, other: Self) -> Self {
                Self::counted(self.0.$function(other.0))
            }
        }
    };
}

count!(Add, add);
count!(Sub, sub);
count!(Mul, mul);
count!(Div, div);

impl Neg for Counting {
    type Output = Self;
    fn neg(self) -> Self {
        Self::counted(-self.0)
    }
}

impl Scalar for Counting {
    type Real = f64;
    fn constant(value: f64) -> Self {
        Counting(value)
    }
    fn real(self) -> f64 {
        self.0
    }
    fn sqrt(self) -> Self {
        Self::counted(self.0.sqrt())
    }
    fn exp(self) -> Self {
        Self::counted(self.0.exp())
    }
    fn ln(self) -> Self {
        Self::counted(self.0.ln())
    }
    fn sin(self) -> Self {
        Self::counted(self.0.sin())
    }
    fn cos(self) -> Self {
        Self::counted(self.0.cos())
    }
}

const X: V<f64> = [0.2, -0.1, 0.4];
const NORMAL: V<f64> = [0.48, 0.6, 0.64];
const ADJOINT: V<f64> = [0.7, -0.2, 0.5];

/// A Lambertian formula with lights of one kind in different places, all above the horizon of
/// [`NORMAL`], and its parameters.
fn lambert(light: Light, lights: usize) -> (Formula, Vec<f64>) {
    let mut parameters = vec![0.8, 0.6, 0.4, 0.1, 0.2, 0.3];
    for i in 0..lights {
        let shift = i as f64 / 50.0;
        parameters.extend([1.5 - shift, 0.8, 2.0 + shift, 0.9, 0.8 + shift, 0.7]);
    }
    (Formula::Lambert { lights: vec![light; lights] }, parameters)
}

/// The operations of the radiance and of its VJP at one point.
fn operations(light: Light, lights: usize) -> [usize; 2] {
    let (formula, parameters) = lambert(light, lights);
    let parameters: Vec<Counting> = parameters.into_iter().map(Counting).collect();
    let (x, n, adjoint) = (X.map(Counting), NORMAL.map(Counting), ADJOINT.map(Counting));
    let mut bars = vec![Counting(0.0); parameters.len()];
    OPERATIONS.set(0);
    formula.radiance(&parameters, x, n, ALL_LIT);
    let forward = OPERATIONS.take();
    formula.vjp(&parameters, [x, n], ALL_LIT, adjoint, &mut bars);
    [forward, OPERATIONS.take()]
}

#[test]
fn operations_grow_linearly_with_the_number_of_lights() {
    for light in [Light::Directional, Light::Point] {
        let [none, one] = [0, 1].map(|lights| operations(light, lights));
        for pass in 0..2 {
            let of_light = one[pass] - none[pass];
            assert!(of_light > 0);
            for lights in [2, 8, 16, 32, 64] {
                let expected = none[pass] + lights * of_light;
                let found = operations(light, lights)[pass];
                assert_eq!(found, expected, "{light:?}, {lights} lights, pass {pass}");
            }
        }
    }
}

/// The derivative of adjoint · radiance by one of the parameters, then x, then n, in dual numbers.
fn derivative(formula: &Formula, parameters: &[f64], lit: u64, index: usize) -> f64 {
    let inputs: Vec<Dual<f64, 1>> = parameters
        .iter()
        .chain(&X)
        .chain(&NORMAL)
        .enumerate()
        .map(|(i, v)| if i == index { Dual::variable(*v, 0) } else { Dual::lift(*v) })
        .collect();
    let (x, n) = (at(&inputs, parameters.len()), at(&inputs, parameters.len() + 3));
    let rgb = formula.radiance(&inputs, x, n, lit);
    (0..3).map(|c| ADJOINT[c] * rgb[c].d[0]).sum()
}

#[test]
fn the_vjp_equals_dual_numbers_of_the_radiance() {
    let [directional, point] = [Light::Directional, Light::Point].map(|light| lambert(light, 3));
    let constant = (Formula::Constant, vec![0.1, 0.2, 0.3]);
    for (formula, parameters) in [directional, point, constant, (Formula::Normal, Vec::new())] {
        // All lights, and all but the second.
        for lit in [ALL_LIT, !2] {
            let mut bars = vec![0.25; parameters.len()];
            let [x, n] = formula.vjp(&parameters, [X, NORMAL], lit, ADJOINT, &mut bars);
            bars.iter_mut().for_each(|bar| *bar -= 0.25);
            bars.extend(x.into_iter().chain(n));
            for (i, bar) in bars.iter().enumerate() {
                let expected = derivative(&formula, &parameters, lit, i);
                assert_relative_eq!(*bar, expected, epsilon = 1e-14, max_relative = 1e-13);
            }
        }
    }
}
