//! Model files: safetensors files with the tensors `layers.{i}.weight` and `layers.{i}.bias`, and
//! the architecture in the metadata.

use std::collections::HashMap;

use crate::grids::{
    Degree, FEATURES, HashGrid, MOST_CELLS, MOST_COEFFICIENTS, MOST_FEATURES, MOST_LEVELS,
    SplineSize,
};
use glam::DVec3;
use safetensors::tensor::{Dtype, SafeTensors};

use crate::architecture::{Activation, Architecture, Encoding, Transform};
use crate::head::{DIRECTIONS, RadianceHead};
use crate::mlp::Mlp;
use crate::network::Network;
use crate::tensor_file::{Tensor, TensorFile, bytes, dtype_of, numbers};
use lanes::Lane;

/// An error of reading or writing a model file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// The data is not valid in the safetensors format.
    #[error("invalid safetensors data: {0}")]
    Container(String),
    /// A metadata entry is missing or has a wrong value.
    #[error("metadata entry \"{key}\" is {found:?}, expected {expected}")]
    Metadata {
        /// The key of the entry.
        key: &'static str,
        /// The value in the file; empty if the entry is missing.
        found: String,
        /// A description of valid values.
        expected: &'static str,
    },
    /// A tensor is missing, has a wrong shape or type, or has elements that are not finite.
    #[error("tensor \"{name}\" is {found}, expected {expected}")]
    Tensor {
        /// The tensor's name.
        name: String,
        /// A description of the tensor in the file.
        found: String,
        /// A description of a valid tensor.
        expected: String,
    },
}

type Result<T> = std::result::Result<T, ModelError>;

/// The metadata entries of a file.
struct Metadata(HashMap<String, String>);

impl Metadata {
    /// The value of an entry, without surrounding spaces.
    fn get(&self, key: &str) -> Option<&str> {
        self.0.get(key).map(|s| s.trim())
    }

    fn error(&self, key: &'static str, expected: &'static str) -> ModelError {
        ModelError::Metadata { key, found: self.get(key).unwrap_or("").to_owned(), expected }
    }

    /// A number above 0, or `default` if the entry is missing.
    fn positive(&self, key: &'static str, default: Option<f64>) -> Result<f64> {
        let number = self.get(key).map_or(default, |text| text.parse().ok());
        number
            .filter(|v| *v > 0.0 && v.is_finite())
            .ok_or_else(|| self.error(key, "a number above 0"))
    }

    /// Numbers separated by commas, with or without brackets. No numbers if the entry is missing.
    fn list<T: std::str::FromStr>(
        &self,
        key: &'static str,
        expected: &'static str,
    ) -> Result<Vec<T>> {
        let text = self.get(key).unwrap_or("").trim_start_matches('[').trim_end_matches(']').trim();
        if text.is_empty() {
            return Ok(Vec::new());
        }
        text.split(',').map(|n| n.trim().parse().map_err(|_| self.error(key, expected))).collect()
    }

    fn encoding(&self) -> Result<Encoding> {
        match self.get("encoding") {
            None | Some("none" | "") => Ok(Encoding::None),
            Some("frequency") => {
                let bands =
                    self.get("bands").and_then(|b| b.parse().ok()).filter(|b| (1..=16).contains(b));
                let bands =
                    bands.ok_or_else(|| self.error("bands", "a whole number from 1 to 16"))?;
                Ok(Encoding::Frequency { bands })
            }
            Some(_) => Err(self.error("encoding", "none or frequency")),
        }
    }

    fn activation(&self) -> Result<Activation> {
        match self.get("activation") {
            Some("softplus") => Ok(Activation::Softplus { beta: self.positive("beta", None)? }),
            Some("sine") => Ok(Activation::Sine { omega: self.positive("omega", None)? }),
            Some("relu") => Ok(Activation::Relu),
            _ => Err(self.error("activation", "softplus, sine or relu")),
        }
    }

