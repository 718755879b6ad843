//! The masks of a data set, which are found in the same way for the files of every program.
//!
//! A mask is in a folder with `mask` in its name, or beside the photograph with `mask` in its own:
//! for `images/train/a.jpg`, it is `masks/train/a.png`, `Mask/a.JPG`, `masks/a.jpg.png`,
//! `images/train/a_mask.png`, `a.mask.png`, `mask_a.png` or `dynamic_mask_a.png`. Its folders must
//! be the last ones of the photograph, and no other photograph may fit as well. Without a name in
//! common, masks with the numbers of the photographs are theirs.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

use crate::readers::MaskKind;
use crate::readers::lookup::{
    FOLDERS, entries, file_name, folded, is_foreign, is_image, natural_order, number, only,
    without_extension,
};
use crate::readers::mask::MaskFile;
use crate::readers::notes::{first_of, relative};
use crate::readers::recognised::Recognised;
use crate::readers::unread::UnreadView;

/// Folders within a folder of masks that are looked into.
const DEPTH: usize = 4;

/// The start of the names of instant-ngp's masks.
const DYNAMIC: &str = "dynamic_mask";

/// A file that looks like a mask.
struct Candidate {
    path: PathBuf,
    /// The folders between the folder of masks and the file. Of a mask beside its photograph: all
    /// folders of its path.
    folders: Vec<String>,
    /// The folder around that of masks, if it has no photographs: the last one of the photograph's
    /// own, or none of them.
    aside: Option<String>,
    /// The folder beside or within which its photograph is.
    within: PathBuf,
    /// The names of photographs that it fits, without their extension or with it.
    names: Vec<String>,
    /// The place of its folder of masks in the order in which they count; those beside the
    /// photographs are last.
    rank: usize,
    is_dynamic: bool,
    /// Whether it is in a folder of reduced copies.
    is_copy: bool,
}

/// Gives masks to the views that have none from their camera file, and adds notes on files that
/// look like masks and have no view. `folder` is that of the data set.
pub(crate) fn find(recognised: &mut Recognised, folder: &Path) {
    drop_missing(recognised, folder);
    let folders = image_folders(recognised, folder);
    let (candidates, foreign) = candidates(recognised, folder, &folders);
    if !foreign.is_empty() {
        let (look, names) = (looking_like_masks(foreign.len()), listed(&foreign, folder));
        let text = format!("{look}, in a format that is not read: {names}. Convert to PNG");
        recognised.notes.push(text);
    }
    if candidates.is_empty() {
        return;
    }
    let photographs = Photographs::of(recognised, folder);
    let mut fits: Vec<Fit> = candidates.iter().map(|c| photographs.fit(c)).collect();
    let by_number = photographs.by_number(&candidates, &mut fits, recognised.pairs_by_order);
    let mut best: BTreeMap<&Path, &Candidate> = BTreeMap::new();
    for (candidate, fit) in candidates.iter().zip(&fits) {
        let Fit::One(photograph) = *fit else { continue };
        let path = photographs.all[photograph].path.as_path();
        best.entry(path)
            .and_modify(|other| *other = better(other, candidate, path))
            .or_insert(candidate);
    }
    let best: BTreeMap<PathBuf, MaskFile> = best
        .into_iter()
        .map(|(path, mask)| (path.to_owned(), mask.file(path, recognised.used_by_extension)))
        .collect();
    let notes = notes(&candidates, &fits, &photographs, &best, folder);
    recognised.notes.extend(by_number);
    recognised.notes.extend(notes);
    for view in recognised.views_mut() {
        if view.mask.is_none() {
            view.mask = best.get(&view.path).cloned();
        }
    }
}

/// Takes masks away that a camera file names and that are not there, with a note.
fn drop_missing(recognised: &mut Recognised, folder: &Path) {
    let mut missing = Vec::new();
    for view in recognised.views_mut() {
        missing.extend(view.mask.take_if(|mask| !mask.path.exists()).map(|mask| mask.path));
    }
    if !missing.is_empty() {
        let (count, names) = (missing.len(), listed(&missing, folder));
        let are = if count == 1 { "mask is" } else { "masks are" };
        let text = format!("{count} {are} named by the camera file and missing: {names}");
        recognised.notes.push(text);
    }
}

