//! The bounding sphere of the object: from the data set, or estimated.

use std::fmt;

use field::Sphere;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::BackgroundEstimate;
use crate::aim::{aimed_point, aimed_point_at, framed, is_clear_of_cameras, widest};
use crate::backdrop::Backdrop;
use crate::background::{Surrounding, UNIFORM};
use crate::carve::visual_hull_sphere;
use crate::cloud::{
    before_plane, shown_by_masks, sphere_around, sphere_of_compact, sphere_of_inner,
};
use crate::distant::share_of_distant;
use crate::matches::Matches;
use crate::picture::Picture;
use crate::still::Still;
use dataset::{Dataset, View};
use files::InputError;

/// Room around an estimated sphere, as a factor on the radius. Carved cells are coarse, and warp
/// fields need both sides of a silhouette.
const MARGIN: f64 = 1.1;

/// The photographs have backgrounds of different colours if the spread of all is this many times
/// that of one.
const DIFFERENT: f32 = 3.0;

/// The least share of a background that must be far away, so that all of it counts as such: the
/// floor of a landscape is near.
const DISTANT: f32 = 0.9;

/// The largest share of the pixels around a visual hull that may show the object. With more, the
/// background is not as uniform as it seems, and parts of the object count as background.
const MOST_STRAY: f64 = 0.02;

/// The share of the views whose films must show a point of what they look at.
const ON_FILMS: f64 = 0.7;

/// The largest radius of a sphere by matches, in radii of the one that the median camera sees
/// whole.
const MOST_GROWTH: f64 = 2.0;

/// Cameras stand at one place if they are nearer to each other than this part of their distance
/// from the origin.
const ONE_PLACE: f64 = 1e-9;

/// The evidence that a bounding sphere comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SphereSource {
    /// The user.
    Asked,
    /// The data set.
    Dataset,
    /// The masks of the object.
    Masks,
    /// The points on the scene's surfaces.
    Points,
    /// The outline of the object in front of uniform or smooth backgrounds.
    Outlines,
    /// Matches between the photographs, and the cameras.
    Matches,
    /// The cameras alone.
    Cameras,
}

impl fmt::Display for SphereSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            SphereSource::Asked => "as asked",
            SphereSource::Dataset => "from the data set",
            SphereSource::Masks => "from the masks",
            SphereSource::Points => "from the data set's points",
            SphereSource::Outlines => "from outlines in front of plain backgrounds",
            SphereSource::Matches => "from the cameras and matches between the photographs",
            SphereSource::Cameras => "from the cameras alone",
        })
    }
}

/// The bounding sphere and the backgrounds of a data set.
#[derive(Clone, Debug, PartialEq)]
pub struct Surroundings {
    /// The bounding sphere, in the data set's units.
    pub sphere: Sphere<f64>,
    /// The evidence for it.
    pub source: SphereSource,
    /// One uniform background of all training views.
    pub background: BackgroundEstimate,
    /// A uniform background of each training view.
    pub backgrounds: Vec<BackgroundEstimate>,
    /// The share of the background, 0 to 1, that photographs show alike along equal directions: 1
    /// if all of it is far away. Only parts with a pattern count. 0 in front of uniform
    /// backgrounds.
    pub distant: f32,
    /// The backdrop, as far as it stands still in the image while the cameras move: an object that
    /// turns in front of a fixed camera. [`Still::NONE`] in front of uniform backgrounds.
    pub still: Still,
    /// The points on surfaces by matches between photographs, in the data set's units; none if
    /// they were not looked for.
    pub points: Vec<DVec3>,
}

impl Surroundings {
    fn new(views: &[View], sphere: Sphere<f64>, source: SphereSource) -> Self {
        let of_view = |view| Surrounding::of(view, &sphere);
        let shown: Vec<Surrounding> = views.par_iter().map(of_view).collect();
        // One after the other: each copies its pixels.
        let background = BackgroundEstimate::of_surroundings(&shown);
        let backgrounds = shown.par_chunks(1).map(BackgroundEstimate::of_surroundings).collect();
        Surroundings {
            sphere,
            source,
            background,
            backgrounds,
            distant: 0.0,
            still: Still::NONE,
            points: Vec::new(),
        }
    }

