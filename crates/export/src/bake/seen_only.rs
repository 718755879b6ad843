//! The radiance of what photographs see, and grey where they see nothing.

use field::{Shader, SurfaceAdjoint, SurfaceBatch};
use glam::{DVec2, Vec3};
use rayon::prelude::*;
use render::{Camera, InvalidField, Sample, Scene};

use crate::bake::colours::GREY;

/// Pixels along the longer side of a depth map.
const SIZE: u32 = 128;

/// A point is seen if it lies at most this far behind the surface of a depth map, in bounding radii:
/// more than its pixels and a slanted surface take.
const BEHIND: f64 = 0.03;

/// A shader with the radiance of another one at points that a camera sees, and [`GREY`] elsewhere.
///
/// No photograph tells the radiance of a part that none sees: the head gives any colour there. A
/// camera sees a point if its normal faces the camera, and if the camera's depth map, of 128 pixels
/// along its longer side, has no surface in front of the point: in none of the nine pixels around
/// it, so that no outline is grey.
pub struct SeenOnly<'a> {
    shader: &'a dyn Shader<f32>,
    maps: Vec<DepthMap>,
    /// In world units.
    behind: f64,
}

/// The distances of the first hits of a camera's rays.
struct DepthMap {
    camera: Camera,
    /// Rows from the top; infinite for a ray without a hit.
    distances: Vec<f32>,
}

impl std::fmt::Debug for SeenOnly<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SeenOnly").field("cameras", &self.maps.len()).finish_non_exhaustive()
    }
}

impl<'a> SeenOnly<'a> {
    /// The shader of a scene where a camera of the scene sees the point.
    ///
    /// # Errors
    /// If the field gives a NaN or an infinity along a ray.
    pub fn of(scene: &Scene<'a, f32>) -> Result<Self, InvalidField> {
        let cameras: Vec<Camera> = scene.cameras.iter().map(reduced).collect();
        let rays = cameras.iter().map(|c| u64::from(c.width) * u64::from(c.height)).sum();
        let lattice = scene.lattice_for(rays);
        // Closest approaches do not matter.
        let small = Scene { cameras: &cameras, ..*scene }.with_lattice(lattice.as_ref(), 0.0);
        let map = |camera: usize| DepthMap::of(&small, camera);
        let maps = (0..cameras.len()).into_par_iter().map(map).collect::<Result<_, _>>()?;
        Ok(SeenOnly { shader: scene.shader, maps, behind: BEHIND * scene.bounds.radius })
    }

    fn is_seen(&self, x: Vec3, normal: Vec3) -> bool {
        self.maps.iter().any(|map| map.sees(x, normal, self.behind))
    }
}

/// The camera with at most [`SIZE`] pixels along its longer side.
fn reduced(camera: &Camera) -> Camera {
    let longer = camera.width.max(camera.height);
    let side = |pixels: u32| (pixels * SIZE.min(longer) / longer).max(1);
    camera.resized(side(camera.width), side(camera.height))
}

impl DepthMap {
    fn of(scene: &Scene<'_, f32>, camera: usize) -> Result<Self, InvalidField> {
        let own = scene.cameras[camera];
        let center = |i: u32| {
            let (x, y) = (f64::from(i % own.width), f64::from(i / own.width));
            Sample { camera, u: DVec2::new(x + 0.5, y + 0.5) }
        };
        let samples: Vec<Sample> = (0..own.width * own.height).map(center).collect();
        let distance = |traced: Option<render::TracedRay<f32>>| {
            traced.and_then(|traced| traced.depth()).unwrap_or(f32::INFINITY)
        };
        let distances = scene.trace(&samples)?.into_iter().map(distance).collect();
        Ok(DepthMap { camera: own, distances })
    }

