//! Cameras.

use std::path::Path;

use glam::{DVec2, DVec3};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{numbers, rows, tuple};
use crate::failure::{wrong, wrong_input};

/// A pinhole camera; the keywords are the keys of `camera` in a scene file.
#[pyclass(frozen, module = "dsdf")]
#[derive(Clone, Copy)]
pub(crate) struct Camera(pub(crate) render::Camera);

/// The size of a camera's film, and its other numbers to the last bit.
type State = (u32, u32, [f64; 18]);

fn state_of(camera: &render::Camera) -> State {
    let render::Camera { width, height, focal, principal, eye, right, up, forward, radial } =
        *camera;
    let vectors = [eye, right, up, forward].map(|v| v.to_array());
    let pairs = [focal, principal, radial].map(|v| v.to_array());
    let mut numbers = [0.0; 18];
    numbers[..12].copy_from_slice(vectors.as_flattened());
    numbers[12..].copy_from_slice(pairs.as_flattened());
    (width, height, numbers)
}

fn of_state((width, height, numbers): State) -> render::Camera {
    let vector = |i: usize| DVec3::from_slice(&numbers[3 * i..]);
    let pair = |i: usize| DVec2::from_slice(&numbers[12 + 2 * i..]);
    let [eye, right, up, forward] = [0, 1, 2, 3].map(vector);
    let [focal, principal, radial] = [0, 1, 2].map(pair);
    render::Camera { width, height, focal, principal, eye, right, up, forward, radial }
}

/// A camera by the keys of a scene file. `name` is its name in messages.
fn read(description: &Bound<'_, PyDict>, name: &str) -> PyResult<Camera> {
    let py = description.py();
    let (numpy, plain) = (py.import("numpy")?, PyDict::new(py));
    for (key, value) in description {
        let key: String = key.extract()?;
        let (values, _) = numbers(&value, &format!("{name}: /{key}"))?;
        if !values.iter().all(|v| v.is_finite()) {
            return Err(wrong(name, &format!("/{key}"), value, "finite numbers"));
        }
        let value = numpy.call_method1("asarray", (value,))?.call_method0("tolist")?;
        plain.set_item(key, value)?;
    }
    let text = py.import("json")?.call_method1("dumps", (plain,));
    let text: String = text
        .map_err(|error| {
            wrong(name, "keywords", error.value(py), "finite numbers and lists of them")
        })?
        .extract()?;
    let value = serde_json::from_str(&text)
        .map_err(|error| wrong(name, "keywords", error, "finite numbers and lists of them"))?;
    scene::camera(Path::new(name), &value).map(Camera).map_err(wrong_input)
}

/// The cameras of a sequence of cameras, or of dictionaries with their keys.
pub(crate) fn read_all(cameras: &Bound<'_, PyAny>) -> PyResult<Vec<render::Camera>> {
    let mut out = Vec::new();
    for (i, item) in cameras.try_iter()?.enumerate() {
        let (item, name) = (item?, format!("cameras[{i}]"));
        let camera = match item.cast::<Camera>() {
            Ok(camera) => *camera.get(),
            Err(_) => match item.cast::<PyDict>() {
                Ok(description) => read(description, &name)?,
                Err(_) => {
                    let found = item.get_type().name()?;
                    return Err(wrong("arguments", &name, found, "a dsdf.Camera"));
                }
            },
        };
        out.push(camera.0);
    }
    if out.is_empty() {
        return Err(wrong("arguments", "cameras", "none", "one or more"));
    }
    Ok(out)
}

#[pymethods]
impl Camera {
    #[new]
    #[pyo3(signature = (state = None, /, **description))]
    fn new(
        py: Python<'_>,
        state: Option<State>,
        description: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        if let Some(state) = state {
            return Ok(Camera(of_state(state)));
        }
        match description {
            Some(description) => read(description, "camera"),
            None => read(&PyDict::new(py), "camera"),
        }
    }

    /// The arguments that make an equal camera: `pickle` and `copy` ask for them.
    fn __getnewargs__(&self) -> (State,) {
        (state_of(&self.0),)
    }

    /// The width of the film, in pixels.
    #[getter]
    fn width(&self) -> u32 {
        self.0.width
    }

    /// The height of the film, in pixels.
    #[getter]
    fn height(&self) -> u32 {
        self.0.height
    }

    /// The focal lengths (x, y), in pixels.
    #[getter]
    fn focal(&self) -> (f64, f64) {
        self.0.focal.into()
    }

    /// The principal point (x, y), in pixels.
    #[getter]
    fn principal(&self) -> (f64, f64) {
        self.0.principal.into()
    }

    /// The camera-to-world matrix, 4 × 4: x right, y up, looking along −z.
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.0.pose().transpose().to_cols_array();
        PyArray1::from_slice(py, &rows).reshape([4, 4])
    }

    /// The unit directions through film positions u, n × 2 in pixels: n × 3, in world space.
    fn directions<'py>(&self, u: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let py = u.py();
        let (u, shape) = numbers(u, "u")?;
        if shape.len() != 2 || shape[1] != 2 {
            return Err(wrong("u", "shape", tuple(&shape), "(n, 2)"));
        }
        let of = |u: &[f64]| self.0.direction(DVec2::from_slice(u));
        let directions: Vec<_> = u.chunks_exact(2).map(of).collect();
        rows(py, &directions)
    }

    fn __repr__(&self) -> String {
        let render::Camera { width, height, focal, eye, .. } = self.0;
        format!("Camera({width} x {height}, focal=({}, {}), eye={eye})", focal.x, focal.y)
    }
}
