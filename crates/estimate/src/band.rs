//! The estimator `band`: the boundary integral widened to a band.

use field::{Real, SurfaceBatch, Vector3};
use render::{InvalidField, Primary, Scene, TracedRay, normals, pixel_samples};
use warp::Projection;

use crate::estimator::{Batch, Estimator, SilhouetteMask};
use crate::record::{Record, Silhouettes, chart};

/// The width of the band, in pixels. The bias grows with it: on average, a silhouette counts half
/// of it further out. The variance falls with it.
const WIDTH: f64 = 0.2;

/// Area samples; those whose rays pass a surface within a band carry its silhouette.
///
/// A ray whose closest approach has m < w clears the silhouette by m/|∇_u m| pixels. The silhouette
/// moves by −∂_θ f/|∇_u m|, so its integral along the curve becomes an integral over the area of
/// the band, of ΔL (−∂_θ f)/w, without a Jacobian. w is 0.2 pixels in world units at the closest
/// approach, times |∇f|. The width is fixed, so the bias does not fall with the number of samples.
///
/// Wang, Deng, Zhang, Jakob and Marschner, "A Simple Approach to Differentiable Rendering of SDFs",
/// SIGGRAPH Asia 2024, section 4.
#[derive(Clone, Copy, Debug)]
pub struct Band;

/// The closest approach of a sample's ray, within the band.
struct Approach<R: Real> {
    sample: usize,
    x: R::Vec3,
    direction: R::Vec3,
    /// 1/w for |∇f| = 1, per world unit.
    inverse_width: R,
}

/// The closest approaches of a batch of samples that may lie within the band.
fn approaches<R: Real>(scene: &Scene<'_, R>, primary: &Primary<R>) -> Vec<Approach<R>> {
    let mut found = Vec::new();
    for (i, sample) in primary.samples.iter().enumerate() {
        let Some(TracedRay { ray, found: hit }) = primary.ray_of(sample) else { continue };
        if hit.clearance.is_infinite() {
            continue;
        }
        let x = ray.at(hit.nearest);
        let chart = chart(&scene.cameras[sample.sample.camera]);
        let jacobian = Projection::<R>::jacobian(&chart, x);
        let scale = jacobian[0].length().max(jacobian[1].length());
        let width = R::of(WIDTH) / scale;
        if hit.clearance * hit.nearest < width {
            let (direction, inverse_width) = (ray.direction, R::one() / width);
            found.push(Approach { sample: i, x, direction, inverse_width });
        }
    }
    found
}

/// The silhouette points of a batch of samples.
fn silhouettes<R: Real>(scene: &Scene<'_, R>, primary: &Primary<R>, spp: u32) -> Silhouettes<R> {
    let near = approaches(scene, primary);
    let x: Vec<R::Vec3> = near.iter().map(|a| a.x).collect();
    let direction: Vec<R::Vec3> = near.iter().map(|a| a.direction).collect();
    let (mut f, mut gradient) = (vec![R::zero(); x.len()], vec![R::Vec3::zero(); x.len()]);
    scene.field.value_gradient(&x, &mut f, &mut gradient);
    let mut front = vec![R::Vec3::zero(); x.len()];
    let normal = normals::<R>(&gradient);
    let points = SurfaceBatch { x: &x, normal: &normal, direction: &direction };
    scene.shader.radiance(&points, &mut front);
    let weight = R::one() / R::of(f64::from(spp));
    let mut silhouettes = Silhouettes::default();
    for (i, (approach, front)) in near.iter().zip(front).enumerate() {
        // 1/w, with w in units of f.
        let inverse_width =
            approach.inverse_width / gradient[i].length().max(R::min_positive_value());
        if f[i] * inverse_width >= R::one() {
            continue;
        }
        let behind = primary.samples[approach.sample].radiance;
        let rgb = (front - behind) * (weight * inverse_width);
        silhouettes.push(approach.sample as u32 / spp, approach.x, rgb);
    }
    silhouettes
}

impl<R: Real> Estimator<R> for Band {
    fn record(
        &self,
        scene: &Scene<'_, R>,
        batch: &Batch<'_>,
        _: &mut SilhouetteMask,
    ) -> Result<Record<R>, InvalidField> {
        let spp = batch.counts.spp;
        let samples = pixel_samples(batch.pixels.iter().copied(), &(0..spp), batch.stream);
        let primary = scene.primary(&samples)?;
        let silhouettes = silhouettes(scene, &primary, spp);
        Ok(Record { silhouettes, ..Record::uniform(primary, spp) })
    }
}
