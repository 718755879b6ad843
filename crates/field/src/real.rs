//! The precision of a computation: `f32` or `f64`, a type parameter in all crates.

use std::fmt::{Debug, Display};
use std::ops::{Add, AddAssign, Mul, Neg, Sub};

use num_traits::{Float, FloatConst, NumAssign};

/// A floating-point type and its vector type: `f32` with [`glam::Vec3`], `f64` with
/// [`glam::DVec3`].
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
    fn of(v: glam::DVec3) -> Self {
        Self::new(R::of(v.x), R::of(v.y), R::of(v.z))
    }
    /// The vector in double precision.
    fn to_double(self) -> glam::DVec3 {
        let [x, y, z] = self.to_array();
        glam::DVec3::new(x.to_double(), y.to_double(), z.to_double())
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

macro_rules! implement_real {
    ($real:ty, $vec:ty) => {
        impl Real for $real {
            type Vec3 = $vec;
            #[inline(always)]
            fn of(value: f64) -> Self {
                value as $real
            }
            #[inline(always)]
            fn to_double(self) -> f64 {
                f64::from(self)
            }
        }

        impl Vector3<$real> for $vec {
            #[inline(always)]
            fn new(x: $real, y: $real, z: $real) -> Self {
                <$vec>::new(x, y, z)
            }
            #[inline(always)]
            fn to_array(self) -> [$real; 3] {
                <$vec>::to_array(&self)
            }
            #[inline(always)]
            fn dot(self, other: Self) -> $real {
                <$vec>::dot(self, other)
            }
            #[inline(always)]
            fn cross(self, other: Self) -> Self {
                <$vec>::cross(self, other)
            }
        }
    };
}

implement_real!(f32, glam::Vec3);
implement_real!(f64, glam::DVec3);
