//! The file `cameras.json` of a run folder: the cameras as a fit refined them.

use std::path::Path;

use dataset::{Dataset, View};
use files::{InputError, WriteError};
use glam::{DMat4, DVec2, DVec3};
use multiview::calibrate::{Calibration, Correction};
use render::Camera;
use serde::{Deserialize, Serialize};

use crate::run_folder::RunFolder;
use crate::run_json;

/// The content of `cameras.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunCameras {
    /// The training views.
    pub views: Vec<RunCamera>,
}

/// The camera of a view as a fit refined it, and its correction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunCamera {
    /// The name of the view.
    pub name: String,
    /// The camera-to-world matrix, row-major, in the units of the data set: x right, y up, looking
    /// along −z.
    pub pose: [[f64; 4]; 4],
    /// The width and the height of the photograph as the fit read it, in pixels.
    pub size: [u32; 2],
    /// The focal lengths, in pixels.
    pub focal: [f64; 2],
    /// The principal point, in pixels.
    pub principal: [f64; 2],
    /// The radial distortion k₁, k₂; see [`Camera::radial`].
    pub radial: [f64; 2],
    /// The angle of the correction, in degrees.
    pub degrees: f64,
    /// The shift of the eye by the correction, in the units of the data set.
    pub shift: [f64; 3],
    /// The motion of the bounding sphere's centre in the image by the correction, in pixels.
    pub pixels: f64,
}

impl RunCameras {
    /// The corrected cameras of these views, which are relative to `origin`.
    pub(crate) fn new(views: &[View], calibration: &Calibration, origin: DVec3) -> Self {
        let cameras = calibration.cameras().into_iter().zip(calibration.corrections());
        let of_view = |(view, (camera, correction)): (&View, (Camera, Correction))| {
            let Correction { degrees, shift, pixels } = correction;
            RunCamera {
                name: view.name.clone(),
                pose: camera.about(-origin).pose().transpose().to_cols_array_2d(),
                size: [camera.width, camera.height],
                focal: camera.focal.to_array(),
                principal: camera.principal.to_array(),
                radial: camera.radial.to_array(),
                degrees,
                shift,
                pixels,
            }
        };
        RunCameras { views: views.iter().zip(cameras).map(of_view).collect() }
    }

    pub(crate) fn save(&self, run: &RunFolder) -> Result<(), WriteError> {
        run_json::save(&run.cameras(), self)
    }

    /// The refined cameras of a run; `None` if they are those of the data set.
    ///
    /// # Errors
    /// If the file is there and cannot be read, or has a wrong entry.
    pub fn load(run: &Path) -> Result<Option<Self>, InputError> {
        run_json::load(&RunFolder::new(run).cameras(), "cameras")
    }

    /// The camera of a view, which has its name.
    fn of(&self, view: &View) -> Option<&RunCamera> {
        self.views.iter().find(|own| own.name == view.name)
    }

    /// All cameras, relative to `origin`. `run` is the folder of the run.
    ///
    /// # Errors
    /// If an entry is no camera.
    pub fn cameras(&self, origin: DVec3, run: &Path) -> Result<Vec<Camera>, InputError> {
        self.views.iter().map(|own| Ok(own.camera(run)?.about(origin))).collect()
    }

    /// Checks that the photographs to fit have the sizes of the run: a fit stores its corrections
    /// in pixels.
    ///
    /// # Errors
    /// Names the first photograph of another size.
    pub fn check_sizes(&self, dataset: &Dataset, run: &Path) -> Result<(), InputError> {
        for view in &dataset.train {
            let Camera { width, height, .. } = view.camera;
            let own = self.of(view).filter(|own| own.size != [width, height]);
            if let Some(RunCamera { size, .. }) = own {
                let found = format!("{width} x {height} pixels");
                let path = RunFolder::new(run).cameras();
                let expected = format!("{} x {}, as in {}", size[0], size[1], path.display());
                return Err(InputError::new(&view.path, "size", found, expected));
            }
        }
        Ok(())
    }

