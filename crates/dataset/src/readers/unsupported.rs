//! Data sets of other programs: they are recognised to name a way to convert them.

use std::path::Path;

use files::InputError;

/// The camera files that can be read, for messages.
const EXPECTED: &str = "transforms_train.json, transforms.json, cameras_sphere.npz, cameras.npz, \
     meta_data.json, *_par.txt, a COLMAP model (cameras.bin or .txt), cameras.json, \
     poses_bounds.npy, cams/*.txt or a camera file of Metashape (.xml)";

/// New poses, for programs whose files no converter reads.
const NEW_POSES: &str = "poses of the photographs by `dsdf poses` (see docs/captures.md)";

/// A form of data set that is not read.
struct Form {
    name: &'static str,
    /// The way to a form that is read.
    remedy: &'static str,
    /// Whether a folder with these files, sorted by name, has this form.
    is_in: fn(&Path, &[String]) -> bool,
}

fn has(names: &[String], name: &str) -> bool {
    names.iter().any(|n| n == name)
}

fn ends(names: &[String], end: &str) -> bool {
    names.iter().any(|n| n.to_lowercase().ends_with(end))
}

/// The first line of a readable text file, up to 500 bytes.
fn first_line(path: &Path) -> String {
    let Ok((file, _)) = files::open(path, "file", "text") else { return String::new() };
    let mut start = Vec::new();
    // A file that cannot be read has no first line.
    let _ = std::io::Read::read_to_end(&mut std::io::Read::take(file, 500), &mut start);
    String::from_utf8_lossy(&start).lines().next().unwrap_or_default().to_owned()
}

const FORMS: [Form; 14] = [
    Form {
        name: "a raw capture of Polycam (keyframes/)",
        remedy: "transforms.json by ns-process-data polycam",
        is_in: |folder, names| {
            has(names, "keyframes") && folder.join("keyframes").is_dir()
                || has(names, "corrected_cameras")
        },
    },
    Form {
        name: "a capture of Record3D (.r3d, or EXR_RGBD with metadata)",
        remedy: "transforms.json by ns-process-data record3d",
        is_in: |_, names| ends(names, ".r3d") || has(names, "EXR_RGBD"),
    },
    Form {
        name: "cameras of RealityCapture (.csv)",
        remedy: "transforms.json by ns-process-data realitycapture",
        is_in: |folder, names| {
            let is_csv = |name: &&String| name.to_lowercase().ends_with(".csv");
            names.iter().filter(is_csv).any(|name| {
                let line = first_line(&folder.join(name));
                line.contains("#name") && line.contains("heading")
            })
        },
    },
    Form {
        name: "a reconstruction of OpenMVG (sfm_data.json)",
        remedy: "a COLMAP model by openMVG_main_openMVG2Colmap",
        is_in: |_, names| ["sfm_data.json", "sfm_data.bin"].iter().any(|name| has(names, name)),
    },
    Form {
        name: "a reconstruction of OpenDroneMap (odm_report or opensfm)",
        remedy: "transforms.json by ns-process-data odm",
        is_in: |_, names| has(names, "odm_report") || has(names, "opensfm"),
    },
    Form {
        name: "a reconstruction of OpenSfM (reconstruction.json)",
        remedy: "a COLMAP model by opensfm export_colmap",
        is_in: |_, names| has(names, "reconstruction.json"),
    },
    Form {
        name: "a project of Metashape (.psx or .psz)",
        remedy: "a camera file of Metashape (menu File, Export, Export Cameras)",
        is_in: |_, names| ends(names, ".psx") || ends(names, ".psz"),
    },
    Form {
        name: "a database of COLMAP without a model (.db)",
        remedy: "a COLMAP model by colmap mapper (see docs/captures.md)",
        is_in: |_, names| ends(names, ".db"),
    },
    Form {
        name: "a reconstruction of Bundler (bundle.out)",
        remedy: NEW_POSES,
        is_in: |folder, names| {
            ["bundle.out", "bundle.rd.out", "bundler.out"].iter().any(|name| has(names, name))
                || folder.join("bundle/bundle.out").is_file()
        },
    },
    Form {
        name: "a reconstruction of VisualSFM (.nvm)",
        remedy: NEW_POSES,
        is_in: |_, names| ends(names, ".nvm"),
    },
    Form {
        name: "a scene of MVE (views/)",
        remedy: NEW_POSES,
        is_in: |folder, names| {
            has(names, "synth_0.out")
                || std::fs::read_dir(folder.join("views")).is_ok_and(|entries| {
                    let mut names = entries.flatten().map(|e| e.file_name());
                    names.any(|name| name.to_string_lossy().ends_with(".mve"))
                })
        },
    },
    Form {
        name: "a project of Meshroom (.mg)",
        remedy: NEW_POSES,
        is_in: |_, names| ends(names, ".mg") || has(names, "MeshroomCache"),
    },
    Form {
        name: "a scan of ScanNet (pose/ and intrinsic/)",
        remedy: "transforms.json made from pose/, or poses by `dsdf poses`",
        is_in: |folder, names| {
            folder.join("pose").is_dir()
                && (has(names, "intrinsic") || has(names, "color") || has(names, "rgb"))
        },
    },
    Form {
        name: "photographs without cameras",
        remedy: NEW_POSES,
        is_in: |folder, names| {
            [".jpg", ".jpeg", ".png", ".heic"].iter().any(|end| ends(names, end))
                || ["images", "input"].iter().any(|name| folder.join(name).is_dir())
        },
    },
];

/// The error of a folder that no reader recognises; `names` are its files.
pub(crate) fn error(folder: &Path, names: &[String]) -> InputError {
    match FORMS.iter().find(|form| (form.is_in)(folder, names)) {
        Some(Form { name, remedy, .. }) => {
            let found = format!("no camera file, but {name}, which is not read");
            InputError::new(folder, "data set", found, remedy)
        }
        None => InputError::new(folder, "data set", "no camera file", EXPECTED),
    }
}
