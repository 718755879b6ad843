//! The surfaces just outside silhouettes.

use field::{Real, Vector3};
use render::{Primary, Scene, Surface};

use super::search::LineTangency;
use crate::record::FilmLine;

/// A hit is moved if the cosine between the reversed ray and its normal is below this. At the
/// distance s from the surface's own silhouette, cos² = 2 s/r. So the others are 0.05 pixels or
/// more from that of a ball of 10 pixels, and their radiance changes little on the way.
const LEAST_COSINE: f64 = 0.1;

/// Newton steps along a ray. The first position is close: the second step is exact to rounding.
const STEPS: usize = 3;

/// Moves grazing hits beside silhouettes to the rays of the silhouettes, and takes the radiance
/// there. `outside` has one sample for each of `found`.
///
/// A ray beside a silhouette shows the radiance at a small distance s from it. Where the surface
/// behind touches the rays close to there, its radiance changes as √s: by 3 % over 0.001 pixels.
pub(super) fn move_grazing_hits<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    found: &[LineTangency<R>],
    outside: &mut Primary<R>,
) {
    let Primary { samples, hits, surface, .. } = outside;
    let cosine = |hit: usize| -surface.normal[hit].dot(surface.direction[hit]);
    let moved: Vec<usize> =
        (0..hits.len()).filter(|&hit| cosine(hit) < R::of(LEAST_COSINE)).collect();
    if moved.is_empty() || scene.shader.is_uniform() {
        return;
    }
    let rays: Vec<(R::Vec3, R::Vec3)> = moved
        .iter()
        .map(|&hit| {
            let LineTangency { line, tangency } = &found[hits[hit].sample];
            let sample = lines[*line].at(tangency.s.to_double());
            let camera = &scene.cameras[sample.camera];
            (R::Vec3::of(camera.eye), R::Vec3::of(camera.direction(sample.u)))
        })
        .collect();
    let mut t: Vec<R> = moved.iter().map(|&hit| hits[hit].t).collect();
    let (mut f, mut gradient) = (vec![R::zero(); t.len()], vec![R::Vec3::zero(); t.len()]);
    let mut x = Vec::with_capacity(t.len());
    for _ in 0..STEPS {
        x.clear();
        x.extend(rays.iter().zip(&t).map(|((eye, d), t)| *eye + *d * *t));
        scene.field.value_gradient(&x, &mut f, &mut gradient);
        for i in 0..t.len() {
            t[i] -= f[i] / gradient[i].dot(rays[i].1);
        }
    }
    let mut at_silhouette = Surface::default();
    let mut of_sample = Vec::new();
    for (i, &hit) in moved.iter().enumerate() {
        let hit = &hits[hit];
        // Newton's method leaves a surface that turns away from the ray.
        let gap = hit.t - found[hit.sample].tangency.t;
        if (t[i] - hit.t).abs() < gap && gradient[i].dot(rays[i].1) < R::zero() {
            let normal = gradient[i] * (R::one() / gradient[i].length());
            at_silhouette.push(rays[i].0 + rays[i].1 * t[i], normal, rays[i].1);
            of_sample.push(hit.sample);
        }
    }
    let mut rgb = vec![R::Vec3::zero(); of_sample.len()];
    scene.shader.radiance(&at_silhouette.batch(), &mut rgb);
    for (sample, rgb) in of_sample.into_iter().zip(rgb) {
        samples[sample].radiance = rgb;
    }
}
