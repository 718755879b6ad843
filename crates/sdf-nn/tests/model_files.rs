//! Crafted model files: sizes are checked before memory is allocated for them.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use sdf_nn::{Network, RadianceHead};

/// The bytes of a model file with these weights, without a bias, all elements zero.
fn file(shapes: &[[usize; 2]], metadata: &str) -> Vec<u8> {
    let mut end = 0;
    let tensors = shapes.iter().enumerate().map(|(l, shape)| {
        let start = end;
        end += 4 * shape[0] * shape[1];
        format!(
            "\"layers.{l}.weight\": {{\"dtype\": \"F32\", \"shape\": {shape:?}, \
             \"data_offsets\": [{start}, {end}]}}"
        )
    });
    let tensors: Vec<String> = tensors.collect();
    let header = format!(
        "{{\"__metadata__\": {{\"activation\": \"relu\"{metadata}}}, {}}}",
        tensors.join(", ")
    );
    [&(header.len() as u64).to_le_bytes(), header.as_bytes(), &vec![0; end]].concat()
}

const HEAD: &str = ", \"inputs\": \"position normal direction\", \"output\": \"sigmoid_squared\"";

#[test]
fn a_layer_without_elements_is_refused_whatever_its_other_size() {
    for width in [1 << 31, 1 << 60, 1 << 61] {
        let bytes = file(&[[width, 0], [1, 0]], "");
        let error = Network::<f32>::from_safetensors(&bytes).unwrap_err().to_string();
        assert!(
            error.contains("layers.0.weight") && error.contains(&format!("[{width}, 3]")),
            "{error}"
        );
        let bytes = file(&[[width, 0], [1, 0]], HEAD);
        let error = RadianceHead::<f32>::from_safetensors(&bytes).unwrap_err().to_string();
        assert!(
            error.contains("layers.0.weight") && error.contains(&format!("[{width}, 9]")),
            "{error}"
        );
    }
    let bytes = file(&[[4, 3], [0, 4], [1 << 60, 0]], "");
    let error = Network::<f32>::from_safetensors(&bytes).unwrap_err().to_string();
    assert!(error.contains("layers.1.weight") && error.contains("[1 or more, 4]"), "{error}");
}

#[test]
fn a_layer_that_does_not_fit_the_layer_below_is_refused() {
    // Believed, these shapes are a network of 10^14 weights in a file of 80 MB.
    let wide = 10_000_000;
    let bytes = file(&[[wide, 1], [wide, 1]], "");
    let error = Network::<f32>::from_safetensors(&bytes).unwrap_err().to_string();
    assert!(error.contains("layers.0.weight"), "{error}");
    let bytes = file(&[[wide / 4, 3], [wide / 4, 1], [1, wide / 4]], "");
    let error = Network::<f32>::from_safetensors(&bytes).unwrap_err().to_string();
    assert!(error.contains("layers.1.weight") && error.contains("2500000]"), "{error}");
    // A skip connection has three inputs more, and the bias is read after the shapes.
    let shapes = [[4, 3], [5, 7], [1, 5]];
    let skipped = file(&shapes, ", \"skip\": \"1\"");
    let error = Network::<f32>::from_safetensors(&skipped).unwrap_err().to_string();
    assert!(error.contains("layers.0.bias"), "{error}");
    let error = Network::<f32>::from_safetensors(&file(&shapes, "")).unwrap_err().to_string();
    assert!(error.contains("layers.1.weight") && error.contains("expected [5, 4]"), "{error}");
}
