//! Patches: photographs must agree about the points of a sharp surface.
//!
//! The radiance of the head can explain a point at a depth that is a little wrong, in each
//! photograph. Two photographs of a pattern agree at the right depth and slope only. See
//! [`multiview::stereo::Consistency`] for the comparison and its sources.

use estimate::record::HitBar;
use glam::Vec3;
use multiview::stereo::PATCH_REACH;
use random::Name;
use render::{Hit, Primary};

use crate::drawn::{Drawn, one_of};
use crate::objective::Patches;
use crate::photometry::Draw;
use crate::stats::BatchStats;

/// The mean loss of a hit at which half of the weight stays after the fall: about that of residuals
/// of 0.027 in display units.
const UNEXPLAINED: f32 = 0.02;

/// The term is evaluated at one of up to this many hits, with this many times its weight, where the
/// weight has fallen by as much: a hit never has more than the first weight.
const MOST: f32 = 4.0;

const PATCH_HITS: Name = Name::new("hits of the term of patches", 37);

impl Patches<'_> {
    /// The term with a fall for this mean loss of hits: `fall` is then the factor on the weight.
    ///
    /// A plane carries a patch, so patches move a curved surface. Where radiance explains single
    /// pixels, those are more exact. Highlights, lenses and exposures that no model explains are an
    /// error of theirs, and patches do not see most of it.
    pub(crate) fn after_fall(self, mean_loss: f32) -> Self {
        let [loss, half] = [mean_loss, UNEXPLAINED].map(|loss| loss.powi(4));
        Patches { fall: self.fall + (1.0 - self.fall) * loss / (loss + half), ..self }
    }

    /// The term is evaluated at one of this many hits.
    fn every(self) -> usize {
        self.fall.recip().clamp(1.0, MOST) as usize
    }
}

/// The adjoints of hits by the term, if there is one. `draw` gives the draw of a sample, unless a
/// silhouette may cross its pixel.
pub(crate) fn patches<'d>(
    drawn: &Drawn<'_>,
    primary: &Primary<f32>,
    draw: impl Fn(usize) -> Option<&'d Draw>,
    stats: &mut BatchStats,
) -> Vec<HitBar<f32>> {
    let Drawn { objective, stream, .. } = *drawn;
    let Some(term) = objective.patches else { return Vec::new() };
    let (consistency, every) = (term.consistency, term.every());
    let weight = objective.pixel_weight() * term.weight * term.fall * every as f32;
    let photographs = &objective.targets.level.photographs;
    let mut of_hit = |i: usize, hit: &Hit<f32>| {
        let draw = draw(hit.sample)?;
        let (view, [x, y]) = (draw.view as usize, [draw.x, draw.y].map(u32::from));
        if !photographs[view].is_used_around(x, y, PATCH_REACH) {
            return None;
        }
        let surface = &primary.surface;
        let found = consistency.at(view, [x, y], surface.x[i], surface.normal[i])?;
        let count = f32::from(draw.count);
        stats.patches += f64::from(found.loss * count) * every as f64;
        let weight = weight * count;
        Some(HitBar { x: found.x * weight, normal: found.normal * weight })
    };
    let none = HitBar { x: Vec3::ZERO, normal: Vec3::ZERO };
    let mut of_hits = vec![none; primary.hits.len()];
    for (i, hit) in one_of(every, primary.hits.iter().enumerate(), stream.named(PATCH_HITS)) {
        of_hits[i] = of_hit(i, hit).unwrap_or(none);
    }
    of_hits
}

#[cfg(test)]
mod tests {
    use dataset::View;
    use estimate::record::Pass;
    use estimate::{Refined, SampleCounts};
    use field::UniformBackground;
    use film::Film;
    use glam::{DVec2, DVec3};
    use multiview::stereo::{Consistency, View as Photograph};
    use random::{Name, Stream};
    use render::{Camera, Sample, Scene};
    use sdf_nn::Encoding;

    use crate::photometry::{Level, MaskUse, pyramid};
    use crate::test_model::{BOUNDS, Model, background_model};
    use crate::{Gradient, Objective, Surface, Workspace, gradient};

    use super::*;

    const SIDE: u32 = 64;
    const RADIUS: f64 = 0.5;
    const BACKGROUND: UniformBackground<f32> = UniformBackground(Vec3::ZERO);
    const DIRECTION: Name = Name::other("direction in the space of the field's parameters");

    fn cameras() -> Vec<Camera> {
        let camera = |angle: f64| {
            let eye = DVec3::new(3.0 * angle.sin(), 0.4 * angle, 3.0 * angle.cos());
            let (focal, middle) = (DVec2::splat(130.0), DVec2::splat(f64::from(SIDE) / 2.0));
            Camera::look_at(SIDE, SIDE, focal, middle, eye, DVec3::ZERO, DVec3::Y).unwrap()
        };
        [-0.3, 0.0, 0.25].map(camera).to_vec()
    }

    /// The model whose surface the photographs show.
    fn shown() -> Model {
        Model::ball(RADIUS, 16, Encoding::None)
    }

    fn scene<'a>(model: &'a Model, cameras: &'a [Camera]) -> Scene<'a, f32> {
        Scene::new(&model.field, &model.head, cameras, &BOUNDS, &BACKGROUND)
    }

