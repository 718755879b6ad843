//! The boundary integral widened to a band.

use field::{Real, SurfaceBatch, Vector3};
use warp::Projection;

use super::pixels::{check_valid, pixel_samples};
use super::primary::normals;
use super::record::Silhouettes;
use super::warped::{means, plain_area};
use super::{Estimator, Pixel, Primary, Record, Sample, Setup};
use crate::InvalidField;

/// The band's width, in pixels. Silhouettes count where they are, up to half of this further out: a
/// bias. With it the variance falls.
const WIDTH: f64 = 0.2;

/// Area samples; those whose ray passes the surface within a band carry the silhouette.
///
/// A ray whose closest approach is m < w clears the silhouette by m/|∇_u m| pixels. As the
/// silhouette moves with −∂_θ f/|∇_u m|, its integral along the curve becomes one over the area of
/// the band, of ΔL (−∂_θ f)/w: no Jacobian is left (Wang, Deng, Zhang, Jakob and Marschner 2024,
/// section 4). w is the world size of a fixed fraction of a pixel, times |∇f|.
#[derive(Clone, Copy, Debug)]
pub struct Band {
    /// Samples a pixel.
    pub spp: u32,
}

/// A closest approach within the band.
struct Approach<R: Real> {
    sample: usize,
    x: R::Vec3,
    direction: R::Vec3,
    /// 1/w.
    inverse_width: R,
}

/// The closest approaches of a batch of samples that may lie within the band.
fn approaches<R: Real>(
    setup: &Setup<'_, R>,
    samples: &[Sample],
    primary: &Primary<R>,
) -> Vec<Approach<R>> {
    let mut found = Vec::new();
    for (i, sample) in samples.iter().enumerate() {
        let (Some(ray), Some(hit)) = (&primary.rays[i], &primary.found[i]) else { continue };
        if hit.clearance.is_infinite() {
            continue;
        }
        let x = ray.at(hit.nearest);
        let jacobian = Projection::<R>::jacobian(&setup.cameras[sample.camera], x);
        let scale = jacobian[0].length().max(jacobian[1].length());
        let width = R::of(WIDTH) / scale;
        if hit.clearance * hit.nearest < width {
            found.push(Approach {
                sample: i,
                x,
                direction: ray.direction,
                inverse_width: R::one() / width,
            });
        }
    }
    found
}

impl<R: Real> Estimator<R> for Band {
    fn record(
        &self,
        setup: &Setup<'_, R>,
        pixels: &[Pixel],
        seed: u64,
    ) -> Result<Record<R>, InvalidField> {
        let samples = pixel_samples(pixels.iter().copied(), &(0..self.spp), seed);
        let primary = setup.primary(&samples);
        check_valid(setup, &samples, primary.invalid)?;
        let near = approaches(setup, &samples, &primary);
        let x: Vec<R::Vec3> = near.iter().map(|a| a.x).collect();
        let direction: Vec<R::Vec3> = near.iter().map(|a| a.direction).collect();
        let (mut f, mut gradient) = (vec![R::zero(); x.len()], vec![R::Vec3::zero(); x.len()]);
        setup.field.value_gradient(&x, &mut f, &mut gradient);
        let mut front = vec![R::Vec3::zero(); x.len()];
        let normal = normals::<R>(&gradient);
        let points = SurfaceBatch { x: &x, normal: &normal, direction: &direction };
        setup.shader.radiance(&points, &mut front);
        let weight = R::one() / R::of(f64::from(self.spp));
        let mut silhouettes = Silhouettes::default();
        for (i, (approach, front)) in near.iter().zip(front).enumerate() {
            // w in units of f.
            let inverse_width =
                approach.inverse_width / gradient[i].length().max(R::min_positive_value());
            if f[i] * inverse_width >= R::one() {
                continue;
            }
            let pixel = approach.sample as u32 / self.spp;
            let rgb = (front - primary.radiance[approach.sample]) * (weight * inverse_width);
            silhouettes.push(pixel, approach.x, rgb);
        }
        let radiance = means::<R>(&primary.radiance, self.spp);
        let rays = samples.len() as u64;
        Ok(Record {
            radiance,
            rays,
            area: vec![plain_area(samples, primary, self.spp)],
            border: None,
            silhouettes,
        })
    }
}
