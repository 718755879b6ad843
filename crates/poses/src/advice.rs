//! The advice for photographs of which COLMAP finds few poses.

use crate::commands::Matching;

/// The share of the photographs below which advice is given.
pub const FEW: f64 = 0.8;

/// Ways to more poses, one sentence each. `matching` is the way in which pairs were chosen.
pub fn remedies(matching: Matching) -> Vec<&'static str> {
    let mut remedies = vec![
        "take more photographs between those that are missing and the others: neighbours show \
         60 % or more of the same things, 15 degrees apart or less",
        "put texture around the object, for example a newspaper under it, and keep the room in \
         the frame: poses are found by the surroundings as well",
        "a turntable in front of one colour works with a textured object only; in front of a \
         room, walk around the object in its place",
        "use photographs as the camera wrote them: sharp, not cropped, with one lens and one zoom",
    ];
    if matching == Matching::Sequential {
        remedies.insert(0, "--matching exhaustive compares all pairs, not only neighbours");
    }
    remedies
}