    /// With the parts of the background that stand still in the image, and that are far away.
    fn with_backdrop(self, views: &[View]) -> Self {
        if self.is_uniform() {
            return self;
        }
        let still = Still::of(views, &self.sphere);
        Surroundings { distant: share_of_distant(views, &self.sphere), still, ..self }
    }

    /// With a sphere by matches between the photographs of the data set, if the cameras alone gave
    /// it. It searches for depths in up to 32 photographs, of at most 8,192 pixels each.
    ///
    /// The depths in the middle of the films tell how far away the place is at which the cameras
    /// aim: their axes do not if all look at one side. The sphere there that the median camera sees
    /// whole is enlarged to contain nearly all that stands out of a wall, a table or a floor and is
    /// on most of the films; without such a plane, nearly all points, if they lie close together.
    /// It stays if it would have to be more than twice as large, or come near a camera.
    #[must_use]
    pub fn with_matches(self, dataset: &Dataset) -> Self {
        if self.source != SphereSource::Cameras {
            return self;
        }
        let views = &dataset.train;
        let matches = Matches::of(views);
        if matches.depths.of_views.is_empty() {
            return self;
        }
        let framed = framed(views, aimed_point_at(views, &matches.depths));
        let sphere = sphere_of_matches(dataset, &matches.points, &framed);
        let found = Self::new(views, sphere, SphereSource::Matches).with_backdrop(views);
        Surroundings { points: matches.points, ..found }
    }

    /// The confidence, 0 to 1, that each view has a uniform background, of a colour of its own: one
    /// view of ten may have less.
    pub fn confidence_of_views(&self) -> f32 {
        let mut all: Vec<f32> = self.backgrounds.iter().map(|b| b.confidence).collect();
        all.sort_by(f32::total_cmp);
        all.get(all.len() / 10).copied().unwrap_or(0.0)
    }

    /// Whether the photographs have uniform backgrounds: one, or each one of its own.
    pub fn is_uniform(&self) -> bool {
        self.is_common() || self.is_per_view()
    }

    /// Whether one uniform background stands for all photographs.
    pub fn is_common(&self) -> bool {
        self.background.is_uniform() && !self.is_per_view()
    }

    /// Whether each photograph has a uniform background of its own colour: the colours of the views
    /// differ by much more than those of the pixels of a view.
    pub fn is_per_view(&self) -> bool {
        let mut spreads: Vec<f32> = self.backgrounds.iter().map(|b| b.spread).collect();
        spreads.sort_by(f32::total_cmp);
        let of_views = spreads.get(spreads.len() / 2).copied().unwrap_or(f32::INFINITY);
        let differ = !self.background.is_uniform() || self.background.spread > DIFFERENT * of_views;
        self.confidence_of_views() >= UNIFORM && differ
    }

    /// Whether the backdrop stands still in the image while the cameras move.
    pub fn is_still(&self) -> bool {
        self.still.is_still()
    }

    /// Whether everything behind the object is far away.
    pub fn is_distant(&self) -> bool {
        self.distant >= DISTANT
    }

    /// The background of each training view: the common one if all views agree well enough.
    fn of_views(&self) -> Vec<BackgroundEstimate> {
        if self.is_common() {
            return vec![self.background; self.backgrounds.len()];
        }
        self.backgrounds.clone()
    }
}

