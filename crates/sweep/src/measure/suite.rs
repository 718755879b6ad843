//! The scenes and cases of the gradient suite, in `tests/gradients`.

use serde::Deserialize;
use serde_json::Value;

use crate::error::Error;
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
pub fn cases() -> Result<Vec<Case>, Error> {
    #[derive(Deserialize)]
    struct Suite {
        case: Vec<Case>,
    }
    let path = workspace_root().join("tests/gradients/suite.toml");
    let text = std::fs::read_to_string(&path).map_err(Error::file(&path))?;
    Ok(toml::from_str::<Suite>(&text).map_err(Error::content)?.case)
}

/// A scene of the gradient suite, with the absolute path of its weights if it has any: callers save
/// it in another folder.
///
/// # Errors
/// If the file cannot be read.
pub fn scene(name: &str) -> Result<Value, Error> {
    let path = workspace_root().join("tests/gradients").join(format!("{name}.json"));
    let text = std::fs::read_to_string(&path).map_err(Error::file(&path))?;
    let mut scene: Value = serde_json::from_str(&text).map_err(Error::content)?;
    if let Some(weights) = scene.pointer_mut("/sdf/weights")
        && let Some(name) = weights.as_str()
    {
        let absolute = workspace_root().join("tests/gradients").join(name);
        *weights = absolute.to_string_lossy().into_owned().into();
    }
    Ok(scene)
}
