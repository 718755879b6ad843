//! The weighted points of a batch of rays: V and ∇·V forward, coefficients in reverse.

use field::{Real, Vector3};

/// A point that keeps a weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WarpSample<R: Real> {
    /// The ray, by its number in the batch.
    pub ray: usize,
    /// The number of the point along its ray.
    pub index: usize,
    /// x_i, in world units.
    pub x: R::Vec3,
    /// ŵ_i; the weights of a ray sum to 1.
    pub weight: R,
    /// a_i = ŵ_i J m_i, in pixels per unit of f.
    pub a: [R; 2],
}

/// The change of a sample's coefficients with the film position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleDivergence<R: Real> {
    /// ∇_u·a_i, per unit of f.
    pub divergence_a: R,
    /// b_i = Σ_e a_i,e ∂x_i/∂u_e, in world units per unit of f.
    pub b: R::Vec3,
}

/// The warp field V of a batch of rays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Warp<R: Real> {
    /// The points that keep a weight: rays in the batch's order, points in order along each.
    pub samples: Vec<WarpSample<R>>,
    /// For each ray, whether all its numbers are finite. A ray that is not valid has no samples,
    /// and its V is 0.
    pub valid: Vec<bool>,
}

/// The warp field V of a batch of rays, and its divergence.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WarpWithDivergence<R: Real> {
    /// V.
    pub warp: Warp<R>,
    /// One element per sample of `warp`.
    pub derivatives: Vec<SampleDivergence<R>>,
}

impl<R: Real> Warp<R> {
    /// The number of rays that are not valid.
    pub fn invalid(&self) -> usize {
        self.valid.iter().filter(|valid| !**valid).count()
    }

    /// The points of all samples, in world units.
    pub fn points(&self) -> Vec<R::Vec3> {
        self.samples.iter().map(|sample| sample.x).collect()
    }

    /// V of every ray, in pixels per unit of the parameter. `f_dot` has ∂_θ f at every sample.
    pub fn velocity(&self, f_dot: &[R]) -> Vec<[R; 2]> {
        let mut v = vec![[R::zero(); 2]; self.valid.len()];
        for (sample, f_dot) in self.samples.iter().zip(f_dot) {
            for (v, a) in v[sample.ray].iter_mut().zip(sample.a) {
                *v -= a * *f_dot;
            }
        }
        v
    }

    /// VJP of θ ↦ −flux through edges of pixels: the coefficient α_i of f at every sample.
    ///
    /// `flux` has one adjoint per ray, and `axis` the film axis of the edge's normal. The boundary
    /// term of a pixel is −(L − c) V·n and V = −Σ a_i ∂_θ f, so α = + flux · a.
    pub fn flux_vjp(&self, flux: &[R], axis: &[usize]) -> Vec<R> {
        self.samples.iter().map(|s| flux[s.ray] * s.a[axis[s.ray]]).collect()
    }
}

impl<R: Real> WarpWithDivergence<R> {
    /// ∇_u·V of every ray, per unit of the parameter. `f_dot` and `gradient_dot` have ∂_θ f and
    /// ∂_θ ∇f at every sample.
    pub fn divergence(&self, f_dot: &[R], gradient_dot: &[R::Vec3]) -> Vec<R> {
        let mut out = vec![R::zero(); self.warp.valid.len()];
        for (i, (sample, rate)) in self.warp.samples.iter().zip(&self.derivatives).enumerate() {
            out[sample.ray] -= rate.divergence_a * f_dot[i] + rate.b.dot(gradient_dot[i]);
        }
        out
    }

    /// VJP of θ ↦ (V, ∇·V): the coefficients α_i of f and c_i of ∇f at every sample, for
    /// `Field::parameter_vjp`.
    ///
    /// The adjoints have one element per ray: `scalar` = δ·(L − c) is that of ∇·V, and
    /// `film` = δ·∇_u L that of V.
    pub fn area_vjp(&self, scalar: &[R], film: &[[R; 2]]) -> (Vec<R>, Vec<R::Vec3>) {
        let pairs = self.warp.samples.iter().zip(&self.derivatives);
        pairs
            .map(|(sample, rate)| {
                let (s, q) = (scalar[sample.ray], film[sample.ray]);
                let along = q[0] * sample.a[0] + q[1] * sample.a[1];
                (-(along + s * rate.divergence_a), -rate.b * s)
            })
            .unzip()
    }
}
