//! The `sdf` part of a scene: which field to build, and which JSON pointer each parameter has.

use std::path::{Path, PathBuf};

use field::{Csg, Field, Kind, Operation, Shape};
use sdf_nn::Network;

use io::InputError;
use io::json::Object;
use render::Precision;

/// A field as a scene file describes it.
#[derive(Clone, Debug, PartialEq)]
pub enum Sdf {
    /// An analytic shape with its flat parameters (see [`Kind::layout`]).
    Shape(Kind, Vec<f64>),
    /// A combination of children; the number is a smooth union's k.
    Csg(Operation, f64, Vec<Sdf>),
    /// A network, from the bytes of its model file.
    Neural {
        /// The model file.
        path: PathBuf,
        /// Its content.
        bytes: Vec<u8>,
    },
}

type Result<T> = std::result::Result<T, InputError>;

const TYPES: &str =
    "sphere, box, torus, capsule, plane, union, intersection, subtraction, smooth_union or neural";

impl Sdf {
    /// Reads the object; relative paths of model files start at `folder`.
    pub(crate) fn read(object: Object<'_>, folder: &Path) -> Result<Self> {
        let sdf = match object.string("type")? {
            "sphere" => Sdf::Shape(
                Kind::Sphere,
                join([&object.numbers::<3>("center")?, &[object.positive("radius")?]]),
            ),
            "box" => {
                let (center, half_size) =
                    (object.numbers::<3>("center")?, object.numbers::<3>("half_size")?);
                if half_size.iter().any(|h| *h <= 0.0) {
                    return Err(object.error("half_size", "three numbers above 0"));
                }
                Sdf::Shape(Kind::Box, join([&center, &half_size]))
            }
            "torus" => {
                let (center, axis) =
                    (object.numbers::<3>("center")?, object.direction("axis")?.to_array());
                let radii = [object.positive("major")?, object.positive("minor")?];
                Sdf::Shape(Kind::Torus, [&center[..], &axis, &radii].concat())
            }
            "capsule" => {
                let (a, b) = (object.numbers::<3>("a")?, object.numbers::<3>("b")?);
                Sdf::Shape(Kind::Capsule, [&a[..], &b, &[object.positive("radius")?]].concat())
            }
            "plane" => {
                let normal = object.direction("normal")?.to_array();
                Sdf::Shape(Kind::Plane, join([&normal, &[object.number("offset")?]]))
            }
            "union" => Self::children(Operation::Union, 0.0, &object, folder)?,
            "intersection" => Self::children(Operation::Intersection, 0.0, &object, folder)?,
            "subtraction" => Self::children(Operation::Subtraction, 0.0, &object, folder)?,
            "smooth_union" => {
                Self::children(Operation::SmoothUnion, object.positive("k")?, &object, folder)?
            }
            "neural" => {
                let path = folder.join(object.string("weights")?);
                let bytes = std::fs::read(&path)
                    .map_err(|e| InputError::new(&path, "weights", e, "a model file"))?;
                check_model(&path, &bytes)?;
                Sdf::Neural { path, bytes }
            }
            _ => return Err(object.error("type", TYPES)),
        };
        object.finish()?;
        Ok(sdf)
    }

    fn children(operation: Operation, k: f64, object: &Object<'_>, folder: &Path) -> Result<Self> {
        let children = object.objects("children", true)?;
        let children: Result<Vec<_>> =
            children.into_iter().map(|child| Self::read(child, folder)).collect();
        Ok(Sdf::Csg(operation, k, children?))
    }

    /// Builds the field in a precision.
    ///
    /// # Errors
    /// If a model file cannot be used.
    pub fn build<R: Precision>(&self) -> Result<Box<dyn Field<R>>> {
        Ok(match self {
            Sdf::Shape(kind, parameters) => Box::new(Shape::<R>::new(*kind, parameters)),
            Sdf::Csg(operation, k, children) => {
                let children: Result<Vec<_>> = children.iter().map(Sdf::build).collect();
                Box::new(match operation {
                    Operation::SmoothUnion => Csg::smooth_union(*k, children?),
                    _ => Csg::new(*operation, children?),
                })
            }
            Sdf::Neural { path, bytes } => Box::new(network::<R>(path, bytes)?),
        })
    }

    /// The JSON pointer of every parameter in the order of the field's flat vector; `None` for a
    /// network's weights.
    pub fn pointers(&self) -> Vec<Option<String>> {
        let mut out = Vec::new();
        self.collect_pointers("/sdf", &mut out);
        out
    }

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
            Sdf::Neural { path, bytes } => {
                let count =
                    network::<f32>(path, bytes).map_or(0, |n| Field::<f32>::parameter_count(&n));
                out.extend((0..count).map(|_| None));
            }
        }
    }
}

/// A network from a model file's bytes.
pub fn network<R: Precision>(path: &Path, bytes: &[u8]) -> Result<Network<R>> {
    Network::from_safetensors(bytes)
        .map_err(|e| InputError::new(path, "weights", e, "a model file of a signed distance"))
}

fn check_model(path: &Path, bytes: &[u8]) -> Result<()> {
    network::<f32>(path, bytes).map(|_| ())
}

fn join<const A: usize>(parts: [&[f64]; A]) -> Vec<f64> {
    parts.concat()
}
