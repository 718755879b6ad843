//! The points that keep a weight, and what is made of them: V and ∇·V forward, coefficients in
//! reverse.

use field::{Real, Vector3};

/// The points of a batch that keep a weight, with what V and its divergence need of them. The
/// points of a ray follow each other, in order along it; rays are in the batch's order.
#[derive(Clone, Debug, Default)]
pub struct Kept<R: Real> {
    /// x_i.
    pub points: Vec<R::Vec3>,
    /// The ray of each point.
    pub ray: Vec<usize>,
    /// The index of each point among those its ray visited.
    pub index: Vec<usize>,
    /// ŵ_i; a ray's sum to 1.
    pub weight: Vec<R>,
    /// a_i = ŵ_i J m_i, in pixels per unit of f.
    pub a: Vec<[R; 2]>,
    /// ∇_u·a_i, per unit of f; empty if the divergence was not asked for.
    pub divergence_a: Vec<R>,
    /// b_i = Σ_e a_i,e ∂x_i/∂u_e, in world units per unit of f; empty if the divergence was not
    /// asked for.
    pub b: Vec<R::Vec3>,
    /// The number of rays in the batch.
    pub rays: usize,
    /// For each ray, whether all was finite. A ray for which it was not contributes nothing: its V
    /// is 0.
    pub valid: Vec<bool>,
    /// The number of rays that are not valid.
    pub invalid: usize,
}

impl<R: Real> Kept<R> {
    /// No points yet, of rays with these flags.
    pub(crate) fn of_rays(valid: Vec<bool>) -> Self {
        let invalid = valid.iter().filter(|valid| !**valid).count();
        Kept { rays: valid.len(), invalid, valid, ..Kept::default() }
    }

    /// V of every ray, in pixels per unit of the parameter; `f_dot` is ∂_θ f at every kept point.
    pub fn velocity(&self, f_dot: &[R]) -> Vec<[R; 2]> {
        let mut v = vec![[R::zero(); 2]; self.rays];
        for (i, &ray) in self.ray.iter().enumerate() {
            for e in 0..2 {
                v[ray][e] -= self.a[i][e] * f_dot[i];
            }
        }
        v
    }

    /// ∇_u·V of every ray, per unit of the parameter; `f_dot` and `gradient_dot` are ∂_θ f and ∂_θ
    /// ∇f at every kept point.
    ///
    /// # Panics
    /// If the divergence was not asked for.
    pub fn divergence(&self, f_dot: &[R], gradient_dot: &[R::Vec3]) -> Vec<R> {
        let mut out = vec![R::zero(); self.rays];
        for (i, &ray) in self.ray.iter().enumerate() {
            out[ray] -= self.divergence_a[i] * f_dot[i] + self.b[i].dot(gradient_dot[i]);
        }
        out
    }

    /// VJP of θ ↦ V and ∇·V: the coefficients (α_i, c_i) at the kept points for
    /// `Field::parameter_vjp`, given a ray's adjoints of its divergence, `scalar` = δ·(L − c), and
    /// of its velocity, `film` = δ·∇_u L.
    ///
    /// # Panics
    /// If the divergence was not asked for.
    pub fn area_vjp(&self, scalar: &[R], film: &[[R; 2]]) -> (Vec<R>, Vec<R::Vec3>) {
        (0..self.points.len())
            .map(|i| {
                let (s, q) = (scalar[self.ray[i]], film[self.ray[i]]);
                let along = q[0] * self.a[i][0] + q[1] * self.a[i][1];
                (-(along + s * self.divergence_a[i]), -self.b[i] * s)
            })
            .unzip()
    }

    /// VJP of θ ↦ −flux: the coefficients α_i at the kept points for boundary samples with adjoints
    /// `flux` and edge normals along film axis `axis`. The boundary term enters a pixel as −(L − c)
    /// V·n, and V = −Σ a_i ∂_θ f: hence the plus.
    pub fn flux_vjp(&self, flux: &[R], axis: &[usize]) -> Vec<R> {
        self.ray.iter().zip(&self.a).map(|(&ray, a)| flux[ray] * a[axis[ray]]).collect()
    }
}
