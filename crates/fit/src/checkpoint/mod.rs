//! The state of a fit between two iterations, in one safetensors file.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;

use files::{InputError, atomic_write};
use safetensors::{Dtype, SafeTensors};
use sdf_nn::tensor_file::{Tensor, TensorFile, bytes, numbers};

use crate::camera_corrections::Corrections;
use crate::clock::Clock;
use crate::error::FitError;

/// The state of a fit between two iterations. Random numbers are functions of the seed and the
/// iteration, so there is no random generator in it.
///
/// A state that is saved borrows the vectors of the fit: copies would take as much memory as the
/// fit itself.
#[derive(Clone, Debug, PartialEq)]
pub struct State<'a> {
    /// The clock of the fit.
    pub clock: Clock,
    /// The parameters and their optimiser.
    pub optimiser: OptimiserState<'a>,
    /// The PSNR of the last preview of a held-out view, in dB; `None` before the first.
    pub held_out_psnr: Option<f64>,
    /// The corrections of the cameras: the parameters of their calibration.
    pub corrections: Corrections<Optimised>,
    /// The exposures of the photographs, if they are fitted.
    pub exposures: Option<Optimised>,
    /// The last survey of the surface, if there was one.
    pub survey: Option<Cow<'a, Survey>>,
    /// The last values of the field on a lattice, if there are some.
    pub lattice: Option<Cow<'a, LatticeState>>,
}

/// The state of the optimiser of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct OptimiserState<'a> {
    /// The parameters of the field, then those of the radiance head, then the trained ones of the
    /// background.
    pub parameters: Cow<'a, [f32]>,
    /// The mean of the parameters over the last part of the budget, if it has begun.
    pub average: Option<Cow<'a, Average>>,
    /// Adam's first moments, one per parameter.
    pub first: Cow<'a, [f32]>,
    /// Adam's second moments, one per parameter.
    pub second: Cow<'a, [f32]>,
    /// The number of Adam's steps.
    pub steps: u64,
    /// The running mean of the gradient's norm; 0 before the first step.
    pub usual_norm: f32,
}

/// A mean of the parameters over steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Average {
    /// The mean, one number per parameter.
    pub parameters: Vec<f32>,
    /// The number of steps.
    pub steps: u64,
}

/// Where the surface was at some time of a fit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Survey {
    /// The number of surveys so far, this one included.
    pub number: u64,
    /// For each pixel of the photographs at the traced size, view after view, row-major, whether
    /// it is far from the surface. Empty if it does not matter.
    pub is_far: Vec<bool>,
    /// For each node of the fine levels of the field's grid, level after level, whether it is
    /// free. Empty without such levels.
    pub is_free: Vec<bool>,
}

/// The values of the field on a lattice at some time of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct LatticeState {
    /// f at the nodes, in world units, in the order of [`trace::Lattice::places`].
    pub values: Vec<f32>,
    /// The largest change of f near the surface since the values before, in world units; `None` for
    /// the first values.
    pub change: Option<f32>,
}

/// Parameters in double precision with their optimiser.
#[derive(Clone, Debug, PartialEq)]
pub struct Optimised {
    /// The parameters, then the first and the second moments of Adam.
    pub numbers: Vec<f64>,
    /// The number of Adam's steps.
    pub steps: u64,
}

impl Optimised {
    /// The state of parameters, of both moments, and the number of steps.
    pub fn new((parameters, first, second, steps): (&[f64], &[f64], &[f64], u64)) -> Self {
        Optimised { numbers: [parameters, first, second].concat(), steps }
    }

    /// The parameters and both moments.
    pub fn parts(&self) -> [&[f64]; 3] {
        let n = self.numbers.len() / 3;
        [0, 1, 2].map(|i| &self.numbers[i * n..(i + 1) * n])
    }
}

/// The name of the tensor of [`State::corrections`], and of their metadata entry.
const CAMERAS: &str = "cameras";

/// The name of the tensor of [`OptimiserState::average`].
const AVERAGE: &str = "average";

/// The name of the tensor of [`State::exposures`].
const EXPOSURES: &str = "exposures";

/// The metadata entry of the number of [`State::survey`].
const SURVEY: &str = "survey";

/// The name of the tensor of [`Survey::is_far`].
const IS_FAR: &str = "is_far";

/// The name of the tensor of [`Survey::is_free`].
const IS_FREE: &str = "is_free";

