//! The published estimator and its relatives: a warp over the points of the sphere tracer.

use boundary::{Edge, Edges};
use field::{Real, Vector3};

use super::pixels::{check_valid, pixel_samples};
use super::record::{Area, AreaWarp, Border};
use super::{Estimator, Filter, Pixel, Primary, Record, Sample, Setup};
use crate::InvalidField;
use random::{gaussian, mix, sobol};

/// The standard deviation of the Gaussian filter, in pixels.
pub const FILTER_DEVIATION: f64 = 0.5;

/// The constant c that the warp carries radiance less of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// The background, for all pixels.
    Background,
    /// The mean of the pixel's other samples. A pixel of constant radiance then has no variance at
    /// all.
    Mean,
}

/// Area samples with the warp of the tracer's points, and the flux through the pixels' borders if
/// they have any.
#[derive(Clone, Copy, Debug)]
pub struct WarpedArea {
    /// Samples a pixel.
    pub spp: u32,
    /// Samples an edge between pixels.
    pub edge_samples: u32,
    /// The pixel filter. With a Gaussian there are no borders.
    pub filter: Filter,
    /// Whether there is a warp at all.
    pub silhouettes: bool,
    /// Whether every point keeps its weight, whatever k is.
    pub all_points: bool,
    /// Whether points weigh as [`Setup::weighting`] says.
    pub own_weights: bool,
    /// The control variate.
    pub control: Control,
}

/// Samples from the Gaussian filter of every pixel, and ∇ ln k at each.
pub(super) fn gaussian_samples<R: Real>(
    pixels: &[Pixel],
    spp: u32,
    seed: u64,
) -> (Vec<Sample>, Vec<[R; 2]>) {
    let mut du = Vec::with_capacity(pixels.len() * spp as usize);
    let mut samples = pixel_samples(pixels.iter().copied(), &(0..spp), seed);
    for sample in &mut samples {
        let corner = sample.u.floor();
        let off = glam::DVec2::from(gaussian((sample.u - corner).into())) * FILTER_DEVIATION;
        sample.u = corner + 0.5 + off;
        du.push((-off / (FILTER_DEVIATION * FILTER_DEVIATION)).to_array().map(R::of));
    }
    (samples, du)
}

/// The mean radiance of every pixel of `spp` samples.
pub(super) fn means<R: Real>(radiance: &[R::Vec3], spp: u32) -> Vec<R::Vec3> {
    let share = R::one() / R::of(f64::from(spp));
    radiance
        .chunks(spp as usize)
        .map(|own| own.iter().fold(R::Vec3::zero(), |sum, l| sum + *l) * share)
        .collect()
}

/// `spp` area samples a pixel, without a warp.
pub(super) fn plain_area<R: Real>(samples: Vec<Sample>, primary: Primary<R>, spp: u32) -> Area<R> {
    let n = samples.len();
    let pixel = (0..n).map(|i| i as u32 / spp).collect();
    Area { samples, primary, pixel, weight: vec![R::one() / R::of(f64::from(spp)); n], warp: None }
}

impl<R: Real> Estimator<R> for WarpedArea {
    fn record(
        &self,
        setup: &Setup<'_, R>,
        pixels: &[Pixel],
        seed: u64,
    ) -> Result<Record<R>, InvalidField> {
        let mut setup = *setup;
        if !self.own_weights {
            setup.weighting = None;
        }
        if self.all_points {
            setup.warp.k = usize::MAX;
        }
        let (samples, filter_du) = match self.filter {
            Filter::Box => {
                (pixel_samples(pixels.iter().copied(), &(0..self.spp), seed), Vec::new())
            }
            Filter::Gaussian => gaussian_samples(pixels, self.spp, seed),
        };
        let primary = setup.primary(&samples);
        check_valid(&setup, &samples, primary.invalid)?;
        let mut record = Record {
            radiance: means::<R>(&primary.radiance, self.spp),
            rays: samples.len() as u64,
            ..Record::default()
        };
        let warp = self.silhouettes.then(|| AreaWarp {
            warped: setup.warp(&samples, &primary.rays, true),
            excess: self.excess(&setup, &primary),
            filter_du,
        });
        if self.silhouettes && self.filter == Filter::Box {
            let border = self.border(&setup, pixels, &primary, seed)?;
            record.rays += border.edge.len() as u64;
            record.border = Some(border);
        }
        record.area.push(Area { warp, ..plain_area(samples, primary, self.spp) });
        Ok(record)
    }
}

