//! The solid of a run: its model in its bounding sphere, as pictures and meshes show it.

use field::BackgroundPerCamera;
use field::{Clipped, Field, Sphere, may_reach};
use render::{Camera, Scene};

use crate::model::Model;
use crate::run_file::RunFile;

/// The solid of a run, to render it.
///
/// A solid that reaches the bounding sphere has a cap there, as in its mesh. A fit itself has no
/// caps: their photometric adjoint would make the sphere a canvas for the background.
pub struct Solid<'a> {
    model: &'a Model,
    field: Box<dyn Field<f32> + 'a>,
    bounds: Sphere<f64>,
}

/// Points at which the slope of the field is taken: a hundredth of the evaluations of an iteration.
pub(crate) const SLOPE_POINTS: u64 = 128;

/// Radius of the tracing sphere of a solid with a cap, in bounding radii: the cap is inside.
const MARGIN: f64 = 1.5;

impl std::fmt::Debug for Solid<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Solid").field("bounds", &self.bounds).finish_non_exhaustive()
    }
}

impl<'a> Solid<'a> {
    /// The solid of a model. It costs 4096 evaluations of the field.
    pub fn new(model: &'a Model, file: &'a RunFile) -> Self {
        let bounds = file.sphere();
        let ball = Sphere { center: bounds.center.as_vec3(), radius: bounds.radius as f32 };
        if may_reach(&model.field, &ball) {
            let field = Box::new(Clipped::new(&model.field, ball));
            return Solid { model, field, bounds: bounds.scaled(MARGIN) };
        }
        Solid { model, field: Box::new(&model.field), bounds }
    }

    /// The solid in front of its background.
    pub fn scene<'b>(&'b self, cameras: &'b [Camera]) -> Scene<'b, f32> {
        self.scene_in_front_of(None, cameras)
    }

    /// The solid in front of these colours of the cameras ([`RunFile::background_of`]), or else of
    /// its background.
    pub fn scene_in_front_of<'b>(
        &'b self,
        colors: Option<&'b BackgroundPerCamera<f32>>,
        cameras: &'b [Camera],
    ) -> Scene<'b, f32> {
        let own = self.model.background.as_background();
        let background = colors.map_or(own, |colors| colors);
        Scene::new(&*self.field, &self.model.head, cameras, &self.bounds, background)
            .with_slope_of_field(SLOPE_POINTS)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, DVec3};
    use render::render;

    use super::*;
    use crate::options::FitOptions;

    /// The area of the image of a run's solid, in pixels. The sphere has the outline of a disc with
    /// a radius of 8 pixels.
    fn area(model: &Model, file: &RunFile) -> f64 {
        let (focal, middle) = (8.0 * f64::sqrt(15.0), DVec2::splat(10.0));
        let eye = DVec3::new(0.0, 0.0, 4.0);
        let camera =
            Camera::look_at(20, 20, DVec2::splat(focal), middle, eye, DVec3::ZERO, DVec3::Y);
        let image =
            render(&Solid::new(model, file).scene(&[camera.unwrap()]), 0, 64, 1, &|_| {}).unwrap();
        image.coverage.iter().map(|c| f64::from(*c)).sum()
    }

    #[test]
    fn a_solid_that_reaches_the_sphere_has_a_cap_there() {
        let options = FitOptions { width: 16, layers: 2, bands: 0, ..FitOptions::default() };
        let file = RunFile::of_test(options);
        let ball = |radius: f64| {
            let options = FitOptions { initial_radius: radius, ..file.options.clone() };
            Model::initial(&RunFile { options, ..file.clone() })
        };
        let disc = std::f64::consts::PI * 64.0;
        // The network's ball is round to some percent.
        assert!((area(&ball(0.5), &file) / disc - 0.24).abs() < 0.05);
        assert!((area(&ball(1.6), &file) / disc - 1.0).abs() < 0.005);
    }
}