/// The bounding sphere of the object, and the background around it.
///
/// The sphere is the first of these that exists:
/// 1. `asked`;
/// 2. the data set's own ([`Dataset::bounds`]);
/// 3. a sphere around the data set's surface points, if there are 50: those that the masks show, if
///    `use_masks` is true and all training views have the coverage of the object; else those in the
///    middle of the views, around the point at which the cameras aim, and all of them if hardly any
///    is farther away;
/// 4. a sphere around the visual hull of these masks;
/// 5. without such masks, a sphere around the visual hull of the photographs, if they have uniform
///    backgrounds, or such that change smoothly over a view, and hardly a pixel outside its image
///    shows the object;
/// 6. a sphere that the median camera sees whole, around the point at which the cameras aim:
///    [`Surroundings::with_matches`] improves it.
///
/// If points and a visual hull both exist, the sphere contains both: points are missing where the
/// object has no texture, one wrong mask takes a part off the hull, and a dark part of the object
/// can look like its background.
///
/// The background is that of the pixels around the sphere. An estimated sphere need not contain the
/// object: look at the picture that `dsdf inspect` writes.
///
/// # Panics
/// If the data set has no training views.
pub fn surroundings(
    dataset: &Dataset,
    asked: Option<Sphere<f64>>,
    use_masks: bool,
) -> Surroundings {
    let views = &dataset.train;
    let known = asked.map(|sphere| (sphere, SphereSource::Asked));
    let known = known.or(dataset.bounds.map(|sphere| (sphere, SphereSource::Dataset)));
    let (sphere, source) = known
        .or_else(|| use_masks.then(|| sphere_of_masks(dataset)).flatten())
        .or_else(|| sphere_of_photographs(dataset))
        .unwrap_or_else(|| (framed(views, aimed_point(views)), SphereSource::Cameras));
    Surroundings::new(views, sphere, source).with_backdrop(views)
}

/// A sphere around the visual hull of the masks and the surface points that they show, as far as
/// there are such; `None` unless each view has a mask.
fn sphere_of_masks(dataset: &Dataset) -> Option<(Sphere<f64>, SphereSource)> {
    let views = &dataset.train;
    let masks: Option<Vec<&[f32]>> = views.iter().map(View::coverage).collect();
    let masks = masks?;
    let hull = visual_hull_sphere(views, &widest(views), |view, i| masks[view][i] >= 0.5)?;
    let points = sphere_around(&shown_by_masks(&dataset.points, views));
    around(points.map(with_margin), Some(with_margin(hull)), SphereSource::Masks)
}

/// A sphere around the surface points and the visual hull of the photographs, as far as there are
/// such.
fn sphere_of_photographs(dataset: &Dataset) -> Option<(Sphere<f64>, SphereSource)> {
    let views = &dataset.train;
    let (framed, wide) = (framed(views, aimed_point(views)), widest(views));
    let rough = Surroundings::new(views, wide, SphereSource::Cameras);
    let hull = match rough.is_uniform() {
        true => {
            let backgrounds = rough.of_views();
            hull_before(views, &wide, |view| {
                let probability = backgrounds[view].probabilities();
                let pixels = views[view].image.pixels.iter();
                pixels.map(|rgb| probability(*rgb) < 0.5).collect()
            })
        }
        false => hull_before_backdrops(views, &wide).or_else(|| hull_before_picture(views, &wide)),
    };
    let inner = sphere_of_inner(&dataset.points, &framed, MARGIN);
    let compact = sphere_of_compact(&dataset.points, &framed).map(with_margin);
    let is_outside = |sphere: &Sphere<f64>| is_clear_of_cameras(dataset, sphere);
    let all = inner.zip(compact).map(|(a, b)| around_both(&a, &b)).filter(is_outside);
    around(all.or(inner), hull, SphereSource::Outlines)
}

/// The sphere that the cameras frame, or a larger one around it that contains what they look at, by
/// the points that photographs agree about.
fn sphere_of_matches(dataset: &Dataset, points: &[DVec3], framed: &Sphere<f64>) -> Sphere<f64> {
    let views = &dataset.train;
    let on_films = |point: &&DVec3| {
        let count = views.iter().filter(|v| v.camera.project_onto_film(**point).is_some()).count();
        count as f64 >= ON_FILMS * views.len() as f64
    };
    let common: Vec<DVec3> = points.par_iter().filter(on_films).copied().collect();
    let eyes = views.iter().map(|v| v.camera.eye).sum::<DVec3>() / views.len() as f64;
    let cloud = match before_plane(&common, eyes, framed.radius) {
        Some(points) => sphere_around(&points),
        None => sphere_of_compact(points, framed),
    };
    let larger = cloud.map(|cloud| around_both(framed, &with_margin(cloud)));
    let is_fit = |sphere: &Sphere<f64>| {
        sphere.radius <= MOST_GROWTH * framed.radius && is_clear_of_cameras(dataset, sphere)
    };
    larger.filter(is_fit).unwrap_or(*framed)
}

