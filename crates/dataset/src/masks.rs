//! The meaning of masks of which the file format does not tell it.

#![warn(clippy::cast_possible_truncation)]

use crate::{Dataset, MaskKind, View};

/// A mask of this share of white along the frame's border is no mask of an object.
const WHITE_BORDER: f64 = 0.5;

/// Takes masks of the object as masks of pixels to use if most of them are white along the border
/// of the frame: an object is in the middle of its photographs. `masks/a.png` can be either for the
/// image `a.jpg`; COLMAP accepts it as pixels to use.
///
/// White leaves pixels out in the masks of the views that `is_dynamic` names, those to fit first,
/// unless most of them have no white along the border: then it is the object.
pub(crate) fn recognise_used(dataset: &mut Dataset, is_dynamic: &[bool]) {
    let views = || dataset.train.iter().chain(&dataset.test).zip(is_dynamic);
    let shares = |wanted: bool| -> Vec<f64> {
        let all = views().filter(|(_, is_dynamic)| **is_dynamic == wanted);
        all.filter_map(|(view, _)| white_border(view)).collect()
    };
    let (objects, dynamic) = (shares(false), shares(true));
    let white = objects.iter().filter(|share| **share > WHITE_BORDER).count();
    let touching = dynamic.iter().filter(|share| **share > 0.0).count();
    let is_used = 2 * white > objects.len();
    let leaves_out = 2 * touching > dynamic.len();
    let mut notes = Vec::new();
    if is_used {
        let all = objects.len();
        notes.push(format!(
            "{white} of {all} masks are white along the border of the frame: white is taken as \
             pixels to use, not as the object"
        ));
    }
    if leaves_out {
        notes.push("white pixels of dynamic masks are left out".to_owned());
    } else if !dynamic.is_empty() {
        let text = "dynamic masks are white in the middle of the photographs only: white is taken";
        notes.push(format!("{text} as the object, not as pixels to leave out"));
    }
    let views = dataset.train.iter_mut().chain(&mut dataset.test).zip(is_dynamic);
    for (view, is_dynamic) in views {
        let is_taken = if *is_dynamic { leaves_out } else { is_used };
        let mask = view.mask.as_mut().filter(|mask| mask.kind == MaskKind::Object && is_taken);
        if let Some(mask) = mask {
            mask.kind = MaskKind::Used;
            if *is_dynamic {
                mask.values.iter_mut().for_each(|value| *value = 1.0 - *value);
            }
        }
    }
    dataset.notes.extend(notes);
}

/// The share of white along the border of a mask of the object; `None` if all of it is white.
fn white_border(view: &View) -> Option<f64> {
    let mask = view.mask.as_ref().filter(|mask| mask.kind == MaskKind::Object)?;
    mask.values.iter().any(|value| *value < 0.5).then_some(())?;
    let (width, height) = (view.image.width as usize, view.image.height as usize);
    let rows = [0, height - 1].into_iter().flat_map(|y| (0..width).map(move |x| [x, y]));
    let columns = [0, width - 1].into_iter().flat_map(|x| (0..height).map(move |y| [x, y]));
    let border: Vec<f64> =
        rows.chain(columns).map(|[x, y]| f64::from(mask.values[y * width + x])).collect();
    Some(border.iter().sum::<f64>() / border.len() as f64)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use crate::Mask;
    use crate::tests::{cameras, photograph};

    use super::*;

    /// A data set whose masks have `inside` in the middle and `outside` along the border.
    fn dataset(kind: MaskKind, inside: f32, outside: f32) -> Dataset {
        let view = |camera: render::Camera| {
            let image = photograph(&camera);
            let (width, height) = (image.width, image.height);
            let is_border = |x, y| x == 0 || y == 0 || x == width - 1 || y == height - 1;
            let value = |i| if is_border(i % width, i / width) { outside } else { inside };
            let mask = Some(Mask { kind, values: (0..width * height).map(value).collect() });
            View { name: String::new(), path: PathBuf::new(), camera, image, mask }
        };
        Dataset {
            path: PathBuf::new(),
            format: String::new(),
            train: cameras(3).into_iter().map(view).collect(),
            test: Vec::new(),
            bounds: None,
            points: Vec::new(),
            is_sure: Vec::new(),
            notes: Vec::new(),
        }
    }

    #[test]
    fn masks_that_are_white_along_the_border_tell_pixels_to_use() {
        let kind_of = |mut dataset: Dataset| {
            recognise_used(&mut dataset, &[false; 3]);
            (dataset.train[2].mask.as_ref().unwrap().kind, dataset.notes.len())
        };
        assert_eq!(kind_of(dataset(MaskKind::Object, 1.0, 0.0)), (MaskKind::Object, 0));
        assert_eq!(kind_of(dataset(MaskKind::Object, 0.0, 1.0)), (MaskKind::Used, 1));
        assert_eq!(kind_of(dataset(MaskKind::Object, 1.0, 1.0)), (MaskKind::Object, 0));
        assert_eq!(kind_of(dataset(MaskKind::Alpha, 0.0, 1.0)), (MaskKind::Alpha, 0));
        let dynamic = |mut dataset: Dataset| {
            recognise_used(&mut dataset, &[true; 3]);
            let mask = dataset.train.remove(2).mask.unwrap();
            (mask.kind, mask.values[0], dataset.notes.len())
        };
        assert_eq!(dynamic(dataset(MaskKind::Object, 0.0, 1.0)), (MaskKind::Used, 0.0, 1));
        assert_eq!(dynamic(dataset(MaskKind::Object, 1.0, 0.0)), (MaskKind::Object, 0.0, 1));
        let mut one_of_three = dataset(MaskKind::Object, 1.0, 0.0);
        one_of_three.train[0] = dataset(MaskKind::Object, 0.0, 1.0).train.remove(0);
        assert_eq!(kind_of(one_of_three), (MaskKind::Object, 0));
    }
}
