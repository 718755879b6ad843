//! Labels above images.

use font8x8::UnicodeFonts;

use crate::film::Film;

/// Width and height of a letter in the font, in pixels.
const LETTER: u32 = 8;

/// The space above and below the letters, in pixels of the font.
const MARGIN: u32 = 2;

/// The width of an image for each pixel of the font: letters grow with the image.
const WIDTH_PER_PIXEL: u32 = 320;

/// The radiance of the strip and of the letters, in every channel.
const STRIP: f32 = 0.02;
const INK: f32 = 0.8;

/// The image with a strip above it that shows `text`, in white on dark grey.
///
/// The strip is 12 pixels high, or a multiple of it on an image wider than 320 pixels. Letters
/// beyond the width are cut off; letters that the font lacks stay empty.
pub fn labelled(film: &Film, text: &str) -> Film {
    let scale = film.width.div_ceil(WIDTH_PER_PIXEL).max(1);
    let height = (LETTER + 2 * MARGIN) * scale;
    let mut out = Film::new(film.width, film.height + height);
    let strip = (film.width * height) as usize;
    out.pixels[..strip].fill([STRIP; 3]);
    out.pixels[strip..].copy_from_slice(&film.pixels);
    for (i, letter) in text.chars().enumerate() {
        let glyph = font8x8::BASIC_FONTS.get(letter).or_else(|| font8x8::LATIN_FONTS.get(letter));
        let left = (LETTER * i as u32 + MARGIN) * scale;
        for (row, bits) in (MARGIN..).zip(glyph.unwrap_or_default()) {
            for y in row * scale..(row + 1) * scale {
                for x in left..(left + LETTER * scale).min(film.width) {
                    if bits >> ((x - left) / scale) & 1 == 1 {
                        out.pixels[(y * film.width + x) as usize] = [INK; 3];
                    }
                }
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_image_is_whole_below_its_label_and_long_labels_are_cut_off() {
        for (width, strip) in [(5, 12), (320, 12), (321, 24)] {
            let film = Film { width, height: 3, pixels: vec![[0.5; 3]; 3 * width as usize] };
            let shown = labelled(&film, "render é ∇ of a long name");
            assert_eq!((shown.width, shown.height), (width, 3 + strip));
            assert_eq!(shown.pixels[(width * strip) as usize..], film.pixels);
            assert!(shown.pixels[..(width * strip) as usize].contains(&[INK; 3]));
        }
        // The letter l is a line from the top to the bottom; a space is empty.
        let film = Film::new(30, 1);
        assert_eq!(labelled(&film, " ").pixels[0], labelled(&film, "").pixels[0]);
        let ink = |text| labelled(&film, text).pixels.iter().filter(|p| **p == [INK; 3]).count();
        assert_eq!(ink("  "), 0);
        assert_eq!(ink("ll"), 2 * ink("l"));
    }
}
