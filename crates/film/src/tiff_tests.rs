//! TIFF and WebP images.

use std::path::{Path, PathBuf};

use image::codecs::webp::WebPEncoder;
use image::{DynamicImage, ExtendedColorType, ImageEncoder};

use crate::{
    Film, TurnedByExif, image_size, read_image, read_image_of, srgb_decode, srgb_encode,
    turned_by_exif,
};

/// A TIFF file of this size in one strip, of samples of 8 bits if `tags` do not say otherwise.
///
/// A tag has a number, a type (1: byte, 2: text, 3: short, 4: long) and values. One that is in
/// `tags` takes the place of the usual one.
pub(crate) fn tiff(
    tags: &[(u16, u16, &[u32])],
    size: [u32; 2],
    channels: u32,
    data: &[u8],
) -> Vec<u8> {
    let length = u32::try_from(data.len()).unwrap();
    let photometric = if channels < 3 { 1 } else { 2 };
    let depths = vec![8; channels as usize];
    let usual: [(u16, u16, &[u32]); 9] = [
        (256, 4, &[size[0]]),
        (257, 4, &[size[1]]),
        (258, 3, &depths),
        (259, 3, &[1]),
        (262, 3, &[photometric]),
        (273, 4, &[8]),
        (277, 3, &[channels]),
        (278, 4, &[size[1]]),
        (279, 4, &[length]),
    ];
    let is_usual = |tag: u16| tags.iter().all(|(other, ..)| *other != tag);
    let mut all: Vec<_> = usual.into_iter().filter(|(tag, ..)| is_usual(*tag)).collect();
    all.extend(tags);
    all.sort_by_key(|(tag, ..)| *tag);
    // The data, the values that are longer than four bytes, and the list.
    let mut out = b"II*\0\0\0\0\0".to_vec();
    out.extend(data);
    let mut list = u16::try_from(all.len()).unwrap().to_le_bytes().to_vec();
    for (tag, kind, values) in all {
        let width = [0, 1, 1, 2, 4][usize::from(kind)];
        let mut bytes: Vec<u8> =
            values.iter().flat_map(|v| v.to_le_bytes()[..width].to_vec()).collect();
        list.extend([tag.to_le_bytes(), kind.to_le_bytes()].concat());
        list.extend(u32::try_from(values.len()).unwrap().to_le_bytes());
        if bytes.len() > 4 {
            list.extend(u32::try_from(out.len()).unwrap().to_le_bytes());
            out.extend(bytes);
        } else {
            bytes.resize(4, 0);
            list.extend(bytes);
        }
    }
    let place = u32::try_from(out.len()).unwrap().to_le_bytes();
    out[4..8].copy_from_slice(&place);
    [&out[..], &list, &[0; 4]].concat()
}

