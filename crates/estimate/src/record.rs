//! What an estimator leaves of a batch of pixels, and its reverse mode.

use boundary::Edge;
use field::{Real, Vector3};

use super::adjoints::Adjoints;
use super::primary::filter;
use super::{Primary, Sample, Setup, Warped};

/// Everything about some pixels that is linear in their adjoints.
#[derive(Default)]
pub struct Record<R: Real> {
    /// The radiance of every pixel, as the estimator's own samples have it.
    pub radiance: Vec<R::Vec3>,
    /// Rays traced.
    pub rays: u64,
    /// Samples of areas.
    pub area: Vec<Area<R>>,
    /// Samples of pixels' borders.
    pub border: Option<Border<R>>,
    /// Points of silhouettes.
    pub silhouettes: Silhouettes<R>,
}

/// How reverse mode treats what it is given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pass<R> {
    /// Coefficients of pixels apart, as derivative images need them.
    PerPixel,
    /// Coefficients of pixels together.
    Sum,
    /// Together, and no sample's coefficient of f larger than this many times that of a silhouette
    /// that crosses its whole pixel.
    Limited(R),
}

impl<R: Real> Record<R> {
    /// VJP of parameters ↦ pixel values: coefficients at points are added to `out`, the shader's
    /// parameter adjoint to `shader`. `delta` has one adjoint a pixel. The points do not depend on
    /// `delta`.
    pub fn vjp(
        &self,
        setup: &Setup<'_, R>,
        delta: &[R::Vec3],
        pass: Pass<R>,
        shader: &mut [R],
        out: &mut Adjoints<R>,
    ) {
        for area in &self.area {
            area.vjp(setup, delta, pass, shader, out);
        }
        if let Some(border) = &self.border {
            border.vjp(delta, pass, out);
        }
        self.silhouettes.vjp(delta, out);
    }
}

/// Film samples, their hits, and a warp if there is one.
pub struct Area<R: Real> {
    /// The samples.
    pub samples: Vec<Sample>,
    /// What they see.
    pub primary: Primary<R>,
    /// The pixel of each sample.
    pub pixel: Vec<u32>,
    /// The share of each sample in its pixel.
    pub weight: Vec<R>,
    /// The warp at every sample.
    pub warp: Option<AreaWarp<R>>,
}

/// A warp at film samples.
pub struct AreaWarp<R: Real> {
    /// V and ∇·V as coefficients on f and ∇f.
    pub warped: Warped<R>,
    /// L − c of each sample, for the constant c of its pixel.
    pub excess: Vec<R::Vec3>,
    /// ∇ ln k of the pixel filter k at each sample, per pixel; empty where it is constant.
    pub filter_du: Vec<[R; 2]>,
}

impl<R: Real> Area<R> {
    /// VJP of parameters ↦ the samples of this area; see [`Record::vjp`].
    pub fn vjp(
        &self,
        setup: &Setup<'_, R>,
        delta: &[R::Vec3],
        pass: Pass<R>,
        shader: &mut [R],
        out: &mut Adjoints<R>,
    ) {
        let n = self.samples.len();
        let delta: Vec<R::Vec3> =
            (0..n).map(|i| delta[self.pixel[i] as usize] * self.weight[i]).collect();
        let adjoint: Vec<R::Vec3> = self.primary.hits.iter().map(|&i| delta[i]).collect();
        let surface = setup.surface_vjp(&self.samples, &self.primary, &adjoint, shader);
        let (mut scalar, mut film, mut total) =
            (vec![R::zero(); n], vec![[R::zero(); 2]; n], vec![R::zero(); n]);
        for (hit, &i) in self.primary.hits.iter().enumerate() {
            (film[i], total[i]) = (surface.film[hit], surface.alpha[hit]);
        }
        if let Some(warp) = &self.warp {
            for i in 0..n {
                scalar[i] = delta[i].dot(warp.excess[i]);
                if let Some(du) = warp.filter_du.get(i) {
                    film[i] = std::array::from_fn(|e| film[i][e] + scalar[i] * du[e]);
                }
            }
        }
        let mut scale = vec![R::one(); n];
        if let Pass::Limited(limit) = pass {
            if let Some(warp) = &self.warp {
                warp.warped.add_area_totals(&scalar, &film, &mut total);
            }
            for i in 0..n {
                let limit = limit * self.silhouette_coefficient(setup, i, delta[i]);
                scale[i] = limit / total[i].abs().max(limit).max(R::min_positive_value());
            }
        }
        for (hit, &i) in self.primary.hits.iter().enumerate() {
            out.push(
                self.pixel[i],
                self.primary.x[hit],
                surface.alpha[hit] * scale[i],
                surface.c[hit] * scale[i],
            );
        }
        if let Some(warp) = &self.warp {
            scalar.iter_mut().zip(&scale).for_each(|(s, k)| *s *= *k);
            film.iter_mut().zip(&scale).for_each(|(f, k)| *f = f.map(|v| v * *k));
            warp.warped.area_vjp(&scalar, &film, &self.pixel, out);
        }
    }

