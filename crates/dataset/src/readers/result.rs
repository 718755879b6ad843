//! The result of a step of a reader.

use files::InputError;

pub(crate) type Result<T> = std::result::Result<T, InputError>;