    /// Whether it has a camera of each training view of a data set.
    pub fn has_views_of(&self, dataset: &Dataset) -> bool {
        dataset.train.iter().all(|view| self.of(view).is_some())
    }

    /// Gives the views of a data set their refined cameras: training views by their names, held-out
    /// views the lens of a training view that was given the same intrinsics. The photographs may
    /// have another size than those of the run. The data set is relative to `origin`. `run` is the
    /// folder of the run, for the message of an error.
    ///
    /// # Errors
    /// If the file lacks a view, or an entry is no camera.
    pub fn apply(
        &self,
        dataset: &mut Dataset,
        origin: DVec3,
        run: &Path,
    ) -> Result<(), InputError> {
        let given: Vec<Camera> = dataset.train.iter().map(|view| view.camera).collect();
        for view in &mut dataset.train {
            let own = self.of(view).ok_or_else(|| wrong(run, &view.name, "nothing"))?;
            let Camera { width, height, .. } = view.camera;
            view.camera = at_size(&own.camera(run)?.about(origin), [width, height]);
        }
        for view in &mut dataset.test {
            let first = given.iter().position(|given| given.has_lens_of(&view.camera));
            if let Some(first) = first {
                let Camera { focal, principal, radial, .. } = dataset.train[first].camera;
                view.camera = Camera { focal, principal, radial, ..view.camera };
            }
        }
        Ok(())
    }
}

/// The camera of the same photograph at another size: at 1/n of it, as photographs are read, or
/// else over the same field of view.
fn at_size(camera: &Camera, [width, height]: [u32; 2]) -> Camera {
    let n = (f64::from(camera.width) / f64::from(width)).round().max(1.0) as u32;
    let is_nth = [camera.width.div_ceil(n), camera.height.div_ceil(n)] == [width, height];
    if is_nth { camera.reduced(n, width, height) } else { camera.resized(width, height) }
}

/// The error of a view of the file in the folder `run`.
fn wrong(run: &Path, name: &str, found: &str) -> InputError {
    let field = format!("cameras: {name}");
    InputError::new(RunFolder::new(run).cameras(), field, found, "a camera of each view to fit")
}

impl RunCamera {
    /// The camera, in the units of the data set. `run` is the folder of the run.
    fn camera(&self, run: &Path) -> Result<Camera, InputError> {
        self.checked().ok_or_else(|| wrong(run, &self.name, "numbers that are no camera"))
    }

    fn checked(&self) -> Option<Camera> {
        let [width, height] = self.size;
        let [focal, principal, radial] = [self.focal, self.principal, self.radial].map(DVec2::from);
        let is_lens = focal.is_finite() && focal.min_element() > 0.0 && width.min(height) > 0;
        if !(is_lens && principal.is_finite() && radial.is_finite()) {
            return None;
        }
        let pose = DMat4::from_cols_array_2d(&self.pose).transpose();
        let camera = Camera::from_pose(width, height, focal, principal, pose)?;
        Some(Camera { radial, ..camera })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A photograph that is read at 1/5 of 32 × 48 pixels has 7 × 10 of them, and the last ones
    /// reach over its border.
    #[test]
    fn cameras_of_smaller_photographs_have_the_same_rays() {
        let (focal, principal) = (DVec2::splat(40.0), DVec2::new(16.0, 24.0));
        let camera = Camera::from_pose(32, 48, focal, principal, DMat4::IDENTITY).unwrap();
        let at = |size| {
            let Camera { width, height, focal, principal, .. } = at_size(&camera, size);
            ([width, height], focal.to_array(), principal.to_array())
        };
        assert_eq!(at([32, 48]), ([32, 48], [40.0; 2], [16.0, 24.0]));
        assert_eq!(at([7, 10]), ([7, 10], [8.0; 2], [3.2, 4.8]));
        assert_eq!(at([16, 36]), ([16, 36], [20.0, 30.0], [8.0, 18.0]));
        assert_eq!(at([64, 96]), ([64, 96], [80.0; 2], [32.0, 48.0]));
    }
}