/// A sphere with room around the visual hull of the pixels that show the object; `None` without
/// one, or if too many pixels outside its image show the object. `shown` gives a flag for each
/// pixel of a view.
fn hull_before(
    views: &[View],
    wide: &Sphere<f64>,
    shown: impl Fn(usize) -> Vec<bool> + Sync,
) -> Option<Sphere<f64>> {
    let shown: Vec<Vec<bool>> = (0..views.len()).into_par_iter().map(&shown).collect();
    // A pixel that is left out may show the object.
    let is_foreground = |view: usize, i: usize| shown[view][i] || !views[view].is_used(i);
    let hull = with_margin(visual_hull_sphere(views, wide, is_foreground)?);
    let is_stray = |view: usize, i: usize| shown[view][i] && views[view].is_used(i);
    (stray(views, &hull, is_stray) <= MOST_STRAY).then_some(hull)
}

/// Like [`hull_before`], before backdrops whose colours change smoothly over each view. They are
/// fitted again around the first hull, where there are more of their pixels.
fn hull_before_backdrops(views: &[View], wide: &Sphere<f64>) -> Option<Sphere<f64>> {
    let around = |candidate: &Sphere<f64>| {
        let of_view = |view| Backdrop::of_view(view, candidate);
        let backdrops: Option<Vec<Backdrop>> = views.par_iter().map(of_view).collect();
        let backdrops = backdrops?;
        hull_before(views, wide, |view| {
            let pixels = views[view].image.pixels.iter().enumerate();
            pixels.map(|(i, rgb)| backdrops[view].is_hidden_at(i, *rgb)).collect()
        })
    };
    around(&around(wide)?)
}

/// Like [`hull_before`], in front of a backdrop that stands still in the image.
fn hull_before_picture(views: &[View], wide: &Sphere<f64>) -> Option<Sphere<f64>> {
    if !Still::of(views, wide).is_still() {
        return None;
    }
    let picture = Picture::of(views, wide)?;
    hull_before(views, wide, |view| {
        let shown = picture.probabilities(view);
        (0..views[view].image.pixels.len())
            .map(|i| shown(i, views[view].image.pixels[i]) < 0.5)
            .collect()
    })
}

/// The sphere with room around it.
fn with_margin(sphere: Sphere<f64>) -> Sphere<f64> {
    sphere.scaled(MARGIN)
}

/// The sphere around both, or the one that exists; `of_hull` is the evidence for the second.
fn around(
    points: Option<Sphere<f64>>,
    hull: Option<Sphere<f64>>,
    of_hull: SphereSource,
) -> Option<(Sphere<f64>, SphereSource)> {
    match (points, hull) {
        (Some(points), Some(hull)) => Some((around_both(&points, &hull), SphereSource::Points)),
        (Some(points), None) => Some((points, SphereSource::Points)),
        (None, Some(hull)) => Some((hull, of_hull)),
        (None, None) => None,
    }
}

/// The share of the pixels outside the image of `hull` that show the object by `is_foreground`:
/// the upper quartile of the views.
fn stray(
    views: &[View],
    hull: &Sphere<f64>,
    is_foreground: impl Fn(usize, usize) -> bool + Sync,
) -> f64 {
    let share = |(number, view): (usize, &View)| {
        let (width, camera) = (view.image.width as usize, &view.camera);
        let place = |i: usize| DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let is_outside = |i: &usize| hull.clip(camera.eye, camera.direction(place(*i))).is_none();
        let outside = (0..view.image.pixels.len()).filter(is_outside);
        let (count, all) = outside.fold((0, 0), |(count, all), i| {
            (count + usize::from(is_foreground(number, i)), all + 1)
        });
        count as f64 / all.max(1) as f64
    };
    let mut shares: Vec<f64> = views.par_iter().enumerate().map(share).collect();
    shares.sort_by(f64::total_cmp);
    shares[3 * shares.len() / 4]
}

