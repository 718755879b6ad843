//! The points of rays at which f is evaluated: some over the whole chord of the bounding sphere,
//! and others where the first ones find opacity.

use field::Field;
use glam::Vec3;
use random::Stream;

use super::compositing::transmittance;

/// Intervals of equal length over the chord.
const COARSE: usize = 16;

/// Points where the coarse intervals have opacity.
const FINE: usize = 8;

/// Points of a ray.
pub const POINTS: usize = COARSE + 1 + FINE;

/// Intervals of a ray.
pub const INTERVALS: usize = POINTS - 1;

/// The largest sharpness times the length of a coarse interval, in choosing the fine points: a
/// surface inside of an interval should draw points to its neighbours too.
const BLUR: f32 = 4.0;

/// f at the first point of a chord, where the field is not evaluated.
///
/// A ray enters the bounding sphere from outside the solid, and the solid ends at the sphere. So
/// where f is negative, the sphere is a surface. Without it, rays would see through a solid that
/// they begin in: a fit of photographs from one side filled the space in front of the object.
const OUTSIDE: f32 = f32::MAX;

/// Weight of every coarse interval in choosing the fine points, beside its opacity.
const FLOOR: f32 = 1e-3;

/// A ray through the bounding sphere.
#[derive(Clone, Copy, Debug)]
pub struct Chord {
    /// The origin of the ray, in world units.
    pub origin: Vec3,
    /// Its unit direction.
    pub direction: Vec3,
    /// The distances at which the ray enters and leaves the sphere.
    pub ends: [f32; 2],
}

impl Chord {
    /// The point at a distance from the origin.
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}

/// Points of chords in order, with f at each.
#[derive(Clone, Debug)]
pub struct ChordPoints {
    /// [`POINTS`] distances for each chord.
    pub t: Vec<f32>,
    /// The values of f. At the first point of a chord it is `f32::MAX`: a ray enters the sphere
    /// from outside the solid.
    pub f: Vec<f32>,
}

impl ChordPoints {
    /// The points of all chords, for a sharpness per world unit. `stream` places them at random.
    pub fn new(field: &dyn Field<f32>, chords: &[Chord], sharpness: f32, stream: Stream) -> Self {
        let jitter = |i: usize, which: u64| stream.at(i as u64).at(which).unit() as f32;
        let mut coarse = Vec::with_capacity(chords.len() * COARSE);
        for (i, chord) in chords.iter().enumerate() {
            let [near, far] = chord.ends;
            let shift = jitter(i, 0) - 0.5;
            coarse.extend((1..=COARSE).map(|k| {
                let part = (k as f32 + if k < COARSE { shift } else { 0.0 }) / COARSE as f32;
                near + (far - near) * part
            }));
        }
        let coarse_f = values(field, chords, &coarse, COARSE);
        let mut fine = Vec::with_capacity(chords.len() * FINE);
        let both = coarse.chunks_exact(COARSE).zip(coarse_f.chunks_exact(COARSE));
        for (i, (t, f)) in both.enumerate() {
            let first = (chords[i].ends[0], OUTSIDE);
            add_fine(first, t, f, sharpness, jitter(i, 1), &mut fine);
        }
        let fine_f = values(field, chords, &fine, FINE);
        let mut points = ChordPoints { t: Vec::new(), f: Vec::new() };
        for (i, chord) in chords.iter().enumerate() {
            let part = |of: usize| i * of..(i + 1) * of;
            let own = coarse[part(COARSE)].iter().zip(&coarse_f[part(COARSE)]);
            let others = fine[part(FINE)].iter().zip(&fine_f[part(FINE)]);
            let mut all = [(chord.ends[0], OUTSIDE); POINTS];
            all[1..].iter_mut().zip(own.chain(others)).for_each(|(all, (t, f))| *all = (*t, *f));
            all[1..].sort_by(|a, b| a.0.total_cmp(&b.0));
            points.t.extend(all.iter().map(|point| point.0));
            points.f.extend(all.iter().map(|point| point.1));
        }
        points
    }
}

/// f at `count` distances of every chord.
fn values(field: &dyn Field<f32>, chords: &[Chord], t: &[f32], count: usize) -> Vec<f32> {
    let each = chords.iter().zip(t.chunks_exact(count));
    let x: Vec<Vec3> = each.flat_map(|(chord, t)| t.iter().map(|t| chord.at(*t))).collect();
    let mut f = vec![0.0; x.len()];
    field.value(&x, &mut f);
    f
}

/// Adds the fine distances of one chord: a stratified sample of the opacity of its intervals.
/// `first` has the distance and the value of f where the chord begins, `t` and `f` those of the
/// ends of the intervals.
fn add_fine(
    first: (f32, f32),
    t: &[f32],
    f: &[f32],
    sharpness: f32,
    jitter: f32,
    out: &mut Vec<f32>,
) {
    let mut weights = [0.0; COARSE];
    let (mut before, mut total) = (1.0, 0.0);
    let mut start = first;
    for (weight, end) in weights.iter_mut().zip(t.iter().copied().zip(f.iter().copied())) {
        let length = (end.0 - start.0).max(f32::MIN_POSITIVE);
        let blurred = sharpness.min(BLUR / length);
        let pass = transmittance(blurred, [start.1, end.1]);
        *weight = before * (1.0 - pass) + FLOOR;
        before *= pass;
        total += *weight;
        start = end;
    }
    let (mut k, mut sum) = (0, 0.0);
    for j in 0..FINE {
        let wanted = (j as f32 + jitter) / FINE as f32 * total;
        while k + 1 < COARSE && sum + weights[k] < wanted {
            sum += weights[k];
            k += 1;
        }
        let part = ((wanted - sum) / weights[k]).clamp(0.0, 1.0);
        let start = if k == 0 { first.0 } else { t[k - 1] };
        out.push(start + (t[k] - start) * part);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::opacity::weights;
    use field::Shape;

    /// The share of the light of a ray through the unit sphere that comes from the first tenth.
    fn share_of_entry(ball: f32) -> f32 {
        let chord =
            Chord { origin: Vec3::new(0.0, 0.0, -2.0), direction: Vec3::Z, ends: [1.0, 3.0] };
        let field = Shape::<f32>::sphere([0.0; 3], ball.into());
        let points = ChordPoints::new(&field, &[chord], 50.0, Stream::of_seed(1));
        let mut each = [0.0; INTERVALS];
        weights(50.0, &points.f, 0.0, &mut each);
        each.iter().zip(&points.t).filter(|(_, t)| **t < 1.2).map(|(weight, _)| weight).sum()
    }

    #[test]
    fn a_solid_that_reaches_the_sphere_ends_there() {
        let [reaches, inside] = [1.5, 0.5].map(share_of_entry);
        assert!(reaches > 0.999 && inside < 1e-3, "{reaches}, {inside}");
    }
}
