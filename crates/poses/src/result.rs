//! The result: the photographs with poses, and the quality of the model.

use std::path::{Path, PathBuf};

use dataset::readers::{SparseModel, sparse_model};
use files::InputError;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::advice::{FEW_REGISTERED, remedies};
use crate::commands::Options;
use crate::photographs::Photographs;

/// The most names of photographs in a line.
const NAMES: usize = 8;

/// A lens as COLMAP found it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Its model, for example `SIMPLE_RADIAL`.
    pub model: String,
    /// Width and height of its photographs, in pixels.
    pub size: [u64; 2],
    /// Its focal length, in pixels.
    pub focal: f64,
}

/// The poses of a data set, in numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Poses {
    /// The folder of the data set.
    pub dataset: PathBuf,
    /// The number of photographs.
    pub photographs: usize,
    /// The number of photographs with a pose.
    pub registered: usize,
    /// The names of the others.
    pub missing: Vec<String>,
    /// The number of photographs of each model, the largest first. The first one is used.
    pub models: Vec<usize>,
    /// The number of points.
    pub points: usize,
    /// The mean reprojection error of the points, in pixels.
    pub reprojection_error: Option<f64>,
    /// The lenses.
    pub cameras: Vec<Camera>,
    /// Width and height of the first undistorted photograph, in pixels.
    pub undistorted: [u64; 2],
    /// Signs that poses or lenses are wrong, one sentence each.
    #[serde(default)]
    pub warnings: Vec<String>,
    /// Ways to more poses, if there are few.
    pub advice: Vec<String>,
}

/// The least and the largest focal length of a lens, in units of the longer side of its
/// photographs: fields of view of 157 and 3 degrees. COLMAP trusts lenses from 0.1 to 10.
const FOCAL: [f64; 2] = [0.1, 20.0];

/// A warning about lenses that do not exist.
fn lens_warning(cameras: &[Camera]) -> Option<String> {
    let side = |camera: &Camera| camera.size.into_iter().max().unwrap_or(1) as f64;
    let is_wrong =
        |camera: &&Camera| !(FOCAL[0]..=FOCAL[1]).contains(&(camera.focal / side(camera)));
    let first = cameras.iter().find(is_wrong)?;
    let wrong = cameras.iter().filter(is_wrong).count();
    Some(format!(
        "{wrong} of {} lenses cannot be right (a focal length of {:.1} pixels for a side of {}), \
         nor can the poses of their photographs: use one lens for many photographs (--cameras), \
         or photographs with EXIF data",
        cameras.len(),
        first.focal,
        side(first)
    ))
}

/// A path as a word of a shell.
fn shell_word(path: &Path) -> String {
    let word = path.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "-_./+,:@%=".contains(c);
    match !word.is_empty() && word.chars().all(is_plain) {
        true => word,
        false => format!("'{}'", word.replace('\'', "'\\''")),
    }
}

/// The models in a folder of COLMAP's results, the one with the most photographs first.
///
/// # Errors
/// If a model cannot be read.
pub(crate) fn models(folder: &Path) -> Result<Vec<(PathBuf, SparseModel)>, InputError> {
    let numbers = (0..).map(|number: u32| folder.join(number.to_string()));
    let folders = numbers.take_while(|path| path.is_dir());
    let mut models = Vec::new();
    for folder in folders {
        let model = sparse_model(&folder)?;
        models.push((folder, model));
    }
    models.sort_by_key(|(_, model)| std::cmp::Reverse(model.images.len()));
    Ok(models)
}

impl Poses {
    /// The poses of a data set whose steps are done. `found` are its models, the used one first.
    ///
    /// # Errors
    /// If the undistorted model cannot be read.
    pub(crate) fn new(
        dataset: &Path,
        photographs: &Photographs,
        found: &[SparseModel],
        options: &Options,
    ) -> Result<Self, Error> {
        let undistorted = sparse_model(&dataset.join("sparse"))?;
        let Some(model) = found.first() else {
            return Err(Error::Colmap(format!("no model in {}", dataset.display())));
        };
        let has_no_pose = |name: &&String| model.images.binary_search(name).is_err();
        let names = photographs.files.iter().map(|file| &file.name);
        let missing: Vec<String> = names.filter(has_no_pose).cloned().collect();
        let (all, registered) = (photographs.count(), model.images.len());
        let is_few = (registered as f64) < FEW_REGISTERED * all as f64;
        let advice = if is_few { remedies(options.matching_of(all)) } else { Vec::new() };
        let camera = |c: &dataset::readers::SparseCamera| Camera {
            model: c.model.clone(),
            size: c.size,
            focal: c.parameters.first().copied().unwrap_or(0.0),
        };
        let cameras: Vec<Camera> = model.cameras.iter().map(camera).collect();
        Ok(Poses {
            dataset: dataset.to_owned(),
            photographs: all,
            registered,
            missing,
            models: found.iter().map(|model| model.images.len()).collect(),
            points: model.points,
            reprojection_error: model.reprojection_error,
            undistorted: undistorted.cameras.first().map_or([0; 2], |camera| camera.size),
            warnings: lens_warning(&cameras).into_iter().collect(),
            cameras,
            advice: advice.into_iter().map(str::to_owned).collect(),
        })
    }

