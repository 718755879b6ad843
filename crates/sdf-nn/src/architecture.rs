//! The description of a network without its parameters.

use crate::grids::SplineSize;
use glam::DVec3;

/// The nonlinearity σ(z) of every hidden layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Activation {
    /// ln(1 + exp(β z))/β: a smooth ReLU.
    Softplus {
        /// The sharpness β, per unit of z.
        beta: f64,
    },
    /// sin(ω z), as in Sitzmann et al., “Implicit Neural Representations with Periodic Activation
    /// Functions”, NeurIPS 2020.
    Sine {
        /// The frequency ω, in radians per unit of z.
        omega: f64,
    },
    /// max(0, z). The network is linear in pieces: its curvature is zero, and normals are constant
    /// in each piece.
    Relu,
}

/// The features of a position x in the unit ball, the input of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// x itself.
    None,
    /// [x, sin(2⁰x), cos(2⁰x), …, sin(2ᵇ⁻¹x), cos(2ᵇ⁻¹x)], each for the three coordinates.
    ///
    /// This is the positional encoding of Mildenhall et al., “NeRF: Representing Scenes as Neural
    /// Radiance Fields for View Synthesis”, ECCV 2020, section 5.1, equation 4, without its factor
    /// π and with x itself.
    Frequency {
        /// The number b of octaves.
        bands: usize,
    },
}

impl Encoding {
    /// The number b of octaves; 0 without waves.
    pub fn bands(self) -> usize {
        match self {
            Encoding::None => 0,
            Encoding::Frequency { bands } => bands,
        }
    }

    /// The number of features: 3 + 6 b.
    pub fn features(self) -> usize {
        3 + 6 * self.bands()
    }
}

/// The architecture of a signed distance network.
#[derive(Clone, Debug, PartialEq)]
pub struct Architecture {
    /// The features of a position.
    pub encoding: Encoding,
    /// Splines over the cube around the unit ball: further features of a position.
    pub grid: SplineSize,
    /// The widths of the hidden layers, from input to output.
    pub hidden: Vec<usize>,
    /// Indices of layers with a skip connection, from 1 to the number of hidden layers: their input
    /// is [h, features]/√2, with h the outputs of the layer below.
    pub skip: Vec<usize>,
    /// The nonlinearity of the hidden layers.
    pub activation: Activation,
}

impl Architecture {
    /// The number of features: those of the encoding, then those of the grid.
    pub fn features(&self) -> usize {
        self.encoding.features() + self.grid.feature_count()
    }
}

/// The map from world space to the unit ball: x ↦ (x − center)/radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// The ball's centre, in world units.
    pub center: DVec3,
    /// The ball's radius, in world units.
    pub radius: f64,
}

impl Transform {
    /// The same map for points relative to `origin`, a point in world units.
    #[must_use]
    pub fn about(self, origin: DVec3) -> Self {
        Transform { center: self.center - origin, ..self }
    }
}

impl Default for Transform {
    /// The unit ball about the origin.
    fn default() -> Self {
        Transform { center: DVec3::ZERO, radius: 1.0 }
    }
}
