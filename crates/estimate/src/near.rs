//! Which pixels a silhouette may cross, from one ray each.

use field::{Real, Vector3};
use glam::DVec2;
use trace::{Intersection, Outcome, Ray};

use super::{Primary, Sample, Setup};

/// How many pixels' distance from its sample a silhouette may have and still count: the sample may
/// sit in one corner and the silhouette pass through the opposite one, √2 away; the rest is room
/// for what first order misses.
const REACH: f64 = 1.6;

/// Hits steeper than this cosine are never near a silhouette of radius 8 px or more: cos² = 2 s/r
/// at distance s.
const STEEP: f64 = 0.65;

/// How far first order is believed.
#[derive(Clone, Copy, Debug)]
pub struct Doubt {
    /// The part of its first-order distance at which a silhouette may be, and the multiple.
    range: [f64; 2],
    /// How far outside of its pixel a silhouette counts as inside, in pixels.
    margin: f64,
    /// Whether every ray through a gap counts.
    gaps: bool,
}

impl Doubt {
    /// Where corners and further samples look too: a ball of two and a half pixels bends within it.
    pub const SMALL: Doubt = Doubt { range: [0.75, 1.35], margin: 0.1, gaps: false };

    /// Where nothing else looks. Fits of `spot` settled at a Chamfer distance of 0.14 % with it,
    /// and at 0.16 % with the small one.
    pub const LARGE: Doubt = Doubt { range: [0.5, 2.0], margin: 0.25, gaps: true };
}

/// For every sample, whether a silhouette may cross its pixel.
///
/// Two tests to first order: a ray that passes a closest approach of f outside (before its hit, if
/// it has one) has a silhouette about f/(t·pixel angle) pixels away, where f falls; a ray that hits
/// at cosine c = −n·d has one where c² falls to zero, c/(2|∂c/∂u|) pixels away. What is near counts
/// if the line through there, across the way to it, meets the pixel. Of several surfaces that a ray
/// passes it knows the closest only.
pub fn near_silhouettes<R: Real>(
    setup: &Setup<'_, R>,
    samples: &[Sample],
    primary: &Primary<R>,
    doubt: Doubt,
) -> Vec<bool> {
    let mut near = vec![false; samples.len()];
    passing(setup, samples, primary, doubt, &mut near);
    grazing(setup, samples, primary, doubt, &mut near);
    near
}

/// Marks rays that pass a surface.
fn passing<R: Real>(
    setup: &Setup<'_, R>,
    samples: &[Sample],
    primary: &Primary<R>,
    doubt: Doubt,
    near: &mut [bool],
) {
    for (i, sample) in samples.iter().enumerate().filter(|(i, _)| primary.rays[*i].is_none()) {
        // All that is in sight may lie between the samples.
        let reach = R::of(setup.cameras[sample.camera].pixel_angle() * REACH);
        let camera = &setup.cameras[sample.camera];
        // Rarely: only what is less than a pixel.
        if setup.within.radius < reach * (setup.within.center - R::Vec3::of(camera.eye)).length() {
            let (nearest, clearance) = setup.beside(sample);
            near[i] = clearance < reach && setup.within.radius < reach * nearest;
        }
    }
    for passage in passages(setup, samples, &primary.rays, &primary.found, REACH) {
        let u = samples[passage.sample].u;
        near[passage.sample] = passage.crosses(u, u.floor(), doubt);
    }
}

/// A surface that a ray passes by: where, as seen on the film.
pub(super) struct Passage {
    pub(super) sample: usize,
    /// The way to it.
    towards: DVec2,
    /// Its distance, in pixels: at least, and to first order.
    away: [f64; 2],
    /// Whether the ray hits something behind it.
    before: bool,
}