    /// The numbers of cells of the grids of details.
    fn details(&self) -> Result<Vec<usize>> {
        let expected = "up to 8 numbers from 1 to 4096";
        let cells = self.list::<usize>("details", expected)?;
        let holds =
            cells.len() <= MOST_LEVELS && cells.iter().all(|c| (1..=MOST_CELLS).contains(c));
        if holds { Ok(cells) } else { Err(self.error("details", expected)) }
    }

    /// The size of a grid of splines; none if the entry is missing.
    fn grid(&self) -> Result<SplineSize> {
        let Some(text) = self.get("grid") else { return Ok(SplineSize::none()) };
        let expected = "{\"levels\": \"16,32\", \"features\": 2, \"degree\": 2}: up to 8 \
                        levels of 4 to 512 coefficients a side, 1 to 16 features, degree 2 or 3";
        let read = || {
            let entry: GridEntry = serde_json::from_str(text).ok()?;
            let levels: Option<Vec<usize>> =
                entry.levels.split(',').map(|n| n.trim().parse().ok()).collect();
            let degree = match entry.degree {
                2 => Degree::Quadratic,
                3 => Degree::Cubic,
                _ => return None,
            };
            let size = SplineSize { levels: levels?, features: entry.features, degree };
            let holds = size.levels.len() <= MOST_LEVELS
                && size.levels.iter().all(|n| (4..=MOST_COEFFICIENTS).contains(n))
                && (1..=MOST_FEATURES).contains(&size.features);
            holds.then_some(size)
        };
        read().ok_or_else(|| self.error("grid", expected))
    }

    fn transform(&self) -> Result<Transform> {
        let expected = "three finite numbers";
        let center = match *self.list::<f64>("center", expected)? {
            [] => DVec3::ZERO,
            [x, y, z] if x.is_finite() && y.is_finite() && z.is_finite() => DVec3::new(x, y, z),
            _ => return Err(self.error("center", expected)),
        };
        Ok(Transform { center, radius: self.positive("radius", Some(1.0))? })
    }

    fn from_parts(
        encoding: Encoding,
        activation: Activation,
        transform: &Transform,
        skip: &[usize],
    ) -> Self {
        let mut map = HashMap::new();
        let mut put = |key: &str, value: String| map.insert(key.to_owned(), value);
        put("dsdf.version", env!("CARGO_PKG_VERSION").to_owned());
        match encoding {
            Encoding::None => put("encoding", "none".to_owned()),
            Encoding::Frequency { bands } => {
                put("bands", bands.to_string());
                put("encoding", "frequency".to_owned())
            }
        };
        match activation {
            Activation::Softplus { beta } => {
                put("beta", beta.to_string());
                put("activation", "softplus".to_owned())
            }
            Activation::Sine { omega } => {
                put("omega", omega.to_string());
                put("activation", "sine".to_owned())
            }
            Activation::Relu => put("activation", "relu".to_owned()),
        };
        put("skip", format!("{skip:?}"));
        let c = transform.center;
        put("center", format!("[{}, {}, {}]", c.x, c.y, c.z));
        put("radius", transform.radius.to_string());
        Metadata(map)
    }
}

/// The metadata entry of a grid of splines, as JSON.
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct GridEntry {
    /// Coefficients along a side of each level, separated by commas.
    levels: String,
    /// Features of a level.
    features: usize,
    /// The degree of the splines.
    degree: usize,
}

impl GridEntry {
    fn text(size: &SplineSize) -> serde_json::Result<String> {
        let levels: Vec<String> = size.levels.iter().map(usize::to_string).collect();
        let (features, degree) = (size.features, size.degree.number());
        serde_json::to_string(&GridEntry { levels: levels.join(","), features, degree })
    }
}

/// An open file: its tensors and metadata.
struct Model<'a> {
    tensors: SafeTensors<'a>,
    metadata: Metadata,
}

impl<'a> Model<'a> {
    fn open(bytes: &'a [u8]) -> Result<Self> {
        let container = |e: safetensors::SafeTensorError| ModelError::Container(e.to_string());
        let tensors = SafeTensors::deserialize(bytes).map_err(container)?;
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(container)?;
        let metadata = Metadata(header.metadata().clone().unwrap_or_default());
        Ok(Model { tensors, metadata })
    }

