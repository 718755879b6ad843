//! What reverse mode leaves: coefficients on f and ∇f at points.

use field::{Field, Real, Vector3};

use super::primary::filter;

/// Points at which the parameter gradient of α f + c·∇f is to be added up.
#[derive(Clone, Debug)]
pub struct Adjoints<R: Real> {
    pub(super) x: Vec<R::Vec3>,
    pub(super) alpha: Vec<R>,
    pub(super) c: Vec<R::Vec3>,
    /// The pixel that each point's coefficients belong to, for derivative images.
    pub(super) pixel: Vec<u32>,
}

impl<R: Real> Default for Adjoints<R> {
    fn default() -> Self {
        Adjoints { x: Vec::new(), alpha: Vec::new(), c: Vec::new(), pixel: Vec::new() }
    }
}

impl<R: Real> Adjoints<R> {
    /// Adds a point on behalf of a pixel.
    pub fn push(&mut self, pixel: u32, x: R::Vec3, alpha: R, c: R::Vec3) {
        self.pixel.push(pixel);
        self.x.push(x);
        self.alpha.push(alpha);
        self.c.push(c);
    }

    /// Whether each point has any weight.
    pub(super) fn weighs(&self) -> Vec<bool> {
        self.alpha
            .iter()
            .zip(&self.c)
            .map(|(a, c)| *a != R::zero() || *c != R::Vec3::zero())
            .collect()
    }

    /// Keeps some points.
    pub(super) fn retain(&mut self, keep: &[bool]) {
        filter(&mut self.x, keep);
        filter(&mut self.alpha, keep);
        filter(&mut self.c, keep);
        filter(&mut self.pixel, keep);
    }

    /// Adds the parameter gradient of all points to `sum`, in one pass. Points without weight cost
    /// nothing.
    pub fn backward(mut self, field: &dyn Field<R>, sum: &mut [R]) {
        self.retain(&self.weighs());
        field.parameter_vjp(&self.x, &self.alpha, &self.c, sum);
    }
}