    /// A photograph of the shown surface with a pattern.
    fn photograph(cameras: &[Camera], camera: usize) -> Film {
        let model = shown();
        let at = |i: u32| DVec2::new(f64::from(i % SIDE) + 0.5, f64::from(i / SIDE) + 0.5);
        let samples: Vec<Sample> = (0..SIDE * SIDE).map(|i| Sample { camera, u: at(i) }).collect();
        let primary = scene(&model, cameras).primary(&samples).unwrap();
        let mut image = Film::new(SIDE, SIDE);
        for (hit, x) in primary.hits.iter().zip(&primary.surface.x) {
            let wave = |a: [f32; 3], phase: f32| (Vec3::from(a).dot(*x) + phase).sin();
            let warped = wave([16.0, 7.0, 5.0], 1.5 * wave([4.0, 9.0, 2.0], 0.3));
            let value = 0.4 + 0.2 * warped + 0.15 * wave([-9.0, 23.0, 11.0], 1.0);
            image.pixels[hit.sample] = [value; 3];
        }
        image
    }

    struct Setting {
        level: Level,
        cameras: Vec<Camera>,
        consistency: Consistency,
        draws: Vec<Draw>,
    }

    impl Setting {
        fn new() -> Self {
            let cameras = cameras();
            let view = |(i, camera): (usize, &Camera)| View {
                name: String::new(),
                path: "0.png".into(),
                camera: *camera,
                image: photograph(&cameras, i),
                mask: None,
            };
            let views: Vec<View> = cameras.iter().enumerate().map(view).collect();
            let level = pyramid(&views, MaskUse::None, &background_model(true), 1).remove(0);
            let of_views = views.iter().map(|v| Photograph { camera: &v.camera, image: &v.image });
            let consistency = Consistency::new(&of_views.collect::<Vec<_>>(), &BOUNDS);
            // Pixels of the middle of the ball, which no silhouette crosses.
            let places = (22..42).step_by(3).flat_map(|y| (22..42).step_by(3).map(move |x| (x, y)));
            let of_place = |(x, y)| (0..3).map(move |view| Draw { view, x, y, count: 1 });
            let draws = places.flat_map(of_place).collect();
            Setting { level, cameras, consistency, draws }
        }

        /// The gradient with this weight of the term.
        fn gradient(&self, model: &Model, weight: f32) -> Gradient {
            let scene = Scene::new(&model.field, &model.head, &self.cameras, &BOUNDS, &BACKGROUND);
            let counts = SampleCounts { spp: 4, edge_samples: 1 };
            let surface = Surface::Sharp { estimator: &Refined, counts, pass: Pass::Limited(1.0) };
            let plain = Objective::photometric(scene, &self.level, &self.draws, surface);
            let patches = Some(Patches { consistency: &self.consistency, weight, fall: 1.0 });
            gradient(&Objective { patches, ..plain }, &mut Workspace::default()).unwrap()
        }
    }

    #[test]
    fn the_gradient_of_patches_matches_differences() {
        let setting = Setting::new();
        let model = Model::ball(RADIUS - 0.005, 16, Encoding::None);
        let all = model.parameters();
        let fields = model.field.parameters().len();
        let weight = 4.0;
        let with = setting.gradient(&model, weight);
        let without = setting.gradient(&model, 0.0);
        assert!(with.stats.patches > 0.2, "{}", with.stats.patches);

        let (mut error, mut square) = (0.0, 0.0);
        for direction in 0..6u64 {
            let stream = Stream::of_seed(direction).named(DIRECTION);
            let step: Vec<f64> = (0..fields as u64).map(|i| stream.at(i).unit() - 0.5).collect();
            let difference = with.parameters.iter().zip(&without.parameters).zip(&step);
            let along: f64 = difference.map(|((w, o), s)| f64::from(w - o) * s).sum();
            let value = |h: f64| {
                let mut moved = model.clone();
                let mut parameters = all.clone();
                parameters.iter_mut().zip(&step).for_each(|(p, s)| *p += (h * s) as f32);
                moved.set_parameters(&parameters);
                setting.gradient(&moved, weight).stats.patches * f64::from(weight)
                    / setting.draws.len() as f64
            };
            let h = 1e-3;
            let expected = (value(h) - value(-h)) / (2.0 * h);
            println!("direction {direction}: {along} against {expected}");
            error += (along - expected).powi(2);
            square += expected.powi(2);
        }
        let relative = (error / square).sqrt();
        println!("relative error of the gradient of patches: {relative:.4}");
        assert!(relative < 0.03, "{relative}");
    }

    #[test]
    fn the_weight_falls_where_radiance_explains_the_photographs() {
        let setting = Setting::new();
        let term = Patches { consistency: &setting.consistency, weight: 4.0, fall: 0.1 };
        let fall = |loss| term.after_fall(loss).fall;
        assert_eq!((fall(0.0), fall(UNEXPLAINED)), (0.1, 0.1 + 0.9 * 0.5));
        assert!(fall(10.0 * UNEXPLAINED) > 0.99);
        assert_eq!(Patches { fall: 1.0, ..term }.after_fall(0.0).fall, 1.0);
        let every = |fall| Patches { fall, ..term }.every();
        assert_eq!([0.0, 0.1, 0.3, 0.6, 1.0].map(every), [4, 4, 3, 1, 1]);
    }

    #[test]
    fn patches_are_smallest_on_the_surface_that_photographs_show() {
        let setting = Setting::new();
        let loss = |radius: f64| {
            setting.gradient(&Model::ball(radius, 16, Encoding::None), 1.0).stats.patches
        };
        let [below, at, above] = [-0.02, 0.0, 0.02].map(|by| loss(RADIUS + by));
        println!("{below}, {at}, {above}");
        assert!(at < 0.5 * below.min(above), "{below}, {at}, {above}");
    }
}
