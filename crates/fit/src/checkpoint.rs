//! The state of a fit between two iterations, in one file.

use std::collections::HashMap;
use std::path::Path;

use safetensors::{Dtype, SafeTensors, tensor::TensorView};

use io::{InputError, atomic_write};

/// The state of a fit between two iterations. Random numbers are functions of the seed and the
/// iteration, so there is no random generator in it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct State {
    /// The number of finished iterations.
    pub(crate) iteration: u64,
    /// Wall time of all sessions, in seconds.
    pub(crate) seconds: f64,
    /// The running mean of the gradient's norm; 0 before the first step.
    pub(crate) usual_norm: f32,
    /// The PSNR of the last preview of a held-out view, in dB; `None` before the first.
    pub(crate) held_out_psnr: Option<f64>,
    /// The parameters of the field, then those of the radiance head.
    pub(crate) parameters: Vec<f32>,
    /// Adam's first moments, one per parameter.
    pub(crate) first: Vec<f32>,
    /// Adam's second moments, one per parameter.
    pub(crate) second: Vec<f32>,
    /// The number of Adam's steps.
    pub(crate) steps: u64,
    /// The refinement of the cameras.
    pub(crate) refinement: Refinement,
    /// The exposures of the photographs, if they are fitted.
    pub(crate) exposures: Option<Optimised>,
}

/// Parameters in double precision with their optimiser.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Optimised {
    /// The parameters, then the first and the second moments of Adam.
    pub(crate) numbers: Vec<f64>,
    /// The number of Adam's steps.
    pub(crate) steps: u64,
}

impl Optimised {
    /// The state of parameters, of both moments, and the number of steps.
    pub(crate) fn new((parameters, first, second, steps): (&[f64], &[f64], &[f64], u64)) -> Self {
        Optimised { numbers: [parameters, first, second].concat(), steps }
    }

    /// The parameters and both moments.
    pub(crate) fn parts(&self) -> [&[f64]; 3] {
        let n = self.numbers.len() / 3;
        [0, 1, 2].map(|i| &self.numbers[i * n..(i + 1) * n])
    }
}

/// The state of the refinement of cameras.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) enum Refinement {
    /// It is not decided yet whether cameras are refined.
    #[default]
    Undecided,
    /// The cameras stay as given.
    Given,
    /// The cameras are refined: the parameters of their calibration.
    Refined(Optimised),
    /// The cameras were adjusted before the fit and stay: the same parameters.
    Adjusted(Optimised),
}

/// The name of the tensor of [`Refinement::Refined`], and of the metadata entry of the refinement.
const CAMERAS: &str = "cameras";

/// The name of the tensor of [`State::exposures`].
const EXPOSURES: &str = "exposures";

/// The metadata entry of the number of steps of a tensor of [`Optimised`].
fn steps_of(name: &str) -> String {
    format!("{name}_steps")
}

/// The most iterations: 2^53, the integers that double precision holds.
const MOST_STEPS: u64 = 1 << 53;

/// The metadata entry of [`State::held_out_psnr`].
const HELD_OUT_PSNR: &str = "held_out_psnr";

