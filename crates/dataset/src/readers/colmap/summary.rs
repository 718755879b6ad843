//! A sparse model in numbers, without its images.

use std::path::Path;

use super::model::Model;
use super::records::CameraRecord;
use crate::readers::result::Result;

/// A camera of a sparse model.
#[derive(Clone, Debug, PartialEq)]
pub struct SparseCamera {
    /// The name of its model, for example `SIMPLE_RADIAL`.
    pub model: String,
    /// Width and height in pixels.
    pub size: [u64; 2],
    /// The parameters of the model. The first one is a focal length in pixels.
    pub parameters: Vec<f64>,
}

/// A sparse model in numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct SparseModel {
    /// The names of its images, in alphabetical order.
    pub images: Vec<String>,
    /// The cameras, in the order of the file.
    pub cameras: Vec<SparseCamera>,
    /// The number of points.
    pub points: usize,
    /// The mean over the points of their distance in the images from the places where they were
    /// found, in pixels; `None` if the files do not have it.
    pub reprojection_error: Option<f64>,
}

/// Reads the sparse model in `folder`, binary or text. Its images are not read.
///
/// # Errors
/// If a file of cameras or images is missing, or a file is damaged.
pub fn sparse_model(folder: &Path) -> Result<SparseModel> {
    let model = Model::in_folder(folder);
    let mut images: Vec<String> = model.images()?.into_iter().map(|image| image.name).collect();
    images.sort();
    let camera =
        |c: CameraRecord| SparseCamera { model: c.model, size: c.size, parameters: c.parameters };
    let cameras = model.cameras()?.into_iter().map(camera).collect();
    let points = model.points()?;
    let errors: Vec<f64> =
        points.iter().filter_map(|p| p.error).filter(|e| e.is_finite() && *e >= 0.0).collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let reprojection_error = (!errors.is_empty()).then_some(mean);
    Ok(SparseModel { images, cameras, points: points.len(), reprojection_error })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_sizes_and_the_mean_error_are_those_of_the_files() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            std::fs::write(folder.path().join(name), text).unwrap();
        };
        write("cameras.txt", "# one\n1 SIMPLE_RADIAL 32 24 40 16 12 0.01\n");
        write("images.txt", "1 1 0 0 0 0 0 4 1 b 2.jpg\n\n2 1 0 0 0 0 0 4 1 a.jpg\n\n");
        write(
            "points3D.txt",
            "1 0 0 0 9 9 9 0.25 1 0\n2 1 0 0 9 9 9 0.75 1 1\n3 0 1 0 9 9 9\n4 0 nan 0 9 9 9 5\n",
        );
        let model = sparse_model(folder.path()).unwrap();
        assert_eq!(model.images, ["a.jpg", "b 2.jpg"]);
        assert_eq!((model.points, model.reprojection_error), (3, Some(0.5)));
        let camera = &model.cameras[0];
        assert_eq!((camera.model.as_str(), camera.size), ("SIMPLE_RADIAL", [32, 24]));
        assert_eq!(camera.parameters, [40.0, 16.0, 12.0, 0.01]);
    }
}
