//! Photographs of phones: EXIF orientations, and HEIF files.

use std::fs::File;

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{DynamicImage, ExtendedColorType, ImageEncoder, RgbImage};

use crate::{
    TurnedByExif, image_size, read_image, read_image_of, read_stored_image_of, refuse_unconverted,
    srgb_decode, srgb_encode, turned_by_exif, write_npy,
};

/// An image of 16 × 8 pixels that is bright in its upper left quarter.
fn quarter() -> RgbImage {
    RgbImage::from_fn(16, 8, |x, y| image::Rgb([255 * u8::from(x < 8 && y < 4); 3]))
}

/// Writes [`quarter`] with an EXIF block of one entry: the orientation, tag 0x0112.
fn write_quarter(mut encoder: impl ImageEncoder, orientation: u8) {
    let mut block = b"II\x2a\0\x08\0\0\0".to_vec();
    block.extend([1, 0, 0x12, 0x01, 3, 0, 1, 0, 0, 0, orientation, 0, 0, 0, 0, 0, 0, 0]);
    encoder.set_exif_metadata(block).unwrap();
    encoder.write_image(quarter().as_raw(), 16, 8, ExtendedColorType::Rgb8).unwrap();
}

#[test]
fn an_image_is_turned_if_only_then_it_has_the_size_of_its_camera() {
    let folder = tempfile::tempdir().unwrap();
    // The column and the row of the bright quarter as shown, for orientations that swap the sides.
    for (orientation, shown) in [(5, [0, 0]), (6, [1, 0]), (7, [1, 1]), (8, [0, 1])] {
        for name in ["a.jpg", "a.png"] {
            let path = folder.path().join(name);
            let file = File::create(&path).unwrap();
            match name {
                "a.jpg" => write_quarter(JpegEncoder::new_with_quality(file, 100), orientation),
                _ => write_quarter(PngEncoder::new(file), orientation),
            }
            let bright = |size: (u32, u32)| {
                let (film, _) = read_image_of(&path, size).unwrap();
                let (w, h) = (film.width, film.height);
                let is_bright =
                    |c: &[u32; 2]| film.at((2 * c[0] + 1) * w / 4, (2 * c[1] + 1) * h / 4)[0] > 0.5;
                let all = [[0, 0], [1, 0], [0, 1], [1, 1]].into_iter().filter(is_bright);
                ((w, h), all.collect::<Vec<_>>())
            };
            assert_eq!(bright((8, 16)), ((8, 16), vec![shown]), "{name}, {orientation}");
            // The size as stored, one that no orientation gives, and none.
            assert_eq!(bright((16, 8)), ((16, 8), vec![[0, 0]]));
            assert_eq!(bright((9, 16)), ((16, 8), vec![[0, 0]]));
            assert_eq!(read_image(&path).unwrap().0.width, 16);
            assert_eq!(image_size(&path).unwrap(), (16, 8));
        }
    }
    // These keep the sides, and 9 is none.
    for orientation in [1, 2, 3, 4, 9] {
        let path = folder.path().join("b.jpg");
        write_quarter(JpegEncoder::new(File::create(&path).unwrap()), orientation);
        assert_eq!(read_image_of(&path, (8, 16)).unwrap(), read_image(&path).unwrap());
        let turned = (2..=4).contains(&orientation).then_some(TurnedByExif::SameSize);
        assert_eq!(turned_by_exif(&path), turned, "{orientation}");
    }
    let path = folder.path().join("c.jpg");
    write_quarter(JpegEncoder::new(File::create(&path).unwrap()), 6);
    assert_eq!(turned_by_exif(&path), Some(TurnedByExif::OtherSize));
    assert_eq!(turned_by_exif(&folder.path().join("absent.jpg")), None);
}

#[test]
fn samples_of_8_bits_have_the_values_of_the_general_conversion() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let ramp: Vec<u8> =
        (0..=255).flat_map(|v: u8| [v, v.wrapping_mul(7), !v, 255 - v / 2]).collect();
    let rgba = DynamicImage::from(image::RgbaImage::from_raw(16, 16, ramp).unwrap());
    let kinds = [
        rgba.clone(),
        DynamicImage::from(rgba.to_rgb8()),
        DynamicImage::from(rgba.to_luma8()),
        DynamicImage::from(rgba.to_luma_alpha8()),
    ];
    for image in kinds {
        image.save(&path).unwrap();
        let (film, alpha) = read_image(&path).unwrap();
        // The general conversion rounds grey twice.
        let tolerance = if image.color().has_color() { 0.0 } else { 1e-6 };
        let (rgb, rgba) = (image.to_rgb32f(), image.to_rgba32f());
        for (found, expected) in film.pixels.iter().zip(rgb.pixels()) {
            let near = |c: usize| (found[c] - srgb_decode(expected.0[c])).abs() <= tolerance;
            assert!((0..3).all(near), "{found:?} against {expected:?}");
        }
        assert_eq!(alpha.is_some(), image.color().has_alpha());
        for (found, expected) in alpha.iter().flatten().zip(rgba.pixels()) {
            assert!((found - expected.0[3]).abs() <= tolerance, "{found} against {expected:?}");
        }
    }
}

