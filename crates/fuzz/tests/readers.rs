//! Every reader on its kept cases and on a fixed number of new ones, and the driver on a reader
//! with every fault.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::path::Path;

use fuzz::campaign::{Campaign, Cases, Limits};

/// The seed of the new cases.
const SEED: u64 = 13;

fn campaign<'a>(reader: &'a str) -> Campaign<'a> {
    let program = Path::new(env!("CARGO_BIN_EXE_fuzz"));
    Campaign { program, reader, limits: Limits::default(), keep: None }
}

/// Reads the kept cases of a reader, and then `count` new ones.
///
/// A sixteenth of these must be accepted, else the harm would never be deep in a file, and another
/// one must be refused.
fn check(reader: &str, count: u64) {
    let kept = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(reader);
    let tally = campaign(reader).run(Cases::Kept(&kept)).unwrap();
    assert!(tally.findings.is_empty(), "kept cases of {reader}:\n{}", tally.describe());
    let folders = std::fs::read_dir(&kept).map_or(0, Iterator::count);
    assert_eq!(tally.executions(), folders as u64, "{reader}");
    let tally = campaign(reader).run(Cases::Count(SEED, count)).unwrap();
    assert!(tally.findings.is_empty(), "{reader}, seed {SEED}:\n{}", tally.describe());
    assert_eq!(tally.executions(), count, "{reader}");
    let shares = (16 * tally.accepted / count, 16 * tally.refused / count);
    assert!(shares.0 > 0 && shares.1 > 0, "{reader}: {tally:?}");
}

macro_rules! readers {
    ($($name:ident: $count:literal,)*) => {
        $(
            #[test]
            fn $name() {
                check(stringify!($name), $count);
            }
        )*

        #[test]
        fn every_reader_has_a_test() {
            let names: Vec<&str> = fuzz::READERS.iter().map(|reader| reader.name).collect();
            assert_eq!(names, [$(stringify!($name)),*]);
        }
    };
}

readers! {
    array: 192,
    image: 192,
    mesh: 192,
    solid: 96,
    model: 192,
    background: 120,
    scene: 192,
    nerf: 96,
    neus: 96,
    middlebury: 96,
    colmap: 96,
    llff: 96,
    blended_mvs: 96,
    metashape: 96,
    sdfstudio: 96,
    splats: 96,
    run: 96,
    sweep: 96,
    results: 96,
    inspect: 24,
    resume: 24,
}

#[test]
fn crashes_hangs_and_wrong_messages_are_found_and_survived() {
    let folder = tempfile::tempdir().unwrap();
    let limits = Limits { seconds: 1.0, mebibytes: 512 };
    let campaign = Campaign { keep: Some(folder.path()), limits, ..campaign("self-test") };
    let tally = campaign.run(Cases::Count(SEED, 200)).unwrap();
    assert_eq!(tally.executions(), 200);
    assert!(tally.accepted > 120 && tally.refused == 0, "{tally:?}");
    let mut found: Vec<(&str, String)> = Vec::new();
    for finding in &tally.findings {
        let kept = folder.path().join(format!("self-test/{SEED}-{}", finding.case));
        let fault = std::fs::read_to_string(kept.join("fault")).unwrap();
        let message = std::fs::read_to_string(kept.with_extension("txt")).unwrap();
        assert_eq!(message, format!("{}: {}\n", finding.kind, finding.message));
        found.push((finding.kind, fault));
    }
    found.sort();
    let expected = [
        ("crash", "abort"),
        ("crash", "memory"),
        ("crash", "panic"),
        ("message", "lines"),
        ("time", "time"),
    ];
    assert_eq!(found, expected.map(|(kind, fault)| (kind, fault.to_owned())), "{tally:?}");
}