impl WarpedArea {
    /// Whether pixel p may have a constant of its own: at the bounding sphere's outline the warp
    /// ends, and nothing but background may be carried there.
    fn own_constant<R: Real>(&self, primary: &Primary<R>, p: usize) -> bool {
        let spp = self.spp as usize;
        self.control == Control::Mean
            && spp > 1
            && primary.rays[p * spp..(p + 1) * spp].iter().all(Option::is_some)
    }

    /// L − c of area samples: c must not depend on the sample itself.
    fn excess<R: Real>(&self, setup: &Setup<'_, R>, primary: &Primary<R>) -> Vec<R::Vec3> {
        let spp = self.spp as usize;
        let mut excess = Vec::with_capacity(primary.radiance.len());
        for (p, own) in primary.radiance.chunks(spp).enumerate() {
            let sum = own.iter().fold(R::Vec3::zero(), |sum, l| sum + *l);
            let own_constant = self.own_constant(primary, p);
            let share = R::one() / R::of((spp - usize::from(spp > 1)) as f64);
            excess
                .extend(own.iter().map(|l| {
                    *l - if own_constant { (sum - *l) * share } else { setup.background }
                }));
        }
        excess
    }

    fn border<R: Real>(
        &self,
        setup: &Setup<'_, R>,
        pixels: &[Pixel],
        primary: &Primary<R>,
        seed: u64,
    ) -> Result<Border<R>, InvalidField> {
        let (samples, edge) = border_samples(setup, pixels, self.edge_samples, seed);
        let constant = means::<R>(&primary.radiance, self.spp)
            .into_iter()
            .enumerate()
            .map(|(p, mean)| if self.own_constant(primary, p) { mean } else { setup.background })
            .collect();
        let primary = setup.primary(&samples);
        check_valid(setup, &samples, primary.invalid)?;
        let warped = setup.warp(&samples, &primary.rays, false);
        let weight = R::one() / R::of(f64::from(self.edge_samples));
        Ok(Border { edge, radiance: primary.radiance, constant, warped, weight })
    }
}

/// Samples of the pixels' borders, each with its edge. An edge has the same samples in every batch.
fn border_samples<R: Real>(
    setup: &Setup<'_, R>,
    pixels: &[Pixel],
    count: u32,
    seed: u64,
) -> (Vec<Sample>, Vec<Edge>) {
    // Area samples use the streams of pixels; edges use their own, told apart by this constant.
    const EDGES: u64 = 0xed6e;
    let (mut samples, mut owners) = (Vec::new(), Vec::new());
    for camera in 0..setup.cameras.len() {
        let own: Vec<usize> = (0..pixels.len()).filter(|&i| pixels[i].camera == camera).collect();
        if own.is_empty() {
            continue;
        }
        let places: Vec<(u32, u32)> = own.iter().map(|&i| (pixels[i].x, pixels[i].y)).collect();
        let film = &setup.cameras[camera];
        for edge in Edges::of(&places, film.width, film.height).as_slice() {
            let [x, y] = edge.point(0.0).map(|v| v as u64);
            let stream =
                mix(mix(mix(seed, EDGES + edge.axis() as u64), camera as u64), y << 32 | x);
            for s in 0..count {
                let [along] = sobol(s, stream);
                samples.push(Sample { camera, u: edge.point(along).into() });
                owners.push(edge.renamed(|p| own[p]));
            }
        }
    }
    (samples, owners)
}
