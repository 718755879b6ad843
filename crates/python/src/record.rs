//! Records of estimators, for fields and shaders that are Python objects.

use estimate::record::{Adjoints, Area, CameraAdjoints, Pass, Record as Samples};
use estimate::{
    Batch, Discontinuity, Estimator, EstimatorOptions, Registry, SampleCounts, SilhouetteMask,
    Terms,
};
use field::{Background, BackgroundPerCamera, Shader, UniformBackground};
use field::{PartialSum, SLOPE_POINTS, Sphere, slope};
use glam::{DVec2, DVec3};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyRuntimeWarning;
use pyo3::prelude::*;
use random::Stream;
use render::{Analytic, CameraAdjoint, Formula, Pixel, Scene};
use warp::WarpOptions;

use crate::arrays::{numbers, read_finite_rows, read_numbers, rows, tuple};
use crate::callbacks::{Callbacks, PyField, PyShader};
use crate::camera::read_all;
use crate::failure::{Failure, wrong, wrong_input};

/// The place in messages about arguments.
const ARGUMENTS: &str = "arguments";

/// The appearance of the surface.
enum Appearance {
    /// An object with `radiance` and `vjp`.
    Object(Py<PyAny>),
    /// The same radiance everywhere.
    Constant(DVec3),
}

/// The parts of a scene.
struct Parts {
    field: Py<PyAny>,
    appearance: Appearance,
    cameras: Vec<render::Camera>,
    bounds: Sphere<f64>,
    background: Box<dyn Background<f64>>,
}

impl Parts {
    /// Runs a pass over the scene without the GIL, which callbacks take while they run.
    ///
    /// # Errors
    /// The first exception of a callback.
    fn with_scene<T: Send>(
        &self,
        py: Python<'_>,
        pass: impl FnOnce(&Scene<'_, f64>) -> T + Send,
    ) -> PyResult<T> {
        let failure = Failure::default();
        let callbacks = |name, object| Callbacks { name, object, failure: &failure };
        let field = PyField { callbacks: callbacks("field", &self.field), ball: self.bounds };
        let shader: Box<dyn Shader<f64> + '_> = match &self.appearance {
            Appearance::Object(object) => Box::new(PyShader(callbacks("shader", object))),
            Appearance::Constant(rgb) => {
                let parameters = rgb.to_array().to_vec();
                Box::new(Analytic { formula: Formula::Constant, parameters })
            }
        };
        let result = py.detach(|| {
            let background = &*self.background;
            pass(&Scene::new(&field, &*shader, &self.cameras, &self.bounds, background))
        });
        drop(shader);
        failure.into_result().map(|()| result)
    }
}

/// The place where the ray through the centre of a pixel enters a ball; `None` if it misses it.
fn entry(bounds: &Sphere<f64>, camera: &render::Camera, pixel: &Pixel) -> Option<DVec3> {
    let u = DVec2::new(f64::from(pixel.x), f64::from(pixel.y)) + 0.5;
    let direction = camera.direction(u);
    let (start, _) = bounds.clip(camera.eye, direction)?;
    Some(camera.eye + direction * start)
}

impl Parts {
    /// Refuses a field that is negative where most rays start: they would see nothing, and have no
    /// derivatives. Warns where some do.
    ///
    /// # Errors
    /// That, or an exception of the field.
    fn refuse_inside(&self, py: Python<'_>, pixels: &[Pixel]) -> PyResult<()> {
        let entry = |pixel: &Pixel| entry(&self.bounds, &self.cameras[pixel.camera], pixel);
        let entries: Vec<DVec3> = pixels.iter().filter_map(entry).collect();
        let mut f = vec![0.0; entries.len()];
        self.with_scene(py, |scene| scene.field.value(&entries, &mut f))?;
        let Some(first) = f.iter().position(|f| *f < 0.0) else { return Ok(()) };
        let (inside, all) = (f.iter().filter(|f| **f < 0.0).count(), f.len());
        let found = format!(
            "{} at {}, where a ray starts ({inside} of {all} rays)",
            f[first], entries[first]
        );
        let expected = "a positive value outside the solid, and bounds that hold the whole solid";
        if 2 * inside > all {
            return Err(wrong("field", "value", found, expected));
        }
        let text = format!("field: value: found {found}, expected {expected}: they see nothing");
        let text = std::ffi::CString::new(text)?;
        PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), &text, 2)
    }
}

/// Samples of pixels, from which derivatives of any function of the pixels follow.
#[pyclass(frozen, module = "dsdf")]
pub(crate) struct Record {
    parts: Parts,
    samples: Samples<f64>,
    /// The camera of each pixel, by its number.
    of_pixel: Vec<usize>,
    unmodelled: Vec<&'static str>,
}

