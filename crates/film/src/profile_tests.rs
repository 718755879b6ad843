//! Images with colour profiles.

use std::path::{Path, PathBuf};

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::codecs::webp::WebPEncoder;
use image::{DynamicImage, ImageEncoder};
use moxcms::ColorProfile as Icc;

use crate::tiff_tests::tiff;
use crate::{
    ColorProfile, color_profile, read_image, read_image_of, read_stored_image_of, srgb_decode,
    srgb_encode,
};

/// The chromaticities of red, green and blue: IEC 61966-2-1, SMPTE EG 432-1, and Adobe RGB (1998).
const SRGB: [[f64; 2]; 3] = [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]];
const P3: [[f64; 2]; 3] = [[0.680, 0.320], [0.265, 0.690], [0.150, 0.060]];
const ADOBE: [[f64; 2]; 3] = [[0.64, 0.33], [0.21, 0.71], [0.15, 0.06]];

/// The chromaticity of their white, D65.
const WHITE: [f64; 2] = [0.3127, 0.3290];

type Matrix = [[f64; 3]; 3];

fn times(m: &Matrix, v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// By Cramer's rule.
fn inverse(m: &Matrix) -> Matrix {
    let minor = |i: usize, j: usize| {
        let ([a, b], [c, d]) = ([(i + 1) % 3, (i + 2) % 3], [(j + 1) % 3, (j + 2) % 3]);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let det: f64 = (0..3).map(|j| m[0][j] * minor(0, j)).sum();
    std::array::from_fn(|i| std::array::from_fn(|j| minor(j, i) / det))
}

/// The matrix from linear colours of these primaries to XYZ.
fn to_xyz(primaries: [[f64; 2]; 3]) -> Matrix {
    let xyz = |[x, y]: [f64; 2]| [x / y, 1.0, (1.0 - x - y) / y];
    let columns = primaries.map(xyz);
    let m: Matrix = std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i]));
    let scale = times(&inverse(&m), xyz(WHITE));
    m.map(|row| std::array::from_fn(|j| row[j] * scale[j]))
}

/// The display value in sRGB of a colour of these primaries and this transfer function.
fn in_srgb(primaries: [[f64; 2]; 3], decode: fn(f32) -> f32, color: [f32; 3]) -> [f32; 3] {
    let xyz = times(&to_xyz(primaries), color.map(|v| f64::from(decode(v))));
    times(&inverse(&to_xyz(SRGB)), xyz).map(|v| srgb_encode(v.clamp(0.0, 1.0) as f32))
}

fn adobe_decode(value: f32) -> f32 {
    value.powf(563.0 / 256.0)
}

/// An image of many colours, also of the most saturated ones, with alpha.
fn colors() -> DynamicImage {
    let level = |v: u32| (v * 51) as u8;
    let pixel =
        |x: u32, y: u32| image::Rgba([level(x % 6), level(x / 6), level(y), (x * 7 + y) as u8]);
    DynamicImage::from(image::RgbaImage::from_fn(36, 6, pixel))
}

/// Writes an image without a profile or with one.
fn write(path: &Path, image: &DynamicImage, profile: Option<&[u8]>) {
    let mut bytes = Vec::new();
    let with = |mut encoder: Box<dyn Encode + '_>| {
        if let Some(profile) = profile {
            encoder.set_profile(profile.to_vec());
        }
        encoder.write(image);
    };
    match files::extension(path).as_str() {
        "png" => with(Box::new(Some(PngEncoder::new(&mut bytes)))),
        "jpg" => with(Box::new(Some(JpegEncoder::new_with_quality(&mut bytes, 95)))),
        "webp" => with(Box::new(Some(WebPEncoder::new_lossless(&mut bytes)))),
        _ => {
            let channels = image.color().channel_count();
            let depth = 8 * u32::from(image.color().bytes_per_pixel() / channels);
            let depths = vec![depth; channels.into()];
            let values: Vec<u32> =
                profile.unwrap_or_default().iter().map(|b| u32::from(*b)).collect();
            let tags: [(u16, u16, &[u32]); 3] =
                [(258, 3, &depths), (338, 3, &[2]), (34675, 1, &values)];
            let alpha = usize::from(image.color().has_alpha());
            let (before, after) = (&tags[..1 + alpha], &tags[2..]);
            let tags = if profile.is_some() { [before, after].concat() } else { before.to_vec() };
            let size = [image.width(), image.height()];
            bytes = tiff(&tags, size, channels.into(), image.as_bytes());
        }
    }
    std::fs::write(path, bytes).unwrap();
}

/// An encoder of any format.
trait Encode {
    fn set_profile(&mut self, profile: Vec<u8>);
    fn write(&mut self, image: &DynamicImage);
}

