//! A number of each point of a group, with arithmetic.

use std::ops::{Add, Mul, Sub};

/// Points whose rows of a table are added up together: the numbers of an AVX2 register.
pub const GROUP: usize = 8;

/// A number of each of [`GROUP`] points. Results have the same bits as those of single numbers.
pub trait Group<R>: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// The same number for all points.
    fn splat(value: R) -> Self;
    /// The numbers of an array.
    fn load(from: &[R; GROUP]) -> Self;
    /// The numbers as an array.
    fn store(self, to: &mut [R; GROUP]);
    /// a b + c, rounded once where the instruction set has a fused multiply–add.
    fn fma(a: Self, b: Self, c: Self) -> Self;
    /// The nearest numbers from 0 to `most`; 0 for a NaN.
    fn clamp(self, most: Self) -> Self;
    /// The lesser numbers. There must be no NaN.
    fn min(self, other: Self) -> Self;
    /// These numbers where a = b, and 0 elsewhere.
    fn where_equal(self, a: Self, b: Self) -> Self;
    /// The integer parts of numbers from 0 to 2²⁴, as integers and as numbers. Those of other
    /// numbers are unspecified.
    fn truncate(self) -> ([u32; GROUP], Self);
}
