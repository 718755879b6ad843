//! Python objects as a field and as a shader.

use field::Shader;
use field::{Field, Sphere, SurfaceAdjoint, SurfaceBatch};
use glam::DVec3;
use pyo3::prelude::*;
use pyo3::types::{PyList, PyTuple};

use crate::arrays::{finite_result_rows, result_numbers, result_rows, rows};
use crate::failure::{Failure, wrong};

/// A Python object, and the first exception of its methods.
pub(crate) struct Callbacks<'a> {
    /// The name of the object in messages.
    pub(crate) name: &'static str,
    pub(crate) object: &'a Py<PyAny>,
    pub(crate) failure: &'a Failure,
}

impl Callbacks<'_> {
    /// Calls a method with a whole batch: arrays n × 3. `read` reads its N results, of which
    /// several are a tuple. `None` after an exception, of this call or of an earlier one.
    fn call<T, const N: usize>(
        &self,
        method: &str,
        batch: &[&[DVec3]],
        read: impl FnOnce([Bound<'_, PyAny>; N]) -> PyResult<T>,
    ) -> Option<T> {
        if self.failure.is_set() {
            return None;
        }
        let result = Python::attach(|py| {
            let arrays: PyResult<Vec<_>> = batch.iter().map(|v| rows(py, v)).collect();
            let result = self.object.bind(py).call_method1(method, PyTuple::new(py, arrays?)?)?;
            read(self.unpack(method, result)?)
        });
        result.map_err(|error| self.failure.keep(error)).ok()
    }

    /// The N results of a method.
    fn unpack<'py, const N: usize>(
        &self,
        method: &str,
        result: Bound<'py, PyAny>,
    ) -> PyResult<[Bound<'py, PyAny>; N]> {
        let is_list = result.is_instance_of::<PyTuple>() || result.is_instance_of::<PyList>();
        let items: Vec<Bound<'py, PyAny>> = match N > 1 && is_list {
            true => result.try_iter()?.collect::<PyResult<_>>()?,
            false => vec![result],
        };
        let found = items.len();
        items.try_into().map_err(|_| {
            let place = format!("{}.{method}", self.name);
            wrong(&place, "result", format!("{found}"), &format!("a tuple of {N} arrays"))
        })
    }
}

/// A Python object with `value`, `value_gradient` and `hessian_vector`, as a field.
///
/// It has no parameters here: their derivatives are taken in Python.
pub(crate) struct PyField<'a> {
    pub(crate) callbacks: Callbacks<'a>,
    /// The ball in which the field is defined, world units.
    pub(crate) ball: Sphere<f64>,
}

impl Field<f64> for PyField<'_> {
    fn parameter_count(&self) -> usize {
        0
    }

    fn bounds(&self) -> Option<Sphere<f64>> {
        Some(self.ball)
    }

    fn value(&self, x: &[DVec3], f: &mut [f64]) {
        if x.is_empty() {
            return;
        }
        let found = self
            .callbacks
            .call("value", &[x], |[value]| result_numbers(&value, "field.value", x.len()));
        match found {
            Some(value) => f.copy_from_slice(&value),
            None => f.fill(f64::NAN),
        }
    }

    fn value_gradient(&self, x: &[DVec3], f: &mut [f64], gradient: &mut [DVec3]) {
        if x.is_empty() {
            return;
        }
        let found = self.callbacks.call("value_gradient", &[x], |[value, slope]| {
            let value = result_numbers(&value, "field.value_gradient, value", x.len())?;
            Ok((value, result_rows(&slope, "field.value_gradient, gradient", x.len())?))
        });
        match found {
            Some((value, slope)) => {
                f.copy_from_slice(&value);
                gradient.copy_from_slice(&slope);
            }
            None => {
                f.fill(f64::NAN);
                gradient.fill(DVec3::NAN);
            }
        }
    }

    fn hessian_vector(
        &self,
        x: &[DVec3],
        p: &[DVec3],
        gradient: &mut [DVec3],
        product: &mut [DVec3],
    ) {
        if x.is_empty() {
            return;
        }
        let found = self.callbacks.call("hessian_vector", &[x, p], |[slope, turned]| {
            let slope = result_rows(&slope, "field.hessian_vector, gradient", x.len())?;
            Ok((slope, result_rows(&turned, "field.hessian_vector, product", x.len())?))
        });
        match found {
            Some((slope, turned)) => {
                gradient.copy_from_slice(&slope);
                product.copy_from_slice(&turned);
            }
            None => {
                gradient.fill(DVec3::NAN);
                product.fill(DVec3::NAN);
            }
        }
    }

    fn parameter_vjp(&self, _: &[DVec3], _: &[f64], _: &[DVec3], _: &mut [f64]) {}
}

/// A Python object with `radiance` and `vjp`, as a shader.
///
/// It has no parameters here: their derivatives are taken in Python.
pub(crate) struct PyShader<'a>(pub(crate) Callbacks<'a>);

impl Shader<f64> for PyShader<'_> {
    fn parameter_count(&self) -> usize {
        0
    }

    fn radiance(&self, points: &SurfaceBatch<'_, f64>, rgb: &mut [DVec3]) {
        if points.is_empty() {
            return;
        }
        let SurfaceBatch { x, normal, direction } = *points;
        let found = self.0.call("radiance", &[x, normal, direction], |[radiance]| {
            finite_result_rows(&radiance, "shader.radiance", x.len())
        });
        match found {
            Some(found) => rgb.copy_from_slice(&found),
            None => rgb.fill(DVec3::NAN),
        }
    }

    fn vjp(
        &self,
        points: &SurfaceBatch<'_, f64>,
        adjoint: &[DVec3],
        bars: &mut SurfaceAdjoint<f64>,
        _: &mut [f64],
    ) {
        if points.is_empty() {
            return;
        }
        let SurfaceBatch { x, normal, direction } = *points;
        let found = self.0.call("vjp", &[x, normal, direction, adjoint], |bars| {
            let [x_bar, normal_bar, direction_bar] = bars;
            let read = |bar, name: &str| finite_result_rows(&bar, name, x.len());
            Ok(SurfaceAdjoint {
                x: read(x_bar, "shader.vjp, adjoint of x")?,
                normal: read(normal_bar, "shader.vjp, adjoint of n")?,
                direction: read(direction_bar, "shader.vjp, adjoint of d")?,
            })
        });
        *bars = found.unwrap_or_else(|| SurfaceAdjoint::zeros(x.len()));
    }
}
