//! The estimators `paper`, `paper-all` and `gaussian`: a warp from the points of the sphere tracer.

use boundary::Edges;
use field::{Real, Vector3};
use random::{Name, Stream};
use render::{InvalidField, Pixel, Primary, Sample, Scene, TracedSample, pixel_samples};
use warp::WarpOptions;

use crate::estimator::{Batch, Estimator, Filter, SilhouetteMask};
use crate::gaussian_samples::gaussian_samples;
use crate::options::{Baseline, EstimatorOptions};
use crate::record::{
    Area, AreaWarp, Border, BorderSample, Record, WarpedSample, warp_samples,
    warp_samples_with_divergence,
};

/// Samples in the areas of pixels with the warp from N points of the sphere tracer, and for the box
/// filter the flux of the warp through the borders of the pixels.
///
/// It is consistent as the samples and N grow, for γ > 2. At finite N it has a bias, which is large
/// for motion along the view.
///
/// Bangaru, Gharbi, Li, Luan, Sunkavalli, Hašan, Bi, Xu, Bernstein and Durand, "Differentiable
/// Rendering of Neural SDFs through Reparameterization", SIGGRAPH Asia 2022. The border flux is
/// equation 2 in section 1 of its supplement.
#[derive(Clone, Copy, Debug)]
pub struct WarpedArea {
    options: WarpOptions,
    filter: Filter,
    baseline: Baseline,
}

/// The N of the paper; the memory of a sample is relative to it.
const PUBLISHED_POINTS: usize = WarpOptions::IMAGE.steps;

const EDGE_SAMPLES: Name = Name::new("positions on an edge between pixels", 5);

impl WarpedArea {
    /// As published: the k points of largest weight, box filter, border flux (`paper`).
    pub fn published(options: &EstimatorOptions) -> Self {
        let EstimatorOptions { warp, baseline } = *options;
        WarpedArea { options: warp, filter: Filter::Box, baseline }
    }

    /// Like [`published`](Self::published), but with all N points; k has no effect (`paper-all`).
    pub fn of_all_points(options: &EstimatorOptions) -> Self {
        let published = Self::published(options);
        WarpedArea { options: WarpOptions { top_k: usize::MAX, ..published.options }, ..published }
    }

    /// Like [`published`](Self::published), under an unbounded Gaussian filter: the derivative of
    /// the filter takes the place of the border flux (`gaussian`).
    pub fn gaussian(options: &EstimatorOptions) -> Self {
        WarpedArea { filter: Filter::Gaussian, ..Self::published(options) }
    }

    /// Whether a pixel with these samples may have a baseline of its own.
    ///
    /// It may not if a ray misses the bounding sphere: the warp ends at the outline of the sphere,
    /// where the radiance is the background.
    fn has_own_baseline<R: Real>(&self, samples: &[TracedSample<R>]) -> bool {
        self.baseline == Baseline::PixelMean
            && samples.len() > 1
            && samples.iter().all(|sample| sample.ray.is_some())
    }

    /// The baseline, at samples, of pixels without one of their own.
    fn shared_baseline<R: Real>(
        &self,
        scene: &Scene<'_, R>,
        samples: &[TracedSample<R>],
    ) -> Vec<R::Vec3> {
        match self.baseline {
            Baseline::None => vec![R::Vec3::zero(); samples.len()],
            Baseline::Background | Baseline::PixelMean => {
                scene.background_radiance(samples.iter().map(|sample| sample.sample))
            }
        }
    }

    /// The rows of area samples, from ∇_u ln k of the filter at each.
    ///
    /// The baseline of a sample does not depend on the sample itself.
    fn warped_samples<R: Real>(
        &self,
        scene: &Scene<'_, R>,
        primary: &Primary<R>,
        spp: usize,
        filter_du: Vec<[R; 2]>,
    ) -> Vec<WarpedSample<R>> {
        let per_other = R::one() / R::of((spp - usize::from(spp > 1)) as f64);
        let shared = self.shared_baseline(scene, &primary.samples);
        let mut rest = shared.into_iter().zip(filter_du);
        let mut out = Vec::with_capacity(primary.samples.len());
        for own in primary.samples.chunks(spp) {
            let sum = own.iter().fold(R::Vec3::zero(), |sum, s| sum + s.radiance);
            let own_baseline = self.has_own_baseline(own);
            let less_background = !own_baseline && self.baseline != Baseline::None;
            out.extend(own.iter().zip(&mut rest).map(|(s, (shared, filter_du))| {
                let others = (sum - s.radiance) * per_other;
                let baseline = if own_baseline { others } else { shared };
                let radiance_minus_baseline = s.radiance - baseline;
                WarpedSample { radiance_minus_baseline, filter_du, less_background }
            }));
        }
        out
    }