/// Samples pixels with an estimator. `dsdf.record` in Python documents the arguments.
#[pyfunction]
#[pyo3(signature = (field, shader, cameras, pixels, *, bounds, estimator="refined", seed, spp,
    edge_samples=None, background=None, relaxation=1.0, hit_tolerance=None, steps=22, top_k=14,
    gamma=3.0, lambda_d=1.0, epsilon=1e-6))]
#[allow(clippy::too_many_arguments, reason = "the keywords of a Python function")]
pub(crate) fn record(
    py: Python<'_>,
    field: Py<PyAny>,
    shader: &Bound<'_, PyAny>,
    cameras: &Bound<'_, PyAny>,
    pixels: &Bound<'_, PyAny>,
    bounds: &Bound<'_, PyAny>,
    estimator: &str,
    seed: &Bound<'_, PyAny>,
    spp: &Bound<'_, PyAny>,
    edge_samples: Option<&Bound<'_, PyAny>>,
    background: Option<&Bound<'_, PyAny>>,
    relaxation: f64,
    hit_tolerance: Option<f64>,
    steps: usize,
    top_k: usize,
    gamma: f64,
    lambda_d: f64,
    epsilon: f64,
) -> PyResult<Record> {
    let cameras = read_all(cameras)?;
    let pixels = read_pixels(pixels, &cameras)?;
    let parts = Parts {
        field,
        appearance: read_appearance(shader)?,
        background: read_background(background, cameras.len())?,
        bounds: read_bounds(bounds)?,
        cameras,
    };
    let seed: u64 = whole(seed, "seed", "0 to 18446744073709551615", |_| true)?;
    let count = |value, name| whole(value, name, "1 to 65536", |n| (1..=65_536).contains(n));
    let spp: u32 = count(spp, "spp")?;
    let edge_samples =
        edge_samples.map_or(Ok(spp.div_ceil(2)), |value| count(value, "edge_samples"))?;
    let default = trace::Options::default();
    let tolerance = hit_tolerance.unwrap_or(default.tolerance);
    let tracing = trace::Options { relaxation, tolerance, ..default };
    let flag = |name| if name == "tolerance" { "hit_tolerance" } else { name };
    tracing.validate().map_err(|e| wrong(ARGUMENTS, flag(e.name), e.found, e.expected))?;
    let warp = WarpOptions { steps, top_k, gamma, lambda_d, epsilon };
    warp.validate().map_err(|e| wrong(ARGUMENTS, e.name, e.found, e.expected))?;
    let estimator = named(estimator, warp)?;
    let counts = SampleCounts { spp, edge_samples };
    parts.refuse_inside(py, &pixels)?;
    let ball = parts.bounds;
    let (samples, unmodelled) = parts.with_scene(py, |scene| {
        // As `Scene::with_slope_of_field`, by this thread alone: PyTorch changes a module while it
        // evaluates it with other parameters.
        let relaxation = tracing.relaxation / slope(scene.field, &ball, SLOPE_POINTS);
        let scene = scene.with_options(trace::Options { relaxation, ..tracing });
        let batch =
            Batch { pixels: &pixels, counts, stream: Stream::of_seed(seed), terms: Terms::All };
        let samples = estimator.record(&scene, &batch, &mut SilhouetteMask::default());
        (samples, estimator.unmodelled(&scene))
    })?;
    let not_finite = |e| wrong_input(files::InputError::new("field", "value", e, "a finite field"));
    Ok(Record {
        parts,
        samples: samples.map_err(not_finite)?,
        of_pixel: pixels.iter().map(|pixel| pixel.camera).collect(),
        unmodelled: unmodelled.into_iter().map(Discontinuity::name).collect(),
    })
}

/// A whole number in a range, of which `expected` are the words.
fn whole<'py, T: for<'a> FromPyObject<'a, 'py>>(
    value: &Bound<'py, PyAny>,
    name: &str,
    expected: &str,
    is_in_range: impl Fn(&T) -> bool,
) -> PyResult<T> {
    let number = value.extract::<T>().ok().filter(is_in_range);
    number.ok_or_else(|| wrong(ARGUMENTS, name, value, expected))
}

/// The estimator of a name.
fn named(name: &str, warp: WarpOptions) -> PyResult<Box<dyn Estimator<f64>>> {
    let registry = Registry::default();
    let options = EstimatorOptions { warp, ..EstimatorOptions::default() };
    match registry.get(name) {
        Some(entry) => Ok(entry.estimator(&options)),
        None => {
            let expected = format!("one of {}", registry.names());
            Err(wrong(ARGUMENTS, "estimator", name, &expected))
        }
    }
}

