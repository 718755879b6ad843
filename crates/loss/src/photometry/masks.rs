//! The use of masks in a fit.

use std::path::Path;

use dataset::{Dataset, Mask, MaskKind, View};
use files::InputError;
use serde::{Deserialize, Serialize};

/// The choice of a use for masks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum MaskChoice {
    /// Use alpha channels, masks of pixels to leave out, and masks of the object if each view has
    /// one and the background is neither uniform nor chosen
    #[default]
    Auto,
    /// Use the masks, of whatever kind; masks must be there
    Use,
    /// Use no masks; `eval` compares with them
    Ignore,
}

/// The use of the masks of a data set in a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MaskUse {
    /// No use.
    None,
    /// The coverage of the object: it is composited over a colour that changes from iteration to
    /// iteration, and the model is rendered in front of the same colour.
    Coverage,
    /// Pixels are left out.
    LeaveOut,
}

/// The least share of the views whose masks must have pixels of the object and of the background.
const CUT_VIEWS: f64 = 0.5;

/// A pixel of less coverage shows the background rather than the object.
const HALF: f32 = 0.5;

impl MaskChoice {
    /// The use of the masks of a data set. `is_uniform` tells whether its photographs have uniform
    /// backgrounds; `source` is the origin of the choice, for the message of the error.
    ///
    /// # Errors
    /// If masks must be used, none leaves pixels out, and those of the object are missing in a
    /// training view or are the same everywhere in most.
    pub fn resolve(
        self,
        dataset: &Dataset,
        is_uniform: bool,
        source: &Path,
    ) -> Result<MaskUse, InputError> {
        let views = &dataset.train;
        let covered = covered(views);
        let all_equal = covered == views.len() && !cut_out(views);
        let found = if covered == views.len() && !all_equal {
            MaskUse::Coverage
        } else if has_kind(views, MaskKind::Used) {
            MaskUse::LeaveOut
        } else {
            MaskUse::None
        };
        let objects = has_kind(views, MaskKind::Object);
        match self {
            MaskChoice::Ignore => Ok(MaskUse::None),
            MaskChoice::Use if found == MaskUse::None => {
                let found = match all_equal {
                    true => "use, and masks that are the same everywhere in most views".to_owned(),
                    false => {
                        let first = views.iter().find(|view| view.coverage().is_none());
                        let name = first.map_or("", |view| &view.name);
                        let (all, path) = (views.len(), dataset.path.display());
                        format!(
                            "use, and masks for {covered} of {all} views of {path}, none for {name}"
                        )
                    }
                };
                let expected = "a mask or an alpha channel of the object for each view to fit";
                Err(InputError::new(source, "masks", found, expected))
            }
            MaskChoice::Auto if found == MaskUse::Coverage => {
                Ok(if objects && is_uniform { MaskUse::None } else { found })
            }
            MaskChoice::Use | MaskChoice::Auto => Ok(found),
        }
    }
}

/// Refuses a data set without the masks for this use. `source` is the `fit.toml` of the run.
///
/// # Errors
/// If a training view lacks its mask, or none leaves pixels out.
pub fn check_masks(wanted: MaskUse, dataset: &Dataset, source: &Path) -> Result<(), InputError> {
    let (views, covered) = (&dataset.train, covered(&dataset.train));
    let (holds, expected) = match wanted {
        MaskUse::None => return Ok(()),
        MaskUse::Coverage => (covered == views.len(), "a mask for each view, as in this run"),
        MaskUse::LeaveOut => {
            (has_kind(views, MaskKind::Used), "masks of pixels to leave out, as in this run")
        }
    };
    let found =
        format!("a data set with masks of the object for {covered} of {} views", views.len());
    if holds { Ok(()) } else { Err(InputError::new(source, "masks", found, expected)) }
}

/// The number of views with the coverage of the object.
fn covered(views: &[View]) -> usize {
    views.iter().filter(|view| view.coverage().is_some()).count()
}

/// Whether a view has a mask of this kind.
fn has_kind(views: &[View], kind: MaskKind) -> bool {
    views.iter().any(|view| view.mask.as_ref().is_some_and(|mask| mask.kind == kind))
}

/// Whether most masks have pixels of the object and pixels of the background.
fn cut_out(views: &[View]) -> bool {
    let has_both = |coverage: &[f32]| {
        coverage.iter().any(|c| *c < HALF) && coverage.iter().any(|c| *c >= HALF)
    };
    let cut = views.iter().filter(|view| view.coverage().is_some_and(has_both)).count();
    cut as f64 >= CUT_VIEWS * views.len() as f64
}