impl<E: ImageEncoder> Encode for Option<E> {
    fn set_profile(&mut self, profile: Vec<u8>) {
        self.as_mut().unwrap().set_icc_profile(profile).unwrap();
    }

    fn write(&mut self, image: &DynamicImage) {
        image.write_with_encoder(self.take().unwrap()).unwrap();
    }
}

/// The display values of an image's pixels, and its alpha channel.
fn display(path: &Path) -> (Vec<[f32; 3]>, Option<Vec<f32>>) {
    let (film, alpha) = read_image(path).unwrap();
    let pixels: Vec<[f32; 3]> = film.pixels.iter().map(|p| p.map(srgb_encode)).collect();
    // Every way to read an image converts it.
    let stored = read_stored_image_of(path, (film.width, film.height)).unwrap();
    assert_eq!(stored.into_film(), (film.clone(), alpha.clone()));
    assert_eq!(read_image_of(path, (1, 1)).unwrap(), (film, alpha.clone()));
    (pixels, alpha)
}

/// Files without and with a profile of a format; a TIFF file has 16 bits a channel.
fn pair(folder: &Path, end: &str, profile: &[u8]) -> [PathBuf; 2] {
    let image = match end {
        "jpg" => colors().to_rgb8().into(),
        "tif" => colors().to_rgba16().into(),
        _ => colors(),
    };
    let paths = ["plain", "profile"].map(|name| folder.join(format!("{name}.{end}")));
    write(&paths[0], &image, None);
    write(&paths[1], &image, Some(profile));
    paths
}

#[test]
fn display_p3_and_adobe_rgb_become_srgb() {
    let folder = tempfile::tempdir().unwrap();
    let spaces = [
        (Icc::new_display_p3(), P3, srgb_decode as fn(f32) -> f32, "Display P3"),
        (Icc::new_adobe_rgb(), ADOBE, adobe_decode, "Adobe RGB"),
    ];
    for (icc, primaries, decode, name) in spaces {
        let profile = icc.encode().unwrap();
        for (end, tolerance) in [("png", 1.0), ("jpg", 1.0), ("webp", 1.0), ("tif", 0.25)] {
            let [plain, with] = pair(folder.path(), end, &profile);
            assert_eq!(color_profile(&plain), ColorProfile::None);
            let found = color_profile(&with);
            assert!(matches!(&found, ColorProfile::Converted(n) if n.contains(name)), "{found:?}");
            let ((stored, alpha), (read, same)) = (display(&plain), display(&with));
            assert_eq!(alpha, same, "{end}");
            let mut changed = 0.0f32;
            for (from, to) in stored.iter().zip(&read) {
                for (expected, to) in in_srgb(primaries, decode, *from).iter().zip(to) {
                    let error = 255.0 * (expected - to).abs();
                    assert!(error <= tolerance, "{end}, {name}: {from:?} became {to}, {expected}");
                }
                let changes = from.iter().zip(to).map(|(from, to)| 255.0 * (from - to).abs());
                changed = changes.fold(changed, f32::max);
            }
            assert!(changed > 10.0, "{end}: {changed}");
        }
    }
}

#[test]
fn a_photograph_in_display_p3_has_the_colours_of_its_original() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    // From sRGB to Display P3, for colours that are not very dark.
    let original =
        |x: u32, y: u32| [60 + x * 12, 70 + y * 15, 240 - x * 5 - y * 7].map(|v| v as u8);
    let (from, to) = (to_xyz(SRGB), inverse(&to_xyz(P3)));
    let pixel = |x: u32, y: u32| {
        let linear = original(x, y).map(|v| f64::from(srgb_decode(f32::from(v) / 255.0)));
        let p3 = times(&to, times(&from, linear)).map(|v| srgb_encode(v as f32));
        image::Rgb(p3.map(|v| (255.0 * v).round() as u8))
    };
    let image = DynamicImage::from(image::RgbImage::from_fn(16, 12, pixel));
    write(&path, &image, Some(&Icc::new_display_p3().encode().unwrap()));
    let (pixels, _) = display(&path);
    for (i, pixel) in (0u32..).zip(pixels) {
        for (v, expected) in pixel.iter().zip(original(i % 16, i / 16)) {
            assert!((255.0 * v - f32::from(expected)).abs() <= 1.01, "{i}: {pixel:?}");
        }
    }
}

