//! The advice for photographs of which COLMAP finds few poses.

use crate::commands::Matching;

/// The share of the photographs below which advice is given.
pub const FEW_REGISTERED: f64 = 0.8;

/// Ways to more poses, one sentence each. `matching` is the way in which pairs were chosen.
pub fn remedies(matching: Matching) -> Vec<&'static str> {
    let mut remedies = vec![
        "take more photographs: neighbours 15 degrees apart or less, with 60 % of the same things",
        "put texture around the object, for example a newspaper, and keep the room in the frame",
        "use a turntable for a textured object before one colour only; in a room, walk around it",
        "use photographs as the camera wrote them: sharp, not cropped, one lens, one zoom",
    ];
    match matching {
        Matching::Sequential => {
            remedies.insert(0, "--matching exhaustive compares all pairs, not only neighbours");
        }
        Matching::Alike => {
            remedies.insert(0, "--matching exhaustive compares all pairs, not only those alike");
        }
        Matching::Auto | Matching::Exhaustive => {}
    }
    remedies
}
