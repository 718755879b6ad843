//! The scenes and cases of the gradient suite, in `tests/gradients`.

use anyhow::Context;
use serde::Deserialize;
use serde_json::Value;

use crate::measure::workspace_root;

/// A case of the gradient suite.
#[derive(Clone, Debug, Deserialize)]
pub struct Case {
    /// The scene's name.
    pub scene: String,
    /// JSON pointers to the parameters by which the image is differentiated.
    pub wrt: Vec<String>,
}

/// The cases of `tests/gradients/suite.toml`.
///
/// # Errors
/// If the file cannot be read.
pub fn cases() -> anyhow::Result<Vec<Case>> {
    #[derive(Deserialize)]
    struct Suite {
        case: Vec<Case>,
    }
    let path = workspace_root().join("tests/gradients/suite.toml");
    let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
    Ok(toml::from_str::<Suite>(&text)?.case)
}

/// A scene of the gradient suite, with the absolute path of its weights if it has any: callers save
/// it in another folder.
///
/// # Errors
/// If the file cannot be read.
pub fn scene(name: &str) -> anyhow::Result<Value> {
    let path = workspace_root().join("tests/gradients").join(format!("{name}.json"));
    let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
    let mut scene: Value = serde_json::from_str(&text)?;
    if let Some(weights) = scene.pointer_mut("/sdf/weights")
        && let Some(name) = weights.as_str()
    {
        let absolute = workspace_root().join("tests/gradients").join(name);
        *weights = absolute.to_string_lossy().into_owned().into();
    }
    Ok(scene)
}
