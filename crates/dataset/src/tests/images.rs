//! Images and masks: size, alpha, distortion, files that are missing or damaged.

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
fn missing_truncated_and_unreadable_images_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    write_nerf(folder.path(), "transforms.json", &cameras(3));
    let path = folder.path().join("transforms_1.png");
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    refused(folder.path(), &["transforms_1.png", "cut short"]);
    std::fs::write(&path, "words").unwrap();
    refused(folder.path(), &["transforms_1.png", "no image"]);
    std::fs::remove_file(&path).unwrap();
    refused(folder.path(), &["transforms_1", "no such file"]);
}
