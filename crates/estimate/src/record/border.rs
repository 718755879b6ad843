//! Samples of the borders of pixels.

use boundary::Edge;
use field::{Real, Vector3};

use crate::record::adjoints::Adjoints;
use crate::record::film_warp::FilmWarp;
use crate::record::pass::Pass;

/// A sample on an edge between pixels.
#[derive(Clone, Copy, Debug)]
pub struct BorderSample<R: Real> {
    /// The edge. Its pixels are given by their numbers in the batch.
    pub edge: Edge,
    /// The radiance along the ray of the sample, linear RGB.
    pub radiance: R::Vec3,
    /// The baseline c of a pixel without one of its own, linear RGB.
    pub shared_baseline: R::Vec3,
}

/// Samples of the borders of pixels, for the flux of a warp through them.
#[derive(Debug)]
pub struct Border<R: Real> {
    /// The samples.
    pub samples: Vec<BorderSample<R>>,
    /// The own baseline c of each pixel, linear RGB, if it has one.
    pub baseline: Vec<Option<R::Vec3>>,
    /// V at every sample.
    pub film_warp: FilmWarp<R>,
    /// The weight of one sample in the mean over its edge.
    pub weight: R,
}

impl<R: Real> Border<R> {
    /// VJP of θ ↦ −∮ (L − c) V·n over the borders of the pixels (Bangaru et al. 2022, supplement,
    /// section 1, equation 2).
    pub(crate) fn vjp(&self, delta: &[R::Vec3], pass: Pass<R>, out: &mut Adjoints<R>) {
        let axis: Vec<usize> = self.samples.iter().map(|s| s.edge.axis()).collect();
        let carried = |sample: &BorderSample<R>, p: usize| {
            let baseline = self.baseline[p].unwrap_or(sample.shared_baseline);
            delta[p].dot(sample.radiance - baseline) * self.weight
        };
        if pass == Pass::PerPixel {
            let sides: [fn(&Edge) -> Option<usize>; 2] = [Edge::inside, Edge::outside];
            for (side, sign) in sides.into_iter().zip([R::one(), -R::one()]) {
                let flux =
                    |s: &BorderSample<R>| side(&s.edge).map_or(R::zero(), |p| sign * carried(s, p));
                let flux: Vec<R> = self.samples.iter().map(flux).collect();
                let pixel: Vec<u32> =
                    self.samples.iter().map(|s| side(&s.edge).unwrap_or(0) as u32).collect();
                self.film_warp.flux_vjp(&flux, &axis, &pixel, out);
            }
        } else {
            let gather = |s: &BorderSample<R>| s.edge.gather(|p| carried(s, p));
            let flux: Vec<R> = self.samples.iter().map(gather).collect();
            self.film_warp.flux_vjp(&flux, &axis, &vec![0; flux.len()], out);
        }
    }
}
