//! The error of a page.

use files::InputError;
use render::InvalidField;

/// A page that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file of the run is wrong input.
    #[error(transparent)]
    Run(#[from] InputError),
    /// The field of the run is not finite.
    #[error(transparent)]
    Field(#[from] InvalidField),
    /// A picture has no JPEG form.
    #[error("cannot encode a picture of the report")]
    Picture(#[source] image::ImageError),
    /// The data of the scripts have no JSON form.
    #[error(transparent)]
    Data(#[from] serde_json::Error),
    /// The options of the fit have no TOML form.
    #[error(transparent)]
    Options(#[from] toml::ser::Error),
}

impl Error {
    /// The wrong input, if that is the error.
    pub fn input(&self) -> Option<&InputError> {
        match self {
            Error::Run(input) => Some(input),
            Error::Field(_) | Error::Picture(_) | Error::Data(_) | Error::Options(_) => None,
        }
    }
}
