//! Files of images, meshes and data sets.

use std::path::{Path, PathBuf};

use dataset::{LoadOptions, View};
use film::Film;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;

use crate::arrays::{numbers, rows, tuple};
use crate::camera::Camera;
use crate::failure::{of_anyhow, wrong, wrong_input};
use crate::pool;

/// An image, linear RGB: float32, height × width × 3.
type Image<'py> = Bound<'py, PyArray3<f32>>;

fn image_array<'py>(py: Python<'py>, film: &Film) -> PyResult<Image<'py>> {
    let shape = [film.height as usize, film.width as usize, 3];
    PyArray1::from_slice(py, film.pixels.as_flattened()).reshape(shape)
}

/// Reads an image as linear RGB, height × width × 3.
#[pyfunction]
pub(crate) fn read_image(py: Python<'_>, path: PathBuf) -> PyResult<Image<'_>> {
    let (film, _) = film::read_image(&path).map_err(wrong_input)?;
    image_array(py, &film)
}

/// Refuses a path that no image can be written to.
#[pyfunction]
pub(crate) fn check_image(path: PathBuf) -> PyResult<()> {
    if !["png", "exr", "npy"].contains(&files::extension(&path).as_str()) {
        let found = format!("extension \"{}\"", files::extension(&path));
        return Err(wrong(&path.to_string_lossy(), "output", found, ".png, .exr, .npy"));
    }
    files::check_output(&path).map_err(|error| of_anyhow(&error.into()))
}

/// Writes an image: .png as sRGB, .exr and .npy linear.
#[pyfunction]
pub(crate) fn write_image(path: PathBuf, image: &Bound<'_, PyAny>) -> PyResult<()> {
    let (numbers, shape) = numbers(image, "image")?;
    let size = match shape.as_slice() {
        [height, width, 3] if *height > 0 && *width > 0 => [*width, *height].map(u32::try_from),
        _ => return Err(wrong("image", "shape", tuple(&shape), "(height, width, 3)")),
    };
    let [Ok(width), Ok(height)] = size else {
        return Err(wrong("image", "shape", tuple(&shape), "sides below 2^32"));
    };
    let pixels = numbers.chunks_exact(3).map(|p| [p[0] as f32, p[1] as f32, p[2] as f32]);
    let film = Film { width, height, pixels: pixels.collect() };
    film::write_image(&path, &film).map_err(|error| of_anyhow(&error.into()))
}

/// Vertices, n × 3 in the units of the file, and faces, m × 3.
type Mesh<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<u32>>);

/// Reads the vertices and the faces of a mesh.
#[pyfunction]
pub(crate) fn read_mesh(py: Python<'_>, path: PathBuf) -> PyResult<Mesh<'_>> {
    let mesh = py.detach(|| mesh::read_mesh(&path)).map_err(wrong_input)?;
    let vertices: Vec<_> = mesh.vertices.iter().map(|v| v.as_dvec3() + mesh.origin).collect();
    let faces = PyArray1::from_slice(py, mesh.faces.as_flattened());
    Ok((rows(py, &vertices)?, faces.reshape([mesh.faces.len(), 3])?))
}

/// A photograph: name, camera, image, coverage by the object (height × width) or `None`.
type Photograph<'py> = (String, Camera, Image<'py>, Option<Bound<'py, PyArray2<f32>>>);

fn photograph<'py>(py: Python<'py>, view: &View) -> PyResult<Photograph<'py>> {
    let shape = [view.image.height as usize, view.image.width as usize];
    let coverage = view.coverage().map(|c| PyArray1::from_slice(py, c).reshape(shape));
    let image = image_array(py, &view.image)?;
    Ok((view.name.clone(), Camera(view.camera), image, coverage.transpose()?))
}

/// Reads a data set at 1/`downscale` of its size: the photographs to fit, and the held-out ones.
#[pyfunction]
#[allow(clippy::type_complexity, reason = "two lists of photographs")]
pub(crate) fn read_dataset(
    py: Python<'_>,
    path: PathBuf,
    downscale: u32,
) -> PyResult<(Vec<Photograph<'_>>, Vec<Photograph<'_>>)> {
    if downscale == 0 {
        return Err(wrong("arguments", "downscale", 0, "1 or more"));
    }
    let load = |path: &Path| dataset::load(path, &LoadOptions { downscale });
    let dataset = py.detach(|| pool::run(|| load(&path))).map_err(wrong_input)?;
    let list = |views: &[View]| -> PyResult<Vec<_>> {
        views.iter().map(|view| photograph(py, view)).collect()
    };
    Ok((list(&dataset.train)?, list(&dataset.test)?))
}
