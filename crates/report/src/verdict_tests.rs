//! The rules of the verdict, one piece of evidence after the other.

use super::*;

/// The evidence of a good fit.
fn good() -> Evidence {
    Evidence {
        training_views: 32,
        uniform_background: true,
        background_confidence: 1.0,
        exposure_spread: Some(0.05),
        fits_exposures: false,
        surface: Some(SurfaceShares {
            on_sphere: 0.0,
            seen_on_sphere: 0.0,
            seen_above_table: 0.0,
            unseen: 0.05,
            unseen_sides: 0.05,
        }),
        training_match: Some(32.0),
        held_out_match: Some(31.0),
    }
}

fn shares(seen_on_sphere: f64, unseen: f64) -> Option<SurfaceShares> {
    let (on_sphere, seen_above_table) = (seen_on_sphere, seen_on_sphere);
    Some(SurfaceShares {
        on_sphere,
        seen_on_sphere,
        seen_above_table,
        unseen,
        unseen_sides: unseen,
    })
}

#[test]
fn each_fault_follows_from_its_evidence() {
    let cluttered = Evidence { background_confidence: 0.1, surface: shares(0.2, 0.1), ..good() };
    let short = Evidence { training_match: Some(19.0), held_out_match: Some(18.5), ..good() };
    let cow = Evidence { training_match: Some(24.8), held_out_match: Some(22.7), ..good() };
    let apart = Evidence { held_out_match: Some(25.0), ..good() };
    let cases = [
        (good(), None),
        (Evidence { surface: None, ..good() }, Some(Fault::NoSurface)),
        (cluttered.clone(), Some(Fault::PaintedBackground)),
        (Evidence { uniform_background: false, ..cluttered.clone() }, Some(Fault::SmallSphere)),
        (
            Evidence { uniform_background: false, training_match: Some(22.8), ..cluttered.clone() },
            Some(Fault::LowAccuracy),
        ),
        // A sphere that cuts off most of what is seen is blamed before poses are.
        (
            Evidence {
                uniform_background: false,
                training_match: Some(18.0),
                held_out_match: Some(12.0),
                surface: shares(0.5, 0.1),
                ..cluttered.clone()
            },
            Some(Fault::SmallSphere),
        ),
        // A table.
        (
            Evidence {
                uniform_background: false,
                surface: shares(0.2, 0.1).map(|s| SurfaceShares { seen_above_table: 0.0, ..s }),
                ..cluttered
            },
            None,
        ),
        (Evidence { surface: shares(0.2, 0.1), ..good() }, Some(Fault::SmallSphere)),
        (apart.clone(), Some(Fault::Inconsistent)),
        (Evidence { training_views: 5, ..apart }, Some(Fault::FewViews)),
        (short.clone(), Some(Fault::LowAccuracy)),
        (Evidence { exposure_spread: Some(0.3), ..short.clone() }, Some(Fault::Exposure)),
        (
            Evidence { exposure_spread: Some(0.3), fits_exposures: true, ..short },
            Some(Fault::LowAccuracy),
        ),
        (Evidence { exposure_spread: Some(0.3), ..cow.clone() }, Some(Fault::Exposure)),
        (cow, None),
        (Evidence { surface: shares(0.0, 0.5), ..good() }, Some(Fault::Unseen)),
        (Evidence { training_match: None, held_out_match: None, ..good() }, Some(Fault::Unseen)),
        // The exposures differ, and the fit is good all the same.
        (Evidence { exposure_spread: Some(0.3), ..good() }, None),
        (Evidence { held_out_match: None, exposure_spread: None, ..good() }, None),
        (Evidence { training_match: Some(39.0), held_out_match: Some(34.0), ..good() }, None),
        // Few views suffice for this shape.
        (Evidence { training_views: 5, ..good() }, None),
    ];
    for (evidence, expected) in cases {
        assert_eq!(Fault::of(&evidence), expected, "{evidence:?}");
    }
}

#[test]
fn the_text_has_the_numbers_and_an_option() {
    let painted = Evidence {
        background_confidence: 0.0,
        surface: Some(SurfaceShares {
            on_sphere: 0.375,
            seen_on_sphere: 0.25,
            seen_above_table: 0.25,
            unseen: 0.125,
            unseen_sides: 0.1,
        }),
        held_out_match: None,
        ..good()
    };
    let verdict = Verdict::of(painted);
    let text = verdict.to_string();
    for words in ["37.5 %", "25.0 % in view", "12.5 % seen by no", "32.0 dB", "--background"] {
        assert!(text.contains(words), "no {words:?} in\n{text}");
    }
    let json = serde_json::to_value(&verdict).unwrap();
    assert_eq!(json["fault"], "painted-background");
    assert_eq!(json["surface"]["unseen"], 0.125);
    assert!(json["held_out_match"].is_null() && json["text"].as_str() == Some(verdict.text));
    assert!(Verdict::of(good()).to_string().contains("nothing wrong was found"));
}
