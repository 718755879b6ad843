//! A small model for tests, with tables in the field, the head and the background.

use crate::photometry::BackgroundModel;
use field::{Shader, Sphere};
use glam::DVec3;
use random::Stream;
use sdf_nn::background::{Extent, Volume};
use sdf_nn::grids::{Degree, SplineSize};
use sdf_nn::{Activation, Architecture, Encoding, Network, RadianceHead, Transform};

use inspect::BackgroundEstimate;

/// The bounding sphere.
pub(crate) const BOUNDS: Sphere<f64> = Sphere { center: DVec3::ZERO, radius: 1.0 };

/// A signed distance network, a radiance head and a background.
#[derive(Clone)]
pub(crate) struct Model {
    pub(crate) field: Network<f32>,
    pub(crate) head: RadianceHead<f32>,
    pub(crate) background: Volume<f32>,
}

impl Model {
    /// A ball of this radius, with networks of two layers of this width.
    pub(crate) fn ball(radius: f64, width: usize, encoding: Encoding) -> Self {
        let transform = Transform { center: BOUNDS.center, radius: BOUNDS.radius };
        let architecture = Architecture {
            encoding,
            grid: SplineSize { levels: vec![6], features: 2, degree: Degree::Quadratic },
            hidden: vec![width; 2],
            skip: Vec::new(),
            activation: Activation::Softplus { beta: 20.0 },
        };
        let octaves = Encoding::Frequency { bands: 6 };
        let hidden = vec![64; 3];
        Model {
            field: Network::geometric(architecture, transform, radius, Stream::of_seed(0)),
            head: RadianceHead::new(
                octaves,
                &[4, 8],
                hidden,
                Activation::Relu,
                transform,
                Stream::of_seed(1),
            ),
            background: Volume::new(Extent::Volume, BOUNDS, Stream::of_seed(2)),
        }
    }

    /// The parameters of the field, the head and the background.
    pub(crate) fn parameters(&self) -> Vec<f32> {
        [self.field.parameters(), &self.head.parameters(), self.background.parameters()].concat()
    }

    /// Sets all parameters.
    pub(crate) fn set_parameters(&mut self, parameters: &[f32]) {
        let (field, others) = parameters.split_at(self.field.parameters().len());
        let (head, background) = others.split_at(self.head.parameter_count());
        self.field.set_parameters(field);
        self.head.set_parameters(head);
        self.background.set_parameters(background);
    }

    /// The place of the three biases of the head's last layer.
    pub(crate) fn last_bias(&self) -> usize {
        self.field.parameters().len() + self.head.table().start - 3
    }
}

/// The background of photographs in front of one colour, or of a room.
pub(crate) fn background_model(is_trained: bool) -> BackgroundModel {
    let estimate = BackgroundEstimate { color: [0.05, 0.1, 0.2], spread: 0.01, confidence: 1.0 };
    BackgroundModel { bounds: BOUNDS, estimates: vec![estimate], picture: None, is_trained }
}
