//! The discontinuities of the radiance on the film, whose motion is a term of a derivative.

use field::Real;
use render::Scene;

use crate::crossing::has_visible_creases;

/// A kind of curve on the film across which the radiance jumps.
///
/// Its motion is a term of a pixel's derivative: the integral of jump times normal velocity along
/// the curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Discontinuity {
    /// Curves where rays touch a surface.
    Silhouettes,
    /// Curves on a surface across which its normal jumps, and with it the radiance.
    Creases,
    /// The edges of shadows on a surface.
    ShadowEdges,
}

impl Discontinuity {
    /// The kinds that a scene can have, without those in `modelled`.
    pub fn of_scene_except<R: Real>(scene: &Scene<'_, R>, modelled: &[Self]) -> Vec<Self> {
        let kinds = [
            (Self::Silhouettes, true),
            (Self::Creases, has_visible_creases(scene)),
            (Self::ShadowEdges, scene.shader.has_shadow_edges()),
        ];
        let left_out = |(kind, possible): &(Self, bool)| *possible && !modelled.contains(kind);
        kinds.into_iter().filter(left_out).map(|(kind, _)| kind).collect()
    }

    /// The English name, in lower case.
    pub fn name(self) -> &'static str {
        match self {
            Self::Silhouettes => "silhouettes",
            Self::Creases => "creases",
            Self::ShadowEdges => "shadow edges",
        }
    }
}

#[cfg(test)]
#[path = "discontinuity_tests.rs"]
mod tests;
