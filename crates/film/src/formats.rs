//! The formats of images that are read.

/// The formats in words, for messages.
pub(crate) const IMAGE: &str = "a PNG, JPEG, EXR or NPY image";

/// The extensions of their files, in lower case.
pub(crate) const EXTENSIONS: [&str; 5] = ["png", "jpg", "jpeg", "exr", "npy"];