#[test]
fn profiles_of_srgb_and_useless_ones_leave_all_bits() {
    let folder = tempfile::tempdir().unwrap();
    let p3 = Icc::new_display_p3().encode().unwrap();
    let mut cmyk = p3.clone();
    cmyk[16..20].copy_from_slice(b"CMYK");
    let mut lab = p3.clone();
    lab[16..20].copy_from_slice(b"Lab ");
    // The primary red is nearly black.
    let mut black = p3.clone();
    let tag = p3.windows(4).position(|w| w == b"rXYZ").unwrap();
    let place = u32::from_be_bytes(*p3[tag + 4..].first_chunk().unwrap()) as usize;
    black[place + 8..place + 20].copy_from_slice(&[0, 0, 16, 0].repeat(3));
    let grey = Icc::new_gray_with_gamma(1.8).encode().unwrap();
    let cases: [(Vec<u8>, Option<&str>); 7] = [
        (Icc::new_srgb().encode().unwrap(), None),
        (p3[..p3.len() / 2].to_vec(), Some("damaged")),
        (vec![7; 500], Some("damaged")),
        (cmyk, Some("Cmyk")),
        (lab, Some("Lab")),
        (black, Some("white")),
        (grey, Some("Gray")),
    ];
    for (profile, why) in cases {
        for end in ["png", "jpg", "webp", "tif"] {
            let [plain, with] = pair(folder.path(), end, &profile);
            assert_eq!(display(&plain), display(&with), "{end}");
            match (color_profile(&with), why) {
                (ColorProfile::Srgb, None) => {}
                (ColorProfile::Unknown(text), Some(why)) if text.contains(why) => {}
                other => panic!("{end}: {other:?}"),
            }
        }
    }
}

#[test]
fn grey_images_keep_black_and_white() {
    let folder = tempfile::tempdir().unwrap();
    let ramp = image::GrayImage::from_fn(256, 1, |x, _| image::Luma([x as u8]));
    let gamma = Icc::new_gray_with_gamma(1.8).encode().unwrap();
    let grey = DynamicImage::from(ramp);
    let kinds = [grey.clone(), grey.to_luma_alpha8().into(), grey.to_luma16().into()];
    for (end, kind) in [("png", 0), ("png", 1), ("png", 2), ("tif", 0), ("tif", 2), ("jpg", 0)] {
        let path = folder.path().join(format!("grey.{end}"));
        write(&path, &kinds[kind], Some(&gamma));
        let found = color_profile(&path);
        assert!(matches!(found, ColorProfile::Converted(_)), "{found:?}");
        let (pixels, alpha) = display(&path);
        assert!(alpha.is_none_or(|alpha| alpha == [1.0; 256]));
        let slack = if end == "jpg" { 12.0 } else { 1.0 };
        for (x, pixel) in pixels.iter().enumerate() {
            let expected = srgb_encode((x as f32 / 255.0).powf(1.8));
            assert!(255.0 * (pixel[0] - expected).abs() <= slack, "{end}: {x}: {pixel:?}");
            assert!(pixel[0] == pixel[1] && pixel[0] == pixel[2]);
        }
        if end != "jpg" {
            let film = read_image(&path).unwrap().0;
            assert_eq!([film.pixels[0], film.pixels[255]], [[0.0; 3], [1.0; 3]]);
        }
        // Grey values of a photograph that had colours: those of Display P3 are those of sRGB.
        write(&path, &kinds[kind], None);
        let plain = display(&path);
        write(&path, &kinds[kind], Some(&Icc::new_display_p3().encode().unwrap()));
        assert_eq!((display(&path), color_profile(&path)), (plain, ColorProfile::Srgb));
    }
}

#[test]
fn a_profile_in_several_segments_behind_others_is_put_together() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    let [plain, with] = pair(folder.path(), "jpg", &Icc::new_adobe_rgb().encode().unwrap());
    let (file, expected) = (std::fs::read(&plain).unwrap(), display(&with));
    let profile = Icc::new_adobe_rgb().encode().unwrap();
    let segment = |code: u8, content: &[u8]| {
        let length = u16::try_from(content.len() + 2).unwrap().to_be_bytes();
        [&[0xff, code], &length[..], content].concat()
    };
    let part = |number: u8, bytes: &[u8]| {
        segment(0xe2, &[b"ICC_PROFILE\0", &[number, 3][..], bytes].concat())
    };
    let third = profile.len() / 3;
    let parts = [
        part(1, &profile[..third]),
        part(2, &profile[third..2 * third]),
        part(3, &profile[2 * third..]),
    ];
    // More than the bytes in which a profile is looked for first.
    let others = segment(0xe1, &[3; 65000]).repeat(5);
    let mpf = segment(0xe2, b"MPF\0II*\0");
    let file_with = |parts: &[&[u8]]| {
        let all = [&file[..2], &others, &mpf, &parts.concat(), &file[2..]].concat();
        std::fs::write(&path, all).unwrap();
        color_profile(&path)
    };
    for order in [[0, 1, 2], [2, 0, 1]] {
        let found = file_with(&order.map(|i: usize| &parts[i][..]));
        assert!(matches!(found, ColorProfile::Converted(_)), "{found:?}");
        assert_eq!(display(&path), expected);
    }
    for parts in [&[&parts[0][..], &parts[2]][..], &[&parts[0], &parts[0], &parts[2]]] {
        let found = file_with(parts);
        assert!(matches!(&found, ColorProfile::Unknown(why) if why.contains("of 3 parts")));
        assert_eq!(display(&path), display(&plain));
    }
}