/// The first names of these files, relative to the folder.
fn listed<P: AsRef<Path>>(paths: &[P], folder: &Path) -> String {
    first_of(paths, |path| relative(path.as_ref(), folder))
}

/// The start of a note on this number of files.
fn looking_like_masks(count: usize) -> String {
    let look = if count == 1 { "file looks like a mask" } else { "files look like masks" };
    format!("{count} {look}")
}

/// The folders of the photographs, and that of the data set.
fn image_folders(recognised: &Recognised, folder: &Path) -> BTreeSet<PathBuf> {
    let of_views = recognised.views().filter_map(|view| view.path.parent()).map(Path::to_owned);
    of_views.chain([folder.to_owned()]).collect()
}

/// The files that look like masks, and those in formats that are not read.
fn candidates(
    recognised: &Recognised,
    folder: &Path,
    folders: &BTreeSet<PathBuf>,
) -> (Vec<Candidate>, Vec<PathBuf>) {
    let taken = recognised.views().flat_map(|view| {
        [Some(&view.path), view.mask.as_ref().map(|mask| &mask.path)].into_iter().flatten()
    });
    let taken: BTreeSet<&Path> = taken.map(PathBuf::as_path).collect();
    let is_reduced = recognised.views().any(|view| view.full_size.is_some());
    let mut all = Vec::new();
    let places = mask_folders(folder, folders, is_reduced);
    for (rank, MaskFolder { path: place, aside, is_copy, .. }) in places.iter().enumerate() {
        let beside = place.parent().unwrap_or(place);
        let within = if aside.is_some() { folder } else { beside }.to_owned();
        let is_dynamic = file_name(place).to_lowercase().starts_with(DYNAMIC);
        collect(place, &mut Vec::new(), &mut |path, folders| {
            let (folders, names) = (folders.to_vec(), names_of(&file_name(&path)));
            let (within, aside, is_copy) = (within.clone(), aside.clone(), *is_copy);
            all.push(Candidate { path, folders, aside, within, names, rank, is_dynamic, is_copy });
        });
    }
    for place in folders {
        for path in entries(place) {
            let name = file_name(&path);
            if has_mark(without_extension(&name)) && is_image_or_foreign(&path) && path.is_file() {
                let is_dynamic = name.to_lowercase().starts_with(DYNAMIC);
                let (folders, rank, within) = (parts(place), places.len(), place.clone());
                let (names, aside, is_copy) = (names_of(&name), None, false);
                all.push(Candidate {
                    path,
                    folders,
                    aside,
                    within,
                    names,
                    rank,
                    is_dynamic,
                    is_copy,
                });
            }
        }
    }
    all.retain(|candidate| !taken.contains(candidate.path.as_path()));
    let (read, foreign): (Vec<Candidate>, Vec<Candidate>) =
        all.into_iter().partition(|candidate| is_image(&files::extension(&candidate.path)));
    (read, foreign.into_iter().map(|candidate| candidate.path).collect())
}

/// Whether a file is an image, or one in a format that is not read here.
fn is_image_or_foreign(path: &Path) -> bool {
    let extension = files::extension(path);
    is_image(&extension) || is_foreign(&extension)
}

/// A folder of masks.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct MaskFolder {
    /// The kind of its name: those that count first have the least.
    kind: usize,
    path: PathBuf,
    /// The folder around it, if that has no photograph: `cam0` for `cam0/masks` beside
    /// `images/cam0`.
    aside: Option<String>,
    /// Whether the name is that of a reduced copy, `masks_4`.
    is_copy: bool,
}