#[test]
fn pixels_of_a_stored_image_are_those_of_its_film() {
    let folder = tempfile::tempdir().unwrap();
    let ramp: Vec<u8> = (0..20 * 9 * 4u32).map(|v| (v * v % 251) as u8).collect();
    let rgba = DynamicImage::from(image::RgbaImage::from_raw(20, 9, ramp).unwrap());
    let images = [
        ("a.png", rgba.clone()),
        ("b.png", DynamicImage::from(rgba.to_rgb8())),
        ("c.png", DynamicImage::from(rgba.to_luma8())),
        ("d.png", DynamicImage::from(rgba.to_luma_alpha8())),
        ("e.png", DynamicImage::from(rgba.to_rgba16())),
        ("f.png", DynamicImage::from(rgba.to_luma16())),
        ("g.jpg", DynamicImage::from(rgba.to_rgb8())),
        ("h.exr", DynamicImage::from(rgba.to_rgb32f())),
    ];
    for (name, image) in images {
        let path = folder.path().join(name);
        image.save(&path).unwrap();
        let stored = read_stored_image_of(&path, (20, 9)).unwrap();
        let (film, alpha) = read_image(&path).unwrap();
        assert_eq!((stored.size(), stored.has_alpha()), ([20, 9], alpha.is_some()), "{name}");
        assert_eq!(stored.alpha().map(Iterator::collect::<Vec<f32>>), alpha, "{name}");
        assert_eq!(stored.first_non_finite(), None);
        let decoded = stored.clone().decoded();
        for (i, pixel) in film.pixels.iter().enumerate() {
            let (x, y) = (i as u32 % 20, i as u32 / 20);
            let mut row = [[0.0; 3]; 20];
            stored.write_row(y, &mut row);
            assert_eq!([stored.at(x, y), row[x as usize]], [*pixel; 2], "{name}");
            assert_eq!(stored.display_at(x, y), srgb_encode(pixel[0]), "{name}");
            assert_eq!(decoded.at(x, y), *pixel, "{name}");
            assert_eq!(decoded.display_at(x, y), stored.display_at(x, y), "{name}");
            assert_eq!(decoded.alpha_at(x, y), stored.alpha_at(x, y), "{name}");
            assert_eq!(stored.alpha_at(x, y), alpha.as_ref().map_or(1.0, |alpha| alpha[i]));
        }
    }
    let path = folder.path().join("i.npy");
    write_npy(&path, &[2, 2], &[0.0, 1.0, f32::INFINITY, 3.0]).unwrap();
    let stored = read_stored_image_of(&path, (2, 2)).unwrap();
    assert_eq!(stored.first_non_finite(), Some(f32::INFINITY));
}

/// The first bytes of a HEIF file with these brands.
fn heif(brands: &[u8]) -> Vec<u8> {
    let length = 8 + brands.len() as u32;
    [&length.to_be_bytes()[..], b"ftyp", brands, &[0; 40]].concat()
}

#[test]
fn heif_files_are_refused_with_a_converter_whatever_their_name_is() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("IMG_1.jpg");
    for (brands, format) in [
        (&b"heic\0\0\0\0mif1heic"[..], "HEIC"),
        (b"mif1\0\0\0\0mif1heicmiaf", "HEIC"),
        (b"avif\0\0\0\0mif1avif", "AVIF"),
        (b"mif1\0\0\0\0miaf", "HEIF"),
    ] {
        std::fs::write(&path, heif(brands)).unwrap();
        for error in [read_image(&path).unwrap_err(), image_size(&path).unwrap_err()] {
            let text = error.to_string();
            for word in
                ["IMG_1.jpg: image: ", format, "heif-convert IMG_1.jpg IMG_1-converted.jpg", "sips"]
            {
                assert!(text.contains(word), "no {word} in {text}");
            }
        }
    }
    // A film, a brand behind the end of the box, and a box that is cut short.
    for other in [heif(b"isom\0\0\0\0avc1"), [heif(b"crx "), heif(b"heic")].concat(), heif(b"")] {
        std::fs::write(&path, &other).unwrap();
        assert!(!read_image(&path).unwrap_err().to_string().contains("heif-convert"));
        assert!(!image_size(&path).unwrap_err().to_string().contains("heif-convert"));
    }
}

#[test]
fn a_missing_image_is_refused_by_the_heif_file_in_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("b.HEIC"), heif(b"heic")).unwrap();
    let refusal = |name: &str| read_image(&at(name)).unwrap_err().to_string();
    // By name, with and without an extension; then because the folder has no other image.
    for name in ["b.jpg", "b", "c.jpg"] {
        assert!(refusal(name).contains("b.HEIC: image: found a HEIC image"), "{name}");
        assert_eq!(image_size(&at(name)).unwrap_err().to_string(), refusal(name));
    }
    assert!(refuse_unconverted(folder.path()).is_err());
    std::fs::write(at("d.png"), "").unwrap();
    assert!(refusal("b.jpg").contains("b.HEIC"));
    assert!(refusal("c.jpg").contains("c.jpg: image: found no such file"));
    refuse_unconverted(folder.path()).unwrap();
    refuse_unconverted(&at("none/a.jpg")).unwrap();
}
