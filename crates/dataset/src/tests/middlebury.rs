//! `*_par.txt`.

use std::path::PathBuf;

use super::*;

/// A line of the camera file.
pub(super) fn middlebury_line(name: &str, c: &Camera, skew: f64) -> String {
    let (r, t) = world_to_camera(c);
    let k = [c.focal.x, skew, c.principal.x, 0.0, c.focal.y, c.principal.y, 0.0, 0.0, 1.0];
    let numbers = k.into_iter().chain(r.transpose().to_cols_array()).chain(t.to_array());
    format!("{name} {}", numbers.map(|v| format!("{v:.12}")).collect::<Vec<_>>().join(" "))
}

/// Writes the camera file and the images; returns the file's path.
fn write_middlebury(folder: &Path, cameras: &[Camera]) -> PathBuf {
    let lines = cameras.iter().enumerate().map(|(i, c)| {
        let name = format!("ball{i:04}.png");
        write_image(&folder.join(&name), &photograph(c)).unwrap();
        middlebury_line(&name, c, 0.0)
    });
    let text = format!("{}\n{}\n", cameras.len(), lines.collect::<Vec<_>>().join("\n"));
    let path = folder.join("ball_par.txt");
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn data_sets_are_read_and_wrong_lines_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let all = cameras(9);
    let file = write_middlebury(folder.path(), &all);
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    for (view, camera) in in_order(&dataset).into_iter().zip(&all) {
        assert_same_camera(&view.camera, camera, 1e-9);
    }
    let good = std::fs::read_to_string(&file).unwrap();
    let line = middlebury_line("ball0000.png", &all[0], 0.0);
    let with = |other: &str| std::fs::write(&file, good.replace(&line, other)).unwrap();
    with("ball0000.png 1 2 3");
    refused(folder.path(), &["ball_par.txt", "line 2", "3 numbers"]);
    with(&line.replacen("90.000000000000", "nan", 1));
    refused(folder.path(), &["line 2", "number 1 that is not finite"]);
    with(&line.replacen("90.000000000000", "0", 1));
    refused(folder.path(), &["line 2", "singular K", "fx and fy above 0"]);
    let stretched = line.split(' ').enumerate().map(|(i, w)| if i == 10 { "1.5" } else { w });
    with(&stretched.collect::<Vec<_>>().join(" "));
    refused(folder.path(), &["line 2", "R with columns of length"]);
    with(&line.replace("ball0000", "absent"));
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_eq!(dataset.notes, ["1 of 9 images is missing and left out: absent.png"]);
    assert_eq!(dataset.train.len() + dataset.test.len(), 8);
    std::fs::write(&file, good.replacen('9', "8", 1)).unwrap();
    refused(folder.path(), &["views", "found 9", "expected 8"]);
    std::fs::write(&file, "0\n").unwrap();
    refused(folder.path(), &["views"]);
}

#[test]
fn skew_is_removed_from_the_photographs() {
    let folder = tempfile::tempdir().unwrap();
    let all = cameras(2);
    let file = write_middlebury(folder.path(), &all);
    let lines: Vec<String> =
        (0..2).map(|i| middlebury_line(&format!("ball000{i}.png"), &all[i], 8.0)).collect();
    std::fs::write(&file, format!("2\n{}\n", lines.join("\n"))).unwrap();
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    let view = &dataset.train[0];
    // Without skew, a point with the tangent y appears 8 y pixels to the left.
    let y = (10.5 - all[0].principal.y) / all[0].focal.y;
    let zoom = view.camera.focal.x / all[0].focal.x;
    let at = DVec2::new(20.5, 10.5) - DVec2::new(8.0 * y, 0.0) - all[0].principal;
    assert!((1.0..1.2).contains(&zoom), "{zoom}");
    assert_relative_eq!(
        view.camera.direction(at * zoom + view.camera.principal),
        all[0].direction(DVec2::new(20.5, 10.5) - DVec2::new(8.0 * y, 0.0)),
        epsilon = 1e-12
    );
    assert_ne!(view.image, photograph(&all[0]));
}