impl MaskFolder {
    /// A folder with this name, if it says that masks are in it.
    fn of(path: PathBuf, aside: Option<String>, is_reduced: bool) -> Option<Self> {
        let name = file_name(&path).to_lowercase();
        let base = name.rsplit_once('_').filter(|(_, factor)| factor.parse::<u32>().is_ok());
        let is_copy = base.is_some_and(|(base, _)| base.contains("mask"));
        let is_mask = name.contains("mask") && !name.contains("masked");
        if !path.is_dir() || !(is_mask || OTHER_NAMES.contains(&name.as_str())) {
            return None;
        }
        let kind = match name.as_str() {
            _ if is_copy => {
                if is_reduced {
                    0
                } else {
                    4
                }
            }
            "masks" => 1,
            "mask" => 2,
            _ => 3,
        };
        let kind = kind + if aside.is_some() { 5 } else { 0 };
        Some(MaskFolder { kind, path, aside, is_copy })
    }
}

/// Names of folders of masks without `mask` in them.
const OTHER_NAMES: [&str; 4] = ["silhouette", "silhouettes", "matte", "mattes"];

/// The folders of masks in the order in which they count: `masks`, `mask`, and others by name. A
/// copy like `masks_4` comes first for reduced photographs, and last for others. Folders aside of
/// those of photographs come behind all.
fn mask_folders(folder: &Path, folders: &BTreeSet<PathBuf>, is_reduced: bool) -> Vec<MaskFolder> {
    let outside = |path: &&PathBuf| !path.starts_with(folder);
    let mut places: BTreeSet<&Path> = BTreeSet::from([folder]);
    for path in folders {
        // Masks may be beside any folder from that of the photograph up to that of the data set.
        places.extend(path.ancestors().take_while(|p| p.starts_with(folder)));
        places.extend(Some(path).filter(outside).into_iter().flat_map(|p| p.ancestors().take(2)));
    }
    let near = places.iter().flat_map(|place| entries(place)).map(|path| (path, None));
    let aside = entries(folder).into_iter().filter(|path| path.is_dir());
    let aside = aside.filter(|path| !places.contains(path.as_path()));
    let within = |path: PathBuf| {
        let name = file_name(&path);
        entries(&path).into_iter().map(move |inner| (inner, Some(name.clone())))
    };
    let of = |(path, aside)| MaskFolder::of(path, aside, is_reduced);
    let mut all: Vec<MaskFolder> = near.chain(aside.flat_map(within)).filter_map(of).collect();
    all.sort();
    all.dedup();
    let paths: Vec<PathBuf> = all.iter().map(|own| own.path.clone()).collect();
    let is_within =
        |path: &PathBuf| paths.iter().any(|other| path != other && path.starts_with(other));
    all.retain(|own| !is_within(&own.path));
    all
}

/// Calls `add` for the images in a folder and in those within it, with their folders.
fn collect(place: &Path, folders: &mut Vec<String>, add: &mut dyn FnMut(PathBuf, &[String])) {
    for path in entries(place) {
        if path.is_dir() && folders.len() < DEPTH {
            folders.push(file_name(&path));
            collect(&path, folders, add);
            folders.pop();
        } else if is_image_or_foreign(&path) && path.is_file() {
            add(path, folders);
        }
    }
}

const SEPARATORS: [char; 4] = ['_', '.', '-', ' '];

/// A stem without a mark of masks: `a_mask`, `mask-a`, `dynamic_mask_a`, `a_mask1`, `mask000`,
/// `000mask`.
fn without_mark(stem: &str) -> Option<&str> {
    let start = |mark: &str| {
        let head = stem.get(..mark.len()).filter(|head| head.eq_ignore_ascii_case(mark))?;
        let rest = &stem[head.len()..];
        rest.strip_prefix(SEPARATORS).or(Some(rest).filter(|r| r.starts_with(is_digit)))
    };
    let end = |stem: &'_ str, mark: &str| -> Option<usize> {
        let at = stem.len().checked_sub(mark.len())?;
        stem.get(at..).filter(|tail| tail.eq_ignore_ascii_case(mark))?;
        let rest = &stem[..at];
        let whole = Some(rest).filter(|rest| rest.ends_with(is_digit));
        rest.strip_suffix(SEPARATORS).or(whole).map(str::len)
    };
    let unnumbered = stem.trim_end_matches(is_digit);
    let at_start = [DYNAMIC, "masks", "mask"].iter().find_map(|mark| start(mark));
    let at_end = || {
        let ends = [stem, unnumbered].into_iter().flat_map(|s| ["masks", "mask"].map(|m| (s, m)));
        ends.into_iter().find_map(|(stem, mark)| end(stem, mark)).map(|length| &stem[..length])
    };
    at_start.or_else(at_end).filter(|rest| !rest.is_empty())
}