/// The smallest sphere around two spheres.
fn around_both(a: &Sphere<f64>, b: &Sphere<f64>) -> Sphere<f64> {
    let (between, distance) = (b.center - a.center, a.center.distance(b.center));
    if distance + b.radius <= a.radius {
        return *a;
    }
    if distance + a.radius <= b.radius {
        return *b;
    }
    let radius = 0.5 * (a.radius + b.radius + distance);
    Sphere { center: a.center + between * ((radius - a.radius) / distance), radius }
}

/// Refuses cameras that all stand at one place: nothing tells the distance of a surface.
///
/// # Errors
/// If there are several, and all stand at one place.
pub fn check_places(dataset: &Dataset) -> Result<(), InputError> {
    let eyes = || dataset.train.iter().chain(&dataset.test).map(|view| view.camera.eye);
    let (count, first) = (eyes().count(), eyes().next().unwrap_or_default());
    if count < 2 || eyes().any(|eye| eye.distance(first) > ONE_PLACE * first.length()) {
        return Ok(());
    }
    let place = files::point(first.to_array(), first.length());
    let found = format!("{count} cameras at one place, {place}");
    Err(InputError::new(&dataset.path, "poses", found, "photographs from different places"))
}

/// Checks the cameras of all views against the bounding sphere.
///
/// A camera inside the sphere is refused: the object has no silhouette from there. If most cameras
/// look away from the sphere, all are refused: the poses are in another convention.
///
/// # Errors
/// For the first camera inside, or if more than half look away.
pub fn check_cameras(dataset: &Dataset, bounds: &Sphere<f64>) -> Result<(), InputError> {
    let views: Vec<&View> = dataset.train.iter().chain(&dataset.test).collect();
    let inside = |v: &&&View| (v.camera.eye - bounds.center).length() <= bounds.radius;
    if let Some(view) = views.iter().find(inside) {
        let distance = (view.camera.eye - bounds.center).length();
        let center = files::point(bounds.center.to_array(), bounds.radius);
        let [distance, radius] = [distance, bounds.radius].map(|d| files::length(d, bounds.radius));
        let found = format!("a camera {distance} from the centre {center}");
        let expected = format!("all cameras outside the bounding radius {radius} (see --bounds)");
        return Err(InputError::new(&dataset.path, &view.name, found, expected));
    }
    let away = views.iter().filter(|v| looks_away(v, bounds)).count();
    if 2 * away > views.len() {
        let found = format!("{away} of {} cameras look away from the bounding sphere", views.len());
        let expected = "cameras that look at it (poses in the OpenCV convention need their y and \
            z axes negated; see --bounds)";
        return Err(InputError::new(&dataset.path, "poses", found, expected));
    }
    Ok(())
}

/// True if the sphere's centre is behind the camera of `view`.
pub fn looks_away(view: &View, bounds: &Sphere<f64>) -> bool {
    (bounds.center - view.camera.eye).dot(view.camera.forward) < 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sphere_around_two_touches_both() {
        let sphere = |x: f64, radius| Sphere { center: DVec3::new(x, 0.0, 0.0), radius };
        let both = around_both(&sphere(-1.0, 1.0), &sphere(2.0, 2.0));
        assert!((both.radius - 3.0).abs() < 1e-12 && (both.center.x - 1.0).abs() < 1e-12);
        let (small, large) = (sphere(0.2, 0.5), sphere(0.0, 1.0));
        assert_eq!([around_both(&small, &large), around_both(&large, &small)], [large; 2]);
    }
}
