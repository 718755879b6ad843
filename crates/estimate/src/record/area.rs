//! Samples of the areas of pixels.

use field::RayAdjoint;
use field::{PartialSum, Real, Vector3};
use render::{Primary, Scene, retain_flagged};
use trace::hit_vjp;

use crate::record::adjoints::{Adjoints, PointAdjoint};
use crate::record::cameras::CameraAdjoints;
use crate::record::film_warp::FilmWarpWithDivergence;
use crate::record::parts::PixelParts;
use crate::record::pass::Pass;
use crate::record::surface::{HitBar, SurfaceCoefficients, surface_vjp};

/// The pixel of a sample, and its weight there.
#[derive(Clone, Copy, Debug)]
pub struct PixelWeight<R> {
    /// The pixel, by its number in the batch.
    pub pixel: u32,
    /// The weight of the sample in the pixel's value.
    pub weight: R,
}

/// Film samples in the areas of pixels with their hits, and a warp if the estimator has one.
#[derive(Debug)]
pub struct Area<R: Real> {
    /// The samples and their hits.
    pub primary: Primary<R>,
    /// The pixel and the weight of each sample.
    pub weights: Vec<PixelWeight<R>>,
    /// The warp at every sample.
    pub warp: Option<AreaWarp<R>>,
    /// The adjoints of the hits by losses beside the pixels' radiance; one per hit, or none. They
    /// do not count for cameras: a loss that compares photographs depends on these by other ways
    /// too.
    pub of_hits: Vec<HitBar<R>>,
}

/// A warp at film samples.
#[derive(Debug)]
pub struct AreaWarp<R: Real> {
    /// V and ∇_u·V at the samples.
    pub film_warp: FilmWarpWithDivergence<R>,
    /// One row per sample.
    pub samples: Vec<WarpedSample<R>>,
}

/// The quantities at a film sample that its warp is multiplied by.
#[derive(Clone, Copy, Debug)]
pub struct WarpedSample<R: Real> {
    /// L − c, linear RGB, with the baseline c: the background, or the mean of the pixel's other
    /// samples.
    pub radiance_minus_baseline: R::Vec3,
    /// ∇_u ln k of the pixel filter k, per pixel; zero for a box filter.
    pub filter_du: [R; 2],
    /// Whether the baseline is the background along the sample's ray.
    pub less_background: bool,
}

/// For each sample: the adjoints of ∇_u·V and of V, and the sum of its coefficients of f.
struct SampleAdjoints<R> {
    divergence: Vec<R>,
    film: Vec<[R; 2]>,
    total: Vec<R>,
}

impl<R: Real> Area<R> {
    /// Samples with these weights, without a warp and without adjoints of hits.
    pub fn new(primary: Primary<R>, weights: Vec<PixelWeight<R>>) -> Self {
        Area { primary, weights, warp: None, of_hits: Vec::new() }
    }

    /// `spp` samples per pixel with equal weights, in the order of the pixels, without a warp.
    pub fn uniform(primary: Primary<R>, spp: u32) -> Self {
        let weight = R::one() / R::of(f64::from(spp));
        let in_pixel = |i: usize| PixelWeight { pixel: i as u32 / spp, weight };
        let weights = (0..primary.samples.len()).map(in_pixel).collect();
        Area::new(primary, weights)
    }

    /// VJP of θ ↦ the part of these samples in the pixel values; see [`crate::record::Record::vjp`] for the
    /// arguments.
    pub fn vjp(
        &self,
        scene: &Scene<'_, R>,
        delta: &[R::Vec3],
        pass: Pass<R>,
        shader: &mut PartialSum<R>,
        out: &mut Adjoints<R>,
    ) {
        let delta: Vec<R::Vec3> =
            self.weights.iter().map(|s| delta[s.pixel as usize] * s.weight).collect();
        let adjoint: Vec<R::Vec3> = self.primary.hits.iter().map(|hit| delta[hit.sample]).collect();
        let surface = surface_vjp(scene, &self.primary, &adjoint, &self.of_hits, shader);
        let mut adjoints = self.sample_adjoints(&delta, &surface);
        if scene.background.uniform().is_none() {
            self.add_background_du(scene, &delta, &mut adjoints.film);
        }
        let scale = self.scale(scene, &delta, pass, &mut adjoints);
        if let Some(cameras) = &mut out.cameras {
            self.add_cameras(scene, &delta, &surface, &scale, cameras);
        }
        for (i, (hit, surface)) in self.primary.hits.iter().zip(surface).enumerate() {
            let scale = scale[hit.sample];
            let (x, alpha, c) =
                (self.primary.surface.x[i], surface.alpha * scale, surface.c * scale);
            out.push(self.weights[hit.sample].pixel, PointAdjoint { x, alpha, c });
        }
        if let Some(warp) = &self.warp {
            let SampleAdjoints { mut divergence, mut film, .. } = adjoints;
            divergence.iter_mut().zip(&scale).for_each(|(s, k)| *s *= *k);
            film.iter_mut().zip(&scale).for_each(|(f, k)| *f = f.map(|v| v * *k));
            let pixel = |sample: usize| self.weights[sample].pixel;
            warp.film_warp.area_vjp(&divergence, &film, pixel, out);
        }
    }

