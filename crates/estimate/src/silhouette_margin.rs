//! A test for the pixels that a silhouette may cross, from single rays.

use field::{Real, Vector3};
use glam::DVec2;
use render::{Camera, Pixel, Primary, Sample, Scene, TracedRay, TracedSample};
use trace::Outcome;

/// A hit whose cosine between reversed ray and normal is above this has no silhouette near it.
/// At the distance s from a silhouette of radius r, cos² = 2 s/r, so this holds for r ≥ 8 pixels.
/// In the gradient suite `refined` has the same errors at 0.5 and 0.8, with 0.966 and 1.023 times
/// the evaluations.
pub(crate) const SILHOUETTE_COSINE: f64 = 0.65;

/// The margin for errors of the first-order position of a silhouette.
#[derive(Clone, Copy, Debug)]
pub struct SilhouetteMargin {
    /// The least and the largest distance of a silhouette, as multiples of its first-order
    /// distance.
    range: [f64; 2],
    /// A silhouette up to this far outside a pixel, in pixels, counts as inside.
    outside: f64,
    /// Whether a ray that passes one surface and hits another always marks its pixel.
    gaps: bool,
}

impl SilhouetteMargin {
    /// The largest distance, in pixels, from a sample to a silhouette that crosses the sample's pixel.
    /// The sample may be in one corner and the silhouette in the opposite one, √2 away; the rest is a
    /// margin for the error of first order. In the gradient suite `refined` has the same errors at 1.1
    /// and 3.2, with 0.987 and 1.004 times the evaluations.
    pub const REACH: f64 = 1.6;

    /// For estimators that also test corners and further samples. The outline of a ball of 2.5
    /// pixels stays within this margin of its tangent.
    pub const SMALL: SilhouetteMargin =
        SilhouetteMargin { range: [0.75, 1.35], outside: 0.1, gaps: false };

    /// For a single ray per pixel. Fits of `spot` reach a Chamfer distance of 0.14 % of the
    /// bounding radius with it, and of 0.16 % with the small margin.
    pub const LARGE: SilhouetteMargin =
        SilhouetteMargin { range: [0.5, 2.0], outside: 0.25, gaps: true };
}

/// For every sample, whether a silhouette may cross its pixel.
///
/// There are two tests, both to first order:
///
/// - A ray that passes a surface (before its hit, if it has one) has a silhouette about
///   f/(t · pixel angle) pixels away, in the direction in which f falls.
/// - A ray that hits a surface with the cosine c = −n·d has a silhouette c/(2 |∂c/∂u|) pixels away,
///   where c² falls to zero.
///
/// To first order the silhouette is a straight line through this position, perpendicular to the
/// direction to it. The pixel is marked if the line meets it, within `margin`. Of several surfaces
/// that a ray passes, only the closest is tested, so the test can miss a silhouette.
pub fn near_silhouettes<R: Real>(
    scene: &Scene<'_, R>,
    primary: &Primary<R>,
    margin: SilhouetteMargin,
) -> Vec<bool> {
    let mut near = vec![false; primary.samples.len()];
    mark_small_balls(scene, primary, &mut near);
    let traced = primary.samples.iter().map(|s| (s.sample, primary.ray_of(s)));
    for passage in passages(scene, traced, SilhouetteMargin::REACH) {
        let sample = &primary.samples[passage.sample].sample;
        near[passage.sample] = passage.crosses(sample, &pixel_of(sample), margin);
    }
    mark_grazing(scene, primary, margin, &mut near);
    near
}

/// The pixel that a sample lies in.
fn pixel_of(Sample { camera, u }: &Sample) -> Pixel {
    Pixel { camera: *camera, x: u.x as u32, y: u.y as u32 }
}

/// Marks samples that pass closely by a ball of rays smaller than a pixel: all of the solid may lie
/// between the samples.
fn mark_small_balls<R: Real>(scene: &Scene<'_, R>, primary: &Primary<R>, near: &mut [bool]) {
    let ball = &scene.tracing.ball;
    let reach = |camera: &Camera| R::of(camera.pixel_angle() * SilhouetteMargin::REACH);
    let is_small = |camera: &Camera| {
        ball.radius < reach(camera) * (ball.center - R::Vec3::of(camera.eye)).length()
    };
    let small: Vec<bool> = scene.cameras.iter().map(is_small).collect();
    if !small.contains(&true) {
        return;
    }
    let misses = primary.samples.iter().enumerate().filter(|(_, s)| s.ray.is_none());
    for (i, TracedSample { sample, .. }) in misses.filter(|(_, s)| small[s.sample.camera]) {
        let reach = reach(&scene.cameras[sample.camera]);
        let (nearest, clearance) = scene.passing(sample);
        near[i] = clearance < reach && ball.radius < reach * nearest;
    }
}

/// A surface that a ray passes, and its first-order position on the film.
pub(crate) struct Passage {
    /// The sample, by its number in the batch.
    pub(crate) sample: usize,
    /// The direction from the sample to the silhouette on the film, of any length.
    towards: DVec2,
    /// The distance to it in pixels: a lower bound, and to first order.
    away: [f64; 2],
    /// Whether the ray hits a surface behind it.
    in_front_of_hit: bool,
}

