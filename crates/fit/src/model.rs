//! The model of a fit: a signed distance network and a radiance head.

use std::ops::Range;
use std::path::Path;

use files::{InputError, atomic_write};
use glam::DVec3;
use optim::Group;
use random::{Name, Stream};
use sdf_nn::{Activation, Architecture, Network, RadianceHead, Transform};

use crate::architecture::{encoding, is_fine, mlp_parameters, spline_size};
use crate::error::FitError;
use crate::model_background::ModelBackground;
use crate::run_file::RunFile;
use crate::run_folder::RunFolder;

/// A signed distance network, a network for the radiance on its surface, and a background.
#[derive(Clone, Debug)]
pub struct Model {
    /// The signed distance, in world units, negative inside.
    pub field: Network<f32>,
    /// The radiance, linear RGB.
    pub head: RadianceHead<f32>,
    /// The radiance along rays that miss.
    pub background: ModelBackground,
}

/// Width of the radiance head's hidden layers.
const HEAD_WIDTH: usize = 64;
/// Number of the radiance head's hidden layers.
const HEAD_LAYERS: usize = 3;
/// Octaves of the frequency encoding of the position in the radiance head.
pub(crate) const HEAD_BANDS: usize = 6;
/// Cells along the side of the grids of details in the radiance head, in front of a trained
/// background; see docs/captures-compared.md.
const DETAILS: [usize; 4] = [32, 64, 128, 256];

/// The grids of details of a run's radiance head. Octaves explain renders in front of a uniform background, and an iteration takes less time without grids.
fn details(file: &RunFile) -> &'static [usize] {
    if file.background_kind.is_trained() { &DETAILS } else { &[] }
}

/// The learning rate of a trained background, in units of that of the networks.
///
/// At 5, the background explained photographs from one side before the solid did, and the solid
/// lost: 14.5 dB on held-out views of a skull on a table after 4,000 iterations. At 2 and 1: 20.6
/// and 21.8 dB (second seed: 21.5 and 21.5 dB).
const BACKGROUND_RATE: f64 = 1.0;

/// The learning rate of the features of details, in units of that of the networks.
const DETAIL_RATE: f64 = 2.0;

/// The name of the group of the field's network without the matrices between hidden layers.
pub(crate) const NETWORK_GROUP: &str = "field";

/// The name of the group of these matrices.
pub(crate) const MATRICES_GROUP: &str = "field matrices";

/// The learning rate of matrices that take steps of Muon, in units of that of the others: those
/// between hidden layers of the field, and all of the radiance head but the last. docs/detail.md
/// compares them.
pub(crate) const MATRIX_RATE: f64 = 2.0;

/// The groups of the parameters of a network with these names, in their order: those of its matrices
/// have the second one.
fn of_network(
    [rest, matrix]: [&str; 2],
    network: Range<usize>,
    matrices: impl Iterator<Item = (Range<usize>, usize)>,
) -> Vec<Group> {
    let (mut groups, mut next) = (Vec::new(), network.start);
    for (place, columns) in matrices {
        groups.push(Group::new(rest, next..place.start));
        next = place.end;
        groups.push(Group { rate: MATRIX_RATE, ..Group::matrix(matrix, place, columns) });
    }
    groups.push(Group::new(rest, next..network.end));
    groups
}

/// The floor of the steps of coefficients of the field's grid. Without it, coefficients inside the
/// solid, whose gradients are next to nothing, made cavities that no photograph shows: `spot` after
/// 150 s on one thread had a Chamfer distance of 0.55 %, 0.32 % with a floor of 0.1, and 0.14 % and
/// no cavity with 1. With 3 at three times the rate: 0.15 %.
const GRID_FLOOR: f64 = 1.0;

const INITIAL_RADIANCE: Name = Name::new("first weights of the radiance head", 22);

impl Model {
    /// The model at the start of a fit: a sphere with a nearly uniform radiance.
    ///
    /// It is a function of the run's options, bounding sphere and background.
    pub fn initial(file: &RunFile) -> Self {
        let (options, bounds) = (&file.options, file.sphere());
        let transform = Transform { center: bounds.center, radius: bounds.radius };
        let architecture = Architecture {
            encoding: encoding(options.bands),
            grid: spline_size(&options.grid),
            hidden: vec![options.width; options.layers],
            skip: Vec::new(),
            activation: Activation::Softplus { beta: options.beta },
        };
        let stream = Stream::of_seed(options.seed);
        let mut field = Network::geometric(architecture, transform, options.initial_radius, stream);
        let levels = field.architecture().grid.levels.clone();
        // The largest first: the others then gather few coefficients.
        for (level, side) in levels.iter().enumerate().rev().filter(|(_, side)| is_fine(**side)) {
            field.set_free_nodes(level, &vec![false; side.pow(3)]);
        }
        let hidden = vec![HEAD_WIDTH; HEAD_LAYERS];
        let head = RadianceHead::new(
            encoding(HEAD_BANDS),
            details(file),
            hidden,
            Activation::Relu,
            transform,
            stream.named(INITIAL_RADIANCE),
        );
        Model { field, head, background: ModelBackground::initial(file) }
    }

