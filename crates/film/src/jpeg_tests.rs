//! JPEG files whose end is missing, is not the end of the file, or lies in another image.

use std::path::Path;

use crate::read_image;

/// Files of all kinds of scans, by `fixtures/make.py`.
const FILES: [(&str, &[u8]); 8] = [
    ("baseline", include_bytes!("../fixtures/baseline.jpg")),
    ("baseline-restart", include_bytes!("../fixtures/baseline-restart.jpg")),
    ("progressive", include_bytes!("../fixtures/progressive.jpg")),
    ("progressive-restart", include_bytes!("../fixtures/progressive-restart.jpg")),
    ("grey-baseline", include_bytes!("../fixtures/grey-baseline.jpg")),
    ("grey-baseline-restart", include_bytes!("../fixtures/grey-baseline-restart.jpg")),
    ("grey-progressive", include_bytes!("../fixtures/grey-progressive.jpg")),
    ("grey-progressive-restart", include_bytes!("../fixtures/grey-progressive-restart.jpg")),
];

/// The pixels of a file with this content, or the message of its error.
fn read(path: &Path, bytes: &[u8]) -> Result<Vec<[f32; 3]>, String> {
    std::fs::write(path, bytes).unwrap();
    read_image(path).map(|(film, _)| film.pixels).map_err(|error| error.to_string())
}

/// A segment of application data.
fn segment(code: u8, content: &[u8]) -> Vec<u8> {
    let length = u16::try_from(content.len() + 2).unwrap().to_be_bytes();
    [&[0xff, code], &length[..], content].concat()
}

#[test]
fn data_behind_the_image_are_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    let film = [&b"\0\0\0\x18ftypmp42\0\0\0\0\xff\xda\0\x08"[..], &[7; 99], b"\xff\xda"].concat();
    for (name, file) in FILES {
        let alone = read(&path, file).unwrap();
        let broken = &FILES[2].1[..400];
        for behind in
            [&film[..], FILES[0].1, FILES[7].1, broken, b"\xff\xda", b"\xff\xd8", &[0; 64]]
        {
            let whole = [file, behind].concat();
            assert_eq!(read(&path, &whole).as_ref(), Ok(&alone), "{name}");
            // The first image is cut short, whatever follows: nothing, or what is left of a disk.
            for cut in [file.len() / 2, file.len() - 3] {
                let error = read(&path, &[&file[..cut], &[0; 64]].concat()).unwrap_err();
                assert!(error.contains("cut short"), "{name}: {error}");
            }
        }
    }
}

#[test]
fn an_image_without_its_end_is_read_if_all_its_scans_are_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    for (name, file) in FILES {
        let whole = read(&path, file).unwrap();
        // The mark of the end is missing in part, or as a whole, or another image follows.
        let scans = &file[..file.len() - 2];
        for bytes in [&file[..file.len() - 1], scans, &[scans, file].concat()] {
            assert_eq!(read(&path, bytes).as_ref(), Ok(&whole), "{name}");
        }
        for cut in 3..scans.len() {
            let error = read(&path, &file[..cut]).expect_err(&format!("{name} cut at {cut}"));
            assert!(error.contains("a.jpg") && error.contains("cut short"), "{error}");
            // The rest of the file was never written.
            if cut % 7 == 0 || cut + 9 > scans.len() {
                let error = read(&path, &[&file[..cut], &[0; 900]].concat()).unwrap_err();
                assert!(error.contains("cut short"), "{name} cut at {cut}: {error}");
            }
        }
    }
}

#[test]
fn a_smaller_image_in_a_header_is_not_the_image() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    for (name, file) in FILES {
        let whole = read(&path, file).unwrap();
        let header = segment(0xe1, &[b"Exif\0\0", FILES[4].1, &[0; 50]].concat());
        let with = [&file[..2], &header, b"\xff\xff", &file[3..]].concat();
        assert_eq!(read(&path, &with).as_ref(), Ok(&whole), "{name}");
        for cut in [60, header.len() - 20, header.len(), with.len() - file.len() / 3] {
            let error = read(&path, &with[..cut]).unwrap_err();
            assert!(error.contains("cut short"), "{name} cut at {cut}: {error}");
        }
    }
}

#[test]
fn damaged_files_are_no_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    for (_, file) in FILES {
        for at in (2..file.len()).step_by(17) {
            for byte in [0, 0xff, file[at] ^ 0x11] {
                let mut damaged = file.to_vec();
                damaged[at] = byte;
                let end = damaged.len() - 2;
                for bytes in [&damaged[..], &damaged[..end]] {
                    if let Err(error) = read(&path, bytes) {
                        assert_eq!(error.lines().count(), 1, "{error}");
                    }
                }
            }
        }
    }
}
