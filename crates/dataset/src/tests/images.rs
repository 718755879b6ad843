//! Images and masks: size, alpha, distortion, files that are missing or damaged.

use std::path::Path;

use super::*;

#[test]
fn downscaled_images_are_averaged_in_linear_radiance() {
    let folder = tempfile::tempdir().unwrap();
    write_nerf(folder.path(), "transforms.json", &cameras(2));
    let whole = load(folder.path(), &LoadOptions { downscale: 1 }).unwrap();
    let half = load(folder.path(), &LoadOptions { downscale: 2 }).unwrap();
    let (a, b) = (&whole.train[0], &half.train[0]);
    assert_eq!((b.camera.width, b.camera.height), (24, 20));
    let mean = (0..3).map(|c| {
        [(10, 8), (11, 8), (10, 9), (11, 9)].map(|(x, y)| a.image.at(x, y)[c]).iter().sum::<f32>()
            / 4.0
    });
    for (mean, found) in mean.zip(b.image.at(5, 4)) {
        assert_relative_eq!(mean, found, epsilon = 1e-6);
    }
    let u = DVec2::new(11.5, 17.0);
    assert_relative_eq!(a.camera.direction(u), b.camera.direction(u / 2.0), epsilon = 1e-12);
    assert!(load(folder.path(), &LoadOptions { downscale: 0 }).is_err());
}

/// The mean of each block of n × n pixels of a row-major image, as far as it lies in the image.
fn means(width: usize, values: &[f32], n: usize) -> Vec<f32> {
    let height = values.len() / width;
    let mut out = Vec::new();
    for y in (0..height).step_by(n) {
        for x in (0..width).step_by(n) {
            let (mut sum, mut count) = (0.0, 0.0);
            for v in y..(y + n).min(height) {
                for u in x..(x + n).min(width) {
                    sum += values[v * width + u];
                    count += 1.0;
                }
            }
            out.push(sum / count);
        }
    }
    out
}

/// A channel of an image.
fn channel(image: &Film, c: usize) -> Vec<f32> {
    image.pixels.iter().map(|pixel| pixel[c]).collect()
}

/// An image with noise in all channels. Alpha is below a half in some pixels.
fn noise() -> image::RgbaImage {
    let noise = |x: u32, y: u32| [x * 37 + y * 101, x * 91 + y * 17, x * y, 90 * x + 7 * y];
    image::RgbaImage::from_fn(WIDTH, HEIGHT, |x, y| {
        image::Rgba(noise(x, y).map(|v| (v % 256) as u8))
    })
}

#[test]
fn whole_images_have_the_values_of_their_films_times_alpha() {
    let folder = tempfile::tempdir().unwrap();
    let mut root = write_nerf(folder.path(), "transforms.json", &cameras(4));
    let image = image::DynamicImage::from(noise());
    let files = ["a.png", "b.jpg", "c.png", "d.png"].map(|name| folder.path().join(name));
    image.save(&files[0]).unwrap();
    image.to_rgb8().save(&files[1]).unwrap();
    image.to_luma16().save(&files[2]).unwrap();
    image.to_rgba16().save(&files[3]).unwrap();
    for (i, file) in files.iter().enumerate() {
        root["frames"][i]["file_path"] = json!(file);
    }
    write_json(&folder.path().join("transforms.json"), &root);
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    for (view, file) in in_order(&dataset).into_iter().zip(&files) {
        let (film, alpha) = film::read_image(file).unwrap();
        assert_eq!(view.mask.as_ref().map(|mask| &mask.values), alpha.as_ref());
        for c in 0..3 {
            let mut expected = channel(&film, c);
            let scaled = expected.iter_mut().zip(alpha.iter().flatten());
            scaled.for_each(|(value, alpha)| *value *= alpha);
            assert_eq!(channel(&view.image, c), expected, "{}", file.display());
        }
    }
}

