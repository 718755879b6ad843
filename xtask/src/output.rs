//! The files of measured results.

use std::path::Path;

use anyhow::Context;

/// Replaces a file in a folder whole.
pub(crate) fn write(folder: &Path, name: &str, content: impl AsRef<[u8]>) -> anyhow::Result<()> {
    let mut file = tempfile::NamedTempFile::new_in(folder)?;
    std::io::Write::write_all(&mut file, content.as_ref())?;
    file.persist(folder.join(name)).with_context(|| name.to_owned())?;
    Ok(())
}
