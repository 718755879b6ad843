//! The precision of a computation: `f32` or `f64`, a type parameter in all crates.

use std::fmt::{Debug, Display};
use std::ops::{Add, AddAssign, Mul, Neg, Sub};

use glam::{DVec3, Vec3};
use num_traits::{Float, FloatConst, NumAssign};

/// A floating-point type and its vector type: `f32` with [`Vec3`], `f64` with
/// [`DVec3`].
pub trait Real:
    Float + FloatConst + NumAssign + Debug + Display + Default + Send + Sync + 'static
{
    /// The vector type with three components of this precision.
    type Vec3: Vector3<Self>;

    /// A double-precision number rounded to this precision.
    fn of(value: f64) -> Self;

    /// The value in double precision.
    fn to_double(self) -> f64;
}

/// A vector with three components, generic over the precision.
pub trait Vector3<R: Real>:
    Copy
    + Debug
    + Default
    + PartialEq
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Neg<Output = Self>
    + Mul<R, Output = Self>
    + AddAssign
{
    /// The vector (x, y, z).
    fn new(x: R, y: R, z: R) -> Self;
    /// The components (x, y, z).
    fn to_array(self) -> [R; 3];
    /// The inner product.
    fn dot(self, other: Self) -> R;
    /// The right-handed cross product.
    fn cross(self, other: Self) -> Self;

    /// The zero vector.
    fn zero() -> Self {
        Self::default()
    }
    /// The vector of the components (x, y, z).
    fn from_array([x, y, z]: [R; 3]) -> Self {
        Self::new(x, y, z)
    }
    /// A double-precision vector rounded to this precision.
    fn of(v: DVec3) -> Self {
        Self::new(R::of(v.x), R::of(v.y), R::of(v.z))
    }
    /// The vector in double precision.
    fn to_double(self) -> DVec3 {
        let [x, y, z] = self.to_array();
        DVec3::new(x.to_double(), y.to_double(), z.to_double())
    }
    /// The Euclidean length.
    fn length(self) -> R {
        self.dot(self).sqrt()
    }
    /// Whether no component is infinite or NaN.
    fn is_finite(self) -> bool {
        self.to_array().iter().all(|c| c.is_finite())
    }
}

impl Real for f32 {
    type Vec3 = Vec3;
    #[inline(always)]
    fn of(value: f64) -> Self {
        value as f32
    }
    #[inline(always)]
    fn to_double(self) -> f64 {
        f64::from(self)
    }
}

impl Vector3<f32> for Vec3 {
    #[inline(always)]
    fn new(x: f32, y: f32, z: f32) -> Self {
        Vec3::new(x, y, z)
    }
    #[inline(always)]
    fn to_array(self) -> [f32; 3] {
        Vec3::to_array(&self)
    }
    #[inline(always)]
    fn dot(self, other: Self) -> f32 {
        Vec3::dot(self, other)
    }
    #[inline(always)]
    fn cross(self, other: Self) -> Self {
        Vec3::cross(self, other)
    }
}

impl Real for f64 {
    type Vec3 = DVec3;
    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn to_double(self) -> f64 {
        self
    }
}

impl Vector3<f64> for DVec3 {
    #[inline(always)]
    fn new(x: f64, y: f64, z: f64) -> Self {
        DVec3::new(x, y, z)
    }
    #[inline(always)]
    fn to_array(self) -> [f64; 3] {
        DVec3::to_array(&self)
    }
    #[inline(always)]
    fn dot(self, other: Self) -> f64 {
        DVec3::dot(self, other)
    }
    #[inline(always)]
    fn cross(self, other: Self) -> Self {
        DVec3::cross(self, other)
    }
}