/// Writes a file of this name and content.
fn written(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// An image of 5 × 4 pixels with colours and alpha.
fn rgba() -> DynamicImage {
    let ramp: Vec<u8> = (0..5 * 4 * 4u32).map(|v| (v * v % 251) as u8).collect();
    DynamicImage::from(image::RgbaImage::from_raw(5, 4, ramp).unwrap())
}

#[test]
fn tiff_images_of_bytes_words_grey_and_alpha_are_read() {
    let folder = tempfile::tempdir().unwrap();
    // The values of a PNG file of the same samples.
    let expected = |image: DynamicImage| {
        let path = folder.path().join("a.png");
        image.save(&path).unwrap();
        read_image(&path).unwrap()
    };
    let words = |samples: &[u16]| samples.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let la = rgba().to_luma_alpha8();
    let l16 = rgba().to_luma16();
    let rgb16 = rgba().to_rgb16();
    let rgb = rgba().to_rgb8();
    let planes: Vec<u8> = (0..3).flat_map(|c| rgb.pixels().map(move |p| p.0[c])).collect();
    let alpha: (u16, u16, &[u32]) = (338, 3, &[2]);
    let of =
        |tags: &[(u16, u16, &[u32])], channels, data: &[u8]| tiff(tags, [5, 4], channels, data);
    let white: Vec<u8> = rgba().to_luma8().iter().map(|v| !v).collect();
    let files = [
        (of(&[], 3, &rgb), DynamicImage::from(rgb.clone())),
        (of(&[], 1, &rgba().to_luma8()), DynamicImage::from(rgba().to_luma8())),
        (of(&[(262, 3, &[0])], 1, &white), DynamicImage::from(rgba().to_luma8())),
        (of(&[alpha], 4, &rgba().to_rgba8()), rgba()),
        (of(&[alpha], 2, &la), DynamicImage::from(rgba().to_luma_alpha8())),
        // A channel without a meaning.
        (of(&[(338, 3, &[0])], 2, &la), DynamicImage::from(rgba().to_luma8())),
        (of(&[(258, 3, &[16])], 1, &words(&l16)), DynamicImage::from(l16.clone())),
        (of(&[(258, 3, &[16; 3])], 3, &words(&rgb16)), DynamicImage::from(rgb16.clone())),
        (
            of(&[(284, 3, &[2]), (273, 4, &[8, 28, 48]), (279, 4, &[20; 3])], 3, &planes),
            DynamicImage::from(rgb.clone()),
        ),
    ];
    for (i, (file, image)) in files.into_iter().enumerate() {
        // The content tells the format.
        for name in ["b.tif", "b.jpg"] {
            let path = written(folder.path(), name, &file);
            assert_eq!(read_image(&path).unwrap(), expected(image.clone()), "file {i}");
            assert_eq!(image_size(&path).unwrap(), (5, 4));
        }
        for cut in 4..file.len() {
            let path = written(folder.path(), "cut.tif", &file[..cut]);
            let error = read_image(&path).expect_err(&format!("{i} cut at {cut}")).to_string();
            assert!(error.contains("cut.tif") && error.contains("cut short"), "{error}");
            assert_eq!(error.lines().count(), 1, "{error}");
        }
    }
}

#[test]
fn colours_that_are_multiplied_by_alpha_are_divided() {
    let folder = tempfile::tempdir().unwrap();
    let file = tiff(&[(338, 3, &[1])], [2, 1], 4, &[50, 100, 20, 100, 0, 0, 0, 0]);
    let (film, alpha) = read_image(&written(folder.path(), "a.tif", &file)).unwrap();
    assert_eq!(film.pixels[0][1], 1.0);
    assert!((srgb_encode(film.pixels[0][0]) - 0.5).abs() < 0.003);
    assert_eq!((film.pixels[1], alpha.unwrap()[1]), ([0.0; 3], 0.0));
}

#[test]
fn tiff_images_of_floats_are_linear() {
    let folder = tempfile::tempdir().unwrap();
    let values = [0.25f64, -1.0, 3.5, 0.5, 1.5, 1000.0];
    let wide: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let single: Vec<u8> = values.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect();
    let half: Vec<u8> = values.iter().flat_map(|v| half::f16::from_f64(*v).to_le_bytes()).collect();
    for (bits, data) in [(16, half), (32, single), (64, wide)] {
        let tags: [(u16, u16, &[u32]); 2] = [(258, 3, &[bits; 3]), (339, 3, &[3; 3])];
        let file = tiff(&tags, [2, 1], 3, &data);
        let (film, alpha) = read_image(&written(folder.path(), "a.tif", &file)).unwrap();
        let pixels = vec![[0.25, -1.0, 3.5], [0.5, 1.5, 1000.0]];
        assert_eq!((film, alpha), (Film { width: 2, height: 1, pixels }, None), "{bits}");
        let tags: [(u16, u16, &[u32]); 2] = [(258, 3, &[bits]), (339, 3, &[3])];
        let file = tiff(&tags, [6, 1], 1, &data);
        let (film, _) = read_image(&written(folder.path(), "a.tif", &file)).unwrap();
        assert_eq!(film.pixels[5], [1000.0; 3]);
    }
}

#[test]
fn kinds_of_tiff_images_that_are_not_read_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let bits: (u16, u16, &[u32]) = (258, 3, &[32; 3]);
    for file in [
        tiff(&[bits], [2, 1], 3, &[7; 24]),
        tiff(&[(262, 3, &[5])], [2, 1], 4, &[7; 8]),
        tiff(&[(262, 3, &[3]), (320, 3, &[0; 768])], [2, 1], 1, &[7; 2]),
        tiff(&[(259, 3, &[50000])], [2, 1], 1, &[7; 2]),
        tiff(&[(258, 3, &[8]), (339, 3, &[2])], [2, 1], 1, &[7; 2]),
    ] {
        let error = read_image(&written(folder.path(), "a.tif", &file)).unwrap_err().to_string();
        assert!(error.contains("TIFF image") && error.contains("grey or RGB"), "{error}");
        assert_eq!(error.lines().count(), 1, "{error}");
    }
}