    /// The shape and the elements of a tensor with `rank` dimensions.
    fn tensor(&self, name: &str, rank: usize) -> Result<(Vec<usize>, Vec<f64>)> {
        let error = |found: String, expected: &str| ModelError::Tensor {
            name: name.to_owned(),
            found,
            expected: expected.to_owned(),
        };
        let view =
            self.tensors.tensor(name).map_err(|_| error("missing".to_owned(), "a tensor"))?;
        if view.shape().len() != rank {
            return Err(error(
                format!("of shape {:?}", view.shape()),
                &format!("of {rank} dimensions"),
            ));
        }
        let numbers: Vec<f64> = match view.dtype() {
            Dtype::F32 => bytemuck::allocation::pod_collect_to_vec::<u8, f32>(view.data())
                .into_iter()
                .map(f64::from)
                .collect(),
            Dtype::F64 => bytemuck::allocation::pod_collect_to_vec(view.data()),
            other => return Err(error(format!("{other:?}"), "F32 or F64")),
        };
        match numbers.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(error(format!("{} at element {i}", numbers[i]), "finite numbers")),
            None => Ok((view.shape().to_vec(), numbers)),
        }
    }

    /// The widths of the hidden layers, from the shapes of the weights. The layers in `skip` have
    /// `features` more inputs than the layer below has outputs, as the first has without a layer
    /// below.
    ///
    /// Every shape is checked before it is used: with these widths, a network has as many
    /// parameters as the file has elements.
    fn hidden(&self, features: usize, skip: &[usize]) -> Result<Vec<usize>> {
        let mut widths: Vec<usize> = Vec::new();
        loop {
            let layer = widths.len();
            let name = format!("layers.{layer}.weight");
            if self.tensors.tensor(&name).is_err() {
                break;
            }
            let (shape, _) = self.tensor(&name, 2)?;
            let of_features = if layer == 0 || skip.contains(&layer) { features } else { 0 };
            let inputs = widths.last().unwrap_or(&0) + of_features;
            if shape[0] == 0 || shape[1] != inputs {
                let outputs = if shape[0] == 0 { "1 or more" } else { &shape[0].to_string() };
                let (found, expected) =
                    (format!("of shape {shape:?}"), format!("[{outputs}, {inputs}]"));
                return Err(ModelError::Tensor { name, found, expected });
            }
            widths.push(shape[0]);
        }
        let highest = self
            .tensors
            .names()
            .into_iter()
            .filter_map(|n| n.strip_prefix("layers.")?.split('.').next()?.parse::<usize>().ok())
            .max();
        if widths.is_empty() || highest.is_some_and(|h| h >= widths.len()) {
            self.tensor(&format!("layers.{}.weight", widths.len()), 2)?;
        }
        widths.pop();
        Ok(widths)
    }

    /// Reads a tensor of this shape into the start of a table.
    fn fill_table<R: Lane>(&self, name: &str, expected: &[usize], table: &mut [R]) -> Result<()> {
        let (shape, numbers) = self.tensor(name, expected.len())?;
        if shape != expected {
            let (found, expected) = (format!("of shape {shape:?}"), format!("{expected:?}"));
            return Err(ModelError::Tensor { name: name.to_owned(), found, expected });
        }
        table.iter_mut().zip(numbers).for_each(|(p, v)| *p = R::of(v));
        Ok(())
    }

    /// Reads the parameters of a perceptron and checks every shape.
    fn fill<R: Lane>(&self, mlp: &mut Mlp<R>) -> Result<()> {
        for (l, layer) in mlp.layers.clone().into_iter().enumerate() {
            let parts = [
                (format!("layers.{l}.weight"), vec![layer.outputs, layer.inputs], layer.start),
                (format!("layers.{l}.bias"), vec![layer.outputs], layer.bias()),
            ];
            for (name, expected, start) in parts {
                self.fill_table(&name, &expected, &mut mlp.parameters[start..])?;
            }
        }
        mlp.repack();
        Ok(())
    }
}

