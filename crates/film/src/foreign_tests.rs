//! Files of formats that are not read.

use crate::tiff_tests::tiff;
use crate::{image_size, is_image_name, read_image, refuse_unconverted};

/// The starts of files, their formats, and words of their converters.
fn files() -> Vec<(Vec<u8>, &'static str, &'static str)> {
    let any = |start: &[u8]| [start, &[1; 80]].concat();
    let tga = [0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 4, 0, 3, 0, 24, 0x20];
    let mapped = [0, 1, 1, 0, 0, 2, 0, 24, 0, 0, 0, 0, 4, 0, 3, 0, 8, 0];
    vec![
        (any(b"BM\x46\0\0\0\0\0\0\0\x36\0\0\0\x28\0\0\0"), "a BMP image", "magick"),
        (any(b"GIF89a"), "a GIF image", "magick"),
        (any(b"GIF87a"), "a GIF image", "magick"),
        (any(b"\xff\x0a"), "a JPEG XL image", "magick"),
        (any(b"\0\0\0\x0cJXL \r\n\x87\n\0\0\0\x14ftypjxl "), "a JPEG XL image", "magick"),
        (any(b"\0\0\0\x0cjP  \r\n\x87\n\0\0\0\x14ftypjp2 "), "a JPEG 2000 image", "magick"),
        (any(b"\xff\x4f\xff\x51"), "a JPEG 2000 image", "magick"),
        (any(b"8BPS\0\x01"), "a PSD image", "magick"),
        (any(b"P6\n4 3\n255\n"), "PPM", "magick"),
        (any(b"P5 # grey\n4 3 255 "), "PGM", "magick"),
        (any(b"P3\n# text\n1 1 1"), "PPM", "magick"),
        (any(b"Pf\n4 3\n-1.0\n"), "PFM", "magick"),
        (any(b"P7\nWIDTH 4\n"), "PAM", "magick"),
        (any(b"#?RADIANCE\n"), "Radiance HDR", "magick"),
        (any(b"#?RGBE\n"), "Radiance HDR", "magick"),
        (any(b"DDS \x7c\0\0\0"), "a DDS image", "magick"),
        (any(&tga), "a TGA image", "magick"),
        (any(&mapped), "a TGA image", "magick"),
        (any(b"II*\0\x10\0\0\0CR\x02\0"), "a CR2 image", "dcraw"),
        (any(b"\0\0\0\x18ftypcrx \0\0\0\x01crx isom"), "a CR3 image", "darktable-cli"),
        (any(b"FUJIFILMCCD-RAW 0201"), "a RAF image", "dcraw"),
        (any(b"IIRO\x08\0\0\0"), "an ORF image", "dcraw"),
        (any(b"IIRS\x08\0\0\0"), "an ORF image", "dcraw"),
        (any(b"MMOR\0\0\0\x08"), "an ORF image", "dcraw"),
        (any(b"IIU\0\x18\0\0\0"), "an RW2 image", "sips -s format tiff"),
    ]
}

#[test]
fn formats_that_are_not_read_are_refused_with_a_converter_whatever_their_name_is() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["IMG_1.png", "IMG_1.dat", "IMG_1"] {
        let path = folder.path().join(name);
        for (bytes, format, converter) in files() {
            std::fs::write(&path, &bytes).unwrap();
            for error in [read_image(&path).unwrap_err(), image_size(&path).unwrap_err()] {
                let text = error.to_string();
                for word in [name, "image: found a", format, converter, name] {
                    assert!(text.contains(word), "no {word} in {text}");
                }
                // The converter must not overwrite its input.
                let over = format!(" {name} {name}");
                assert!(!text.ends_with(&over) && text.lines().count() == 1, "{text}");
            }
        }
    }
}

#[test]
fn raw_files_that_are_tiff_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refusal = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let texts = [read_image(&path).unwrap_err(), image_size(&path).unwrap_err()];
        let [text, other] = texts.map(|error| error.to_string());
        assert_eq!(text, other);
        text
    };
    let long = 4;
    // A version of DNG beside a small picture that could be read.
    let dng = tiff(&[(50706, 1, &[1, 4, 0, 0])], [2, 2], 1, &[0; 4]);
    assert!(refusal("a.tif", &dng).contains("found a DNG image"));
    // The colours of a sensor in a list of its own, of Nikon; the picture alone could be read.
    let maker = b"NIKON CORPORATION\0".map(u32::from);
    let picture = |place: u32| tiff(&[(271, 2, &maker), (330, long, &[place])], [2, 2], 1, &[0; 4]);
    let picture = picture(u32::try_from(picture(0).len()).unwrap());
    read_image(&{
        let path = folder.path().join("picture.tif");
        std::fs::write(&path, &picture).unwrap();
        path
    })
    .unwrap();
    // One entry: the tag 262, of one short.
    let sensor = [1, 0, 6, 1, 3, 0, 1, 0, 0, 0, 0x23, 0x80, 0, 0, 0, 0, 0, 0];
    let nef = [&picture[..], &sensor].concat();
    let text = refusal("b.tif", &nef);
    assert!(text.contains("found a NEF image") && text.contains("darktable-cli b.tif"), "{text}");
    assert!(text.contains("b-converted.tif"), "{text}");
    // The name tells where the content does not.
    let plain = tiff(&[], [2, 2], 1, &[0; 4]);
    assert!(refusal("c.NEF", &plain).contains("found a NEF image"));
    assert!(refusal("c.arw", &plain).contains("found an ARW image"));
    // A list that names itself, and places outside the file.
    for sub in [8, u32::MAX, 0] {
        let path = folder.path().join("loop.tif");
        let tags: &[u32] = &[sub; 40];
        std::fs::write(&path, tiff(&[(330, long, tags)], [2, 2], 1, &[0; 4])).unwrap();
        read_image(&path).unwrap();
    }
}

#[test]
fn a_missing_image_is_refused_by_the_file_of_another_format_in_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("b.cr2"), b"II*\0\x10\0\0\0CR\x02\0").unwrap();
    let refusal = |name: &str| read_image(&at(name)).unwrap_err().to_string();
    for name in ["b.jpg", "b", "c.jpg"] {
        assert!(refusal(name).contains("b.cr2: image: found a CR2 image"), "{name}");
    }
    assert!(refuse_unconverted(folder.path()).is_err());
    std::fs::write(at("d.TIFF"), "").unwrap();
    assert!(refusal("b.jpg").contains("b.cr2"));
    assert!(refusal("c.jpg").contains("no such file"));
    refuse_unconverted(folder.path()).unwrap();
    assert!(is_image_name(&at("d.TIFF")) && !is_image_name(&at("b.cr2")));
}

#[test]
fn texts_and_tables_are_no_images_of_another_format() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let texts: [&[u8]; 6] = [
        b"BMW and other words, longer than a header",
        b"P1 left P2 right P3 middle",
        b"Pf. words",
        &[0; 64],
        &[1, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 24, 0],
        b"some words, and more of them",
    ];
    for text in texts {
        std::fs::write(&path, text).unwrap();
        let error = read_image(&path).unwrap_err().to_string();
        assert!(error.contains("no image") && !error.contains("convert"), "{error}");
    }
}