/// Pixels as rows of camera, column and row.
fn read_pixels(value: &Bound<'_, PyAny>, cameras: &[render::Camera]) -> PyResult<Vec<Pixel>> {
    let (numbers, shape) = numbers(value, "pixels")?;
    if shape.len() != 2 || shape[1] != 3 {
        return Err(wrong(ARGUMENTS, "pixels", tuple(&shape), "an array of shape (n, 3)"));
    }
    let pixel = |(i, row): (usize, &[f64])| {
        let [camera, x, y] = [row[0], row[1], row[2]];
        let whole = row.iter().all(|v| v.fract() == 0.0 && *v >= 0.0);
        let own_camera = cameras.get(camera as usize).filter(|_| camera >= 0.0);
        match own_camera.filter(|c| whole && x < f64::from(c.width) && y < f64::from(c.height)) {
            Some(_) => Ok(Pixel { camera: camera as usize, x: x as u32, y: y as u32 }),
            None => {
                let (place, found) = (format!("pixels[{i}]"), format!("{row:?}"));
                let expected = match own_camera {
                    Some(c) => format!(
                        "whole numbers: a camera, a column below {}, a row below {}",
                        c.width, c.height
                    ),
                    None => format!("the number of a camera, below {}", cameras.len()),
                };
                Err(wrong(ARGUMENTS, &place, found, &expected))
            }
        }
    };
    numbers.chunks_exact(3).enumerate().map(pixel).collect()
}

/// An object with a method `radiance`, or a colour.
fn read_appearance(shader: &Bound<'_, PyAny>) -> PyResult<Appearance> {
    if shader.hasattr("radiance")? {
        return Ok(Appearance::Object(shader.clone().unbind()));
    }
    let expected = "an object with radiance and vjp, or a colour of three finite numbers";
    let rgb = read_numbers(shader, "shader", 3).map(|rgb| DVec3::from_slice(&rgb));
    match rgb.ok().filter(|rgb| rgb.is_finite()) {
        Some(rgb) => Ok(Appearance::Constant(rgb)),
        None => Err(wrong(ARGUMENTS, "shader", shader, expected)),
    }
}

/// A colour, or one for each camera; black by default.
fn read_background(
    value: Option<&Bound<'_, PyAny>>,
    cameras: usize,
) -> PyResult<Box<dyn Background<f64>>> {
    let Some(value) = value else { return Ok(Box::new(UniformBackground(DVec3::ZERO))) };
    let (numbers, shape) = numbers(value, "background")?;
    let mut colours = numbers.chunks_exact(3).map(DVec3::from_slice);
    let expected = format!("3 finite numbers, or an array of shape ({cameras}, 3)");
    match (shape.as_slice(), numbers.iter().all(|v| v.is_finite())) {
        ([3], true) => Ok(Box::new(UniformBackground(colours.next().unwrap_or_default()))),
        ([n, 3], true) if *n == cameras => Ok(Box::new(BackgroundPerCamera(colours.collect()))),
        _ => Err(wrong(ARGUMENTS, "background", value, &expected)),
    }
}

/// A sphere as four numbers: centre and radius.
fn read_bounds(value: &Bound<'_, PyAny>) -> PyResult<Sphere<f64>> {
    let numbers = read_numbers(value, "bounds", 4)?;
    let bounds = [numbers[0], numbers[1], numbers[2], numbers[3]];
    if !files::is_sphere(bounds) {
        return Err(wrong(ARGUMENTS, "bounds", value, files::SPHERE));
    }
    let [x, y, z, radius] = bounds;
    Ok(Sphere { center: DVec3::new(x, y, z), radius })
}