/// The name of the tensor of [`LatticeState::values`].
const LATTICE: &str = "lattice";

/// The metadata entry of [`LatticeState::change`].
const CHANGE: &str = "lattice_change";

/// The metadata entry of the number of steps of a tensor of [`Optimised`] or [`Average`].
fn steps_of(name: &str) -> String {
    format!("{name}_steps")
}

/// The most iterations: 2^53, the integers that double precision holds.
const MOST_STEPS: u64 = 1 << 53;

/// The metadata entry of [`State::held_out_psnr`].
const HELD_OUT_PSNR: &str = "held_out_psnr";

impl State<'_> {
    /// Writes the state to `path`. The file is replaced as a whole: an interrupted write leaves the
    /// old file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), FitError> {
        let file = TensorFile::new(self.tensors(), self.metadata())?;
        Ok(atomic_write(path, |out| file.write(out))?)
    }

    /// The tensors of the file.
    fn tensors(&self) -> Vec<Tensor<'_>> {
        let OptimiserState { parameters, average, first, second, .. } = &self.optimiser;
        let average = average.as_ref().map(|average| (AVERAGE, &average.parameters[..]));
        let vectors = [("parameters", &parameters[..]), ("first", first), ("second", second)];
        let mut tensors = Vec::new();
        let lattice = self.lattice.as_ref().map(|lattice| (LATTICE, &lattice.values[..]));
        for (name, own) in vectors.into_iter().chain(average).chain(lattice) {
            tensors.push(Tensor::vector(name, Dtype::F32, own.len(), numbers(own)));
        }
        for (name, Optimised { numbers: own, .. }) in self.optimised() {
            tensors.push(Tensor::vector(name, Dtype::F64, own.len(), numbers(own)));
        }
        if let Some(survey) = &self.survey {
            for (name, flags) in [(IS_FAR, &survey.is_far), (IS_FREE, &survey.is_free)] {
                let elements = bytes(bytemuck::cast_slice::<bool, u8>(flags));
                tensors.push(Tensor::vector(name, Dtype::BOOL, flags.len(), elements));
            }
        }
        tensors
    }

    /// The parameters in double precision, with the names of their tensors.
    fn optimised(&self) -> impl Iterator<Item = (&'static str, &Optimised)> {
        let both = [(CAMERAS, self.corrections.get()), (EXPOSURES, self.exposures.as_ref())];
        both.into_iter().filter_map(|(name, own)| Some((name, own?)))
    }

    /// The metadata of the file.
    fn metadata(&self) -> HashMap<String, String> {
        let State { clock, optimiser, .. } = self;
        let mut metadata = HashMap::from([
            ("iteration".to_owned(), clock.iteration.to_string()),
            ("seconds".to_owned(), clock.seconds.to_string()),
            ("searching".to_owned(), clock.searching.to_string()),
            ("usual_norm".to_owned(), optimiser.usual_norm.to_string()),
            ("steps".to_owned(), optimiser.steps.to_string()),
        ]);
        if let Some(average) = &optimiser.average {
            metadata.insert(steps_of(AVERAGE), average.steps.to_string());
        }
        if let Some(psnr) = self.held_out_psnr {
            metadata.insert(HELD_OUT_PSNR.to_owned(), psnr.to_string());
        }
        let word = match &self.corrections {
            Corrections::Undecided => "undecided",
            Corrections::Given => "given",
            Corrections::Refined(_) => "refined",
            Corrections::Adjusted(_) => "adjusted",
        };
        metadata.insert(CAMERAS.to_owned(), word.to_owned());
        let steps = self.optimised().map(|(name, own)| (steps_of(name), own.steps.to_string()));
        metadata.extend(steps);
        if let Some(survey) = &self.survey {
            metadata.insert(SURVEY.to_owned(), survey.number.to_string());
        }
        if let Some(change) = self.lattice.as_ref().and_then(|lattice| lattice.change) {
            metadata.insert(CHANGE.to_owned(), change.to_string());
        }
        metadata
    }

    /// Reads a state. `count` gives the number of parameters for a number of free nodes of
    /// [`Survey::is_free`].
    ///
    /// # Errors
    /// If the file cannot be read, is cut short, has another number of parameters, or has a number
    /// that is not finite or out of range.
    pub fn load(path: &Path, count: impl Fn(usize) -> usize) -> Result<State<'static>, InputError> {
        let error = |field: &str, found: String, expected: &str| {
            InputError::new(path, field, found, expected)
        };
        let bytes = files::read(path, "checkpoint", "a checkpoint of this run")?;
        let corrupt = |e: safetensors::SafeTensorError| {
            error("checkpoint", e.to_string(), "a whole checkpoint")
        };
        let tensors = SafeTensors::deserialize(&bytes).map_err(corrupt)?;
        let (_, header) = SafeTensors::read_metadata(&bytes).map_err(corrupt)?;
        let metadata = header.metadata().clone().unwrap_or_default();
        let count_of = |key: &str| read_count(path, key, &metadata);
        let has = |name: &str| tensors.names().contains(&name);
        let read_survey = || read_survey(path, &metadata, &tensors);
        let survey = metadata.contains_key(SURVEY).then(read_survey).transpose()?;
        let is_free = survey.iter().flat_map(|survey| &survey.is_free);
        let count = count(is_free.filter(|free| **free).count());
        let vector = |name: &str, least: f32, expected: &str| {
            let view = tensors.tensor(name).map_err(corrupt)?;
            if view.dtype() != Dtype::F32 || view.shape() != [count] {
                let found = format!("{:?} of shape {:?}", view.dtype(), view.shape());
                return Err(error(
                    name,
                    found,
                    &format!("F32 of shape [{count}], according to fit.toml"),
                ));
            }
            let numbers: Vec<f32> = bytemuck::allocation::pod_collect_to_vec(view.data());
            match numbers.iter().position(|v| !(v.is_finite() && *v >= least)) {
                Some(i) => Err(error(name, format!("{} at element {i}", numbers[i]), expected)),
                None => Ok(numbers),
            }
        };
        let owned = |name, least, expected| vector(name, least, expected).map(Cow::Owned);
        let average = || -> Result<Average, InputError> {
            let parameters = vector(AVERAGE, f32::MIN, "finite numbers")?;
            Ok(Average { parameters, steps: count_of(&steps_of(AVERAGE))? })
        };
        Ok(State {
            clock: read_clock(path, &metadata)?,
            optimiser: OptimiserState {
                usual_norm: read_number(path, "usual_norm", &metadata)? as f32,
                parameters: owned("parameters", f32::MIN, "finite numbers")?,
                average: has(AVERAGE).then(average).transpose()?.map(Cow::Owned),
                first: owned("first", f32::MIN, "finite numbers")?,
                second: owned("second", 0.0, "finite numbers, 0 or more")?,
                steps: count_of("steps")?,
            },
            held_out_psnr: read_held_out_psnr(path, &metadata)?,
            corrections: read_corrections(path, &metadata, &tensors)?,
            exposures: has(EXPOSURES)
                .then(|| read_optimised(path, EXPOSURES, &metadata, &tensors))
                .transpose()?,
            survey: survey.map(Cow::Owned),
            lattice: has(LATTICE)
                .then(|| read_lattice(path, &metadata, &tensors))
                .transpose()?
                .map(Cow::Owned),
        })
    }
}

