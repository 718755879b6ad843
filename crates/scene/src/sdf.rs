//! The `sdf` object of a scene file: the field to build, and the JSON pointer of each parameter.

#![warn(clippy::cast_possible_truncation)]

use std::path::{Path, PathBuf};

use field::{Clipped, Csg, Field, Kind, Operation, Shape, Sphere, may_reach};
use glam::DVec3;
use sdf_nn::{Network, Passes};

use field::Precision;
use files::InputError;
use files::json::Object;

type Result<T> = std::result::Result<T, InputError>;

/// The description of a field in a scene file.
#[derive(Clone, Debug, PartialEq)]
pub enum Sdf {
    /// An analytic shape with its parameters in one vector (see [`Kind::layout`]).
    Shape(Kind, Vec<f64>),
    /// A combination of children. The number is the width k of a smooth union in world units, and 0
    /// for the other operations.
    Csg(Operation, f64, Vec<Sdf>),
    /// A network.
    Neural {
        /// The model file.
        path: PathBuf,
        /// The bytes of the model file.
        bytes: Vec<u8>,
        /// Whether the solid may reach the ball of the network, and is clipped to it.
        clipped: bool,
    },
}

const TYPES: &str =
    "sphere, box, torus, capsule, plane, union, intersection, subtraction, smooth_union or neural";

impl Sdf {
    /// Reads the object. Relative paths of model files start at `folder`.
    pub(crate) fn read(object: Object<'_>, folder: &Path) -> Result<Self> {
        let combination =
            |operation, k| -> Result<Self> { Self::read_children(operation, k, &object, folder) };
        let sdf = match object.string("type")? {
            "union" => combination(Operation::Union, 0.0)?,
            "intersection" => combination(Operation::Intersection, 0.0)?,
            "subtraction" => combination(Operation::Subtraction, 0.0)?,
            "smooth_union" => combination(Operation::SmoothUnion, object.positive("k")?)?,
            "neural" => Self::read_network(&object, folder)?,
            shape => Self::read_shape(shape, &object)?,
        };
        object.finish()?;
        Ok(sdf)
    }

    /// Reads an analytic shape: its parameters in the order of [`Kind::layout`].
    fn read_shape(name: &str, object: &Object<'_>) -> Result<Self> {
        let (kind, parameters) = match name {
            "sphere" => (
                Kind::Sphere,
                [&object.numbers::<3>("center")?[..], &[object.positive("radius")?]].concat(),
            ),
            "box" => {
                let center = object.numbers::<3>("center")?;
                let half_size = object.numbers::<3>("half_size")?;
                if half_size.iter().any(|h| *h <= 0.0) {
                    return Err(object.error("half_size", "three numbers above 0"));
                }
                (Kind::Box, [center, half_size].concat())
            }
            "torus" => {
                let center = object.numbers::<3>("center")?;
                let axis = object.direction("axis")?.to_array();
                let radii = [object.positive("major")?, object.positive("minor")?];
                (Kind::Torus, [&center[..], &axis, &radii].concat())
            }
            "capsule" => {
                let (a, b) = (object.numbers::<3>("a")?, object.numbers::<3>("b")?);
                (Kind::Capsule, [&a[..], &b, &[object.positive("radius")?]].concat())
            }
            "plane" => {
                let normal = object.direction("normal")?.to_array();
                (Kind::Plane, [&normal[..], &[object.number("offset")?]].concat())
            }
            _ => return Err(object.error("type", TYPES)),
        };
        Ok(Sdf::Shape(kind, parameters))
    }

    fn read_children(
        operation: Operation,
        k: f64,
        object: &Object<'_>,
        folder: &Path,
    ) -> Result<Self> {
        let children = object.objects("children", true)?;
        let children: Result<Vec<_>> =
            children.into_iter().map(|child| Self::read(child, folder)).collect();
        Ok(Sdf::Csg(operation, k, children?))
    }

    /// Reads a model file and checks that it describes a signed distance.
    fn read_network(object: &Object<'_>, folder: &Path) -> Result<Self> {
        let path = folder.join(object.string("weights")?);
        let bytes = files::read(&path, "weights", "a model file")?;
        let network = network::<f64>(&path, &bytes)?;
        let clipped = network.bounds().is_some_and(|ball| may_reach(&network, &ball));
        Ok(Sdf::Neural { path, bytes, clipped })
    }

    /// Builds the field in single or double precision, for points relative to `origin`.
    ///
    /// # Errors
    /// If a model file cannot be used.
    pub(crate) fn build<R: Precision + Passes>(&self, origin: DVec3) -> Result<Box<dyn Field<R>>> {
        Ok(match self {
            Sdf::Shape(kind, parameters) => {
                Box::new(Shape::<R>::about(origin.to_array(), *kind, parameters))
            }
            Sdf::Csg(operation, k, children) => {
                let children: Result<Vec<_>> = children.iter().map(|c| c.build(origin)).collect();
                Box::new(match operation {
                    Operation::SmoothUnion => Csg::smooth_union(*k, children?),
                    _ => Csg::new(*operation, children?),
                })
            }
            Sdf::Neural { path, bytes, clipped } => {
                let network = network::<R>(path, bytes)?.about(origin);
                match network.bounds().filter(|_| *clipped) {
                    Some(ball) => Box::new(Clipped::new(network, ball)),
                    None => Box::new(network),
                }
            }
        })
    }

    /// The balls of all bounded shapes and networks in the tree, relative to `origin`.
    pub(crate) fn bounded_parts(&self, origin: DVec3) -> Result<Vec<Sphere<f64>>> {
        Ok(match self {
            Sdf::Csg(_, _, children) => {
                let parts: Result<Vec<_>> =
                    children.iter().map(|child| child.bounded_parts(origin)).collect();
                parts?.concat()
            }
            part => part.build::<f64>(origin)?.bounds().into_iter().collect(),
        })
    }

    /// The JSON pointer of every parameter, in the order of the field's parameter vector. A weight
    /// of a network has none.
    pub fn pointers(&self) -> Vec<Option<String>> {
        let mut out = Vec::new();
        self.collect_pointers("/sdf", &mut out);
        out
    }

    /// Appends the pointers of the object at the pointer `at`.
    fn collect_pointers(&self, at: &str, out: &mut Vec<Option<String>>) {
        match self {
            Sdf::Shape(kind, _) => {
                for (name, length) in kind.layout() {
                    match length {
                        1 => out.push(Some(format!("{at}/{name}"))),
                        _ => out.extend((0..*length).map(|i| Some(format!("{at}/{name}/{i}")))),
                    }
                }
            }
            Sdf::Csg(operation, _, children) => {
                for (i, child) in children.iter().enumerate() {
                    child.collect_pointers(&format!("{at}/children/{i}"), out);
                }
                if *operation == Operation::SmoothUnion {
                    out.push(Some(format!("{at}/k")));
                }
            }
            Sdf::Neural { path, bytes, .. } => {
                let count =
                    network::<f32>(path, bytes).map_or(0, |n| Field::<f32>::parameter_count(&n));
                out.extend((0..count).map(|_| None));
            }
        }
    }
}

/// Builds a network from the bytes of a model file; `path` is for error messages.
///
/// # Errors
/// If the bytes are not a model file of a signed distance.
pub fn network<R: Precision + Passes>(path: &Path, bytes: &[u8]) -> Result<Network<R>> {
    Network::from_safetensors(bytes)
        .map_err(|e| InputError::new(path, "weights", e, "a model file of a signed distance"))
}