/// Points, coefficients of f and coefficients of ∇f.
type Coefficients<'py> =
    (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

impl Record {
    fn delta(&self, delta: &Bound<'_, PyAny>) -> PyResult<Vec<DVec3>> {
        read_finite_rows(delta, "delta", self.samples.radiance.len())
    }
}

#[pymethods]
impl Record {
    /// The value of every pixel, n × 3, linear RGB.
    #[getter]
    fn radiance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        rows(py, &self.samples.radiance)
    }

    /// An estimate of the part of every pixel in which the object is visible, n numbers.
    #[getter]
    fn coverage<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.samples.coverage())
    }

    /// The number of traced rays.
    #[getter]
    fn rays(&self) -> u64 {
        self.samples.rays
    }

    /// The terms that the estimator leaves out for this scene, by their names.
    #[getter]
    fn unmodelled(&self) -> Vec<&'static str> {
        self.unmodelled.clone()
    }

    /// VJP of the field: (x, α, c) for the adjoints δ of the pixels, n × 3.
    fn backward<'py>(
        &self,
        py: Python<'py>,
        delta: &Bound<'py, PyAny>,
    ) -> PyResult<Coefficients<'py>> {
        let delta = self.delta(delta)?;
        let (x, alpha, c) = self.parts.with_scene(py, |scene| {
            let mut shader = PartialSum::zero(scene.shader.parameter_count(), 0..0);
            let mut adjoints = Adjoints::default();
            self.samples.vjp(scene, &delta, Pass::Sum, &mut shader, &mut adjoints);
            adjoints.columns()
        })?;
        let bad =
            (0..x.len()).find(|&i| !(x[i].is_finite() && alpha[i].is_finite() && c[i].is_finite()));
        if let Some(i) = bad {
            let expected = "finite second derivatives of the field, and a smaller delta";
            return Err(wrong(
                "field",
                "hessian_vector",
                format!("not finite at {}", x[i]),
                expected,
            ));
        }
        Ok((rows(py, &x)?, PyArray1::from_vec(py, alpha), rows(py, &c)?))
    }

    /// VJP of the shader: (x, n, d, L̄) for the adjoints δ of the pixels, n × 3.
    #[allow(clippy::type_complexity, reason = "four arrays")]
    fn shading<'py>(
        &self,
        py: Python<'py>,
        delta: &Bound<'py, PyAny>,
    ) -> PyResult<[Bound<'py, PyArray2<f64>>; 4]> {
        let delta = self.delta(delta)?;
        let mut columns: [Vec<DVec3>; 4] = Default::default();
        for Area { primary, weights, .. } in &self.samples.area {
            let surface = &primary.surface;
            columns[0].extend(&surface.x);
            columns[1].extend(&surface.normal);
            columns[2].extend(&surface.direction);
            columns[3].extend(primary.hits.iter().map(|hit| {
                let in_pixel = weights[hit.sample];
                delta[in_pixel.pixel as usize] * in_pixel.weight
            }));
        }
        let [x, n, d, adjoint] = &columns;
        Ok([rows(py, x)?, rows(py, n)?, rows(py, d)?, rows(py, adjoint)?])
    }

    /// VJP of the cameras for the adjoints δ of the pixels, n × 3: by their eyes, m × 3, by
    /// rotations about these in world space, m × 3, by their focal lengths and their principal
    /// points, m × 2 each.
    #[allow(clippy::type_complexity, reason = "four arrays")]
    fn cameras<'py>(
        &self,
        py: Python<'py>,
        delta: &Bound<'py, PyAny>,
    ) -> PyResult<[Bound<'py, PyArray2<f64>>; 4]> {
        if !self.samples.has_cameras() {
            let expected = "an estimator with derivatives by cameras, such as refined";
            return Err(wrong(ARGUMENTS, "estimator", "one that has none", expected));
        }
        let delta = self.delta(delta)?;
        let count = self.parts.cameras.len();
        let sums = self.parts.with_scene(py, |scene| {
            let mut shader = PartialSum::zero(scene.shader.parameter_count(), 0..0);
            let cameras = Some(CameraAdjoints::new(self.of_pixel.clone(), count));
            let mut adjoints = Adjoints { cameras, ..Adjoints::default() };
            self.samples.vjp(scene, &delta, Pass::Sum, &mut shader, &mut adjoints);
            adjoints.cameras.map_or_else(Vec::new, |cameras| cameras.sums)
        })?;
        let columns = |of: fn(&CameraAdjoint) -> Vec<f64>| {
            let numbers: Vec<f64> = sums.iter().flat_map(of).collect();
            PyArray1::from_slice(py, &numbers).reshape([count, numbers.len() / count])
        };
        Ok([
            columns(|sum| sum.eye.to_array().to_vec())?,
            columns(|sum| sum.rotation.to_array().to_vec())?,
            columns(|sum| sum.focal.to_array().to_vec())?,
            columns(|sum| sum.principal.to_array().to_vec())?,
        ])
    }

    /// VJP of the background: the adjoint of its colour, 3 numbers, or of the colours of all
    /// cameras, m × 3.
    fn background<'py>(
        &self,
        py: Python<'py>,
        delta: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let delta = self.delta(delta)?;
        let count = self.parts.background.parameter_count();
        let mut sum = PartialSum::zero(count, 0..0);
        self.parts.with_scene(py, |scene| {
            let areas = &self.samples.area;
            areas.iter().for_each(|area| area.background_vjp(scene, &delta, &mut sum));
        })?;
        if self.parts.background.uniform().is_some() {
            return Ok(PyArray1::from_vec(py, sum.others).into_any());
        }
        let colours: Vec<DVec3> = sum.others.chunks_exact(3).map(DVec3::from_slice).collect();
        Ok(rows(py, &colours)?.into_any())
    }
}
