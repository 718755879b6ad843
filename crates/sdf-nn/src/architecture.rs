//! What a network looks like, apart from its numbers.

use glam::DVec3;

/// The nonlinearity after every hidden layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Activation {
    /// ln(1 + exp(β z))/β.
    Softplus {
        /// The sharpness, per unit of z.
        beta: f64,
    },
    /// sin(ω z).
    Sine {
        /// The frequency, radians per unit of z.
        omega: f64,
    },
    /// max(0, z): no curvature, so normals do not vary within a linear piece.
    Relu,
}

/// What the network sees of a position x of the unit ball.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// x itself.
    None,
    /// [x, sin(2⁰x), cos(2⁰x), …, sin(2ᵇ⁻¹x), cos(2ᵇ⁻¹x)], each over the three coordinates.
    Frequency {
        /// The number b of octaves.
        bands: usize,
    },
}

impl Encoding {
    /// The number b of octaves.
    pub fn bands(self) -> usize {
        match self {
            Encoding::None => 0,
            Encoding::Frequency { bands } => bands,
        }
    }

    /// The number of features.
    pub fn features(self) -> usize {
        3 + 6 * self.bands()
    }
}

/// The shape of a signed distance network.
#[derive(Clone, Debug, PartialEq)]
pub struct Architecture {
    /// What it sees of a position.
    pub encoding: Encoding,
    /// The widths of its hidden layers.
    pub hidden: Vec<usize>,
    /// Indices of layers whose input is [h, encoded x]/√2.
    pub skip: Vec<usize>,
    /// The nonlinearity.
    pub activation: Activation,
}

/// The map from world space to the unit ball: x ↦ (x − center)/radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// The ball's centre, in world units.
    pub center: DVec3,
    /// The ball's radius, in world units.
    pub radius: f64,
}

impl Default for Transform {
    fn default() -> Self {
        Transform { center: DVec3::ZERO, radius: 1.0 }
    }
}