#[test]
fn a_camera_says_adobe_rgb_in_its_exif_block() {
    let folder = tempfile::tempdir().unwrap();
    let [plain, with] = pair(folder.path(), "jpg", &Icc::new_adobe_rgb().encode().unwrap());
    let file = std::fs::read(&plain).unwrap();
    let path = folder.path().join("a.jpg");
    for (rule, expected) in [(b"R03\0", &with), (b"R98\0", &plain)] {
        // The list at 8 names that of the camera at 26, which names that of exchange at 44.
        let entry = |tag: u16, kind: u8, count: u8, value: &[u8]| {
            [&[1, 0], &tag.to_le_bytes()[..], &[kind, 0, count, 0, 0, 0], value, &[0; 4]].concat()
        };
        let block = [
            &b"Exif\0\0II*\0\x08\0\0\0"[..],
            &entry(0x8769, 4, 1, &[26, 0, 0, 0]),
            &entry(0xa005, 4, 1, &[44, 0, 0, 0]),
            &entry(1, 2, 4, rule),
        ]
        .concat();
        let length = u16::try_from(block.len() + 2).unwrap().to_be_bytes();
        let all = [&file[..2], &[0xff, 0xe1], &length, &block, &file[2..]].concat();
        std::fs::write(&path, all).unwrap();
        assert_eq!(display(&path), display(expected));
        let is_converted = matches!(color_profile(&path), ColorProfile::Converted(_));
        assert_eq!(is_converted, rule == b"R03\0");
    }
}

/// A profile with a table for the perceptual rendering intent alone: linear values of sRGB.
fn table_profile() -> Vec<u8> {
    let fixed = |v: f64| ((v * 65536.0).round() as i32).to_be_bytes();
    let words = |values: &[u16]| values.iter().flat_map(|v| v.to_be_bytes()).collect::<Vec<u8>>();
    // The columns are the primaries for the white D50 of profiles.
    let rows = [[0.4361, 0.3851, 0.1431], [0.2225, 0.7169, 0.0606], [0.0139, 0.0971, 0.7139]];
    let corners = (0..8u8).map(|i| [i >> 2, i >> 1 & 1, i & 1].map(f64::from));
    let grid: Vec<u16> =
        corners.flat_map(|c| times(&rows, c).map(|v| (v * 32768.0).round() as u16)).collect();
    let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0].map(fixed).concat();
    let curves = words(&[0, 65535].repeat(3));
    let start = [&b"mft2\0\0\0\0\x03\x03\x02\0"[..], &identity, &words(&[2, 2])].concat();
    let table = [start, curves.clone(), words(&grid), curves].concat();
    let length = |n: usize| u32::try_from(n).unwrap().to_be_bytes();
    let white = [0.9642, 1.0, 0.8249].map(fixed).concat();
    [
        &length(144 + table.len())[..],
        b"\0\0\0\0\x02\x40\0\0mntrRGB XYZ ",
        &[0; 12],
        b"acsp",
        &[0; 28],
        &white,
        &[0; 48],
        &length(1),
        b"A2B0",
        &length(144),
        &length(table.len()),
        &table,
    ]
    .concat()
}

#[test]
fn a_profile_with_a_table_for_one_rendering_intent_is_applied() {
    let folder = tempfile::tempdir().unwrap();
    let [plain, with] = pair(folder.path(), "png", &table_profile());
    let found = color_profile(&with);
    assert!(matches!(found, ColorProfile::Converted(_)), "{found:?}");
    for (from, to) in display(&plain).0.iter().zip(display(&with).0) {
        for (from, to) in from.iter().zip(to) {
            // The package interpolates on a grid of its own.
            assert!(255.0 * (srgb_encode(*from) - to).abs() < 12.0, "{from} became {to}");
        }
    }
}

#[test]
fn damaged_profiles_are_no_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let image = DynamicImage::from(image::RgbImage::new(2, 1));
    for profile in [Icc::new_display_p3(), Icc::new_srgb(), Icc::new_gray_with_gamma(2.2)] {
        let profile = profile.encode().unwrap();
        for at in (0..profile.len()).step_by(5) {
            for byte in [0, 0xff, profile[at] ^ 0x44] {
                let mut damaged = profile.clone();
                damaged[at] = byte;
                write(&path, &image, Some(&damaged));
                read_image(&path).unwrap();
                let _ = color_profile(&path);
            }
        }
    }
}