/// A file with a perceptron's tensors, in the perceptron's precision.
///
/// `tables` are further tensors, of one vector of features for each entry.
fn file_of<'a, R: Lane>(
    mlp: &Mlp<R>,
    tables: Vec<(String, Vec<usize>, &'a [R])>,
    metadata: Metadata,
) -> Result<TensorFile<'a>> {
    let dtype = dtype_of::<R>();
    let encode = |numbers: &mut dyn Iterator<Item = R>| {
        let numbers = numbers.map(R::to_double);
        let encoded: Vec<u8> = if dtype == Dtype::F32 {
            numbers.flat_map(|v| (v as f32).to_le_bytes()).collect()
        } else {
            numbers.flat_map(f64::to_le_bytes).collect()
        };
        bytes(encoded)
    };
    let mut tensors = Vec::new();
    for (l, layer) in mlp.layers.iter().enumerate() {
        let (n, window) = (layer.inputs, |c: usize| mlp.window_factor(l, c));
        let mut weights =
            (0..layer.outputs * n).map(|i| mlp.parameters[layer.start + i] * window(i % n));
        let (name, shape) = (format!("layers.{l}.weight"), vec![layer.outputs, n]);
        tensors.push(Tensor { name, dtype, shape, elements: encode(&mut weights) });
        let bias = &mlp.parameters[layer.bias()..layer.bias() + layer.outputs];
        let (name, shape) = (format!("layers.{l}.bias"), vec![layer.outputs]);
        tensors.push(Tensor { name, dtype, shape, elements: encode(&mut bias.iter().copied()) });
    }
    let of_table = |(name, shape, table)| Tensor { name, dtype, shape, elements: numbers(table) };
    tensors.extend(tables.into_iter().map(of_table));
    TensorFile::new(tensors, metadata.0).map_err(|e| ModelError::Container(e.to_string()))
}

impl<R: Lane> Network<R> {
    /// Reads a network from the bytes of a model file.
    ///
    /// # Errors
    /// If `bytes` is no safetensors file, or its metadata and tensors do not describe a signed
    /// distance network.
    pub fn from_safetensors(bytes: &[u8]) -> Result<Self> {
        let model = Model::open(bytes)?;
        let metadata = &model.metadata;
        let (encoding, skip) = (metadata.encoding()?, metadata.list("skip", "indices of layers")?);
        let grid = metadata.grid()?;
        let architecture = Architecture {
            encoding,
            hidden: model.hidden(encoding.features() + grid.feature_count(), &skip)?,
            grid,
            skip,
            activation: metadata.activation()?,
        };
        if architecture.skip.iter().any(|&s| s == 0 || s > architecture.hidden.len()) {
            return Err(metadata.error("skip", "indices of layers after the first"));
        }
        let scale = metadata.positive("scale", Some(1.0))?;
        let mut network = Network::zero(architecture, metadata.transform()?, scale);
        model.fill(&mut network.mlp)?;
        let size = network.architecture.grid.clone();
        for (l, (side, range)) in size.levels.iter().zip(size.ranges()).enumerate() {
            let shape = vec![*side, *side, *side, size.features];
            model.fill_table(&format!("grid.{l}"), &shape, &mut network.table[range])?;
        }
        network.gather_parameters();
        Ok(network)
    }

    /// The bytes of a model file, in the network's precision. Octave weights are multiplied into
    /// the tensors.
    ///
    /// # Errors
    /// If the safetensors header cannot be made.
    pub fn to_safetensors(&self) -> Result<Vec<u8>> {
        Ok(self.file_about(DVec3::ZERO)?.to_bytes())
    }