    /// Keeps the samples of some pixels.
    pub(super) fn retain(&mut self, keep: impl Fn(u32) -> bool) {
        debug_assert!(self.warp.is_none());
        let keep: Vec<bool> = self.pixel.iter().map(|pixel| keep(*pixel)).collect();
        self.primary.retain(&keep);
        filter(&mut self.samples, &keep);
        filter(&mut self.pixel, &keep);
        filter(&mut self.weight, &keep);
    }

    /// The coefficient of f of a silhouette that crosses the whole pixel at full contrast. The
    /// estimators' tails have no variance to speak of (1/distance next to a silhouette, 1/cosine at
    /// a grazing hit), and single samples would undo a hundred iterations of a fit.
    fn silhouette_coefficient(&self, setup: &Setup<'_, R>, i: usize, delta: R::Vec3) -> R {
        let camera = &setup.cameras[self.samples[i].camera];
        let t = self.primary.found[i].map_or(R::infinity(), |found| found.t);
        R::of(camera.focal.max_element()) / t.max(R::min_positive_value()) * delta.length()
    }
}

/// Samples of the borders of pixels.
pub struct Border<R: Real> {
    /// The edge of each sample; its pixels are indices in the record.
    pub edge: Vec<Edge>,
    /// The radiance of each sample.
    pub radiance: Vec<R::Vec3>,
    /// The constant c of each pixel.
    pub constant: Vec<R::Vec3>,
    /// V at every sample.
    pub warped: Warped<R>,
    /// The share of one sample in its edge.
    pub weight: R,
}

impl<R: Real> Border<R> {
    fn vjp(&self, delta: &[R::Vec3], pass: Pass<R>, out: &mut Adjoints<R>) {
        let axis: Vec<usize> = self.edge.iter().map(Edge::axis).collect();
        let carried =
            |i: usize, p: usize| delta[p].dot(self.radiance[i] - self.constant[p]) * self.weight;
        let mut push =
            |flux: Vec<R>, pixel: Vec<u32>| self.warped.flux_vjp(&flux, &axis, &pixel, out);
        let all = 0..self.edge.len();
        if pass == Pass::PerPixel {
            let sides: [fn(&Edge) -> Option<usize>; 2] = [Edge::inside, Edge::outside];
            for (side, sign) in sides.into_iter().zip([R::one(), -R::one()]) {
                let flux = all
                    .clone()
                    .map(|i| side(&self.edge[i]).map_or(R::zero(), |p| sign * carried(i, p)));
                push(
                    flux.collect(),
                    all.clone().map(|i| side(&self.edge[i]).unwrap_or(0) as u32).collect(),
                );
            }
        } else {
            let flux = all.clone().map(|i| self.edge[i].gather(|p| carried(i, p)));
            push(flux.collect(), all.clone().map(|_| 0).collect());
        }
    }
}

/// Points of silhouettes, each with what f falling there adds to its pixel.
pub struct Silhouettes<R: Real> {
    /// The points.
    pub x: Vec<R::Vec3>,
    /// The pixel of each.
    pub pixel: Vec<u32>,
    /// −∂(pixel value)/∂f at each, RGB.
    pub rgb: Vec<R::Vec3>,
}

impl<R: Real> Default for Silhouettes<R> {
    fn default() -> Self {
        Silhouettes { x: Vec::new(), pixel: Vec::new(), rgb: Vec::new() }
    }
}

impl<R: Real> Silhouettes<R> {
    /// Adds a point at which the pixel's value grows by `rgb` as f falls by one.
    pub fn push(&mut self, pixel: u32, x: R::Vec3, rgb: R::Vec3) {
        self.pixel.push(pixel);
        self.x.push(x);
        self.rgb.push(rgb);
    }

    fn vjp(&self, delta: &[R::Vec3], out: &mut Adjoints<R>) {
        for i in 0..self.x.len() {
            let alpha = -delta[self.pixel[i] as usize].dot(self.rgb[i]);
            out.push(self.pixel[i], self.x[i], alpha, R::Vec3::zero());
        }
    }
}