    /// The levels of the field's grid whose nodes are free near the surface only.
    pub(crate) fn fine_levels(&self) -> impl Iterator<Item = usize> + '_ {
        let levels = &self.field.architecture().grid.levels;
        (0..levels.len()).filter(|level| is_fine(levels[*level]))
    }

    /// The number of nodes of these levels.
    pub(crate) fn fine_nodes(&self) -> usize {
        let levels = &self.field.architecture().grid.levels;
        levels.iter().filter(|side| is_fine(**side)).map(|side| side.pow(3)).sum()
    }

    /// Sets the free nodes of these levels: a flag for each node, level after level.
    ///
    /// # Panics
    /// If the number of flags is wrong.
    pub(crate) fn set_fine_nodes(&mut self, is_free: &[bool]) {
        let mut rest = is_free;
        for level in self.fine_levels().collect::<Vec<_>>() {
            let count = self.field.architecture().grid.levels[level].pow(3);
            let (own, others) = rest.split_at(count);
            self.field.set_free_nodes(level, own);
            rest = others;
        }
    }

    /// The number of parameters of a run's model with this number of free nodes of fine levels,
    /// without making one.
    pub(crate) fn parameter_count(file: &RunFile, free_nodes: usize) -> usize {
        let (features, tables) = RadianceHead::<f32>::size_of_details(details(file));
        let inputs = encoding(HEAD_BANDS).features() + RadianceHead::<f32>::DIRECTIONS + features;
        let head = mlp_parameters(inputs, HEAD_WIDTH, HEAD_LAYERS, 3) + tables as u64;
        let background = ModelBackground::parameter_count(file.background_kind);
        let free = free_nodes * spline_size(&file.options.grid).features;
        (file.options.field_parameters() + head) as usize + free + background
    }

    /// The matrices of the field's network that take steps of Muon: those between hidden layers.
    pub(crate) fn matrices_of_field(&self) -> impl Iterator<Item = (Range<usize>, usize)> + '_ {
        let between = self.field.architecture().hidden.len() - 1;
        self.field.matrices().skip(1).take(between)
    }

    /// The groups of the parameters, in their order.
    pub(crate) fn groups(&self) -> Vec<Group> {
        let field = self.field.parameters().len();
        let shape = field + self.head.parameter_count();
        let details = shape - self.head.detail_count();
        let all = shape + self.background.parameters().len();
        let network = 0..self.field.weight_count();
        let mut groups =
            of_network([NETWORK_GROUP, MATRICES_GROUP], network, self.matrices_of_field());
        let mut next = self.field.weight_count();
        for count in self.field.splines().free_counts() {
            let group = Group::new("grid", next..next + count);
            groups.push(Group { floor: GRID_FLOOR, ..group });
            next += count;
        }
        let of_head = self.head.matrices().take(HEAD_LAYERS);
        let of_head =
            of_head.map(|(place, columns)| (place.start + field..place.end + field, columns));
        groups.extend(of_network(["radiance", "radiance matrices"], field..details, of_head));
        groups.push(Group { rate: DETAIL_RATE, ..Group::new("details", details..shape) });
        groups.push(Group { rate: BACKGROUND_RATE, ..Group::new("background", shape..all) });
        groups
    }

    /// The parameters of the field, then those of the radiance head, then the trained ones of the
    /// background.
    pub fn parameters(&self) -> Vec<f32> {
        let background = self.background.parameters();
        [self.field.parameters(), &self.head.parameters(), background].concat()
    }

    /// Sets the parameters, in the order of [`parameters`](Self::parameters).
    ///
    /// # Panics
    /// If the number of parameters is wrong.
    pub fn set_parameters(&mut self, parameters: &[f32]) {
        let (field, others) = parameters.split_at(self.field.parameters().len());
        let (head, background) = others.split_at(self.head.parameter_count());
        let others = || {
            self.head.set_parameters(head);
            self.background.set_parameters(background);
        };
        rayon::join(|| self.field.set_parameters(field), others);
    }

    /// Writes `model.safetensors`, `radiance.safetensors` and, if the background is trained,
    /// `background.safetensors` into a run folder, in world units. The model is relative to
    /// `origin`.
    ///
    /// # Errors
    /// If a file cannot be written. A file that was there before then stays complete.
    pub(crate) fn save(&self, run: &RunFolder, origin: DVec3) -> Result<(), FitError> {
        let (field, head) = (self.field.file_about(-origin)?, self.head.file_about(-origin)?);
        atomic_write(&run.model(), |out| field.write(out))?;
        atomic_write(&run.radiance(), |out| head.write(out))?;
        self.background.save(run, origin)
    }

    /// Reads the model of a run folder, for points relative to the origin of the run. `file` is the
    /// run's `fit.toml`.
    ///
    /// # Errors
    /// If a file is missing or is not a model file.
    pub fn load(run: &Path, file: &RunFile) -> Result<Self, InputError> {
        let origin = file.origin();
        let folder = RunFolder::new(run);
        let read = |path: &Path| files::read(path, "model", "the model file of a run");
        let wrong = |path: &Path, e: sdf_nn::ModelError| {
            InputError::new(path, "weights", e, "a model file")
        };
        let path = folder.model();
        let field: Network<f32> =
            Network::from_safetensors(&read(&path)?).map_err(|e| wrong(&path, e))?;
        let path = folder.radiance();
        let head: RadianceHead<f32> =
            RadianceHead::from_safetensors(&read(&path)?).map_err(|e| wrong(&path, e))?;
        let background = ModelBackground::load(&folder, file)?;
        Ok(Model { field: field.about(origin), head: head.about(origin), background })
    }
}