    /// Samples of the borders of the pixels, with V at each. `area` has the pixels' area samples.
    fn border<R: Real>(
        &self,
        scene: &Scene<'_, R>,
        batch: &Batch<'_>,
        area: &Primary<R>,
    ) -> Result<Border<R>, InvalidField> {
        let (spp, count) = (batch.counts.spp, batch.counts.edge_samples);
        let baseline = area
            .pixel_means(spp)
            .into_iter()
            .zip(area.samples.chunks(spp as usize))
            .map(|(mean, own)| self.has_own_baseline(own).then_some(mean))
            .collect();
        let (positions, edges) = border_samples(scene, batch.pixels, count, batch.stream);
        let primary = scene.primary(&positions)?;
        let weighting = self.options.weighting::<R>(scene.bounds.radius);
        let (points, k) = (self.options.steps, self.options.top_k);
        let film_warp = warp_samples(scene, &primary, points, &weighting, k);
        let shared = self.shared_baseline(scene, &primary.samples);
        let samples = primary.samples.into_iter().zip(shared).zip(edges);
        let border_sample = |((sample, shared_baseline), edge): ((TracedSample<R>, _), _)| {
            BorderSample { edge, radiance: sample.radiance, shared_baseline }
        };
        let samples = samples.map(border_sample).collect();
        let weight = R::one() / R::of(f64::from(count));
        Ok(Border { samples, baseline, film_warp, weight })
    }
}

impl<R: Real> Estimator<R> for WarpedArea {
    fn filter(&self) -> Filter {
        self.filter
    }

    fn record(
        &self,
        scene: &Scene<'_, R>,
        batch: &Batch<'_>,
        _: &mut SilhouetteMask,
    ) -> Result<Record<R>, InvalidField> {
        let spp = batch.counts.spp;
        let (samples, filter_du) = match self.filter {
            Filter::Box => {
                let samples = pixel_samples(batch.pixels.iter().copied(), &(0..spp), batch.stream);
                let zero = vec![[R::zero(); 2]; samples.len()];
                (samples, zero)
            }
            Filter::Gaussian => gaussian_samples(batch.pixels, spp, batch.stream),
        };
        let primary = scene.primary(&samples)?;
        let weighting = self.options.weighting::<R>(scene.bounds.radius);
        let (points, k) = (self.options.steps, self.options.top_k);
        let film_warp = warp_samples_with_divergence(scene, &primary, points, &weighting, k);
        let warped = self.warped_samples(scene, &primary, spp as usize, filter_du);
        let border = match self.filter {
            Filter::Box => Some(self.border(scene, batch, &primary)?),
            Filter::Gaussian => None,
        };
        let border_rays = border.as_ref().map_or(0, |border| border.samples.len());
        let radiance = primary.pixel_means(spp);
        let warp = Some(AreaWarp { film_warp, samples: warped });
        let area = vec![Area { warp, ..Area::uniform(primary, spp) }];
        let rays = (samples.len() + border_rays) as u64;
        Ok(Record { radiance, rays, area, border, ..Record::default() })
    }

    fn memory_factor(&self) -> usize {
        self.options.steps.div_ceil(PUBLISHED_POINTS)
    }
}

/// `count` samples on every edge of the pixels' borders, each with its edge. An edge has the same
/// samples in every batch.
fn border_samples<R: Real>(
    scene: &Scene<'_, R>,
    pixels: &[Pixel],
    count: u32,
    stream: Stream,
) -> (Vec<Sample>, Vec<boundary::Edge>) {
    let stream = stream.named(EDGE_SAMPLES);
    let (mut samples, mut owners) = (Vec::new(), Vec::new());
    for camera in 0..scene.cameras.len() {
        let own: Vec<usize> = (0..pixels.len()).filter(|&i| pixels[i].camera == camera).collect();
        if own.is_empty() {
            continue;
        }
        let places: Vec<(u32, u32)> = own.iter().map(|&i| (pixels[i].x, pixels[i].y)).collect();
        let film = &scene.cameras[camera];
        for edge in Edges::of(&places, film.width, film.height).as_slice() {
            let [x, y] = edge.point(0.0).map(|v| v as u64);
            let stream = stream.at(edge.axis() as u64).at(camera as u64).at(y << 32 | x);
            for [along] in stream.sobol_points(0..count) {
                samples.push(Sample { camera, u: edge.point(along).into() });
                owners.push(edge.renamed(|p| own[p]));
            }
        }
    }
    (samples, owners)
}
