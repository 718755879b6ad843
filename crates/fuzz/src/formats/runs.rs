//! Run folders: `fit.toml`, the checkpoint, the model files, `metrics.jsonl`.

use std::collections::HashMap;

use fit::{
    BackgroundKind, ExposureModel, FitOptions, MaskUse, Model, ModelBackground, RunFile, Split,
};
use proptest::prelude::*;
use safetensors::Dtype;
use safetensors::tensor::TensorView;
use sdf_nn::grids::GridLevels;
use serde_json::{Value, json};

use crate::case::Case;
use crate::formats::datasets::small_dataset;
use crate::formats::models::Tensors;
use crate::spoil::{Spoil, spoiled};
use crate::tree::Tree;

/// The finished iterations of every run.
const ITERATIONS: u64 = 3;

/// The files of a run folder.
#[derive(Clone, Debug)]
struct Run {
    options: Tree,
    state: Tensors,
    field: Tensors,
    head: Tensors,
    metrics: Vec<Tree>,
}

/// The content of `fit.toml` for a small network, with the data set in the folder `data`.
pub(crate) fn run_file(width: usize, layers: usize, bands: usize) -> RunFile {
    let options = FitOptions {
        iterations: Some(ITERATIONS),
        downscale: Some(1),
        width,
        layers,
        bands,
        batch: 16,
        grid: GridLevels(vec![4, 6]),
        ..FitOptions::default()
    };
    RunFile {
        dataset: "data".into(),
        bounds: [0.0, 0.0, 0.0, 1.0],
        masks: MaskUse::None,
        background_kind: BackgroundKind::Constant,
        background: [0.0; 3],
        background_spread: 0.05,
        background_confidence: 0.5,
        exposure_model: ExposureModel::Even,
        sphere_growths: 0,
        views: Some(Split {
            train: vec!["images/001.png".to_owned(), "images/002.png".to_owned()],
            held_out: vec!["images/000.png".to_owned()],
            poses: None,
        }),
        options,
    }
}

/// The content of `fit.toml` for a small network before a volume.
pub(crate) fn room_file() -> RunFile {
    RunFile { background_kind: BackgroundKind::Volume, ..run_file(1, 1, 0) }
}

/// The model files of a run before a volume, of which that of the background is harmed.
pub(crate) fn background_files() -> BoxedStrategy<Case> {
    let model = Model::initial(&room_file());
    let field = model.field.to_safetensors().unwrap_or_default();
    let head = model.head.to_safetensors().unwrap_or_default();
    let background = match &model.background {
        ModelBackground::Trained(volume) => volume.to_safetensors().unwrap_or_default(),
        ModelBackground::Constant(_) | ModelBackground::Picture(_) => Vec::new(),
    };
    spoiled(Just(Tensors::of(&background)))
        .prop_map(move |background| {
            Case::default()
                .file("model.safetensors", field.clone())
                .file("radiance.safetensors", head.clone())
                .file("background.safetensors", background.to_bytes())
        })
        .boxed()
}

impl Run {
    fn new(width: usize, layers: usize, bands: usize) -> Self {
        let file = run_file(width, layers, bands);
        let model = Model::initial(&file);
        let text = toml::to_string(&file).unwrap_or_default();
        let options: Value = toml::from_str(&text).unwrap_or_default();
        Run {
            options: options.into(),
            state: state(&model.parameters()),
            field: Tensors::of(&model.field.to_safetensors().unwrap_or_default()),
            head: Tensors::of(&model.head.to_safetensors().unwrap_or_default()),
            metrics: (1..=ITERATIONS).map(metrics).collect(),
        }
    }

    fn to_case(&self) -> Case {
        let lines = self.metrics.iter().flat_map(|line| [line.json(), b"\n".to_vec()].concat());
        Case::default()
            .file("fit.toml", self.options.toml())
            .file("checkpoint/state.safetensors", self.state.to_bytes())
            .file("model.safetensors", self.field.to_bytes())
            .file("radiance.safetensors", self.head.to_bytes())
            .file("metrics.jsonl", lines.collect::<Vec<u8>>())
    }
}

impl Spoil for Run {
    fn spoil(&mut self, place: usize, harm: usize) {
        match place % 8 {
            0..3 => self.options.spoil(place / 8, harm),
            3 | 4 => self.state.spoil(place / 8, harm),
            5 => self.field.spoil(place / 8, harm),
            6 => self.head.spoil(place / 8, harm),
            _ => {
                let line = place / 8 % self.metrics.len();
                self.metrics[line].spoil(place / 64, harm);
            }
        }
    }
}

/// The checkpoint after some iterations.
fn state(parameters: &[f32]) -> Tensors {
    let bytes: Vec<u8> = parameters.iter().flat_map(|p| p.to_le_bytes()).collect();
    let zeros = vec![0; bytes.len()];
    let view = |data| TensorView::new(Dtype::F32, vec![parameters.len()], data);
    let views = [("parameters", &bytes), ("first", &zeros), ("second", &zeros)];
    let views = views.into_iter().filter_map(|(name, data)| Some((name, view(data).ok()?)));
    let texts = [
        ("iteration", "3"),
        ("steps", "3"),
        ("seconds", "0.25"),
        ("searching", "0.1"),
        ("usual_norm", "0.5"),
        ("cameras", "given"),
    ];
    let texts: HashMap<String, String> =
        texts.map(|(key, value)| (key.to_owned(), value.to_owned())).into();
    Tensors::of(&safetensors::serialize(views, Some(texts)).unwrap_or_default())
}

/// A line of `metrics.jsonl`.
fn metrics(iteration: u64) -> Tree {
    let evaluations = json!({"value": 9, "gradient": 9, "hessian_vector": 0, "parameter": 9});
    json!({"iteration": iteration, "seconds": 0.08 * iteration as f64, "progress": 0.3,
           "loss": 0.1, "eikonal": 0.01, "train_psnr": 12.5, "psnr": null,
           "evaluations": evaluations, "rays_per_second": 1e4, "edge_fraction": 0.2, "level": 0,
           "gradient_norm": 0.3})
    .into()
}

fn runs() -> BoxedStrategy<Case> {
    let bases = (1..9usize, 1..4usize, 0..4usize).prop_map(|(w, l, b)| Run::new(w, l, b));
    spoiled(bases).prop_map(|run| run.to_case()).boxed()
}

/// A run folder `run`, and its data set in the folder `data`.
pub(crate) fn run_folders() -> BoxedStrategy<Case> {
    let folder = |run: Case| Case::default().case("run", run).case("data", small_dataset());
    runs().prop_map(folder).boxed()
}
