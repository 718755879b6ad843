//! Camera rays, their first hits, and the radiance along them.

use field::{Field, Real, SurfaceBatch, Vector3};
use rustc_hash::FxHashMap;
use trace::{Intersection, Outcome, Ray};

use crate::invalid::InvalidField;
use crate::sample::Sample;
use crate::scene::Scene;

/// A ray with the tracer's result.
#[derive(Clone, Copy, Debug)]
pub struct TracedRay<R: Real> {
    /// The ray.
    pub ray: Ray<R>,
    /// The tracer's result.
    pub found: Intersection<R>,
}

impl<R: Real> TracedRay<R> {
    /// The distance of the hit along the ray, in world units; `None` for a ray without a hit.
    pub fn depth(&self) -> Option<R> {
        (self.found.outcome == Outcome::Hit).then_some(self.found.t)
    }

    /// Whether the field was a NaN or an infinity along the ray.
    fn is_invalid(&self) -> bool {
        self.found.outcome == Outcome::Invalid
    }
}

/// A film sample with its radiance.
#[derive(Clone, Copy, Debug)]
pub struct TracedSample<R: Real> {
    /// The sample.
    pub sample: Sample,
    /// The number of its ray in [`Primary::rays`]; `None` if the ray misses the ball of rays.
    pub ray: Option<u32>,
    /// The radiance along the ray, linear RGB: of the first hit, or else the background.
    pub radiance: R::Vec3,
}

/// The hit of a film sample.
#[derive(Clone, Copy, Debug)]
pub struct Hit<R: Real> {
    /// The sample, by its number in the batch.
    pub sample: usize,
    /// The distance from the eye, in world units.
    pub t: R,
    /// ∇f at the hit point.
    pub gradient: R::Vec3,
}

/// The first hits of a batch of samples.
#[derive(Clone, Debug, Default)]
pub struct Primary<R: Real> {
    /// The samples.
    pub samples: Vec<TracedSample<R>>,
    /// The rays that meet the ball of rays, in the order of their samples.
    pub rays: Vec<TracedRay<R>>,
    /// The hits, in the order of their samples.
    pub hits: Vec<Hit<R>>,
    /// The surface at the hits, with one element per hit.
    pub surface: Surface<R>,
}

/// Surface points as one vector per quantity; see [`SurfaceBatch`].
#[derive(Clone, Debug, Default)]
pub struct Surface<R: Real> {
    /// The points, in world units.
    pub x: Vec<R::Vec3>,
    /// The unit normals.
    pub normal: Vec<R::Vec3>,
    /// The unit view directions, from the camera to the point.
    pub direction: Vec<R::Vec3>,
}

/// A camera inside the ball of rays, or this close to it in bounding radii, starts its rays
/// half-way to the nearest surface: the projection onto the film is singular at the eye.
const AT_THE_EYE: f64 = 1e-3;

/// If a ray starts this close to its camera, in bounding radii, its tracing scale follows from the
/// distance to the nearest surface: surfaces there may be small compared to the ball.
const CLOSE: f64 = 0.5;

/// The least tracing scale, in bounding radii: an eye on a surface would have a scale of 0.
const LEAST_SCALE: f64 = 1e-6;

impl<R: Real> Surface<R> {
    /// The points as the argument of a shader.
    pub fn batch(&self) -> SurfaceBatch<'_, R> {
        let Surface { x, normal, direction } = self;
        SurfaceBatch { x, normal, direction }
    }

    /// Adds a point (world units) with its unit normal and unit view direction.
    pub fn push(&mut self, x: R::Vec3, normal: R::Vec3, direction: R::Vec3) {
        self.x.push(x);
        self.normal.push(normal);
        self.direction.push(direction);
    }
}

impl<R: Real> Primary<R> {
    /// The ray of a sample; `None` if it misses the ball of rays.
    pub fn ray_of(&self, sample: &TracedSample<R>) -> Option<&TracedRay<R>> {
        sample.ray.map(|ray| &self.rays[ray as usize])
    }