    fn sees(&self, x: Vec3, normal: Vec3, behind: f64) -> bool {
        let away = x.as_dvec3() - self.camera.eye;
        if normal.as_dvec3().dot(away) >= 0.0 {
            return false;
        }
        let Some(u) = self.camera.project_onto_film(x.as_dvec3()) else { return false };
        let [width, height] = [self.camera.width, self.camera.height].map(i64::from);
        let (column, row) = (u.x as i64, u.y as i64);
        let furthest = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (column + dx, row + dy)));
        let furthest = furthest
            .filter(|(x, y)| (0..width).contains(x) && (0..height).contains(y))
            .map(|(x, y)| self.distances[(y * width + x) as usize])
            .fold(0.0, f32::max);
        away.length() <= f64::from(furthest) + behind
    }
}

impl Shader<f32> for SeenOnly<'_> {
    fn parameter_count(&self) -> usize {
        self.shader.parameter_count()
    }

    fn radiance(&self, points: &SurfaceBatch<'_, f32>, rgb: &mut [Vec3]) {
        self.shader.radiance(points, rgb);
        let surface = points.x.iter().zip(points.normal);
        rgb.iter_mut()
            .zip(surface)
            .filter(|(_, (x, normal))| !self.is_seen(**x, **normal))
            .for_each(|(rgb, _)| *rgb = GREY);
    }

    /// That of the other shader: grey points count as if they were seen.
    fn vjp(
        &self,
        points: &SurfaceBatch<'_, f32>,
        adjoint: &[Vec3],
        bars: &mut SurfaceAdjoint<f32>,
        parameters: &mut [f32],
    ) {
        self.shader.vjp(points, adjoint, bars, parameters);
    }
}

#[cfg(test)]
mod tests {
    use field::{Csg, Operation, Shape, Sphere, UniformBackground};
    use glam::DVec3;
    use render::{Analytic, Formula};

    use super::*;

    const BOUNDS: Sphere<f64> = Sphere { center: DVec3::ZERO, radius: 1.0 };

    /// A ball of radius 0.3, and a smaller one behind it for the camera on the x axis.
    #[test]
    fn what_the_camera_does_not_see_is_grey() {
        let ball = |x, radius| -> Box<dyn field::Field<f32>> {
            Box::new(Shape::sphere([x, 0.0, 0.0], radius))
        };
        let field = Csg::new(Operation::Union, vec![ball(0.4, 0.3), ball(-0.4, 0.2)]);
        let shader = Analytic { formula: Formula::Constant, parameters: vec![1.0, 0.5, 0.25] };
        let background = UniformBackground(Vec3::ZERO);
        let (focal, middle) = (DVec2::splat(600.0), DVec2::splat(200.0));
        let eye = DVec3::X * 4.0;
        let cameras =
            [Camera::look_at(400, 400, focal, middle, eye, DVec3::ZERO, DVec3::Z).unwrap()];
        let scene = Scene::new(&field, &shader, &cameras, &BOUNDS, &background);
        let seen = SeenOnly::of(&scene).unwrap();
        let shown = |center: f32, radius: f32, normal: Vec3| {
            let normal = normal.normalize();
            let (x, mut rgb) = (Vec3::X * center + normal * radius, [Vec3::ZERO]);
            let batch = SurfaceBatch { x: &[x], normal: &[normal], direction: &[-normal] };
            seen.radiance(&batch, &mut rgb);
            rgb[0]
        };
        let color = Vec3::new(1.0, 0.5, 0.25);
        // The outline is where the cosine to the axis is 0.3/3.6.
        for (normal, expected) in [
            (Vec3::X, color),
            (Vec3::new(0.2, 1.0, 0.0), color),
            (Vec3::new(0.2, -0.7, -0.7), color),
            (Vec3::new(-0.1, 1.0, 0.0), GREY),
            (Vec3::NEG_X, GREY),
        ] {
            assert_eq!(shown(0.4, 0.3, normal), expected, "{normal}");
        }
        for normal in [Vec3::X, Vec3::new(0.5, 0.5, 0.5), Vec3::Z] {
            assert_eq!(shown(-0.4, 0.2, normal), GREY, "{normal}, behind the other ball");
        }
    }
}