/// Multiplies each photograph with the coverage of its mask: the object over black, as if it had an
/// alpha channel.
pub fn put_over_black(views: &mut [View]) {
    for view in views {
        if let Some(Mask { kind: kind @ MaskKind::Object, values }) = &mut view.mask {
            for (pixel, coverage) in view.image.pixels.iter_mut().zip(values) {
                *pixel = pixel.map(|c| c * *coverage);
            }
            *kind = MaskKind::Alpha;
        }
    }
}

#[cfg(test)]
mod tests {
    use film::Film;
    use glam::{DVec2, DVec3};
    use render::Camera;

    use super::*;

    /// Views with the given masks of two pixels.
    fn dataset(masks: &[Option<(MaskKind, [f32; 2])>]) -> Dataset {
        let camera = Camera::look_at(2, 1, DVec2::ONE, DVec2::ONE, DVec3::Z, DVec3::ZERO, DVec3::Y);
        let view = |mask: &Option<(MaskKind, [f32; 2])>| View {
            name: String::new(),
            path: "0.png".into(),
            camera: camera.unwrap(),
            image: Film { width: 2, height: 1, pixels: vec![[0.4; 3]; 2] },
            mask: mask.map(|(kind, values)| Mask { kind, values: values.to_vec() }),
        };
        Dataset {
            path: "data".into(),
            format: String::new(),
            train: masks.iter().map(view).collect(),
            test: Vec::new(),
            bounds: None,
            points: Vec::new(),
            is_sure: Vec::new(),
            notes: Vec::new(),
        }
    }

    #[test]
    fn the_use_follows_the_kind_of_the_masks_and_the_background() {
        let of = |kind| Some((kind, [0.0, 1.0]));
        let opaque = Some((MaskKind::Alpha, [1.0; 2]));
        let (alpha, object, used) = (of(MaskKind::Alpha), of(MaskKind::Object), of(MaskKind::Used));
        let cases = [
            (vec![alpha, alpha], [MaskUse::Coverage; 2], Some(MaskUse::Coverage)),
            (vec![alpha, opaque], [MaskUse::Coverage; 2], Some(MaskUse::Coverage)),
            (vec![opaque, opaque], [MaskUse::None; 2], None),
            (vec![object, object], [MaskUse::None, MaskUse::Coverage], Some(MaskUse::Coverage)),
            (vec![used, None], [MaskUse::LeaveOut; 2], Some(MaskUse::LeaveOut)),
            (vec![object, None], [MaskUse::None; 2], None),
            (vec![None, None], [MaskUse::None; 2], None),
        ];
        for (masks, auto, forced) in cases {
            let data = dataset(&masks);
            let resolve = |choice: MaskChoice, is_uniform| {
                choice.resolve(&data, is_uniform, Path::new("arguments"))
            };
            let found = [true, false].map(|uniform| resolve(MaskChoice::Auto, uniform).unwrap());
            assert_eq!(found, auto, "{masks:?}");
            assert_eq!(resolve(MaskChoice::Use, true).ok(), forced, "{masks:?}");
            assert_eq!(resolve(MaskChoice::Ignore, false).unwrap(), MaskUse::None);
            assert!(
                auto.into_iter()
                    .all(|used| check_masks(used, &data, Path::new("fit.toml")).is_ok())
            );
        }
        for (used, views) in [(MaskUse::Coverage, [object, None]), (MaskUse::LeaveOut, [object; 2])]
        {
            let error = check_masks(used, &dataset(&views), Path::new("fit.toml")).unwrap_err();
            assert!(error.to_string().ends_with("as in this run"), "{error}");
        }
        let error =
            MaskChoice::Use.resolve(&dataset(&[None, object]), true, Path::new("arguments"));
        let text = error.unwrap_err().to_string();
        assert!(text.starts_with("arguments: masks: found use, and masks for 1 of 2"), "{text}");
    }

    #[test]
    fn photographs_are_put_over_black_once() {
        let mut views = dataset(&[Some((MaskKind::Object, [0.25, 1.0]))]).train;
        for _ in 0..2 {
            put_over_black(&mut views);
            assert_eq!(views[0].image.pixels, [[0.1; 3], [0.4; 3]]);
        }
    }
}