/// The clock of a checkpoint.
fn read_clock(path: &Path, metadata: &HashMap<String, String>) -> Result<Clock, InputError> {
    Ok(Clock {
        iteration: read_count(path, "iteration", metadata)?,
        seconds: read_number(path, "seconds", metadata)?,
        searching: read_number(path, "searching", metadata)?,
    })
}

/// The number of this name in a checkpoint, 0 or more.
fn read_number(
    path: &Path,
    key: &str,
    metadata: &HashMap<String, String>,
) -> Result<f64, InputError> {
    let text = metadata.get(key).map_or("nothing", String::as_str);
    let number = text.parse::<f64>().ok().filter(|n| (0.0..1e30).contains(n));
    number.ok_or_else(|| InputError::new(path, key, text, "a number from 0 to 1e30"))
}

/// The number of steps of this name in a checkpoint.
fn read_count(
    path: &Path,
    key: &str,
    metadata: &HashMap<String, String>,
) -> Result<u64, InputError> {
    let text = metadata.get(key).map_or("nothing", String::as_str);
    let number = text.parse::<u64>().ok().filter(|n| *n <= MOST_STEPS);
    number.ok_or_else(|| InputError::new(path, key, text, "an integer from 0 to 2^53"))
}

/// The PSNR of the last preview of a held-out view in a checkpoint.
fn read_held_out_psnr(
    path: &Path,
    metadata: &HashMap<String, String>,
) -> Result<Option<f64>, InputError> {
    let Some(text) = metadata.get(HELD_OUT_PSNR) else { return Ok(None) };
    let number = text.parse::<f64>().ok().filter(|n| n.abs() < 1e30);
    let error = || InputError::new(path, HELD_OUT_PSNR, text, "a PSNR in dB");
    number.map(Some).ok_or_else(error)
}