#[test]
fn reduced_views_are_the_means_of_the_whole_ones() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("transforms.json");
    let mut root = write_nerf(folder.path(), "transforms.json", &cameras(4));
    let image = image::DynamicImage::from(noise());
    image.save(folder.path().join("transforms_1.png")).unwrap();
    image.to_luma8().save(folder.path().join("mask.png")).unwrap();
    root["frames"][2]["mask_path"] = json!("mask.png");
    image.to_rgb16().save(folder.path().join("transforms_3.png")).unwrap();
    for distortion in [0.0, 0.2] {
        root["k1"] = json!(distortion);
        write_json(&path, &root);
        let whole = load(&path, &LoadOptions::default()).unwrap();
        for n in [2, 3, 7, 100] {
            let reduced = load(&path, &LoadOptions { downscale: n }).unwrap();
            for (a, b) in in_order(&whole).into_iter().zip(in_order(&reduced)) {
                let (width, n) = (WIDTH as usize, n as usize);
                for c in 0..3 {
                    assert_eq!(means(width, &channel(&a.image, c), n), channel(&b.image, c));
                }
                let of_whole = a.mask.as_ref().map(|mask| means(width, &mask.values, n));
                assert_eq!(of_whole, b.mask.as_ref().map(|mask| mask.values.clone()));
            }
        }
    }
}

#[test]
fn masks_come_from_alpha_a_key_or_the_masks_folder() {
    let folder = tempfile::tempdir().unwrap();
    let mut root = write_nerf(folder.path(), "transforms.json", &cameras(3));
    let mut rgba = image::RgbaImage::from_pixel(WIDTH, HEIGHT, image::Rgba([255, 255, 255, 0]));
    rgba.put_pixel(3, 2, image::Rgba([255, 255, 255, 255]));
    rgba.save(folder.path().join("transforms_0.png")).unwrap();
    let grey = image::GrayImage::from_pixel(WIDTH, HEIGHT, image::Luma([128]));
    grey.save(folder.path().join("white.png")).unwrap();
    root["frames"][1]["mask_path"] = json!("white.png");
    // The third has an alpha channel that cuts nothing out.
    let white = image::RgbaImage::from_pixel(WIDTH, HEIGHT, image::Rgba([255, 255, 255, 254]));
    white.save(folder.path().join("transforms_2.png")).unwrap();
    std::fs::create_dir(folder.path().join("masks")).unwrap();
    image::GrayImage::new(WIDTH, HEIGHT)
        .save(folder.path().join("masks/transforms_2.png"))
        .unwrap();
    let path = folder.path().join("transforms.json");
    write_json(&path, &root);
    let dataset = load(&path, &LoadOptions::default()).unwrap();
    let views = in_order(&dataset);
    let masks: Vec<&Mask> = views.iter().map(|v| v.mask.as_ref().unwrap()).collect();
    let kinds = [MaskKind::Alpha, MaskKind::Used, MaskKind::Object];
    assert!(masks.iter().map(|mask| mask.kind).eq(kinds));
    let masks: Vec<&Vec<f32>> = masks.iter().map(|mask| &mask.values).collect();
    assert_eq!((masks[0][0], masks[0][2 * WIDTH as usize + 3]), (0.0, 1.0));
    assert_eq!((views[0].image.at(0, 0), views[0].image.at(3, 2)), ([0.0; 3], [1.0; 3]));
    assert_relative_eq!(masks[1][7], 128.0 / 255.0, epsilon = 1e-5);
    assert_eq!(masks[2][7], 0.0);
    root["frames"][1]["mask_path"] = json!("none.png");
    write_json(&path, &root);
    let notes = load(&path, &LoadOptions::default()).unwrap().notes;
    assert!(notes[0].ends_with("named by the camera file and missing: none.png"), "{notes:?}");
}

#[test]
fn distortion_is_removed_from_the_photographs() {
    let folder = tempfile::tempdir().unwrap();
    let mut root = write_nerf(folder.path(), "transforms.json", &cameras(3));
    root["k1"] = json!(0.3);
    write_json(&folder.path().join("transforms.json"), &root);
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    let view = in_order(&dataset)[0];
    assert!(
        view.camera.focal.x > 90.0,
        "an image with pincushion distortion is magnified, focal lengths {}",
        view.camera.focal
    );
    assert_ne!(view.image, photograph(&cameras(1)[0]));
}