    /// The adjoints of every sample; `delta` are those of radiance, with the samples' weights.
    fn sample_adjoints(
        &self,
        delta: &[R::Vec3],
        surface: &[SurfaceCoefficients<R>],
    ) -> SampleAdjoints<R> {
        let n = self.weights.len();
        let mut divergence = vec![R::zero(); n];
        let (mut film, mut total) = (vec![[R::zero(); 2]; n], vec![R::zero(); n]);
        for (hit, surface) in self.primary.hits.iter().zip(surface) {
            (film[hit.sample], total[hit.sample]) = (surface.film, surface.alpha);
        }
        if let Some(warp) = &self.warp {
            for (i, WarpedSample { radiance_minus_baseline, filter_du, .. }) in
                warp.samples.iter().enumerate()
            {
                divergence[i] = delta[i].dot(*radiance_minus_baseline);
                film[i] = std::array::from_fn(|e| film[i][e] + divergence[i] * filter_du[e]);
            }
        }
        SampleAdjoints { divergence, film, total }
    }

    /// Adds the part of a background that is not uniform in δ·∇_u(L − c). A sample that misses has
    /// L = B there, and the baseline c may be B at any sample.
    fn add_background_du(&self, scene: &Scene<'_, R>, delta: &[R::Vec3], film: &mut [[R; 2]]) {
        let Some(warp) = &self.warp else { return };
        let (mut own, mut rays, mut adjoint) = (Vec::new(), Vec::new(), Vec::new());
        for (i, hit) in self.primary.hit_mask().into_iter().enumerate() {
            // Where both are B, or neither is, B has no part.
            if hit == warp.samples[i].less_background {
                own.push(i);
                rays.push(scene.background_ray(&self.primary.samples[i].sample));
                adjoint.push(if hit { -delta[i] } else { delta[i] });
            }
        }
        let mut bars = vec![RayAdjoint::zero(); rays.len()];
        scene.background.ray_vjp(&rays, &adjoint, &mut bars);
        for (i, bar) in own.into_iter().zip(bars) {
            let sample = self.primary.samples[i].sample;
            let (_, du) = scene.cameras[sample.camera].direction_du(sample.u);
            for (film, du) in film[i].iter_mut().zip(du) {
                *film += bar.direction.dot(R::Vec3::of(du));
            }
        }
    }

    /// Adds the adjoints of the cameras: of hits by their surface, of misses by the background.
    fn add_cameras(
        &self,
        scene: &Scene<'_, R>,
        delta: &[R::Vec3],
        surface: &[SurfaceCoefficients<R>],
        scale: &[R],
        cameras: &mut CameraAdjoints,
    ) {
        for (hit, surface) in self.primary.hits.iter().zip(surface) {
            let (scale, RayAdjoint { origin, direction }) = (scale[hit.sample], surface.ray);
            let bar = RayAdjoint { origin: origin * scale, direction: direction * scale };
            cameras.add_ray(scene, &self.primary.samples[hit.sample].sample, bar);
        }
        if scene.background.uniform().is_some() {
            return;
        }
        let (mut own, mut rays, mut adjoint) = (Vec::new(), Vec::new(), Vec::new());
        for (i, hit) in self.primary.hit_mask().into_iter().enumerate() {
            if !hit && delta[i] != R::Vec3::zero() {
                own.push(self.primary.samples[i].sample);
                rays.push(scene.background_ray(&self.primary.samples[i].sample));
                adjoint.push(delta[i]);
            }
        }
        let mut bars = vec![RayAdjoint::zero(); rays.len()];
        scene.background.ray_vjp(&rays, &adjoint, &mut bars);
        own.iter().zip(bars).for_each(|(sample, bar)| cameras.add_ray(scene, sample, bar));
    }

