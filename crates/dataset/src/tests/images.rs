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
    refused(&path, &["none.png", "no such file"]);
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
