//! The origin of the cells in a folder: fingerprints of the program and the data, and the machines.
//!
//! A folder is continued only with the same program and the same data.

use std::path::{Path, PathBuf};

use crate::error::Error;
use crate::report::files::{read, read_if_present, write_whole};
use crate::report::schema::DataSet;
use files::InputError;
use serde_json::Value;

/// A 64-bit FNV-1a hash, the same on every machine: G. Fowler, L. C. Noll, K.-P. Vo and
/// D. Eastlake, "The FNV Non-Cryptographic Hash Algorithm".
struct Fnv1a(u64);

impl Fnv1a {
    const fn new() -> Self {
        Fnv1a(0xcbf2_9ce4_8422_2325)
    }

    fn add(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }

    fn add_file(&mut self, path: &Path) -> Result<(), InputError> {
        let refuse = |e| InputError::new(path, "file", e, "a file to read");
        self.add(&read(path).map_err(refuse)?);
        Ok(())
    }
}

/// The fingerprint of a file's content.
fn fingerprint(path: &Path) -> Result<u64, InputError> {
    let mut hash = Fnv1a::new();
    hash.add_file(path)?;
    Ok(hash.0)
}

/// The fingerprint of a data set, from names and contents of its files: all of its folder, or its
/// scene with the files that the scene names; and its true surface.
pub(crate) fn data_fingerprint(data: &DataSet, base: &Path) -> Result<u64, InputError> {
    let mut files: Vec<PathBuf> = data.mesh.iter().map(|mesh| base.join(mesh)).collect();
    if let Some(scene) = &data.scene {
        let scene = base.join(scene);
        let beside = scene.parent().unwrap_or(Path::new(""));
        let text = read_if_present(&scene)?.unwrap_or_default();
        let content = serde_json::from_str(&text).unwrap_or(Value::Null);
        files_named_in(&content, beside, &mut files);
        files.push(scene);
    }
    if let Some(dataset) = &data.dataset {
        files_under(&base.join(dataset), &mut files)?;
    }
    let mut hash = Fnv1a::new();
    for path in files {
        hash.add(path.strip_prefix(base).unwrap_or(&path).to_string_lossy().as_bytes());
        hash.add_file(&path)?;
    }
    Ok(hash.0)
}

/// Adds all files of a folder and its folders, in the order of their names.
fn files_under(folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), InputError> {
    let refuse = |e| InputError::new(folder, "dataset", e, "a folder to read");
    let mut own: Vec<PathBuf> =
        std::fs::read_dir(folder).map_err(refuse)?.flatten().map(|entry| entry.path()).collect();
    own.sort();
    for path in own {
        if path.is_dir() {
            files_under(&path, files)?;
        } else {
            files.push(path);
        }
    }
    Ok(())
}

/// Adds the files that a scene's strings name.
fn files_named_in(content: &Value, folder: &Path, files: &mut Vec<PathBuf>) {
    match content {
        Value::String(text) => {
            files.extend(Some(folder.join(text)).filter(|path| path.is_file()));
        }
        Value::Array(list) => list.iter().for_each(|item| files_named_in(item, folder, files)),
        Value::Object(map) => map.values().for_each(|item| files_named_in(item, folder, files)),
        _ => {}
    }
}

/// The file of fingerprints: one line for the program and one for each data set.
const INPUTS: &str = "inputs";

/// Writes the fingerprints of the program and the data sets to the folder `output`.
///
/// # Errors
/// An [`InputError`] if the folder has cells or data of another program or of other data.
pub(crate) fn check(
    output: &Path,
    binary: &Path,
    sets: &[DataSet],
    base: &Path,
) -> Result<(), Error> {
    let mut own = format!("program {:016x}\n", fingerprint(binary)?);
    for set in sets {
        own += &format!("{} {:016x}\n", set.name, data_fingerprint(set, base)?);
    }
    let path = output.join(INPUTS);
    let rendered = |set: &DataSet| output.join("data").join(&set.name).exists();
    let begun = output.join("cells").exists() || sets.iter().any(rendered);
    if let Some(known) = read_if_present(&path)?.filter(|known| begun && *known != own) {
        let name = first_difference(&known, &own).split(' ').next().unwrap_or_default();
        let (found, expected) = match name {
            "program" => {
                ("another program".to_owned(), "the program of this folder's cells (see --binary)")
            }
            "less" => ("fewer data sets".to_owned(), "the data of this folder's cells"),
            name => (format!("other data of {name}"), "the data of this folder's cells"),
        };
        let expected = format!("{expected}, or another folder");
        return Err(InputError::new(&path, "inputs", found, expected).into());
    }
    write_whole(&path, own)
}

/// The first line of `known` that `own` lacks, or `less` if there is none.
pub(crate) fn first_difference<'a>(known: &'a str, own: &str) -> &'a str {
    known.lines().find(|line| !own.lines().any(|own| own == *line)).unwrap_or("less")
}

/// Gathers fingerprints and machines of shards in the folder `output`.
///
/// Programs may differ, since each machine may build its own: a warning names them.
///
/// # Errors
/// An [`InputError`] if the shards were made of different data.
pub(crate) fn merge(shards: &[PathBuf], output: &Path) -> Result<(), Error> {
    let mut first: Option<(PathBuf, String)> = None;
    let mut all_machines = Vec::new();
    for folder in [output].into_iter().chain(shards.iter().map(PathBuf::as_path)) {
        all_machines.extend(machines(folder)?);
        let path = folder.join(INPUTS);
        let Some(inputs) = read_if_present(&path)? else { continue };
        match &first {
            None => first = Some((path, inputs)),
            Some((known, expected)) => compare_inputs(&path, &inputs, known, expected)?,
        }
    }
    add_machines(output, all_machines)?;
    first.map_or(Ok(()), |(_, inputs)| write_whole(&output.join(INPUTS), inputs))
}

/// Refuses other data than that of the folder `known`, and warns of another program.
fn compare_inputs(
    path: &Path,
    inputs: &str,
    known: &Path,
    expected: &str,
) -> Result<(), InputError> {
    let data = |inputs: &str| -> String {
        inputs.lines().filter(|line| !line.starts_with("program ")).collect()
    };
    if data(inputs) != data(expected) {
        let expected = format!("that of {}", known.display());
        return Err(InputError::new(path, "inputs", "other data", expected));
    }
    if inputs != expected {
        let (path, known) = (path.display(), known.display());
        eprintln!("warning: {path}: another program than that of {known}");
    }
    Ok(())
}

/// The file of machines, one line each, for the report.
const MACHINES: &str = "machines";

/// The machines that ran cells of a folder.
pub(crate) fn machines(folder: &Path) -> Result<Vec<String>, InputError> {
    let text = read_if_present(&folder.join(MACHINES))?.unwrap_or_default();
    Ok(text.lines().map(str::to_owned).collect())
}

/// The line of this machine: processor, cores, and the program's revision. The revision of a
/// program from `--binary` is unknown.
pub(crate) fn this_machine(cores: usize, given: bool) -> String {
    let program = if given {
        "a program given".to_owned()
    } else {
        format!("dsdf {}", crate::measure::host::revision())
    };
    format!("{}, {cores} cores, {program}", crate::measure::host::processor())
}

/// Adds machines to those of a folder, each once.
pub(crate) fn add_machines(folder: &Path, more: Vec<String>) -> Result<(), Error> {
    let mut all = machines(folder)?;
    for line in more {
        if !all.contains(&line) {
            all.push(line);
        }
    }
    let lines: String = all.iter().map(|line| format!("{line}\n")).collect();
    write_whole(&folder.join(MACHINES), lines)
}