    /// For every sample, whether it hits.
    pub fn hit_mask(&self) -> Vec<bool> {
        let mut mask = vec![false; self.samples.len()];
        self.hits.iter().for_each(|hit| mask[hit.sample] = true);
        mask
    }

    /// The mean radiance of every pixel, linear RGB, from `spp` samples per pixel in the order of
    /// the pixels.
    pub fn pixel_means(&self, spp: u32) -> Vec<R::Vec3> {
        let share = R::one() / R::of(f64::from(spp));
        let sum = |own: &[TracedSample<R>]| {
            own.iter().fold(R::Vec3::zero(), |sum, s| sum + s.radiance) * share
        };
        self.samples.chunks(spp as usize).map(sum).collect()
    }

    /// Keeps the samples that are flagged, with their hits, and renumbers them.
    ///
    /// `keep` has one flag per sample.
    ///
    /// # Panics
    /// If `keep` is too short to have a flag for every sample that hits.
    pub fn retain(&mut self, keep: &[bool]) {
        let with_ray = self.samples.iter().zip(keep).filter(|(sample, _)| sample.ray.is_some());
        let kept_rays: Vec<bool> = with_ray.map(|(_, keep)| *keep).collect();
        let kept_hits: Vec<bool> = self.hits.iter().map(|hit| keep[hit.sample]).collect();
        let mut kept_before = 0;
        let number: Vec<usize> = keep
            .iter()
            .map(|keep| {
                kept_before += usize::from(*keep);
                kept_before.wrapping_sub(1)
            })
            .collect();
        retain_flagged(&mut self.samples, keep);
        number_rays(&mut self.samples);
        retain_flagged(&mut self.rays, &kept_rays);
        retain_flagged(&mut self.hits, &kept_hits);
        retain_flagged(&mut self.surface.x, &kept_hits);
        retain_flagged(&mut self.surface.normal, &kept_hits);
        retain_flagged(&mut self.surface.direction, &kept_hits);
        self.hits.iter_mut().for_each(|hit| hit.sample = number[hit.sample]);
    }
}

impl<R: Real> Primary<R> {
    /// Adds the samples of another batch, with their hits, after its own.
    pub fn append(&mut self, other: Self) {
        let (samples, rays) = (self.samples.len(), self.rays.len() as u32);
        let moved = |sample: TracedSample<R>| TracedSample {
            ray: sample.ray.map(|ray| ray + rays),
            ..sample
        };
        self.samples.extend(other.samples.into_iter().map(moved));
        self.rays.extend(other.rays);
        let moved = |hit: Hit<R>| Hit { sample: hit.sample + samples, ..hit };
        self.hits.extend(other.hits.into_iter().map(moved));
        self.surface.x.extend(other.surface.x);
        self.surface.normal.extend(other.surface.normal);
        self.surface.direction.extend(other.surface.direction);
    }

    /// Deals the samples, with their hits, to `count` parts. `part` has the number of the part of
    /// each sample. Samples of a part keep their order.
    pub fn deal(self, count: usize, part: &[usize]) -> Vec<Self> {
        let mut parts: Vec<Self> = (0..count).map(|_| Primary::default()).collect();
        let mut number = Vec::with_capacity(part.len());
        for (mut sample, part) in self.samples.into_iter().zip(part) {
            let own = &mut parts[*part];
            if let Some(ray) = &mut sample.ray {
                own.rays.push(self.rays[*ray as usize]);
                *ray = own.rays.len() as u32 - 1;
            }
            number.push(own.samples.len());
            own.samples.push(sample);
        }
        let Surface { x, normal, direction } = self.surface;
        for (i, hit) in self.hits.into_iter().enumerate() {
            let own = &mut parts[part[hit.sample]];
            own.hits.push(Hit { sample: number[hit.sample], ..hit });
            own.surface.push(x[i], normal[i], direction[i]);
        }
        parts
    }
}

