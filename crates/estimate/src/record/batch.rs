//! The record of an estimator over a batch of pixels.

use field::{PartialSum, Real};
use render::{Primary, Scene};

use crate::record::adjoints::Adjoints;
use crate::record::area::{Area, PixelWeight};
use crate::record::border::Border;
use crate::record::parts::PixelParts;
use crate::record::pass::Pass;
use crate::record::silhouettes::{SilhouettePoint, Silhouettes};

/// All terms of the derivatives of a batch of pixels. Each is linear in the adjoints of the pixels.
#[derive(Debug, Default)]
pub struct Record<R: Real> {
    /// The value of every pixel from the same samples, linear RGB.
    pub radiance: Vec<R::Vec3>,
    /// The number of traced rays.
    pub rays: u64,
    /// Samples in the areas of pixels.
    pub area: Vec<Area<R>>,
    /// Samples of the borders of pixels.
    pub border: Option<Border<R>>,
    /// Points of silhouettes.
    pub silhouettes: Silhouettes<R>,
}

impl<R: Real> Record<R> {
    /// A record of `pixels` black pixels without samples.
    pub fn black(pixels: usize) -> Self {
        Record { radiance: vec![field::Vector3::zero(); pixels], ..Record::default() }
    }

    /// The record of the smooth part: `spp` samples per pixel with equal weights, in the order of
    /// the pixels, and one ray per sample.
    pub fn uniform(primary: Primary<R>, spp: u32) -> Self {
        Record {
            radiance: primary.pixel_means(spp),
            rays: primary.samples.len() as u64,
            area: vec![Area::uniform(primary, spp)],
            ..Record::default()
        }
    }

    /// Whether the record has the derivatives by cameras: an estimator that carries silhouettes by
    /// a warp has those by θ alone.
    pub fn has_cameras(&self) -> bool {
        self.border.is_none() && self.area.iter().all(|area| area.warp.is_none())
    }

    /// VJP of (θ; shader parameters; cameras) ↦ pixel values.
    ///
    /// `delta` has one adjoint per pixel. The coefficients at points, from which
    /// [`Adjoints::backward`] makes the gradient by θ, are added to `out`; the adjoint of the
    /// shader's parameters is added to `shader`. The points do not depend on `delta`.
    /// If [`Adjoints::cameras`] are wanted, the adjoints of the cameras are added to them; see
    /// [`has_cameras`](Self::has_cameras).
    pub fn vjp(
        &self,
        scene: &Scene<'_, R>,
        delta: &[R::Vec3],
        pass: Pass<R>,
        shader: &mut PartialSum<R>,
        out: &mut Adjoints<R>,
    ) {
        for area in &self.area {
            area.vjp(scene, delta, pass, shader, out);
        }
        if let Some(border) = &self.border {
            border.vjp(delta, pass, out);
        }
        self.silhouettes.vjp(scene, delta, out);
    }

    /// Adds the record of other pixels after its own. One reverse pass over both takes less time
    /// than two: it fills the blocks of the field and of the shader better.
    ///
    /// # Panics
    /// If a record has a border or a warp.
    pub fn append(&mut self, other: Self) {
        assert!(self.has_cameras() && other.has_cameras(), "a record has a border or a warp");
        let first = self.radiance.len() as u32;
        self.radiance.extend(other.radiance);
        self.rays += other.rays;
        for area in other.area.into_iter().filter(|area| !area.weights.is_empty()) {
            if self.area.is_empty() {
                self.area.push(Area::uniform(Primary::default(), 1));
            }
            self.area[0].append(area, first);
        }
        let points = other.silhouettes.points.into_iter();
        self.silhouettes
            .points
            .extend(points.map(|point| SilhouettePoint { pixel: point.pixel + first, ..point }));
    }

    /// Deals the samples to parts of consecutive pixels, with these numbers of pixels. Points of
    /// silhouettes get the order of their pixels. The number of rays stays with the first part.
    ///
    /// # Panics
    /// If the record has a border or a warp, or if the numbers do not add up to its pixels.
    pub fn deal(self, sizes: &[usize]) -> Vec<Self> {
        assert!(self.has_cameras(), "a record of a warp has no parts");
        assert_eq!(sizes.iter().sum::<usize>(), self.radiance.len(), "pixels of the parts");
        let parts = PixelParts::new(sizes);
        let mut radiance = self.radiance.into_iter();
        let own = |size: &usize| Record {
            radiance: radiance.by_ref().take(*size).collect(),
            ..Record::default()
        };
        let mut out: Vec<Self> = sizes.iter().map(own).collect();
        for area in self.area {
            let dealt = area.deal(&parts);
            out.iter_mut().zip(dealt).for_each(|(record, area)| record.area.push(area));
        }
        // The order of points of several pixels depends on the pixels that were sampled together.
        let mut points = self.silhouettes.points;
        points.sort_by_key(|point| point.pixel);
        for mut point in points {
            let part = parts.of(point.pixel);
            point.pixel -= parts.first(part);
            out[part].silhouettes.points.push(point);
        }
        if let Some(first) = out.first_mut() {
            first.rays = self.rays;
        }
        out
    }

    /// The coverage of every pixel from the same samples: the share of its area, weighted by the
    /// filter, in which the object is visible.
    pub fn coverage(&self) -> Vec<R> {
        let mut coverage = vec![R::zero(); self.radiance.len()];
        for area in &self.area {
            for hit in &area.primary.hits {
                let PixelWeight { pixel, weight } = area.weights[hit.sample];
                coverage[pixel as usize] += weight;
            }
        }
        coverage
    }

    /// VJP of θ ↦ the coverage of the pixels, by points of silhouettes. `delta` has one adjoint per
    /// pixel. The cameras get no adjoint. See [`SilhouettePoint::coverage`] for the estimators.
    ///
    /// [`SilhouettePoint::coverage`]: crate::record::SilhouettePoint::coverage
    pub fn coverage_vjp(&self, delta: &[R], out: &mut Adjoints<R>) {
        self.silhouettes.coverage_vjp(delta, out);
    }
}