    /// The result in rows: a label of 13 columns, then a sentence.
    pub fn text(&self) -> String {
        let share = 100.0 * self.registered as f64 / self.photographs.max(1) as f64;
        let (registered, all) = (self.registered, self.photographs);
        let mut rows =
            vec![format!("registered   {registered} of {all} photographs ({share:.0} %)")];
        if !self.missing.is_empty() {
            rows.push(format!("missing      {}", shortened(&self.missing)));
        }
        if let [first, others @ ..] = self.models.as_slice()
            && !others.is_empty()
        {
            let others: Vec<String> = others.iter().map(usize::to_string).collect();
            rows.push(format!(
                "models       {}: the one with {first} photographs is used; the others have {}",
                self.models.len(),
                others.join(", ")
            ));
        }
        let error = self
            .reprojection_error
            .map_or(String::new(), |e| format!(", mean reprojection error {e:.2} pixels"));
        rows.push(format!("points       {}{error}", self.points));
        rows.push(format!("camera       {}", self.camera_text()));
        let [width, height] = self.undistorted;
        let dataset = self.dataset.display();
        rows.push(format!("data set     {dataset}: undistorted, {width} x {height} pixels"));
        for warning in &self.warnings {
            rows.push(format!("WARNING      {warning}"));
        }
        for advice in &self.advice {
            rows.push(format!("ADVICE       {advice}"));
        }
        let word = shell_word(&self.dataset);
        rows.push(format!("next         dsdf inspect {word} -o inspect.png"));
        rows.join("\n")
    }

    fn camera_text(&self) -> String {
        let Some(first) = self.cameras.first() else { return "none".to_owned() };
        let focals = || self.cameras.iter().map(|camera| camera.focal);
        let (least, most) = (focals().fold(f64::MAX, f64::min), focals().fold(0.0, f64::max));
        match self.cameras.len() {
            1 => {
                let [width, height] = first.size;
                let focal = first.focal;
                format!("{}, focal length {focal:.1} of {width} x {height} pixels", first.model)
            }
            n => format!("{n} of {}, focal lengths {least:.1} to {most:.1} pixels", first.model),
        }
    }
}

/// The first names of a list, and the number of the others.
fn shortened(names: &[String]) -> String {
    let shown = names.iter().take(NAMES).map(String::as_str).collect::<Vec<_>>().join(", ");
    match names.len().saturating_sub(NAMES) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_names_the_missing_ones_the_models_and_the_advice() {
        let camera = Camera { model: "SIMPLE_RADIAL".into(), size: [320, 240], focal: 342.51 };
        let mut poses = Poses {
            dataset: "data".into(),
            photographs: 48,
            registered: 30,
            missing: (0..10).map(|i| format!("{i}.jpg")).collect(),
            models: vec![30, 8],
            points: 1612,
            reprojection_error: Some(0.493),
            cameras: vec![camera.clone()],
            undistorted: [318, 238],
            warnings: vec!["a lens".into()],
            advice: vec!["more photographs".into()],
        };
        let text = poses.text();
        for row in [
            "registered   30 of 48 photographs (62 %)",
            "missing      0.jpg, 1.jpg, 2.jpg, 3.jpg, 4.jpg, 5.jpg, 6.jpg, 7.jpg and 2 more",
            "models       2: the one with 30 photographs is used; the others have 8",
            "points       1612, mean reprojection error 0.49 pixels",
            "camera       SIMPLE_RADIAL, focal length 342.5 of 320 x 240 pixels",
            "data set     data: undistorted, 318 x 238 pixels",
            "WARNING      a lens",
            "ADVICE       more photographs",
            "next         dsdf inspect data -o inspect.png",
        ] {
            assert!(text.lines().any(|line| line == row), "{row}\n{text}");
        }
        assert_eq!(lens_warning(&poses.cameras), None);
        let odd = [camera.clone(), Camera { focal: 3.4e8, ..camera.clone() }];
        let warning = lens_warning(&odd).unwrap();
        assert!(warning.starts_with("1 of 2 lenses cannot be right (a focal length of 3"));
        assert_eq!(shell_word(Path::new("a b/it's")), r"'a b/it'\''s'");
        poses.cameras.push(Camera { focal: 400.0, ..camera });
        let expected = "2 of SIMPLE_RADIAL, focal lengths 342.5 to 400.0 pixels";
        assert_eq!(poses.camera_text(), expected);
    }
}
