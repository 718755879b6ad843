//! The native part of the Python package `dsdf`.
//!
//! It has the records of estimators for fields and shaders that are Python objects, the commands of
//! `dsdf`, and files of images, meshes and data sets. The Python part (`python/dsdf`) gives them
//! their names and documentation.

mod arrays;
mod callbacks;
mod camera;
mod command;
mod failure;
mod files;
mod pool;
mod record;

use pyo3::prelude::*;

/// The tracer allocates and frees batches of other sizes all the time, as in the program `dsdf`.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::camera::Camera;
    #[pymodule_export]
    use crate::command::run;
    #[pymodule_export]
    use crate::failure::InputError;
    #[pymodule_export]
    use crate::files::{check_image, read_dataset, read_image, read_mesh, write_image};
    #[pymodule_export]
    use crate::record::{Record, record};
}