/// The surfaces that rays pass within `reach` pixels, at most one per ray: the closest.
pub(crate) fn passages<'a, R: Real>(
    scene: &Scene<'_, R>,
    traced: impl Iterator<Item = (Sample, Option<&'a TracedRay<R>>)>,
    reach: f64,
) -> Vec<Passage> {
    let (mut which, mut x) = (Vec::new(), Vec::new());
    for (i, (sample, traced)) in traced.enumerate() {
        let reach = R::of(scene.cameras[sample.camera].pixel_angle() * reach);
        if let Some(TracedRay { ray, found }) = traced
            && found.clearance < reach
        {
            which.push((i, sample, *found));
            x.push(ray.at(found.nearest));
        }
    }
    let (mut f, mut gradient) = (vec![R::zero(); x.len()], vec![R::Vec3::zero(); x.len()]);
    scene.field.value_gradient(&x, &mut f, &mut gradient);
    let mut passages = Vec::with_capacity(x.len());
    for (((sample, Sample { camera, u }, found), f), gradient) in
        which.into_iter().zip(f).zip(gradient)
    {
        let camera = &scene.cameras[camera];
        let (_, du) = camera.direction_du(u);
        let film_gradient =
            DVec2::from(du.map(|du| (gradient.dot(R::Vec3::of(du)) * found.nearest).to_double()));
        let least = found.clearance.to_double() / camera.pixel_angle();
        let away = [least, (f.to_double() / film_gradient.length()).max(least)];
        let in_front_of_hit = found.outcome == Outcome::Hit;
        passages.push(Passage { sample, towards: -film_gradient, away, in_front_of_hit });
    }
    passages
}

impl Passage {
    /// Whether the silhouette of the surface may cross `pixel`. `sample` is that of the ray.
    pub(crate) fn crosses(&self, sample: &Sample, pixel: &Pixel, margin: SilhouetteMargin) -> bool {
        // In a gap between two surfaces the silhouette of the further one may cross the pixel where
        // that of the closer one does not.
        (self.in_front_of_hit && margin.gaps)
            || line_meets(sample.u, pixel.corner(), self.towards, self.away, margin)
    }
}

/// Marks samples whose ray hits at a grazing angle, if the silhouette near it may cross the pixel.
fn mark_grazing<R: Real>(
    scene: &Scene<'_, R>,
    primary: &Primary<R>,
    margin: SilhouetteMargin,
    near: &mut [bool],
) {
    let (normal, direction) = (&primary.surface.normal, &primary.surface.direction);
    let grazing: Vec<usize> = (0..primary.hits.len())
        .filter(|&h| -normal[h].dot(direction[h]) < R::of(SILHOUETTE_COSINE))
        .collect();
    let x: Vec<R::Vec3> = grazing.iter().map(|&h| primary.surface.x[h]).collect();
    let across: Vec<R::Vec3> = grazing
        .iter()
        .map(|&h| {
            let size = primary.hits[h].gradient.length().max(R::min_positive_value());
            (direction[h] - normal[h] * normal[h].dot(direction[h])) * (R::one() / size)
        })
        .collect();
    let (mut ignored, mut turn) = (across.clone(), across.clone());
    scene.field.hessian_vector(&x, &across, &mut ignored, &mut turn);
    for (&h, turn) in grazing.iter().zip(turn) {
        let sample = &primary.samples[primary.hits[h].sample].sample;
        let fall = cosine_fall(scene, primary, h, turn);
        let away = -normal[h].dot(direction[h]).to_double() / (2.0 * fall.length());
        // A NaN, from a cosine and a slope of zero, counts as near. So does a ray that ends on the
        // face behind a rim, where the cosine is negative.
        let corner = pixel_of(sample).corner();
        near[primary.hits[h].sample] |= away.is_nan()
            || away <= 0.0
            || (away <= SilhouetteMargin::REACH
                && line_meets(sample.u, corner, fall, [away; 2], margin));
    }
}

/// −∂c/∂u of the cosine c = −n·d at hit `h`, per pixel. `turn` is ∇²f (d − n (n·d))/|∇f|.
fn cosine_fall<R: Real>(
    scene: &Scene<'_, R>,
    primary: &Primary<R>,
    h: usize,
    turn: R::Vec3,
) -> DVec2 {
    let (hit, normal, d) =
        (&primary.hits[h], primary.surface.normal[h], primary.surface.direction[h]);
    let sample = &primary.samples[hit.sample].sample;
    let (_, du) = scene.cameras[sample.camera].direction_du(sample.u);
    let (g, t) = (hit.gradient, hit.t);
    DVec2::from(du.map(|du| {
        let du = R::Vec3::of(du);
        let dx = du * t - d * (t * g.dot(du) / g.dot(d));
        (turn.dot(dx) + normal.dot(du)).to_double()
    }))
}

/// Whether a line perpendicular to `towards` may meet the pixel whose upper left corner is
/// `corner`. The distance of the line from `u` is between the two of `away`, times the range of the
/// margin.
fn line_meets(
    u: DVec2,
    corner: DVec2,
    towards: DVec2,
    [least, most]: [f64; 2],
    margin: SilhouetteMargin,
) -> bool {
    let Some(towards) = towards.try_normalize() else { return true };
    let low = corner - u - margin.outside;
    let high = low + (1.0 + 2.0 * margin.outside);
    let nearest = (towards * low).min(towards * high).element_sum();
    let furthest = (towards * low).max(towards * high).element_sum();
    furthest >= least * margin.range[0] && nearest <= most * margin.range[1]
}