impl State {
    /// Writes the state to `path`. The file is replaced as a whole: an interrupted write leaves the
    /// old file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(crate) fn save(&self, path: &Path) -> anyhow::Result<()> {
        let tensors =
            [("parameters", &self.parameters), ("first", &self.first), ("second", &self.second)];
        let mut views: Vec<_> = tensors
            .iter()
            .map(|(name, data)| {
                TensorView::new(Dtype::F32, vec![data.len()], bytemuck::cast_slice(data))
                    .map(|view| (*name, view))
            })
            .collect::<Result<_, _>>()?;
        let mut metadata = HashMap::from([
            ("iteration".to_owned(), self.iteration.to_string()),
            ("seconds".to_owned(), self.seconds.to_string()),
            ("usual_norm".to_owned(), self.usual_norm.to_string()),
            ("steps".to_owned(), self.steps.to_string()),
        ]);
        if let Some(psnr) = self.held_out_psnr {
            metadata.insert(HELD_OUT_PSNR.to_owned(), psnr.to_string());
        }
        let (word, cameras) = match &self.refinement {
            Refinement::Undecided => ("undecided", None),
            Refinement::Given => ("given", None),
            Refinement::Refined(cameras) => ("refined", Some(cameras)),
            Refinement::Adjusted(cameras) => ("adjusted", Some(cameras)),
        };
        metadata.insert(CAMERAS.to_owned(), word.to_owned());
        for (name, optimised) in [(CAMERAS, cameras), (EXPOSURES, self.exposures.as_ref())] {
            let Some(Optimised { numbers, steps }) = optimised else { continue };
            let (shape, data) = (vec![numbers.len()], bytemuck::cast_slice(numbers));
            views.push((name, TensorView::new(Dtype::F64, shape, data)?));
            metadata.insert(steps_of(name), steps.to_string());
        }
        let bytes = safetensors::serialize(views, Some(metadata))?;
        atomic_write(path, |out| Ok(out.write_all(&bytes)?))
    }

    /// Reads a state with `count` parameters.
    ///
    /// # Errors
    /// If the file cannot be read, is cut short, has another number of parameters, or has a number
    /// that is not finite or out of range.
    pub(crate) fn load(path: &Path, count: usize) -> anyhow::Result<State> {
        let error = |field: &str, found: String, expected: &str| {
            InputError::new(path, field, found, expected)
        };
        let bytes = io::read(path, "checkpoint", "a checkpoint of this run")?;
        let corrupt = |e: safetensors::SafeTensorError| {
            error("checkpoint", e.to_string(), "a whole checkpoint")
        };
        let tensors = SafeTensors::deserialize(&bytes).map_err(corrupt)?;
        let (_, header) = SafeTensors::read_metadata(&bytes).map_err(corrupt)?;
        let metadata = header.metadata().clone().unwrap_or_default();
        let text = |key: &str| metadata.get(key).map_or("nothing", String::as_str);
        let count_of = |key: &str| {
            let number = text(key).parse::<u64>().ok().filter(|n| *n <= MOST_STEPS);
            number.ok_or_else(|| error(key, text(key).to_owned(), "an integer from 0 to 2^53"))
        };
        let number = |key: &str| {
            let number = text(key).parse::<f64>().ok().filter(|n| (0.0..1e30).contains(n));
            number.ok_or_else(|| error(key, text(key).to_owned(), "a number from 0 to 1e30"))
        };
        let held_out_psnr = || {
            let Some(text) = metadata.get(HELD_OUT_PSNR) else { return Ok(None) };
            let number = text.parse::<f64>().ok().filter(|n| n.abs() < 1e30);
            number.map(Some).ok_or_else(|| error(HELD_OUT_PSNR, text.clone(), "a PSNR in dB"))
        };
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
        Ok(State {
            iteration: count_of("iteration")?,
            seconds: number("seconds")?,
            usual_norm: number("usual_norm")? as f32,
            held_out_psnr: held_out_psnr()?,
            parameters: vector("parameters", f32::MIN, "finite numbers")?,
            first: vector("first", f32::MIN, "finite numbers")?,
            second: vector("second", 0.0, "finite numbers, 0 or more")?,
            steps: count_of("steps")?,
            refinement: read_refinement(path, &metadata, &tensors)?,
            exposures: match tensors.names().contains(&EXPOSURES) {
                true => Some(read_optimised(path, EXPOSURES, &metadata, &tensors)?),
                false => None,
            },
        })
    }
}

