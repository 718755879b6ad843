//! The size at which a fit reads its photographs.
//!
//! A phone's photographs have more pixels than a fit can look at, and more than a small machine can
//! hold: 50 of 12 megapixels are 600 million. The size follows from the options and the sizes of
//! the images alone, so that the same command reads the same pixels on every machine.

/// Bytes of memory for each pixel of the training views: the photograph and its mask at all levels
/// of the pyramid, and the lists of pixels. Measured: 79. The grey values of patches are 2 more.
pub const MEMORY_PER_PIXEL: u64 = 82;

/// A set of at most this many training pixels is read whole, whatever the budget is: its memory is
/// 0.7 GB.
const FEW_PIXELS: u64 = 1 << 23;

/// The memory for photographs in bytes: the program stays below 4 GiB.
const MEMORY: u64 = 3 << 30;

/// The budget reduces the longest side of a photograph to no less than this many pixels.
const LEAST_SIDE: u32 = 480;

/// Bytes of memory for each pixel of a held-out view: an image in single precision and a mask.
const MEMORY_PER_HELD_OUT_PIXEL: u64 = 16;

/// The reason for which photographs are read at a fraction of their size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// The budget cannot draw more pixels.
    Budget,
    /// More pixels could take more than 4 GiB of memory.
    Memory,
}

impl Limit {
    /// The size at which photographs of these widths and heights are read, at 1/`downscale` of
    /// them, and the reason, in one line.
    pub fn text(self, whole: &[[u32; 2]], downscale: u32) -> String {
        let sizes = || whole.iter().map(|size| size.map(|side| side.div_ceil(downscale)));
        let [width, height] =
            sizes().max_by_key(|[w, h]| u64::from(*w) * u64::from(*h)).unwrap_or([1; 2]);
        let up_to = if sizes().all(|size| size == [width, height]) { "" } else { "up to " };
        let reason = match self {
            Limit::Budget => "as many pixels as the budget of a fit can use",
            Limit::Memory => "as many pixels as 4 GiB of memory can hold",
        };
        format!(
            "images: read at 1/{downscale} of their size ({up_to}{width} x {height} pixels), \
             {reason}; --downscale 1 reads them whole"
        )
    }
}

/// The factor by which a fit reduces the width and height of its photographs, and the reason for a
/// factor above 1.
///
/// It is the least whole number for which two things hold. The training pixels are no more than
/// `draws`, the number of pixels that the budget draws on the finest level, or than 2^23 if that is
/// more; for this alone, the longest side is not reduced below 480 pixels. And all photographs fit
/// in 3 GiB. A set with up to 2^23 training pixels is not reduced. `train` and `held_out` are the
/// widths and heights of the photographs in pixels.
pub fn downscale(train: &[[u32; 2]], held_out: &[[u32; 2]], draws: u64) -> (u32, Option<Limit>) {
    let within_memory = |n: u32| {
        let pixels = |sizes: &[[u32; 2]]| u128::from(pixels(sizes, n));
        let bytes = pixels(train) * u128::from(MEMORY_PER_PIXEL)
            + pixels(held_out) * u128::from(MEMORY_PER_HELD_OUT_PIXEL);
        bytes <= u128::from(MEMORY)
    };
    let within_budget = |n: u32| pixels(train, n) <= FEW_PIXELS.max(draws);
    if pixels(train, 1) <= FEW_PIXELS {
        return (1, None);
    }
    // At the largest factor every photograph is one pixel.
    let most = train.iter().chain(held_out).flatten().copied().max().unwrap_or(1);
    let least = |holds: &dyn Fn(u32) -> bool| (1..=most).find(|n| holds(*n)).unwrap_or(most);
    // Many photographs are better drawn in part than read too small.
    let budget = least(&within_budget).min((most / LEAST_SIDE).max(1));
    match (budget, least(&within_memory)) {
        (1, 1) => (1, None),
        (budget, memory) if budget >= memory => (budget, Some(Limit::Budget)),
        (_, memory) => (memory, Some(Limit::Memory)),
    }
}

/// The number of pixels of photographs of these sizes, read at 1/`n` of their width and height.
fn pixels(sizes: &[[u32; 2]], n: u32) -> u64 {
    let of = |size: &[u32; 2]| size.iter().map(|side| u64::from(side.div_ceil(n))).product();
    sizes.iter().fold(0, |sum: u64, size| sum.saturating_add(of(size)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_factor_is_the_least_that_budget_and_memory_allow() {
        // 50 photographs of a phone, of which every eighth is held out.
        let of_phone = |draws: u64| downscale(&[[4032, 3024]; 43], &[[4032, 3024]; 7], draws);
        let (budget, memory) = (Some(Limit::Budget), Some(Limit::Memory));
        // 43 photographs of 504 × 378 pixels are 8.2 million.
        assert_eq!([of_phone(0), of_phone(4_600_000)], [(8, budget); 2]);
        // 21 million pixels are too many for 15 million draws.
        assert_eq!(of_phone(15_360_000), (6, budget));
        assert_eq!(of_phone(45_000_000), (4, budget));
        assert_eq!(of_phone(2_700_000_000), (4, memory));
        assert_eq!(of_phone(u64::MAX), (4, memory));
    }

    #[test]
    fn the_photographs_fit_in_4_gib_with_every_budget() {
        for draws in [1, 4_608_000, 38_400_000, 768_000_000] {
            for count in [10, 50, 300, 2000] {
                let sizes = vec![[4032, 3024]; count];
                let (n, _) = downscale(&sizes, &sizes, draws);
                let bytes = pixels(&sizes, n) * (MEMORY_PER_PIXEL + MEMORY_PER_HELD_OUT_PIXEL);
                assert!(bytes <= MEMORY, "{count} photographs at 1/{n}: {bytes} bytes");
            }
        }
    }

    #[test]
    fn few_pixels_are_read_whole() {
        assert_eq!(downscale(&[[400, 300]; 49], &[[400, 300]; 8], 1), (1, None));
        // 8,388,608 pixels, and one more.
        assert_eq!(downscale(&[[4096, 2048]], &[], 1), (1, None));
        assert_eq!(downscale(&[[4096, 2048], [1, 1]], &[], 1).0, 2);
        assert_eq!(downscale(&[], &[], 1), (1, None));
        // The longest side of 200 photographs keeps 480 pixels.
        assert_eq!(downscale(&[[4032, 3024]; 200], &[], 1), (8, Some(Limit::Budget)));
        // Views of one pixel cannot be reduced.
        let many = vec![[1, 1]; (FEW_PIXELS + 1) as usize];
        assert_eq!(downscale(&many, &[], 1), (1, None));
    }

    #[test]
    fn the_line_has_size_reason_and_remedy() {
        let text = Limit::Budget.text(&[[4032, 3024]; 2], 3);
        let start = "images: read at 1/3 of their size (1344 x 1008 pixels), as many pixels as";
        assert!(
            text.starts_with(start) && text.ends_with("--downscale 1 reads them whole"),
            "{text}"
        );
        let text = Limit::Memory.text(&[[30, 41], [99, 10]], 4);
        assert!(text.contains("1/4 of their size (up to 8 x 11 pixels)"), "{text}");
        assert!(text.contains("4 GiB"), "{text}");
    }
}
