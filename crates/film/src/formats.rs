//! The formats of images that are read.

use std::path::Path;

use files::extension;

/// The formats in words, for messages.
pub(crate) const IMAGE: &str = "a PNG, JPEG, TIFF, WebP, EXR or NPY image";

/// The extensions of the images that are read, in lower case.
pub const IMAGE_EXTENSIONS: [&str; 8] = ["png", "jpg", "jpeg", "tif", "tiff", "webp", "exr", "npy"];

/// The extensions of photographs among them: images that cameras and editors write.
pub const PHOTOGRAPH_EXTENSIONS: [&str; 6] = ["png", "jpg", "jpeg", "tif", "tiff", "webp"];

/// Whether a file has the name of an image that is read: one of [`IMAGE_EXTENSIONS`], in lower or
/// upper case. The file need not exist.
pub fn is_image_name(path: &Path) -> bool {
    IMAGE_EXTENSIONS.contains(&extension(path).as_str())
}

/// Whether a file has the name of a photograph: one of [`PHOTOGRAPH_EXTENSIONS`], in lower or upper
/// case. The file need not exist.
pub fn is_photograph_name(path: &Path) -> bool {
    PHOTOGRAPH_EXTENSIONS.contains(&extension(path).as_str())
}
