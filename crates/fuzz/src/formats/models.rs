//! Model files and other safetensors files.

use app::random::Stream;
use glam::DVec3;
use proptest::collection::vec;
use proptest::prelude::*;
use sdf_nn::{
    Activation, Architecture, Degree, Encoding, Network, RadianceHead, SplineSize, Transform,
};
use serde_json::{Value, json};

use crate::case::Case;
use crate::layout::Layout;
use crate::spoil::{self, Spoil, spoiled};
use crate::tree::Tree;

/// A safetensors file: the length of its header, the header, the data.
#[derive(Clone, Debug)]
pub(crate) struct Tensors {
    /// A wrong length of the header in place of the right one.
    length: Option<u64>,
    header: Tree,
    data: Vec<u8>,
}

impl Tensors {
    /// Takes a valid file apart.
    pub(crate) fn of(bytes: &[u8]) -> Self {
        let length = bytes.first_chunk().map_or(0, |n| u64::from_le_bytes(*n)) as usize;
        let text = bytes.get(8..8 + length).unwrap_or_default();
        let header = serde_json::from_slice(text).unwrap_or_else(|_| json!({}));
        let data = bytes.get(8 + length..).unwrap_or_default().to_vec();
        Tensors { length: None, header: header.into(), data }
    }

    /// The bytes of the file.
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let header = self.header.json();
        let length = self.length.unwrap_or(header.len() as u64);
        Layout::default().integer(length, 8).bytes(header).bytes(self.data.clone()).to_bytes()
    }

    /// Gives a tensor a shape without elements, with a first or a last dimension of `size`. The
    /// file stays valid as a container: the tensor's data are taken out.
    fn empty_tensor(&mut self, which: usize, size: u64, first: bool) {
        let Ok(mut header) = serde_json::from_slice::<Value>(&self.header.json()) else { return };
        let Some(map) = header.as_object_mut() else { return };
        let offset = |tensor: &Value, i: usize| tensor["data_offsets"][i].as_u64().unwrap_or(0);
        let mut tensors: Vec<&mut Value> = map
            .iter_mut()
            .filter(|(key, _)| *key != "__metadata__")
            .map(|(_, t)| t)
            .filter(|tensor| tensor["data_offsets"].is_array())
            .collect();
        tensors.sort_by_key(|tensor| offset(tensor, 0));
        let (count, mut data) = (tensors.len().max(1), Vec::new());
        for (i, tensor) in tensors.into_iter().enumerate() {
            let [start, end] = [offset(tensor, 0), offset(tensor, 1)].map(|n| n as usize);
            let begin = data.len();
            if i == which % count {
                tensor["shape"] = json!(if first { [size, 0] } else { [0, size] });
            } else {
                data.extend(self.data.get(start..end).unwrap_or_default());
            }
            tensor["data_offsets"] = json!([begin, data.len()]);
        }
        (self.header, self.data) = (header.into(), data);
    }
}

impl Spoil for Tensors {
    fn spoil(&mut self, place: usize, harm: usize) {
        match place % 16 {
            0 => self.length = Some(spoil::integer(self.header.json().len() as u64, harm)),
            1 => self.data = spoil::bytes(&self.data, harm),
            2 => {
                let size = [1 << 31, 1 << 60, u64::MAX, 100_000_000][harm % 4];
                self.empty_tensor(place / 16, size, (harm / 4).is_multiple_of(2));
            }
            3 => {
                let at = place / 16 % self.data.len().max(1) / 4 * 4;
                let harm = spoil::float(1.0, harm) as f32;
                if let Some(number) = self.data.get_mut(at..at + 4) {
                    number.copy_from_slice(&harm.to_le_bytes());
                }
            }
            _ => self.header.spoil(place / 16, harm),
        }
    }
}

/// The encoding, the hidden layers and the activation of a network.
fn architectures() -> impl Strategy<Value = Architecture> + Clone {
    let encodings = prop_oneof![
        Just(Encoding::None),
        (1..5usize).prop_map(|bands| Encoding::Frequency { bands })
    ];
    let activations = prop_oneof![
        Just(Activation::Softplus { beta: 100.0 }),
        Just(Activation::Sine { omega: 30.0 }),
        Just(Activation::Relu),
    ];
    let degrees = prop_oneof![Just(Degree::Quadratic), Just(Degree::Cubic)];
    let grids = (vec(4..7usize, 0..3), 1..4usize, degrees)
        .prop_map(|(levels, features, degree)| SplineSize { levels, features, degree });
    (encodings, grids, vec(1..9usize, 1..4), any::<bool>(), activations).prop_map(
        |(encoding, grid, hidden, skips, activation)| {
            let skip = if skips { vec![hidden.len()] } else { Vec::new() };
            Architecture { encoding, grid, hidden, skip, activation }
        },
    )
}

const UNIT: Transform = Transform { center: DVec3::ZERO, radius: 1.0 };

/// The model file of a signed distance.
pub(crate) fn fields() -> BoxedStrategy<Tensors> {
    (architectures(), 0..4u64)
        .prop_map(|(architecture, seed)| {
            let network = Network::<f32>::geometric(architecture, UNIT, 0.5, Stream::of_seed(seed));
            Tensors::of(&network.to_safetensors().unwrap_or_default())
        })
        .boxed()
}

/// The model file of a radiance head.
pub(crate) fn heads() -> BoxedStrategy<Tensors> {
    architectures()
        .prop_map(|Architecture { encoding, hidden, activation, .. }| {
            let head = RadianceHead::<f32>::new(
                encoding,
                &[2, 3],
                hidden,
                activation,
                UNIT,
                Stream::of_seed(1),
            );
            Tensors::of(&head.to_safetensors().unwrap_or_default())
        })
        .boxed()
}

/// The files `model.safetensors` and `radiance.safetensors`, one of them harmed.
pub(crate) fn model_files() -> BoxedStrategy<Case> {
    let pair = prop_oneof![(spoiled(fields()), heads()), (fields(), spoiled(heads()))];
    pair.prop_map(|(field, head)| {
        Case::default()
            .file("model.safetensors", field.to_bytes())
            .file("radiance.safetensors", head.to_bytes())
    })
    .boxed()
}