    /// The model file of the same network for points relative to `origin`, a point in world units.
    ///
    /// # Errors
    /// If the safetensors header cannot be made.
    pub fn file_about(&self, origin: DVec3) -> Result<TensorFile<'_>> {
        let a = &self.architecture;
        let transform = self.transform.about(origin);
        let mut metadata = Metadata::from_parts(a.encoding, a.activation, &transform, &a.skip);
        metadata.0.insert("scale".to_owned(), self.scale.to_string());
        let size = &a.grid;
        if size.feature_count() > 0 {
            let text = GridEntry::text(size).map_err(|e| ModelError::Container(e.to_string()))?;
            metadata.0.insert("grid".to_owned(), text);
        }
        let of_level = |(l, (side, range)): (usize, (&usize, std::ops::Range<usize>))| {
            let shape = vec![*side, *side, *side, size.features];
            (format!("grid.{l}"), shape, &self.table[range])
        };
        let tables = size.levels.iter().zip(size.ranges()).enumerate().map(of_level).collect();
        file_of(&self.mlp, tables, metadata)
    }
}

/// The metadata entry `inputs` of a radiance head; a signed distance network has none.
const HEAD_INPUTS: &str = "position normal direction";
/// The metadata entry `output` of a radiance head: the map from outputs to radiance.
const HEAD_OUTPUT: &str = "sigmoid_squared";

/// The name of the tensor with the features of a level of details.
fn table_name(level: usize) -> String {
    format!("details.{level}")
}

impl<R: Lane> RadianceHead<R> {
    /// Reads a radiance head from the bytes of its file.
    ///
    /// # Errors
    /// If `bytes` is no safetensors file, or its metadata and tensors do not describe a radiance
    /// head.
    pub fn from_safetensors(bytes: &[u8]) -> Result<Self> {
        let model = Model::open(bytes)?;
        let metadata = &model.metadata;
        if metadata.get("inputs") != Some(HEAD_INPUTS) {
            return Err(metadata.error("inputs", HEAD_INPUTS));
        }
        if metadata.get("output") != Some(HEAD_OUTPUT) {
            return Err(metadata.error("output", HEAD_OUTPUT));
        }
        let encoding = metadata.encoding()?;
        let cells = metadata.details()?;
        let details = HashGrid::new(&cells);
        let hidden = model.hidden(encoding.features() + DIRECTIONS + details.features(), &[])?;
        let (activation, transform) = (metadata.activation()?, metadata.transform()?);
        let mut head = RadianceHead::zero(encoding, &cells, &hidden, activation, transform);
        model.fill(&mut head.mlp)?;
        for (l, range) in details.ranges().enumerate() {
            let shape = [range.len() / FEATURES, FEATURES];
            model.fill_table(&table_name(l), &shape, &mut head.tables[range])?;
        }
        Ok(head)
    }

    /// The bytes of a radiance head's file, in its precision. Octave weights are multiplied into
    /// the tensors.
    ///
    /// # Errors
    /// If the safetensors header cannot be made.
    pub fn to_safetensors(&self) -> Result<Vec<u8>> {
        Ok(self.file_about(DVec3::ZERO)?.to_bytes())
    }

    /// The file of the same head for points relative to `origin`, a point in world units.
    ///
    /// # Errors
    /// If the safetensors header cannot be made.
    pub fn file_about(&self, origin: DVec3) -> Result<TensorFile<'_>> {
        let transform = self.transform.about(origin);
        let mut metadata =
            Metadata::from_parts(self.encoding, self.mlp.activation, &transform, &[]);
        metadata.0.insert("inputs".to_owned(), HEAD_INPUTS.to_owned());
        metadata.0.insert("output".to_owned(), HEAD_OUTPUT.to_owned());
        let mut tables = Vec::new();
        if self.details.features() > 0 {
            let cells: Vec<String> = self.details.cells().map(|cells| cells.to_string()).collect();
            metadata.0.insert("details".to_owned(), cells.join(","));
            let of_level = |(l, range): (usize, std::ops::Range<usize>)| {
                let shape = vec![range.len() / FEATURES, FEATURES];
                (table_name(l), shape, &self.tables[range])
            };
            tables.extend(self.details.ranges().enumerate().map(of_level));
        }
        file_of(&self.mlp, tables, metadata)
    }
}
