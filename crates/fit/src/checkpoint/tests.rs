use super::*;

#[test]
fn a_saved_state_loads_with_the_same_bits_and_a_cut_file_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("state.safetensors");
    let state = State {
        clock: Clock { iteration: 17, seconds: 1.0 / 3.0, searching: 0.1 },
        optimiser: OptimiserState {
            usual_norm: 0.1,
            parameters: vec![1.0, f32::MIN_POSITIVE, -0.0].into(),
            average: Some(Cow::Owned(Average { parameters: vec![0.5, 2.0, -1.0], steps: 9 })),
            first: vec![0.1; 3].into(),
            second: vec![0.2; 3].into(),
            steps: 16,
        },
        held_out_psnr: Some(31.4),
        corrections: Corrections::Refined(Optimised {
            numbers: vec![0.5, -0.25, 1e-300],
            steps: 7,
        }),
        exposures: Some(Optimised { numbers: vec![0.1; 9], steps: 8 }),
        survey: Some(Cow::Owned(Survey {
            number: 2,
            is_far: vec![true, false, true],
            is_free: vec![false, true],
        })),
        lattice: Some(Cow::Owned(LatticeState { values: vec![0.25, -1.0], change: Some(0.125) })),
    };
    state.save(&path).unwrap();
    assert_eq!(State::load(&path, |free| 2 + free).unwrap(), state);
    assert!(State::load(&path, |free| 3 + free).unwrap_err().to_string().contains("parameters"));
    let whole = std::fs::read(&path).unwrap();
    for length in 0..whole.len() {
        std::fs::write(&path, &whole[..length]).unwrap();
        assert!(State::load(&path, |_| 3).is_err(), "a checkpoint cut at {length} bytes");
    }
}

#[test]
fn a_negative_mean_square_gradient_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("state.safetensors");
    let state = State {
        clock: Clock { iteration: 1, seconds: 1.0, searching: 0.0 },
        optimiser: OptimiserState {
            usual_norm: 1.0,
            parameters: vec![-1.0; 2].into(),
            average: None,
            first: vec![-1.0; 2].into(),
            second: vec![0.0, -1.0].into(),
            steps: 1,
        },
        held_out_psnr: None,
        corrections: Corrections::Undecided,
        exposures: None,
        survey: None,
        lattice: None,
    };
    state.save(&path).unwrap();
    let error = State::load(&path, |_| 2).unwrap_err();
    let words = "second: found -1 at element 1, expected finite numbers, 0 or more";
    assert!(error.to_string().contains(words), "{error}");
}

#[test]
fn numbers_out_of_range_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("state.safetensors");
    let state = State {
        clock: Clock { iteration: 7777, seconds: 5555.5, searching: 4444.5 },
        optimiser: OptimiserState {
            usual_norm: 0.3333,
            parameters: vec![0.0].into(),
            average: None,
            first: vec![0.0].into(),
            second: vec![0.0].into(),
            steps: 8888,
        },
        held_out_psnr: Some(22.22),
        corrections: Corrections::Given,
        exposures: None,
        survey: None,
        lattice: None,
    };
    state.save(&path).unwrap();
    let whole = String::from_utf8_lossy(&std::fs::read(&path).unwrap()).into_owned();
    for (field, value, wrong) in [
        ("iteration", "7777", ["NaN ", "-5  ", "inf ", "1.5 "]),
        ("steps", "8888", ["NaN ", "-5  ", "inf ", "    "]),
        ("seconds", "5555.5", ["NaN   ", "-1e9  ", "inf   ", "1e300 "]),
        ("searching", "4444.5", ["NaN   ", "-1e9  ", "inf   ", "1e300 "]),
        ("usual_norm", "0.3333", ["NaN   ", "-1    ", "inf   ", "x     "]),
        ("held_out_psnr", "22.22", ["NaN  ", "inf  ", "-inf ", "1e300"]),
    ] {
        for wrong in wrong {
            // The length of the header stays.
            assert_eq!(wrong.len(), value.len());
            let padded =
                format!("\"{}\"{}", wrong.trim(), " ".repeat(wrong.len() - wrong.trim().len()));
            std::fs::write(&path, whole.replace(&format!("\"{value}\""), &padded)).unwrap();
            let error = State::load(&path, |_| 1).unwrap_err().to_string();
            assert!(error.contains(&format!("{field}: found {}", wrong.trim())), "{error}");
        }
    }
}

#[test]
fn equal_states_give_equal_files() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| {
        let path = folder.path().join(name);
        let state = State {
            clock: Clock { iteration: 3, seconds: 2.0, searching: 0.0 },
            optimiser: OptimiserState {
                usual_norm: 1.0,
                parameters: vec![0.25; 3000].into(),
                average: None,
                first: vec![-1.0; 3000].into(),
                second: vec![1.0; 3000].into(),
                steps: 3,
            },
            held_out_psnr: Some(20.0),
            corrections: Corrections::Given,
            exposures: None,
            survey: None,
            lattice: None,
        };
        state.save(&path).unwrap();
        assert_eq!(State::load(&path, |_| 3000).unwrap(), state);
        std::fs::read(path).unwrap()
    };
    assert_eq!(file("a"), file("b"));
}