    /// Adds the gradient by the background's parameters of the part of these samples in the pixel
    /// values. `delta` has one adjoint per pixel.
    pub fn background_vjp(&self, scene: &Scene<'_, R>, delta: &[R::Vec3], sum: &mut PartialSum<R>) {
        let (mut rays, mut adjoint) = (Vec::new(), Vec::new());
        for (i, hit) in self.primary.hit_mask().into_iter().enumerate() {
            let in_pixel = self.weights[i];
            if !hit {
                rays.push(scene.background_ray(&self.primary.samples[i].sample));
                adjoint.push(delta[in_pixel.pixel as usize] * in_pixel.weight);
            }
        }
        scene.background.add_parameter_vjp(&rays, &adjoint, sum);
    }

    /// For every sample, the factor on its coefficients that enforces the limit of
    /// [`Pass::Limited`].
    fn scale(
        &self,
        scene: &Scene<'_, R>,
        delta: &[R::Vec3],
        pass: Pass<R>,
        adjoints: &mut SampleAdjoints<R>,
    ) -> Vec<R> {
        let Pass::Limited(limit) = pass else { return vec![R::one(); delta.len()] };
        let SampleAdjoints { divergence, film, total } = adjoints;
        // A loss of the hit itself may have the coefficient that it has on a plane.
        let mut allowed = vec![R::zero(); delta.len()];
        let directions = &self.primary.surface.direction;
        for ((hit, d), bar) in self.primary.hits.iter().zip(directions).zip(&self.of_hits) {
            allowed[hit.sample] =
                hit_vjp::<R>(hit.gradient, *d, bar.x, R::Vec3::zero()).alpha.abs();
        }
        if let Some(warp) = &self.warp {
            warp.film_warp.add_area_totals(divergence, film, total);
        }
        (0..delta.len())
            .map(|i| {
                let limit = limit * self.silhouette_coefficient(scene, i, delta[i]) + allowed[i];
                limit / total[i].abs().max(limit).max(R::min_positive_value())
            })
            .collect()
    }

    /// The coefficient of f of a silhouette that crosses the whole pixel of sample `i`, with the
    /// contrast 1.
    ///
    /// Coefficients grow as 1/distance next to a silhouette and as 1/cosine at a grazing hit, so
    /// their variance is infinite. Without a limit, one sample can undo a hundred iterations of a
    /// fit.
    fn silhouette_coefficient(&self, scene: &Scene<'_, R>, i: usize, delta: R::Vec3) -> R {
        let sample = &self.primary.samples[i];
        let camera = &scene.cameras[sample.sample.camera];
        let t = self.primary.ray_of(sample).map_or(R::infinity(), |traced| traced.found.t);
        R::of(camera.focal.max_element()) / t.max(R::min_positive_value()) * delta.length()
    }

    /// Adds samples of other pixels, which get the numbers from `first` on.
    pub(crate) fn append(&mut self, other: Self, first: u32) {
        debug_assert!(self.warp.is_none() && other.warp.is_none());
        self.primary.append(other.primary);
        let moved =
            |in_pixel: PixelWeight<R>| PixelWeight { pixel: in_pixel.pixel + first, ..in_pixel };
        self.weights.extend(other.weights.into_iter().map(moved));
    }

    /// Deals the samples to parts of consecutive pixels, whose pixels are numbered anew.
    pub(crate) fn deal(self, parts: &PixelParts) -> Vec<Self> {
        debug_assert!(self.warp.is_none());
        let of_pixel = |in_pixel: &PixelWeight<R>| parts.of(in_pixel.pixel);
        let of_sample: Vec<usize> = self.weights.iter().map(of_pixel).collect();
        let dealt = self.primary.deal(parts.count(), &of_sample);
        let own = |primary| Area::new(primary, Vec::new());
        let mut out: Vec<Self> = dealt.into_iter().map(own).collect();
        for (in_pixel, part) in self.weights.into_iter().zip(of_sample) {
            out[part]
                .weights
                .push(PixelWeight { pixel: in_pixel.pixel - parts.first(part), ..in_pixel });
        }
        out
    }

    /// Keeps the samples of the pixels for which `keep` is true. The samples must not have a warp.
    pub fn retain(&mut self, keep: impl Fn(u32) -> bool) {
        debug_assert!(self.warp.is_none());
        let keep: Vec<bool> = self.weights.iter().map(|in_pixel| keep(in_pixel.pixel)).collect();
        self.primary.retain(&keep);
        retain_flagged(&mut self.weights, &keep);
    }
}
