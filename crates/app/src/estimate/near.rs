//! Which pixels a silhouette may cross, from one ray each.

use field::{Real, Vector3};

use super::{Primary, Sample, Setup};

/// How many pixels' distance from its sample a silhouette may have and still count: the sample may sit in one corner and
/// the silhouette pass through the opposite one, √2 away; the rest is room for what first order misses.
const REACH: f64 = 1.6;

/// Hits steeper than this cosine are never near a silhouette of radius 8 px or more: cos² = 2 s/r at distance s.
const STEEP: f64 = 0.65;

/// For every sample, whether a silhouette may cross its pixel.
///
/// Two tests to first order: a ray that passes a closest approach of f outside (before its hit, if it has one) has a
/// silhouette about f/(t·pixel angle) pixels away; a ray that hits at cosine c = −n·d has one where c² falls to zero,
/// c/(2|∂c/∂u|) pixels away.
pub(crate) fn near_silhouettes<R: Real>(setup: &Setup<'_, R>, samples: &[Sample], primary: &Primary<R>) -> Vec<bool> {
    let (reach, steep) = (R::of(REACH), R::of(STEEP));
    let mut near: Vec<bool> = samples
        .iter()
        .zip(&primary.found)
        .map(|(sample, found)| {
            let cone = R::of(setup.cameras[sample.camera].pixel_angle());
            match found {
                Some(found) => found.clearance < reach * cone,
                // All that is in sight may lie between the samples.
                None => {
                    let (nearest, clearance) = setup.beside(sample);
                    clearance < reach * cone && setup.bounds.radius < reach * cone * nearest
                }
            }
        })
        .collect();
    let grazing: Vec<usize> =
        (0..primary.hits.len()).filter(|&h| -primary.normal[h].dot(primary.direction[h]) < steep).collect();
    let pick = |from: &[R::Vec3]| grazing.iter().map(|&h| from[h]).collect::<Vec<_>>();
    let (x, gradient, normal, direction) =
        (pick(&primary.x), pick(&primary.gradient), pick(&primary.normal), pick(&primary.direction));
    let across: Vec<_> = (0..x.len())
        .map(|i| {
            let size = gradient[i].length().max(R::min_positive_value());
            (direction[i] - normal[i] * normal[i].dot(direction[i])) * (R::one() / size)
        })
        .collect::<Vec<_>>();
    let (mut ignored, mut turn) = (across.clone(), across.clone());
    setup.field.hessian_vector(&x, &across, &mut ignored, &mut turn);
    for (i, &h) in grazing.iter().enumerate() {
        let sample = &samples[primary.hits[h]];
        let (g, d, t) = (gradient[i], direction[i], primary.t[h]);
        let (_, du) = setup.cameras[sample.camera].direction_du(sample.u);
        let slope = du.map(|du| {
            let du = R::Vec3::of(du);
            let dx = du * t - d * (t * g.dot(du) / g.dot(d));
            turn[i].dot(dx) + normal[i].dot(du)
        });
        let distance = -normal[i].dot(d) / (R::of(2.0) * slope[0].hypot(slope[1]));
        // A NaN, where the slope vanishes too, counts as near.
        if distance.is_nan() || distance <= reach {
            near[primary.hits[h]] = true;
        }
    }
    near
}
