//! Numbers of `.npy` arrays in double precision.

use std::io::{Read, Result};

/// The numbers of an array in single or double precision, in the order of the file.
///
/// # Errors
/// If the array has another type or is cut short.
pub(crate) fn numbers<R: Read>(npy: film::NpyReader<R>) -> Result<Vec<f64>> {
    if npy.dtype().descr().contains("f8") {
        return npy.into_vec();
    }
    npy.into_vec::<f32>().map(|v| v.into_iter().map(f64::from).collect())
}