fn is_digit(c: char) -> bool {
    c.is_ascii_digit()
}

/// Whether a stem says that the file is a mask.
fn has_mark(name: &str) -> bool {
    without_mark(name).is_some() || ["mask", "masks"].iter().any(|m| name.eq_ignore_ascii_case(m))
}

/// Whether the file of this name is the mask of one of the files with these stems: `a_mask.png`,
/// `a.mask.png`, `mask_a.png` or `dynamic_mask_a.png` of `a`.
pub fn is_mask_of(name: &str, stems: &BTreeSet<String>) -> bool {
    without_mark(without_extension(name))
        .is_some_and(|of| stems.contains(of) || stems.contains(without_extension(of)))
}

/// The names of photographs that a mask of this name fits.
fn names_of(name: &str) -> Vec<String> {
    let whole = without_extension(name);
    let both = [Some(whole), without_mark(whole)];
    both.into_iter().flatten().map(str::to_owned).collect()
}

/// The parts of a path.
fn parts(path: &Path) -> Vec<String> {
    let part = |c: Component<'_>| match c {
        Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
        _ => None,
    };
    path.components().filter_map(part).collect()
}

/// A photograph that can have a mask.
struct Photograph {
    path: PathBuf,
    /// The folders of its path.
    folders: Vec<String>,
    /// The folders in its name in the data set, without `images` at their start.
    named: Vec<String>,
}

impl Photograph {
    /// The photograph of this name in the data set.
    fn of(path: &Path, name: &str) -> Self {
        let folders = path.parent().map(parts).unwrap_or_default();
        let name = name.replace('\\', "/");
        let name = Path::new(&name).parent().map(parts).unwrap_or_default();
        let is_images = |name: &String| FOLDERS.contains(&name.to_lowercase().as_str());
        let named = name.into_iter().skip_while(is_images).collect();
        Photograph { path: path.to_owned(), folders, named }
    }
}

/// The photographs of the views, and of the images without a view.
struct Photographs {
    all: Vec<Photograph>,
    /// Those with views come first.
    with_views: usize,
    /// The folder of the data set.
    folder: PathBuf,
    /// By their file's name, folded: without the extension, and with it.
    by_name: BTreeMap<String, Vec<usize>>,
}

/// The photograph of a mask.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Fit {
    One(usize),
    /// Several fit as well.
    Several(Vec<usize>),
    /// A photograph without a view.
    Unposed,
    None,
}

impl Photographs {
    fn of(recognised: &Recognised, folder: &Path) -> Self {
        let mut all: Vec<Photograph> = Vec::new();
        let mut known = BTreeSet::new();
        let mut add = |all: &mut Vec<Photograph>, path: &Path, name: &str| {
            // One file may have several paths.
            let file = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
            if known.insert(file) {
                all.push(Photograph::of(path, name));
            }
        };
        for view in recognised.views() {
            add(&mut all, &view.path, &view.name);
        }
        let folders: BTreeSet<&Path> = recognised.views().filter_map(|v| v.path.parent()).collect();
        let with_views = all.len();
        let beside = folders.into_iter().flat_map(entries);
        let beside = beside.filter(|p| is_image(&files::extension(p)));
        let unposed = |p: &PathBuf| !has_mark(without_extension(&file_name(p)));
        beside.filter(unposed).for_each(|path| add(&mut all, &path, ""));
        let missing = [&recognised.missing, &recognised.missing_test, &recognised.unposed];
        missing.into_iter().flatten().for_each(|path| add(&mut all, path, ""));
        let mut by_name: BTreeMap<String, Vec<usize>> = BTreeMap::new();
        for (i, photograph) in all.iter().enumerate() {
            let name = file_name(&photograph.path);
            for key in BTreeSet::from([without_extension(&name), &name]) {
                by_name.entry(folded(key)).or_default().push(i);
            }
        }
        Photographs { all, with_views, folder: folder.to_owned(), by_name }
    }

