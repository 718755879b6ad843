//! NumPy arrays in and out: vectors as rows of three numbers.

use glam::DVec3;
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyBufferError, PyRuntimeError, PyValueError};
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
    numbers_of(value, name, "fiub")
}

/// As [`numbers`], with these kinds of NumPy types: `f` floating point, `i` and `u` whole numbers,
/// `b` booleans.
fn numbers_of(
    value: &Bound<'_, PyAny>,
    name: &str,
    kinds: &str,
) -> PyResult<(Vec<f64>, Vec<usize>)> {
    let py = value.py();
    let numpy = py.import("numpy")?;
    if numpy.getattr("ma")?.call_method1("isMaskedArray", (value,))?.extract()? {
        // Its mask would be lost.
        return Err(wrong(name, "array", "a masked array", "an array without a mask"));
    }
    // NumPy itself knows lists, buffers and `__array__`. DLPack is shared memory as well.
    let is_dlpack = !value.hasattr("__array__")? && value.hasattr("__dlpack__")?;
    let maker = if is_dlpack { "from_dlpack" } else { "asarray" };
    let array = numpy.call_method1(maker, (value,)).map_err(|error| {
        // Rows of several lengths, for example. Other exceptions pass through.
        if error.is_instance_of::<PyValueError>(py) {
            wrong(name, "array", error.value(py), "an array of numbers")
        } else if is_dlpack && is_of_dlpack(py, &error) {
            wrong(name, "array", error.value(py), "an array of numbers in the memory of the CPU")
        } else {
            error
        }
    })?;
    let dtype = array.getattr("dtype")?;
    let kind: String = dtype.getattr("kind")?.extract()?;
    if !kinds.contains(&kind) {
        let expected = if kinds == "f" { "floating-point numbers" } else { "real numbers" };
        return Err(wrong(name, "dtype", dtype.str()?, expected));
    }
    let options = PyDict::new(py);
    options.set_item("order", "C")?;
    options.set_item("copy", false)?;
    let array = array.call_method("astype", ("float64",), Some(&options))?;
    let array = array.cast_into::<PyArrayDyn<f64>>()?;
    let shape = array.shape().to_vec();
    Ok((array.to_vec()?, shape))
}

/// Whether an error tells that an array cannot be shared: by the protocol, or by NumPy.
fn is_of_dlpack(py: Python<'_>, error: &PyErr) -> bool {
    error.is_instance_of::<PyBufferError>(py)
        || error.is_instance_of::<PyRuntimeError>(py)
            && error.value(py).to_string().starts_with("Unsupported")
}

/// Floating-point numbers of an exact shape, the result of a method; or any, as an argument.
fn shaped(
    value: &Bound<'_, PyAny>,
    name: &str,
    shape: &[usize],
    kinds: &str,
) -> PyResult<Vec<f64>> {
    let (numbers, found) = numbers_of(value, name, kinds)?;
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
    shaped(value, name, &[n], "fiub")
}

/// `n` numbers that a method returned: whole numbers and booleans are those of a mistake, for
/// example of a comparison.
pub(crate) fn result_numbers(value: &Bound<'_, PyAny>, name: &str, n: usize) -> PyResult<Vec<f64>> {
    shaped(value, name, &[n], "f")
}

/// `n` vectors that a method returned: an array n × 3.
pub(crate) fn result_rows(value: &Bound<'_, PyAny>, name: &str, n: usize) -> PyResult<Vec<DVec3>> {
    let numbers = shaped(value, name, &[n, 3], "f")?;
    Ok(numbers.chunks_exact(3).map(DVec3::from_slice).collect())
}

/// `n` vectors of finite numbers that a method returned.
pub(crate) fn finite_result_rows(
    value: &Bound<'_, PyAny>,
    name: &str,
    n: usize,
) -> PyResult<Vec<DVec3>> {
    finite(result_rows(value, name, n)?, name)
}

/// `n` vectors of finite numbers: an array n × 3.
pub(crate) fn read_finite_rows(
    value: &Bound<'_, PyAny>,
    name: &str,
    n: usize,
) -> PyResult<Vec<DVec3>> {
    let numbers = shaped(value, name, &[n, 3], "fiub")?;
    finite(numbers.chunks_exact(3).map(DVec3::from_slice).collect(), name)
}

fn finite(rows: Vec<DVec3>, name: &str) -> PyResult<Vec<DVec3>> {
    match rows.iter().position(|row| !row.is_finite()) {
        Some(i) => Err(wrong(name, &format!("row {i}"), rows[i], "finite numbers")),
        None => Ok(rows),
    }
}