#[test]
fn truncated_and_unreadable_images_are_refused_and_a_missing_one_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    write_nerf(folder.path(), "transforms.json", &cameras(3));
    let path = folder.path().join("transforms_1.png");
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    refused(folder.path(), &["transforms_1.png", "cut short"]);
    std::fs::write(&path, "words").unwrap();
    refused(folder.path(), &["transforms_1.png", "no image"]);
    std::fs::remove_file(&path).unwrap();
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_eq!(dataset.notes, ["1 of 3 images is missing and left out: transforms_1"]);
    std::fs::remove_file(folder.path().join("transforms_2.png")).unwrap();
    refused(folder.path(), &["images", "2 of 3 missing", "transforms_1", "no such file"]);
}

/// Reads a picture. With the decoder of PNG alone, the tests are compiled faster.
fn read_png(path: &Path) -> image::RgbImage {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let decoder = image::codecs::png::PngDecoder::new(file).unwrap();
    image::DynamicImage::from_decoder(decoder).unwrap().to_rgb8()
}

/// Writes an image with an EXIF block of one entry: the orientation.
fn write_oriented(path: &Path, image: &image::RgbImage, orientation: u8) {
    let mut encoder = image::codecs::png::PngEncoder::new(std::fs::File::create(path).unwrap());
    let mut exif = b"II\x2a\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    exif.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
    image::ImageEncoder::set_exif_metadata(&mut encoder, exif).unwrap();
    image.write_with_encoder(encoder).unwrap();
}

#[test]
fn photographs_upside_down_by_exif_are_read_as_stored_with_a_note() {
    let folder = tempfile::tempdir().unwrap();
    write_nerf(folder.path(), "transforms.json", &cameras(3));
    let plain = load(folder.path(), &LoadOptions::default()).unwrap();
    assert!(plain.notes.is_empty());
    for (i, orientation) in [(0, 1), (1, 3), (2, 4)] {
        let path = folder.path().join(format!("transforms_{i}.png"));
        write_oriented(&path, &read_png(&path), orientation);
    }
    let found = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_eq!(found.train[1].image, plain.train[1].image);
    assert_eq!(found.notes.len(), 1, "{:?}", found.notes);
    assert!(found.notes[0].starts_with("2 images have") && found.notes[0].ends_with("_1"));
}

#[test]
fn photographs_are_turned_by_exif_where_the_camera_file_has_the_size_as_shown() {
    let folder = tempfile::tempdir().unwrap();
    let mut root = write_nerf(folder.path(), "transforms.json", &cameras(3));
    let shown = load(folder.path(), &LoadOptions::default()).unwrap();
    for i in 0..3 {
        let path = folder.path().join(format!("transforms_{i}.png"));
        let stored = image::imageops::rotate270(&read_png(&path));
        // The image is shown turned by a quarter, clockwise.
        write_oriented(&path, &stored, 6);
    }
    let turned = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_eq!((&turned.train[0].image, turned.notes.len()), (&shown.train[0].image, 0));
    // Without a size in the file, the pixels count as stored.
    root.as_object_mut().unwrap().retain(|key, _| key != "w" && key != "h");
    write_json(&folder.path().join("transforms.json"), &root);
    let stored = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_eq!((stored.train[0].image.width, stored.train[0].image.height), (HEIGHT, WIDTH));
    assert!(stored.notes[0].starts_with("3 images have an EXIF"), "{:?}", stored.notes);
    assert_eq!(open(folder.path()).unwrap().sizes()[0][0], [HEIGHT, WIDTH]);
    // One of the two is a size of the file too.
    root["w"] = (HEIGHT + 1).into();
    write_json(&folder.path().join("transforms.json"), &root);
    refused(folder.path(), &["size", "(from transforms.json)"]);
}

#[test]
fn heic_files_in_place_of_photographs_are_refused_with_a_converter() {
    let folder = tempfile::tempdir().unwrap();
    write_nerf(folder.path(), "transforms.json", &cameras(3));
    let path = folder.path().join("transforms_1.png");
    std::fs::write(&path, b"\0\0\0\x18ftypheic\0\0\0\0mif1heic").unwrap();
    refused(folder.path(), &["transforms_1.png", "HEIC", "heif-convert"]);
    std::fs::rename(&path, folder.path().join("transforms_1.HEIC")).unwrap();
    refused(folder.path(), &["transforms_1.HEIC", "HEIC", "heif-convert"]);
}
