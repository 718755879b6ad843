//! What the cells of a folder were made of: fingerprints of the program and of the data.

use std::path::{Path, PathBuf};

use super::refusal::Refusal;
use super::results::write;
use super::tables::Data;

/// A text file, if there is one.
pub(super) fn read(path: &Path) -> Result<Option<String>, Refusal> {
    match std::fs::read_to_string(path) {
        Ok(text) => Ok(Some(text)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(Refusal::new(path, "file", error, "a file to read")),
    }
}

/// FNV-1a, of 64 bits: the same number on every machine.
struct Hash(u64);

impl Hash {
    const fn new() -> Self {
        Hash(0xcbf2_9ce4_8422_2325)
    }

    fn add(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }

    fn file(&mut self, path: &Path) -> Result<(), Refusal> {
        self.add(
            &std::fs::read(path).map_err(|e| Refusal::new(path, "file", e, "a file to read"))?,
        );
        Ok(())
    }
}

/// A number that tells files apart.
pub(super) fn file(path: &Path) -> Result<u64, Refusal> {
    let mut hash = Hash::new();
    hash.file(path)?;
    Ok(hash.0)
}

/// The same for all that a data set is made of: its folder, or its scene with the files that this
/// names, and its true surface.
pub(super) fn data(data: &Data, folder: &Path) -> Result<u64, Refusal> {
    let mut files: Vec<PathBuf> = data.mesh.iter().map(|mesh| folder.join(mesh)).collect();
    if let Some(scene) = &data.scene {
        let scene = folder.join(scene);
        let beside = scene.parent().unwrap_or(Path::new(""));
        let content = serde_json::from_str(&read(&scene)?.unwrap_or_default())
            .unwrap_or(serde_json::Value::Null);
        named(&content, beside, &mut files);
        files.push(scene);
    }
    if let Some(dataset) = &data.dataset {
        all(&folder.join(dataset), &mut files)?;
    }
    let mut hash = Hash::new();
    for path in files {
        hash.add(path.strip_prefix(folder).unwrap_or(&path).to_string_lossy().as_bytes());
        hash.file(&path)?;
    }
    Ok(hash.0)
}

/// Files of a folder, in the order of their names.
fn all(folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), Refusal> {
    let refuse = |e| Refusal::new(folder, "dataset", e, "a folder to read");
    let mut own: Vec<PathBuf> =
        std::fs::read_dir(folder).map_err(refuse)?.flatten().map(|entry| entry.path()).collect();
    own.sort();
    for path in own {
        if path.is_dir() {
            all(&path, files)?;
        } else {
            files.push(path);
        }
    }
    Ok(())
}

/// Files that a scene names.
fn named(content: &serde_json::Value, folder: &Path, files: &mut Vec<PathBuf>) {
    match content {
        serde_json::Value::String(text) => {
            files.extend(Some(folder.join(text)).filter(|path| path.is_file()))
        }
        serde_json::Value::Array(list) => list.iter().for_each(|item| named(item, folder, files)),
        serde_json::Value::Object(map) => map.values().for_each(|item| named(item, folder, files)),
        _ => {}
    }
}

/// The file that holds them, a line for the program and one for each data set.
const INPUTS: &str = "inputs";

/// Refuses to go on in `output` with another program or other data than what is there was made
/// with; keeps them otherwise.
pub(super) fn check(
    output: &Path,
    binary: &Path,
    sets: &[Data],
    folder: &Path,
) -> anyhow::Result<()> {
    let mut own = format!("program {:016x}\n", file(binary)?);
    for set in sets {
        own += &format!("{} {:016x}\n", set.name, data(set, folder)?);
    }
    let path = output.join(INPUTS);
    let taken = |set: &Data| output.join("data").join(&set.name).exists();
    let begun = output.join("cells").exists() || sets.iter().any(taken);
    if let Some(there) = read(&path)?.filter(|there| begun && *there != own) {
        let found =
            format!("another {}", changed(&there, &own).split(' ').next().unwrap_or_default());
        let expected = "that of the cells that are here (see --binary), or another folder";
        return Err(Refusal::new(&path, "inputs", found, expected).into());
    }
    write(&path, own)
}

/// The first line that is not of `own`.
pub(super) fn changed<'a>(there: &'a str, own: &str) -> &'a str {
    there.lines().find(|line| !own.lines().any(|own| own == *line)).unwrap_or("less")
}

/// Refuses shards of other data, and keeps what they were made of; other programs may be of other
/// machines, and are said.
pub(super) fn merge(folders: &[PathBuf], output: &Path) -> anyhow::Result<()> {
    let of_data =
        |text: &str| text.lines().filter(|line| !line.starts_with("program ")).collect::<String>();
    let mut first: Option<(PathBuf, String)> = None;
    let mut more = Vec::new();
    for folder in [output].into_iter().chain(folders.iter().map(PathBuf::as_path)) {
        more.extend(machines(folder)?);
        let path = folder.join(INPUTS);
        let Some(text) = read(&path)? else { continue };
        let Some((known, there)) = &first else {
            first = Some((path, text));
            continue;
        };
        if of_data(&text) != of_data(there) {
            return Err(Refusal::new(
                &path,
                "inputs",
                "other data",
                format!("that of {}", known.display()),
            )
            .into());
        }
        if text != *there {
            eprintln!(
                "warning: {}: another program than that of {}",
                path.display(),
                known.display()
            );
        }
    }
    add_machines(output, more)?;
    first.map_or(Ok(()), |(_, text)| write(&output.join(INPUTS), text))
}

/// Where and with what cells were run: a line each, kept beside them for the report.
const MACHINES: &str = "machines";

/// The machines of a folder.
pub(super) fn machines(folder: &Path) -> Result<Vec<String>, Refusal> {
    let text = read(&folder.join(MACHINES))?.unwrap_or_default();
    Ok(text.lines().map(str::to_owned).collect())
}

/// This machine, with so many cores of it, and the source of the program unless that was given.
pub(super) fn this_machine(cores: usize, given: bool) -> String {
    let program = if given {
        "a program given".to_owned()
    } else {
        format!("dsdf {}", measure::host::revision())
    };
    format!("{}, {cores} cores, {program}", measure::host::processor())
}

/// Adds machines to those of a folder, each once.
pub(super) fn add_machines(folder: &Path, more: Vec<String>) -> anyhow::Result<()> {
    let mut all = machines(folder)?;
    for line in more {
        if !all.contains(&line) {
            all.push(line);
        }
    }
    write(&folder.join(MACHINES), all.iter().map(|line| format!("{line}\n")).collect::<String>())
}
