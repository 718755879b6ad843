//! The part of a surface inside the masks of the object.

use dataset::View;
use glam::DVec3;
use rayon::prelude::*;

use crate::cut::visible::pixel_of;

/// A pixel of at least this coverage is of the object.
const HALF: f32 = 0.5;

/// For each point, whether it lies in the dilated mask of every view that has a mask of the object
/// and shows the point: its projection is on the film.
///
/// `points` are in the coordinates of the views' cameras. `margin` is the dilation as a part of the
/// image's width: pixels up to this distance from a pixel of the mask count, between the centres of
/// pixels. `None` if no view has a mask of the object.
///
/// NeuS culls so before a Chamfer distance on DTU, with masks dilated by 50 pixels of a width of
/// 1600 (Wang, Liu, Liu, Theobalt, Komura, Wang, "NeuS: Learning Neural Implicit Surfaces by Volume
/// Rendering for Multi-view Reconstruction", NeurIPS 2021).
pub fn inside_masks<'a>(
    views: impl IntoIterator<Item = &'a View>,
    points: &[DVec3],
    margin: f64,
) -> Option<Vec<bool>> {
    let masked: Vec<(&View, &[f32])> =
        views.into_iter().filter_map(|view| Some((view, view.coverage()?))).collect();
    if masked.is_empty() {
        return None;
    }
    let mut inside = vec![true; points.len()];
    for (view, mask) in masked {
        let camera = &view.camera;
        let size = [camera.width as usize, camera.height as usize];
        let dilated = dilated(mask, size, margin * size[0] as f64);
        inside.par_iter_mut().zip(points).filter(|(inside, _)| **inside).for_each(|(inside, x)| {
            *inside = pixel_of(camera, *x).is_none_or(|(_, pixel)| dilated[pixel]);
        });
    }
    Some(inside)
}

/// The pixels within `radius` of a pixel of the mask, between the centres of pixels.
///
/// Each pixel of a row is at a vertical distance from the nearest pixel of the mask in its column.
/// So a disc around that pixel covers an interval of the row; the result is the union of these.
fn dilated(mask: &[f32], [width, height]: [usize; 2], radius: f64) -> Vec<bool> {
    let distances = column_distances(mask, [width, height]);
    let mut out = vec![false; mask.len()];
    let rows = out.par_chunks_mut(width.max(1)).zip(distances.par_chunks(width.max(1)));
    rows.for_each(|(row, distances)| {
        let mut starts = vec![0i32; width + 1];
        for (x, distance) in distances.iter().enumerate() {
            let left = radius * radius - f64::from(*distance).powi(2);
            if left >= 0.0 {
                let half = left.sqrt() as usize;
                starts[x.saturating_sub(half)] += 1;
                starts[(x + half + 1).min(width)] -= 1;
            }
        }
        let mut open = 0;
        for (inside, start) in row.iter_mut().zip(&starts) {
            open += start;
            *inside = open > 0;
        }
    });
    debug_assert_eq!(out.len(), width * height);
    out
}

/// The vertical distance of each pixel from the nearest pixel of the mask in its column, in pixels;
/// `u32::MAX` in a column without one.
fn column_distances(mask: &[f32], [width, height]: [usize; 2]) -> Vec<u32> {
    let mut distances: Vec<u32> =
        mask.iter().map(|m| if *m >= HALF { 0 } else { u32::MAX }).collect();
    let mut spread = |from: usize, to: usize| {
        for x in 0..width {
            let next = distances[from * width + x].saturating_add(1);
            let own = &mut distances[to * width + x];
            *own = (*own).min(next);
        }
    };
    (1..height).for_each(|y| spread(y - 1, y));
    (1..height).rev().for_each(|y| spread(y, y - 1));
    distances
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::{Mask, MaskKind};
    use film::Film;
    use glam::DVec2;
    use random::{Name, Stream};
    use render::Camera;

    #[test]
    fn a_dilation_is_the_set_of_pixels_near_the_mask() {
        let (width, height) = (23, 17);
        let stream = Stream::of_seed(3).named(Name::other("points"));
        for (case, radius) in [(0, 0.0), (1, 1.0), (2, 2.5), (3, 6.0), (4, 100.0)] {
            let is_set = |i: usize| stream.at(case).at(i as u64).unit() < 0.01;
            let mask: Vec<f32> =
                (0..width * height).map(|i| f32::from(u8::from(is_set(i)))).collect();
            let at = |i: usize| DVec2::new((i % width) as f64, (i / width) as f64);
            let near = |i: usize| {
                (0..mask.len()).any(|j| mask[j] > 0.0 && at(i).distance(at(j)) <= radius)
            };
            let expected: Vec<bool> = (0..mask.len()).map(near).collect();
            assert_eq!(dilated(&mask, [width, height], radius), expected, "radius {radius}");
        }
    }

    /// A view along −z from (0, 0, 4), with a focal length of 64 pixels, of 16 × 16 pixels.
    fn view(mask: Option<Mask>) -> View {
        let (focal, middle) = (DVec2::splat(64.0), DVec2::splat(8.0));
        let eye = DVec3::Z * 4.0;
        let camera = Camera::look_at(16, 16, focal, middle, eye, DVec3::ZERO, DVec3::Y).unwrap();
        let image = Film::new(16, 16);
        View { name: String::new(), path: "0.png".into(), camera, image, mask }
    }

    #[test]
    fn points_off_the_film_stay_and_others_need_every_mask() {
        // The left half is of the object; the margin is 2 pixels, of which each is 1/16 wide.
        let left = Mask {
            kind: MaskKind::Object,
            values: (0..256).map(|i| f32::from(u8::from(i % 16 < 8))).collect(),
        };
        let points = [-0.25, 0.09, 0.16, 2.0].map(|x| DVec3::new(x, 0.03, 0.0));
        let behind = DVec3::new(0.2, 0.0, 5.0);
        let points = [&points[..], &[behind]].concat();
        let views = [view(None), view(Some(left.clone()))];
        let inside = inside_masks(&views, &points, 2.0 / 16.0).unwrap();
        assert_eq!(inside, [true, true, false, true, true]);
        let full = Mask { values: vec![1.0; 256], ..left.clone() };
        let views = [view(Some(left.clone())), view(Some(full))];
        assert_eq!(inside_masks(&views, &points, 2.0 / 16.0).unwrap(), inside);
        let used = Mask { kind: MaskKind::Used, ..left };
        assert_eq!(inside_masks(&[view(None), view(Some(used))], &points, 0.1), None);
    }
}