/// The corrections of the cameras in a checkpoint.
fn read_corrections(
    path: &Path,
    metadata: &HashMap<String, String>,
    tensors: &SafeTensors<'_>,
) -> Result<Corrections<Optimised>, InputError> {
    let cameras = || read_optimised(path, CAMERAS, metadata, tensors);
    match metadata.get(CAMERAS).map_or("nothing", String::as_str) {
        "undecided" => Ok(Corrections::Undecided),
        "given" => Ok(Corrections::Given),
        "refined" => Ok(Corrections::Refined(cameras()?)),
        "adjusted" => Ok(Corrections::Adjusted(cameras()?)),
        other => {
            Err(InputError::new(path, CAMERAS, other, "undecided, given, refined or adjusted"))
        }
    }
}

/// The tensor of this name of a checkpoint, with the number of its steps.
fn read_optimised(
    path: &Path,
    name: &str,
    metadata: &HashMap<String, String>,
    tensors: &SafeTensors<'_>,
) -> Result<Optimised, InputError> {
    let error = |field: &str, found: &str, expected| InputError::new(path, field, found, expected);
    let steps = read_count(path, &steps_of(name), metadata)?;
    let expected = "F64 of shape [3 n]";
    let view = tensors.tensor(name).map_err(|e| error(name, &e.to_string(), expected))?;
    let n = view.data().len() / size_of::<f64>();
    if view.dtype() != Dtype::F64 || n == 0 || !n.is_multiple_of(3) {
        let found = format!("{:?} of shape {:?}", view.dtype(), view.shape());
        return Err(error(name, &found, expected));
    }
    Ok(Optimised { numbers: bytemuck::allocation::pod_collect_to_vec(view.data()), steps })
}

/// The survey of a checkpoint.
fn read_survey(
    path: &Path,
    metadata: &HashMap<String, String>,
    tensors: &SafeTensors<'_>,
) -> Result<Survey, InputError> {
    let flags = |name: &str| {
        let error = |found: &str, expected| InputError::new(path, name, found, expected);
        let view = tensors.tensor(name).map_err(|e| error(&e.to_string(), "a tensor"))?;
        if view.dtype() != Dtype::BOOL || view.shape().len() != 1 {
            let found = format!("{:?} of shape {:?}", view.dtype(), view.shape());
            return Err(error(&found, "BOOL of shape [n]"));
        }
        let flag = |byte: &u8| match byte {
            0 => Ok(false),
            1 => Ok(true),
            other => Err(error(&other.to_string(), "0 or 1")),
        };
        view.data().iter().map(flag).collect()
    };
    let number = read_count(path, SURVEY, metadata)?;
    Ok(Survey { number, is_far: flags(IS_FAR)?, is_free: flags(IS_FREE)? })
}

/// The lattice of a checkpoint.
fn read_lattice(
    path: &Path,
    metadata: &HashMap<String, String>,
    tensors: &SafeTensors<'_>,
) -> Result<LatticeState, InputError> {
    let error = |found: &str, expected| InputError::new(path, LATTICE, found, expected);
    let view = tensors.tensor(LATTICE).map_err(|e| error(&e.to_string(), "a tensor"))?;
    if view.dtype() != Dtype::F32 || view.shape().len() != 1 {
        let found = format!("{:?} of shape {:?}", view.dtype(), view.shape());
        return Err(error(&found, "F32 of shape [n]"));
    }
    let values: Vec<f32> = bytemuck::allocation::pod_collect_to_vec(view.data());
    if let Some(i) = values.iter().position(|f| !f.is_finite()) {
        return Err(error(&format!("{} at element {i}", values[i]), "finite numbers"));
    }
    let read = || read_number(path, CHANGE, metadata).map(|change| change as f32);
    let change = metadata.contains_key(CHANGE).then(read).transpose()?;
    Ok(LatticeState { values, change })
}

#[cfg(test)]
mod tests;