    fn fit(&self, mask: &Candidate) -> Fit {
        let same_name: BTreeSet<usize> = mask
            .names
            .iter()
            .flat_map(|name| [name.as_str(), without_extension(name)])
            .filter_map(|name| self.by_name.get(&folded(name)))
            .flatten()
            .copied()
            .collect();
        let ends = |folders: &[String]| {
            let mut both = folders.iter().rev().zip(mask.folders.iter().rev());
            folders.len() >= mask.folders.len() && both.all(|(a, b)| folded(a) == folded(b))
        };
        let is_near = |i: usize| {
            let path = &self.all[i].path;
            path.starts_with(&mask.within) || !path.starts_with(&self.folder)
        };
        let mut all: Vec<usize> =
            same_name.into_iter().filter(|i| is_near(*i) && ends(&self.all[*i].folders)).collect();
        if let Some(aside) = &mask.aside {
            let before = |folders: &[String]| {
                let at = folders.len().checked_sub(mask.folders.len() + 1);
                at.is_some_and(|at| folded(&folders[at]) == folded(aside))
            };
            if all.iter().any(|i| before(&self.all[*i].folders)) {
                all.retain(|i| before(&self.all[*i].folders));
            }
        }
        self.choice(&all, mask)
    }

    /// The photograph of a mask among those with its name: the only one, or the only one with its
    /// folders and its very name.
    fn choice(&self, all: &[usize], mask: &Candidate) -> Fit {
        let own = |i: &&usize| self.all[**i].named == mask.folders;
        let exact = |i: &&usize| {
            let name = file_name(&self.all[**i].path);
            mask.names.iter().any(|of| *of == name || of == without_extension(&name))
        };
        let found = only(all.iter())
            .or_else(|| only(all.iter().filter(own)))
            .or_else(|| only(all.iter().filter(exact)))
            .or_else(|| only(all.iter().filter(own).filter(exact)));
        match (found, all) {
            (Some(i), _) if *i < self.with_views => Fit::One(*i),
            (Some(_), _) => Fit::Unposed,
            (None, []) => Fit::None,
            (None, several) => Fit::Several(several.to_vec()),
        }
    }

    /// Pairs the masks of a folder in which none has the name of a photograph: by their numbers if
    /// these are the numbers of the photographs, or else in the order of the names if
    /// `pairs_by_order`, and there are as many. Returns a note.
    fn by_number(
        &self,
        masks: &[Candidate],
        fits: &mut [Fit],
        pairs_by_order: bool,
    ) -> Option<String> {
        let has_name = fits.iter().any(|fit| *fit != Fit::None);
        let first = masks.iter().map(|mask| mask.rank).min()?;
        let mut of_first: Vec<usize> =
            (0..masks.len()).filter(|i| masks[*i].rank == first).collect();
        let name = |i: usize| file_name(&masks[i].path);
        of_first.sort_by(|a, b| natural_order(&name(*a), &name(*b)));
        let views: Vec<usize> = (0..self.with_views).collect();
        if has_name || of_first.len() != views.len() || views.len() < 2 {
            return None;
        }
        let numbers = |paths: Vec<&Path>| -> Option<BTreeMap<usize, usize>> {
            let all = paths.iter().enumerate().map(|(i, path)| Some((number(path)?, i)));
            let all: BTreeMap<usize, usize> = all.collect::<Option<_>>()?;
            (all.len() == paths.len()).then_some(all)
        };
        let of_masks = numbers(of_first.iter().map(|i| masks[*i].path.as_path()).collect());
        let of_views = numbers(views.iter().map(|i| self.all[*i].path.as_path()).collect());
        let how = match (of_masks, of_views) {
            (Some(masks), Some(views)) if masks.keys().eq(views.keys()) => {
                masks
                    .values()
                    .zip(views.values())
                    .for_each(|(m, v)| fits[of_first[*m]] = Fit::One(*v));
                "their numbers"
            }
            _ if pairs_by_order => {
                of_first.iter().zip(&views).for_each(|(m, v)| fits[*m] = Fit::One(*v));
                "the order of their names"
            }
            _ => return None,
        };
        Some(format!("masks are paired with the photographs by {how}, since the names differ"))
    }
}

