//! NumPy arrays in and out: vectors as rows of three numbers.

use glam::DVec3;
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::failure::wrong;

/// An array n × 3.
pub(crate) fn rows<'py>(py: Python<'py>, v: &[DVec3]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let flat: &[f64] = bytemuck::cast_slice(v);
    PyArray1::from_slice(py, flat).reshape([v.len(), 3])
}

/// The numbers of an array or of anything that NumPy makes an array of, row-major, and its shape.
///
/// # Errors
/// If they are no numbers. `name` says in the message which argument or result it is.
pub(crate) fn numbers(value: &Bound<'_, PyAny>, name: &str) -> PyResult<(Vec<f64>, Vec<usize>)> {
    let py = value.py();
    let array = py.import("numpy")?.call_method1("asarray", (value,))?;
    let dtype = array.getattr("dtype")?;
    let kind: String = dtype.getattr("kind")?.extract()?;
    if !["f", "i", "u", "b"].contains(&kind.as_str()) {
        return Err(wrong(name, "dtype", dtype.str()?, "real numbers"));
    }
    let options = PyDict::new(py);
    options.set_item("order", "C")?;
    options.set_item("copy", false)?;
    let array = array.call_method("astype", ("float64",), Some(&options))?;
    let array = array.cast_into::<PyArrayDyn<f64>>()?;
    let shape = array.shape().to_vec();
    Ok((array.to_vec()?, shape))
}

/// As [`numbers`], of an exact shape.
fn shaped(value: &Bound<'_, PyAny>, name: &str, shape: &[usize]) -> PyResult<Vec<f64>> {
    let (numbers, found) = numbers(value, name)?;
    if found != shape {
        return Err(wrong(name, "shape", tuple(&found), &tuple(shape)));
    }
    Ok(numbers)
}

/// A shape in the notation of Python.
pub(crate) fn tuple(shape: &[usize]) -> String {
    let sides: Vec<String> = shape.iter().map(usize::to_string).collect();
    let comma = if shape.len() == 1 { "," } else { "" };
    format!("({}{comma})", sides.join(", "))
}

/// `n` numbers.
pub(crate) fn read_numbers(value: &Bound<'_, PyAny>, name: &str, n: usize) -> PyResult<Vec<f64>> {
    shaped(value, name, &[n])
}

/// `n` vectors: an array n × 3.
pub(crate) fn read_rows(value: &Bound<'_, PyAny>, name: &str, n: usize) -> PyResult<Vec<DVec3>> {
    let numbers = shaped(value, name, &[n, 3])?;
    Ok(numbers.chunks_exact(3).map(DVec3::from_slice).collect())
}

/// `n` vectors of finite numbers.
pub(crate) fn read_finite_rows(
    value: &Bound<'_, PyAny>,
    name: &str,
    n: usize,
) -> PyResult<Vec<DVec3>> {
    let rows = read_rows(value, name, n)?;
    match rows.iter().position(|row| !row.is_finite()) {
        Some(i) => Err(wrong(name, &format!("row {i}"), rows[i], "finite numbers")),
        None => Ok(rows),
    }
}