#[test]
fn damaged_tiff_images_are_no_panic() {
    let folder = tempfile::tempdir().unwrap();
    let tags: [(u16, u16, &[u32]); 3] = [(274, 3, &[6]), (347, 1, &[0xff, 0xd8]), (338, 3, &[2])];
    for compression in [1, 5, 7, 8, 32773, 4] {
        let compression = [compression];
        let coding: (u16, u16, &[u32]) = (259, 3, &compression);
        let all = [&tags[..], &[coding]].concat();
        let file = tiff(&all, [3, 2], 2, &[0x80, 9, 7, 200, 1, 0, 0xff, 0xd9, 3, 3, 3, 3]);
        for at in 0..file.len() {
            for byte in [0, 1, 0xff, file[at] ^ 0x10] {
                let mut damaged = file.clone();
                damaged[at] = byte;
                let path = written(folder.path(), "a.tif", &damaged);
                let (size, read) = (image_size(&path), read_image(&path));
                if let Err(error) = read {
                    assert_eq!(error.to_string().lines().count(), 1, "{error}");
                } else {
                    size.unwrap();
                }
            }
        }
    }
}

#[test]
fn a_tiff_image_is_turned_by_its_orientation() {
    let folder = tempfile::tempdir().unwrap();
    // The list of entries is behind data that no program reads at the start of a file.
    let data: Vec<u8> = (0..1000 * 400u32).map(|i| if i < 1000 { 255 } else { 0 }).collect();
    for (orientation, turned) in [(6, Some(TurnedByExif::OtherSize)), (1, None), (9, None)] {
        let file = tiff(&[(274, 3, &[orientation])], [1000, 400], 1, &data);
        let path = written(folder.path(), "a.tif", &file);
        assert_eq!(turned_by_exif(&path), turned);
        let (film, _) = read_image_of(&path, (400, 1000)).unwrap();
        let shown = if orientation == 6 { (400, 1000) } else { (1000, 400) };
        assert_eq!((film.width, film.height), shown);
        // The first row becomes the last column.
        assert_eq!(film.at(shown.0 - 1, 0), [1.0; 3]);
    }
}

#[test]
fn a_webp_image_is_turned_by_the_orientation_at_its_end() {
    let folder = tempfile::tempdir().unwrap();
    // Noise of more bytes than the start of a file in which other formats have their block.
    let mut state = 1u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    let noise = image::RgbImage::from_fn(400, 300, |_, _| image::Rgb([next(), next(), next()]));
    let mut file = Vec::new();
    let mut encoder = WebPEncoder::new_lossless(&mut file);
    let block = b"II\x2a\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
    encoder.set_exif_metadata(block.to_vec()).unwrap();
    noise.write_with_encoder(encoder).unwrap();
    assert!(file.len() > 300_000);
    let path = written(folder.path(), "a.webp", &file);
    assert_eq!(turned_by_exif(&path), Some(TurnedByExif::OtherSize));
    let (film, _) = read_image_of(&path, (300, 400)).unwrap();
    assert_eq!((film.width, film.height), (300, 400));
}

#[test]
fn webp_images_are_read_and_cut_ones_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (image, color) in
        [(rgba(), ExtendedColorType::Rgba8), (rgba().to_rgb8().into(), ExtendedColorType::Rgb8)]
    {
        let mut file = Vec::new();
        WebPEncoder::new_lossless(&mut file).encode(image.as_bytes(), 5, 4, color).unwrap();
        for name in ["a.webp", "a.png"] {
            let path = written(folder.path(), name, &file);
            let (film, alpha) = read_image(&path).unwrap();
            assert_eq!(image_size(&path).unwrap(), (5, 4));
            assert_eq!(alpha.is_some(), color == ExtendedColorType::Rgba8);
            for (found, expected) in film.pixels.iter().zip(image.to_rgb8().pixels()) {
                assert_eq!(*found, expected.0.map(|v| srgb_decode(f32::from(v) / 255.0)));
            }
        }
        for cut in 12..file.len() {
            let path = written(folder.path(), "cut.webp", &file[..cut]);
            let error = read_image(&path).expect_err(&format!("cut at {cut}")).to_string();
            assert!(error.contains("cut.webp") && error.contains("cut short"), "{error}");
        }
        for at in 0..file.len() {
            let mut damaged = file.clone();
            damaged[at] ^= 0x55;
            let path = written(folder.path(), "a.webp", &damaged);
            if let Err(error) = read_image(&path) {
                assert_eq!(error.to_string().lines().count(), 1, "{error}");
            }
        }
    }
}