/// Numbers the rays of samples anew, in order.
fn number_rays<R: Real>(samples: &mut [TracedSample<R>]) {
    for (number, ray) in samples.iter_mut().filter_map(|sample| sample.ray.as_mut()).enumerate() {
        *ray = number as u32;
    }
}

/// Keeps the elements that are flagged, in order; elements without a flag are removed.
pub fn retain_flagged<T>(values: &mut Vec<T>, keep: &[bool]) {
    let mut keep = keep.iter();
    values.retain(|_| keep.next() == Some(&true));
}

/// Unit normals ∇f/|∇f|. A gradient of zero gives a vector of zeros.
pub fn normals<R: Real>(gradient: &[R::Vec3]) -> Vec<R::Vec3> {
    gradient.iter().map(|g| *g * (R::one() / g.length().max(R::min_positive_value()))).collect()
}

/// The value of f at the eye, at least 0: the distance to the nearest surface, for a distance
/// field.
fn distance_to_surface<R: Real>(field: &dyn Field<R>, eye: R::Vec3) -> R {
    let mut f = [R::zero()];
    field.value(&[eye], &mut f);
    f[0].max(R::zero())
}

impl<R: Real> Scene<'_, R> {
    /// The ray of every sample, not yet traced; `None` for a ray that misses the ball of rays.
    fn rays<'a>(
        &'a self,
        samples: &'a [Sample],
    ) -> impl Iterator<Item = Option<TracedRay<R>>> + 'a {
        let mut surface_distance = FxHashMap::default();
        let radius = self.radius();
        samples.iter().map(move |sample| {
            let camera = &self.cameras[sample.camera];
            let eye = R::Vec3::of(camera.eye);
            let direction = R::Vec3::of(camera.direction(sample.u));
            let mut ray = Ray::enter(eye, direction, &self.tracing.ball)?;
            let mut nearest = ray.near;
            if ray.near < radius * R::of(CLOSE) {
                let distance = *surface_distance
                    .entry(sample.camera)
                    .or_insert_with(|| distance_to_surface(self.field, eye));
                nearest = nearest.max(distance);
                if ray.near < radius * R::of(AT_THE_EYE) {
                    ray.near = (distance * R::of(0.5)).max(ray.near).min(ray.far);
                }
            }
            let scale = self.tracing_scale(sample.camera, nearest);
            ray.scale = scale.max(radius * R::of(LEAST_SCALE));
            ray.reach = R::of(self.reach * camera.pixel_angle());
            if scale < radius {
                // The part of the solid that the film shows widens along the ray.
                ray.spread = self.film_angle(sample.camera);
            }
            Some(TracedRay { ray, found: Intersection::unfinished() })
        })
    }

    /// For a sample whose ray misses the ball of rays: the distance along the ray, in world units,
    /// at which it passes the centre of the ball, and the tangent of the angle by which it clears
    /// the ball.
    ///
    /// The result is (0, ∞) if the ball is behind the camera.
    pub fn passing(&self, sample: &Sample) -> (R, R) {
        let (camera, ball) = (&self.cameras[sample.camera], &self.tracing.ball);
        let direction = R::Vec3::of(camera.direction(sample.u));
        let away = ball.center - R::Vec3::of(camera.eye);
        let nearest = away.dot(direction);
        let gap = (away - direction * nearest).length() - ball.radius;
        if nearest > R::zero() {
            (nearest, gap.max(R::zero()) / nearest)
        } else {
            (R::zero(), R::infinity())
        }
    }

    /// Traces a batch of samples; `None` for a ray that misses the ball of rays.
    ///
    /// # Errors
    /// If the field gives a NaN or an infinity along a ray.
    pub fn trace(&self, samples: &[Sample]) -> Result<Vec<Option<TracedRay<R>>>, InvalidField> {
        let mut rows: Vec<Option<TracedRay<R>>> = self.rays(samples).collect();
        trace::intersect_rows(
            self.field,
            self.lattice,
            &mut rows,
            |row| row.as_mut().map(|row| (&row.ray, &mut row.found)),
            &self.tracing.options,
        );
        match rows.iter().position(|row| row.is_some_and(|row| row.is_invalid())) {
            Some(i) => Err(InvalidField::at(self.cameras, samples[i])),
            None => Ok(rows),
        }
    }

    /// Traces a batch of samples and shades the hits.
    ///
    /// # Errors
    /// If the field gives a NaN or an infinity along a ray, or a gradient with one at a hit.
    pub fn primary(&self, samples: &[Sample]) -> Result<Primary<R>, InvalidField> {
        let mut rays = Vec::new();
        let uniform = self.background.uniform();
        let radiance = uniform.unwrap_or(R::Vec3::zero());
        let row = |(sample, ray): (&Sample, Option<TracedRay<R>>)| {
            let number = ray.map(|ray| {
                rays.push(ray);
                rays.len() as u32 - 1
            });
            TracedSample { sample: *sample, ray: number, radiance }
        };
        let mut rows: Vec<TracedSample<R>> =
            samples.iter().zip(self.rays(samples)).map(row).collect();
        trace::intersect_rows(
            self.field,
            self.lattice,
            &mut rays,
            |row| Some((&row.ray, &mut row.found)),
            &self.tracing.options,
        );
        let (mut x, mut direction, mut hits) = (Vec::new(), Vec::new(), Vec::new());
        for (sample, row) in rows.iter().enumerate() {
            let Some(ray) = row.ray else { continue };
            let TracedRay { ray, found } = &rays[ray as usize];
            match found.outcome {
                Outcome::Hit => {
                    hits.push(Hit { sample, t: found.t, gradient: R::Vec3::zero() });
                    x.push(ray.origin + ray.direction * found.t);
                    direction.push(ray.direction);
                }
                Outcome::Invalid => return Err(InvalidField::at(self.cameras, row.sample)),
                Outcome::Miss | Outcome::Inside => {}
            }
        }
        let (mut f, mut gradient) = (vec![R::zero(); x.len()], vec![R::Vec3::zero(); x.len()]);
        self.field.value_gradient(&x, &mut f, &mut gradient);
        let finite = |(f, g): (&R, &R::Vec3)| f.is_finite() & g.is_finite();
        if !f.iter().zip(&gradient).fold(true, |all, point| all & finite(point)) {
            let i = f.iter().zip(&gradient).position(|point| !finite(point)).unwrap_or(0);
            return Err(InvalidField::at(self.cameras, samples[hits[i].sample]));
        }
        hits.iter_mut().zip(&gradient).for_each(|(hit, gradient)| hit.gradient = *gradient);
        let surface = Surface { normal: normals::<R>(&gradient), x, direction };
        let mut rgb = vec![R::Vec3::zero(); hits.len()];
        self.shader.radiance(&surface.batch(), &mut rgb);
        for (hit, rgb) in hits.iter().zip(rgb) {
            rows[hit.sample].radiance = rgb;
        }
        let mut primary = Primary { samples: rows, rays, hits, surface };
        if uniform.is_none() {
            self.add_background(&mut primary);
        }
        Ok(primary)
    }

    /// Sets the radiance of the samples that miss.
    fn add_background(&self, primary: &mut Primary<R>) {
        let hit = primary.hit_mask();
        let misses: Vec<&mut TracedSample<R>> =
            primary.samples.iter_mut().zip(hit).filter(|(_, hit)| !hit).map(|(s, _)| s).collect();
        let rgb = self.background_radiance(misses.iter().map(|sample| sample.sample));
        misses.into_iter().zip(rgb).for_each(|(sample, rgb)| sample.radiance = rgb);
    }
}
