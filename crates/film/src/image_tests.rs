use crate::{Film, image_size, read_image, srgb_decode, write_image, write_npy};

fn film() -> Film {
    let pixels = (0..12).map(|i| [i as f32 / 11.0, 0.5, 1.0 - i as f32 / 11.0]).collect();
    Film { width: 4, height: 3, pixels }
}

#[test]
fn images_come_back_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    for (name, tolerance) in [("a.png", 0.01), ("a.exr", 0.0), ("a.npy", 0.0)] {
        let path = folder.path().join(name);
        write_image(&path, &film()).unwrap();
        let (read, alpha) = read_image(&path).unwrap();
        assert_eq!((read.width, read.height, alpha.is_some()), (4, 3, false));
        for (a, b) in read.pixels.as_flattened().iter().zip(film().pixels.as_flattened()) {
            assert!((a - b).abs() <= tolerance, "{name}: {a} against {b}");
        }
    }
    assert!(write_image(&folder.path().join("a.gif"), &film()).is_err());
}

#[test]
fn missing_cut_and_foreign_files_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let noise = |x: u32, y: u32| {
        image::Rgb([x * 37 + y * 101, x * 91 + y * 17, x * y].map(|v| (v % 256) as u8))
    };
    for name in ["a.png", "a.jpg", "a.exr", "a.npy"] {
        let path = folder.path().join(name);
        assert!(read_image(&path).unwrap_err().to_string().contains("no such file"), "{name}");
        match name {
            "a.jpg" => image::RgbImage::from_fn(64, 64, noise).save(&path).unwrap(),
            _ => write_image(&path, &film()).unwrap(),
        }
        read_image(&path).unwrap();
        let whole = std::fs::read(&path).unwrap();
        // A JPEG file has all its pixels without its last two bytes.
        let last = if name == "a.jpg" { 3 } else { 1 };
        for length in [whole.len() / 2, whole.len() * 3 / 4, whole.len() - last] {
            std::fs::write(&path, &whole[..length]).unwrap();
            let error =
                read_image(&path).expect_err(&format!("{name} cut at {length}")).to_string();
            assert!(error.contains(name) && error.contains("cut short"), "{error}");
        }
        for junk in ["", "some words, and more of them"] {
            std::fs::write(&path, junk).unwrap();
            let error = read_image(&path).expect_err(name).to_string();
            assert!(error.contains(name) && !error.contains("cut short"), "{error}");
        }
    }
}

#[test]
fn every_depth_and_channel_count_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let half = srgb_decode(0.5);
    let grey16 = image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(3, 2, image::Luma([0x8000]));
    grey16.save(at("grey16.png")).unwrap();
    image::ImageBuffer::<image::LumaA<u8>, _>::from_pixel(3, 2, image::LumaA([255, 51]))
        .save(at("alpha.png"))
        .unwrap();
    let (grey, none) = read_image(&at("grey16.png")).unwrap();
    assert!(
        none.is_none() && grey.pixels.iter().all(|p| p.iter().all(|c| (c - half).abs() < 1e-4)),
        "{grey:?}"
    );
    let (white, alpha) = read_image(&at("alpha.png")).unwrap();
    assert_eq!(white.pixels[5], [1.0; 3]);
    assert!((alpha.unwrap()[5] - 0.2).abs() < 1e-6);
    for shape in [&[2, 3][..], &[2, 3, 1]] {
        write_npy(&at("grey.npy"), shape, &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]).unwrap();
        let (grey, _) = read_image(&at("grey.npy")).unwrap();
        assert_eq!((grey.width, grey.height, grey.at(2, 1)), (3, 2, [5.0; 3]));
    }
    write_npy(&at("odd.npy"), &[3, 2], &[0.0; 6]).unwrap();
    for shape in [&[6][..], &[1, 3, 2], &[0, 3]] {
        write_npy(&at("odd.npy"), shape, &vec![0.0; shape.iter().product()]).unwrap();
        assert!(read_image(&at("odd.npy")).is_err(), "{shape:?}");
    }
    assert_eq!(image_size(&at("grey16.png")).unwrap(), (3, 2));
    assert_eq!(image_size(&at("grey.npy")).unwrap(), (3, 2));
    assert!(image_size(&at("none.png")).unwrap_err().to_string().contains("no such file"));
}

#[test]
fn a_palette_that_ends_within_a_colour_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    // One pixel of 8 bits, which is the colour 0 of the palette.
    let file = |palette: &[u8]| {
        let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
        let mut chunk = |name: &[u8; 4], content: &[u8]| {
            bytes.extend((content.len() as u32).to_be_bytes());
            let checked = [name, content].concat();
            let crc = checked.iter().fold(!0u32, |crc, byte| {
                (0..8).fold(crc ^ u32::from(*byte), |c, _| (c >> 1) ^ (0xedb8_8320 * (c & 1)))
            });
            bytes.extend(checked);
            bytes.extend((!crc).to_be_bytes());
        };
        chunk(b"IHDR", &[0, 0, 0, 1, 0, 0, 0, 1, 8, 3, 0, 0, 0]);
        chunk(b"PLTE", palette);
        // A stored block of the two bytes 0, and the Adler-32 checksum.
        chunk(b"IDAT", &[0x78, 0x01, 1, 2, 0, 0xfd, 0xff, 0, 0, 0, 2, 0, 1]);
        chunk(b"IEND", &[]);
        bytes
    };
    std::fs::write(&path, file(&[255, 0, 0])).unwrap();
    assert_eq!(read_image(&path).unwrap().0.pixels, [[1.0, 0.0, 0.0]]);
    for palette in [&[255][..], &[255, 0, 0, 0, 255]] {
        std::fs::write(&path, file(palette)).unwrap();
        let error = read_image(&path).unwrap_err().to_string();
        assert!(error.contains("a.png") && error.contains("palette"), "{error}");
    }
}