/// The refinement of the cameras in a checkpoint.
fn read_refinement(
    path: &Path,
    metadata: &HashMap<String, String>,
    tensors: &SafeTensors<'_>,
) -> Result<Refinement, InputError> {
    let cameras = || read_optimised(path, CAMERAS, metadata, tensors);
    match metadata.get(CAMERAS).map_or("nothing", String::as_str) {
        "undecided" => Ok(Refinement::Undecided),
        "given" => Ok(Refinement::Given),
        "refined" => Ok(Refinement::Refined(cameras()?)),
        "adjusted" => Ok(Refinement::Adjusted(cameras()?)),
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
    let key = steps_of(name);
    let text = metadata.get(&key).map_or("nothing", String::as_str);
    let steps = text.parse().ok().filter(|n| *n <= MOST_STEPS);
    let steps = steps.ok_or_else(|| error(&key, text, "an integer from 0 to 2^53"))?;
    let expected = "F64 of shape [3 n]";
    let view = tensors.tensor(name).map_err(|e| error(name, &e.to_string(), expected))?;
    let n = view.data().len() / size_of::<f64>();
    if view.dtype() != Dtype::F64 || n == 0 || !n.is_multiple_of(3) {
        let found = format!("{:?} of shape {:?}", view.dtype(), view.shape());
        return Err(error(name, &found, expected));
    }
    Ok(Optimised { numbers: bytemuck::allocation::pod_collect_to_vec(view.data()), steps })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_saved_state_loads_with_the_same_bits_and_a_cut_file_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("state.safetensors");
        let state = State {
            iteration: 17,
            seconds: 1.0 / 3.0,
            usual_norm: 0.1,
            held_out_psnr: Some(31.4),
            parameters: vec![1.0, f32::MIN_POSITIVE, -0.0],
            first: vec![0.1; 3],
            second: vec![0.2; 3],
            steps: 16,
            refinement: Refinement::Refined(Optimised {
                numbers: vec![0.5, -0.25, 1e-300],
                steps: 7,
            }),
            exposures: Some(Optimised { numbers: vec![0.1; 9], steps: 8 }),
        };
        state.save(&path).unwrap();
        assert_eq!(State::load(&path, 3).unwrap(), state);
        assert!(State::load(&path, 4).unwrap_err().to_string().contains("parameters"));
        let whole = std::fs::read(&path).unwrap();
        for length in 0..whole.len() {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(State::load(&path, 3).is_err(), "a checkpoint cut at {length} bytes");
        }
    }

    #[test]
    fn a_negative_mean_square_gradient_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("state.safetensors");
        let state = State {
            iteration: 1,
            seconds: 1.0,
            usual_norm: 1.0,
            held_out_psnr: None,
            parameters: vec![-1.0; 2],
            first: vec![-1.0; 2],
            second: vec![0.0, -1.0],
            steps: 1,
            refinement: Refinement::Undecided,
            exposures: None,
        };
        state.save(&path).unwrap();
        let error = State::load(&path, 2).unwrap_err();
        assert!(error.is::<InputError>(), "{error}");
        let words = "second: found -1 at element 1, expected finite numbers, 0 or more";
        assert!(error.to_string().contains(words), "{error}");
    }

    #[test]
    fn numbers_out_of_range_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("state.safetensors");
        let state = State {
            iteration: 7777,
            seconds: 5555.5,
            usual_norm: 0.3333,
            held_out_psnr: Some(22.22),
            parameters: vec![0.0],
            first: vec![0.0],
            second: vec![0.0],
            steps: 8888,
            refinement: Refinement::Given,
            exposures: None,
        };
        state.save(&path).unwrap();
        let whole = String::from_utf8_lossy(&std::fs::read(&path).unwrap()).into_owned();
        for (field, value, wrong) in [
            ("iteration", "7777", ["NaN ", "-5  ", "inf ", "1.5 "]),
            ("steps", "8888", ["NaN ", "-5  ", "inf ", "    "]),
            ("seconds", "5555.5", ["NaN   ", "-1e9  ", "inf   ", "1e300 "]),
            ("usual_norm", "0.3333", ["NaN   ", "-1    ", "inf   ", "x     "]),
            ("held_out_psnr", "22.22", ["NaN  ", "inf  ", "-inf ", "1e300"]),
        ] {
            for wrong in wrong {
                // The length of the header stays.
                assert_eq!(wrong.len(), value.len());
                let padded =
                    format!("\"{}\"{}", wrong.trim(), " ".repeat(wrong.len() - wrong.trim().len()));
                std::fs::write(&path, whole.replace(&format!("\"{value}\""), &padded)).unwrap();
                let error = State::load(&path, 1).unwrap_err().to_string();
                assert!(error.contains(&format!("{field}: found {}", wrong.trim())), "{error}");
            }
        }
    }
}