/// The surfaces that rays pass by within `reach` pixels, at most one a ray.
pub(super) fn passages<R: Real>(
    setup: &Setup<'_, R>,
    samples: &[Sample],
    rays: &[Option<Ray<R>>],
    found: &[Option<Intersection<R>>],
    reach: f64,
) -> Vec<Passage> {
    let (mut which, mut x) = (Vec::new(), Vec::new());
    for (i, sample) in samples.iter().enumerate() {
        let reach = R::of(setup.cameras[sample.camera].pixel_angle() * reach);
        if let (Some(ray), Some(found)) = (&rays[i], &found[i])
            && found.clearance < reach
        {
            which.push((i, *found));
            x.push(ray.at(found.nearest));
        }
    }
    let (mut f, mut gradient) = (vec![R::zero(); x.len()], vec![R::Vec3::zero(); x.len()]);
    setup.field.value_gradient(&x, &mut f, &mut gradient);
    let mut passages = Vec::with_capacity(x.len());
    for (((sample, found), f), gradient) in which.into_iter().zip(f).zip(gradient) {
        let camera = &setup.cameras[samples[sample].camera];
        let (_, du) = camera.direction_du(samples[sample].u);
        let rise =
            DVec2::from(du.map(|du| (gradient.dot(R::Vec3::of(du)) * found.nearest).to_double()));
        let least = found.clearance.to_double() / camera.pixel_angle();
        let away = [least, (f.to_double() / rise.length()).max(least)];
        let before = found.outcome == Outcome::Hit;
        passages.push(Passage { sample, towards: -rise, away, before });
    }
    passages
}

impl Passage {
    /// Whether the surface's silhouette may cross the pixel with its least corner at `pixel`; the
    /// ray is at `u`.
    pub(super) fn crosses(&self, u: DVec2, pixel: DVec2, doubt: Doubt) -> bool {
        // In a gap between two surfaces the further one may cross where the closer one does not.
        (self.before && doubt.gaps) || crosses(u, pixel, self.towards, self.away, doubt)
    }
}

/// Marks rays that hit at a grazing angle.
fn grazing<R: Real>(
    setup: &Setup<'_, R>,
    samples: &[Sample],
    primary: &Primary<R>,
    doubt: Doubt,
    near: &mut [bool],
) {
    let grazing: Vec<usize> = (0..primary.hits.len())
        .filter(|&h| -primary.normal[h].dot(primary.direction[h]) < R::of(STEEP))
        .collect();
    let pick = |from: &[R::Vec3]| grazing.iter().map(|&h| from[h]).collect::<Vec<_>>();
    let (x, gradient, normal, direction) = (
        pick(&primary.x),
        pick(&primary.gradient),
        pick(&primary.normal),
        pick(&primary.direction),
    );
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
        // −∂c/∂u.
        let fall = DVec2::from(du.map(|du| {
            let du = R::Vec3::of(du);
            let dx = du * t - d * (t * g.dot(du) / g.dot(d));
            (turn[i].dot(dx) + normal[i].dot(du)).to_double()
        }));
        let away = -normal[i].dot(d).to_double() / (2.0 * fall.length());
        // A NaN, where the slope vanishes too, counts as near, and so does a ray that ends on the
        // face behind a rim.
        if away.is_nan()
            || away <= 0.0
            || (away <= REACH && crosses(sample.u, sample.u.floor(), fall, [away; 2], doubt))
        {
            near[primary.hits[h]] = true;
        }
    }
}

/// Whether a line across `towards` from `u`, at a distance between the two of `away`, give or take,
/// may meet the pixel with its least corner at `pixel`.
fn crosses(u: DVec2, pixel: DVec2, towards: DVec2, [least, most]: [f64; 2], doubt: Doubt) -> bool {
    let Some(towards) = towards.try_normalize() else { return true };
    let low = pixel - u - doubt.margin;
    let high = low + (1.0 + 2.0 * doubt.margin);
    let nearest = (towards * low).min(towards * high).element_sum();
    let furthest = (towards * low).max(towards * high).element_sum();
    furthest >= least * doubt.range[0] && nearest <= most * doubt.range[1]
}
