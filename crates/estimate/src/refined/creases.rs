//! Creases on lines of the film: curves on the surface across which the normal jumps, and so the
//! radiance.

use field::{Real, Vector3};
use render::Scene;

use super::face_change::FaceChange;
use super::line_places::FaceHit;
use crate::record::{FilmLine, Record};

/// Creases between faces whose normals have a smaller sine than this between them are left out: the
/// jump of the radiance is as small.
const LEAST_SINE: f64 = 1e-4;

/// The rounding of a depth, in units in the last place.
const ROUNDING: f64 = 64.0;

/// Depths at both ends of a change belong to faces that meet if they differ by at most this many
/// times the difference of their tangent planes.
const MEETING: f64 = 2.0;

/// Whether two faces meet where the visible surface goes from one to the other. If not, the place
/// is on a silhouette.
///
/// The depth of a face changes along the film by t (∇f·∂d/∂u)/(∇f·d) per pixel. Faces that meet
/// inside the change differ in depth by no more than both do over its width.
pub(super) fn is_crease<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    change: &FaceChange<R>,
) -> bool {
    let line = &lines[change.line];
    let sample = line.at(change.middle());
    let (d, du) = scene.cameras[line.camera].direction_du(sample.u);
    let (d, du) = (R::Vec3::of(d), R::Vec3::of(du[line.axis]));
    let [(from, a), (to, b)] = change.ends;
    let rate = |hit: &FaceHit<R>| {
        let along = hit.gradient.dot(d).abs().max(R::min_positive_value());
        hit.t * hit.gradient.dot(du).abs() / along
    };
    let rounding = a.t * R::epsilon() * R::of(ROUNDING);
    let most = (rate(&a) + rate(&b)) * R::of((to - from) * MEETING) + rounding;
    (a.t - b.t).abs() <= most
}

/// The projection of a crease onto the film.
pub(super) struct Projection<R> {
    /// ∇f·d of both faces.
    along: [R; 2],
    /// (∇f₁·x_s)(∇f₂·d) − (∇f₁·d)(∇f₂·x_s) along both axes of the film: a normal of the curve.
    pub(super) determinant: [R; 2],
}

/// Projects the crease between the two faces of a change.
pub(super) fn project<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    change: &FaceChange<R>,
) -> Projection<R> {
    let line = &lines[change.line];
    let [a, b] = change.ends.map(|(_, hit)| hit);
    let sample = line.at(change.middle());
    let (d, du) = scene.cameras[line.camera].direction_du(sample.u);
    let d = R::Vec3::of(d);
    let along = [a.gradient.dot(d), b.gradient.dot(d)];
    let determinant = du.map(|du| {
        let x = R::Vec3::of(du) * a.t;
        a.gradient.dot(x) * along[1] - along[0] * b.gradient.dot(x)
    });
    Projection { along, determinant }
}

/// Adds a crease to the record.
///
/// A crease is the curve {f₁ = f₂ = 0} of two faces. With x(s, t) on the rays of a line, the two
/// equations give its motion along the line:
/// ∂s/∂θ = −(∂_θf₁ (∇f₂·d) − ∂_θf₂ (∇f₁·d))/D with D = (∇f₁·x_s)(∇f₂·d) − (∇f₁·d)(∇f₂·x_s).
/// The normal of the projected crease is proportional to (D_x, D_y), so the weights n_x² and n_y²
/// of the two axes leave D_axis/(D_x² + D_y²).
pub(super) fn add_crease<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    change: &FaceChange<R>,
    record: &mut Record<R>,
) {
    let line = &lines[change.line];
    let [a, b] = change.ends.map(|(_, hit)| hit);
    let sine = a.gradient.cross(b.gradient).length()
        / (a.gradient.length() * b.gradient.length()).max(R::min_positive_value());
    if sine < R::of(LEAST_SINE) {
        return;
    }
    let Projection { along: [along_a, along_b], determinant } = project(scene, lines, change);
    let square = determinant[0] * determinant[0] + determinant[1] * determinant[1];
    if square <= R::min_positive_value() {
        return;
    }
    let rgb = (a.radiance - b.radiance) * (determinant[line.axis] / square * R::of(line.weight));
    record.silhouettes.push(line.pixel, a.x, rgb * along_b);
    record.silhouettes.push(line.pixel, b.x, -(rgb * along_a));
}