impl Candidate {
    /// The mask of this photograph. With `used_by_extension`, the name `a.jpg.png` says that it
    /// tells which pixels of `a.jpg` to use.
    fn file(&self, photograph: &Path, used_by_extension: bool) -> MaskFile {
        let is_used = used_by_extension && self.has_whole_name(photograph);
        let kind = if is_used { MaskKind::Used } else { MaskKind::Object };
        MaskFile { kind, path: self.path.clone(), is_dynamic: self.is_dynamic }
    }

    fn has_whole_name(&self, photograph: &Path) -> bool {
        let name = folded(&file_name(photograph));
        self.names.iter().any(|of| folded(of) == name)
    }
}

/// The mask that counts of two for one photograph: by the folder, then `a.jpg.png` before `a.png`
/// before `a.jpg`.
fn better<'a>(a: &'a Candidate, b: &'a Candidate, photograph: &Path) -> &'a Candidate {
    let order = |mask: &Candidate| {
        let extension = files::extension(&mask.path);
        (mask.rank, !mask.has_whole_name(photograph), extension != "png", mask.path.clone())
    };
    if order(b) < order(a) { b } else { a }
}

/// The notes on files that look like masks and have no view.
fn notes(
    candidates: &[Candidate],
    fits: &[Fit],
    photographs: &Photographs,
    best: &BTreeMap<PathBuf, MaskFile>,
    folder: &Path,
) -> Vec<String> {
    let mut notes = Vec::new();
    let of = |wanted: &dyn Fn(&Fit) -> bool| -> Vec<&Path> {
        let all = candidates.iter().zip(fits).filter(|(_, fit)| wanted(fit));
        all.map(|(mask, _)| mask.path.as_path()).collect()
    };
    let unfit = of(&|fit| *fit == Fit::None);
    if !unfit.is_empty() {
        let (look, names) = (looking_like_masks(unfit.len()), listed(&unfit, folder));
        notes.push(format!("{look}, for no photograph that is here: {names}"));
    }
    let several = candidates.iter().zip(fits).find_map(|(mask, fit)| match fit {
        Fit::Several(all) => Some((mask, all)),
        _ => None,
    });
    if let Some((mask, all)) = several {
        let count = of(&|fit| matches!(fit, Fit::Several(_))).len();
        let paths: Vec<&Path> = all.iter().map(|i| photographs.all[*i].path.as_path()).collect();
        notes.push(format!(
            "masks that fit several photographs and are not used: {count}; {} fits {}. Put them \
             into folders as those of the photographs",
            listed(&[&mask.path], folder),
            listed(&paths, folder),
        ));
    }
    let used: BTreeSet<&Path> = best.values().map(|mask| mask.path.as_path()).collect();
    let is_idle = |rank: usize| {
        let own = |(mask, _): &(&Candidate, &Fit)| mask.rank == rank && !mask.is_copy;
        let mut of_rank = candidates.iter().zip(fits).filter(own);
        of_rank.clone().any(|(_, fit)| matches!(fit, Fit::One(_)))
            && of_rank.all(|(mask, _)| !used.contains(mask.path.as_path()))
    };
    let ranks: BTreeSet<usize> = candidates.iter().map(|mask| mask.rank).collect();
    for rank in ranks.into_iter().filter(|rank| is_idle(*rank)) {
        let all = candidates.iter().filter(|mask| mask.rank == rank);
        let paths: Vec<&Path> = all.map(|mask| mask.path.as_path()).collect();
        let names = listed(&paths, folder);
        notes.push(format!("masks that are not used, since others come first: {names}"));
    }
    notes
}

/// The views' masks whose white may leave pixels out; see [`MaskFile::is_dynamic`].
pub(crate) fn dynamic(views: &[UnreadView]) -> Vec<bool> {
    views.iter().map(|view| view.mask.as_ref().is_some_and(|mask| mask.is_dynamic)).collect()
}
