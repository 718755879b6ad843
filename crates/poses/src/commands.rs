//! The options of `dsdf poses`, and the command lines of COLMAP that follow from them.

use std::path::Path;

use clap::{Args, ValueEnum};
use files::InputError;

use crate::Error;
use crate::photographs::Photographs;
use crate::program::Help;
use crate::step::{Entry, Settings, Step};

/// The largest number of photographs whose pairs are all compared by default: 11,175 pairs.
const MOST_FOR_ALL_PAIRS: usize = 150;

/// COLMAP's number of features of a photograph, unless there are fewer.
const MOST_FEATURES: u32 = 8192;

/// The pairs that are compared with so many features. The time of a pair grows with the square of
/// their number: 80 photographs with 2,500 features take as long as 25 with all.
const PAIRS_WITH_ALL_FEATURES: f64 = 300.0;

/// The fewest features of a photograph, however many pairs there are.
const LEAST_FEATURES: u32 = 2048;

/// The longest side at which features are searched, in pixels: for the fewest features, and for all
/// of them, which is COLMAP's.
const MAX_SIZE: [u32; 2] = [1600, 3200];

/// The photographs that each is compared with because they are alike.
const ALIKE: u32 = 20;

/// The visual words of a vocabulary: so many for each photograph, and no more. With 4096 of them, 12
/// alike photographs of each of `spot_room` have 89 % of the pairs with 30 matches or more; 81 %
/// with 1024, and 73 % with 256. COLMAP 3.8 needs a minute for 4096.
const WORDS_PER_PHOTOGRAPH: usize = 32;
const MOST_WORDS: usize = 4096;

/// The photographs whose features make a vocabulary: those of more change it little.
const VOCABULARY_PHOTOGRAPHS: usize = 150;

/// Bytes of memory for each pixel of a photograph and each thread while COLMAP finds features on a
/// CPU. Measured with COLMAP 3.8: 2.28 GB for 7.7 million pixels.
const MEMORY_PER_PIXEL: u64 = 300;

/// The pairs of photographs that are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Matching {
    /// All pairs of up to 150 photographs, else those that are alike
    #[default]
    Auto,
    /// All pairs
    Exhaustive,
    /// Neighbours in the order of the names: frames of a video
    Sequential,
    /// Neighbours in the order of the names, then the 20 photographs that are most alike
    Alike,
}

/// The model of a lens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum CameraModel {
    /// A focal length, and no distortion
    SimplePinhole,
    /// One number for the distortion
    #[default]
    SimpleRadial,
    /// Two numbers for the distortion
    Radial,
    /// Two focal lengths, and four numbers for the distortion: for wide lenses and many photographs
    Opencv,
    /// Fisheye lenses
    OpencvFisheye,
}

/// The photographs that share a lens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum CameraChoice {
    /// Those of one size and one EXIF focal length
    #[default]
    Auto,
    /// All
    One,
    /// None: each photograph has a lens of its own
    Each,
}

/// Whether a second search for matches is guided by the first ones: along epipolar lines, and with
/// a looser comparison of features (a ratio of 0.9).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Guided {
    /// If fewer than 80 % of the photographs have a pose without it
    #[default]
    Auto,
    /// From the start
    Always,
    /// Never
    Never,
}

/// The way from matches to poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Mapper {
    /// One photograph after another
    #[default]
    Incremental,
    /// All at once, by COLMAP 4 and later: for hundreds of photographs
    Global,
}

/// The options of a search for poses.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "COLMAP")]
pub struct Options {
    /// Pairs of photographs to compare
    #[arg(long, value_enum, default_value_t)]
    pub matching: Matching,
    /// Neighbours on each side that --matching sequential and alike compare
    #[arg(long, value_name = "N", default_value_t = 20,
          value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub overlap: u32,
    /// A second search for matches in each pair, guided by the first: slower, and more photographs
    /// have a pose
    #[arg(long, value_enum, default_value_t)]
    pub guided: Guided,
    /// From matches to poses
    #[arg(long, value_enum, default_value_t)]
    pub mapper: Mapper,
    /// Model of the lens
    #[arg(long, value_enum, default_value_t)]
    pub camera_model: CameraModel,
    /// Photographs that share a lens
    #[arg(long, value_enum, default_value_t)]
    pub cameras: CameraChoice,
    /// Longest side at which features are searched, in pixels [default: 3200, and down to 1600 where
    /// fewer features are searched: less needs less time and memory]
    #[arg(help_heading = "Features")]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(100..=20000))]
    pub max_size: Option<u32>,
    /// Features of a photograph, the largest ones first [default: 8192 for up to 25 photographs, and
    /// down to 2048 for more: the time of all pairs]
    #[arg(help_heading = "Features")]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(100..=65_536))]
    pub features: Option<u32>,
    /// Seed of COLMAP's random numbers, where its version has one
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u32).range(..=1_000_000))]
    pub seed: u32,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            matching: Matching::default(),
            overlap: 20,
            guided: Guided::default(),
            mapper: Mapper::default(),
            camera_model: CameraModel::default(),
            cameras: CameraChoice::default(),
            max_size: None,
            features: None,
            seed: 0,
        }
    }
}

impl Options {
    /// The pairs that are compared, without `Auto`.
    pub fn matching_of(&self, photographs: usize) -> Matching {
        match self.matching {
            Matching::Auto if photographs <= MOST_FOR_ALL_PAIRS => Matching::Exhaustive,
            Matching::Auto => Matching::Alike,
            asked => asked,
        }
    }

    /// The number of features of a photograph.
    pub fn features_of(&self, photographs: usize) -> u32 {
        let count = photographs as f64;
        let all = count * (count - 1.0) / 2.0;
        let pairs = match self.matching_of(photographs) {
            Matching::Sequential => count * f64::from(self.overlap),
            Matching::Alike => count * f64::from(self.overlap + ALIKE),
            Matching::Auto | Matching::Exhaustive => all,
        };
        let affordable =
            f64::from(MOST_FEATURES) * (PAIRS_WITH_ALL_FEATURES / pairs.min(all)).sqrt();
        self.features.unwrap_or((affordable as u32).clamp(LEAST_FEATURES, MOST_FEATURES))
    }

    /// The longest side at which features are searched, in pixels. COLMAP takes the largest features,
    /// so fewer of them are found at a smaller size, too: the area is in proportion to their number.
    pub fn max_size_of(&self, photographs: usize) -> u32 {
        let share = f64::from(self.features_of(photographs)) / f64::from(MOST_FEATURES);
        let size = f64::from(MAX_SIZE[1]) * share.sqrt();
        self.max_size.unwrap_or((size as u32).clamp(MAX_SIZE[0], MAX_SIZE[1]))
    }

    /// Refuses one lens for photographs of several sizes.
    pub(crate) fn check(&self, photographs: &Photographs) -> Result<(), InputError> {
        if self.cameras == CameraChoice::One && !photographs.have_one_size() {
            let found = "one, for photographs of several sizes";
            return Err(InputError::new("arguments", "--cameras", found, "auto or each"));
        }
        Ok(())
    }

    /// The numbers of the photographs whose features are searched by one call of COLMAP. They share
    /// a lens, unless each has a lens of its own.
    pub(crate) fn groups(&self, photographs: &Photographs) -> Vec<Vec<usize>> {
        match self.cameras {
            CameraChoice::Auto => photographs.alike(),
            CameraChoice::One | CameraChoice::Each => vec![(0..photographs.count()).collect()],
        }
    }

    /// The use of lenses in words. One lens for all is the same for each choice that leads to it.
    fn lenses(&self, photographs: &Photographs) -> &'static str {
        match self.cameras {
            CameraChoice::Each => "each",
            _ if self.groups(photographs).len() == 1 => "one",
            _ => "alike",
        }
    }

    /// The name of the lens's model.
    fn model(&self) -> &'static str {
        match self.camera_model {
            CameraModel::SimplePinhole => "SIMPLE_PINHOLE",
            CameraModel::SimpleRadial => "SIMPLE_RADIAL",
            CameraModel::Radial => "RADIAL",
            CameraModel::Opencv => "OPENCV",
            CameraModel::OpencvFisheye => "OPENCV_FISHEYE",
        }
    }

    /// All steps with the options that their results depend on. Matching is guided or not.
    pub(crate) fn settings(&self, photographs: &Photographs, is_guided: bool) -> Vec<Entry> {
        let matching = self.matching_of(photographs.count());
        // Numbers that nobody asked for are no settings: features that are there stay.
        let max_size = self.max_size.unwrap_or(MAX_SIZE[1]);
        let features = self.features.map(|features| ("features", features.to_string()));
        let of = |step: Step| -> Vec<(&str, String)> {
            match step {
                Step::Features => [
                    ("camera_model", self.model().to_owned()),
                    ("cameras", self.lenses(photographs).to_owned()),
                    ("max_size", max_size.to_string()),
                    ("seed", self.seed.to_string()),
                ]
                .into_iter()
                .chain(features.clone())
                .collect(),
                Step::Matching => {
                    let overlap = || ("overlap", self.overlap.to_string());
                    match matching {
                        Matching::Sequential => vec![("matching", "sequential".into()), overlap()],
                        Matching::Alike => vec![("matching", "alike".into()), overlap()],
                        Matching::Auto | Matching::Exhaustive => {
                            vec![("matching", "exhaustive".to_owned())]
                        }
                    }
                }
                Step::Mapping if self.mapper == Mapper::Global => {
                    vec![("mapper", "global".to_owned())]
                }
                Step::Mapping | Step::Undistortion => Vec::new(),
            }
        };
        let entry = |step: Step| {
            let mut settings: Settings =
                of(step).into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
            if step == Step::Matching && is_guided {
                settings.insert(GUIDED.to_owned(), "yes".to_owned());
            }
            Entry { step, settings }
        };
        Step::ALL.into_iter().map(entry).collect()
    }

    /// The calls of COLMAP for a step, in their order.
    pub(crate) fn calls(&self, step: Step, photographs: &Photographs) -> Vec<Call> {
        match step {
            Step::Features => {
                let groups = self.groups(photographs);
                groups.into_iter().map(|group| Call::of("feature_extractor", group)).collect()
            }
            Step::Matching => {
                let commands: &[&str] = match self.matching_of(photographs.count()) {
                    Matching::Sequential => &["sequential_matcher"],
                    Matching::Alike => &["sequential_matcher", BUILDER, "vocab_tree_matcher"],
                    Matching::Auto | Matching::Exhaustive => &["exhaustive_matcher"],
                };
                commands.iter().map(|command| Call::of(command, Vec::new())).collect()
            }
            Step::Mapping => {
                let command = match self.mapper {
                    Mapper::Incremental => "mapper",
                    Mapper::Global => GLOBAL_MAPPER,
                };
                vec![Call::of(command, Vec::new())]
            }
            Step::Undistortion => vec![Call::of("image_undistorter", Vec::new())],
        }
    }
}

/// A call of COLMAP.
pub(crate) struct Call {
    /// Its command.
    pub(crate) command: &'static str,
    /// The numbers of the photographs that it reads; empty: all.
    pub(crate) group: Vec<usize>,
}

impl Call {
    fn of(command: &'static str, group: Vec<usize>) -> Self {
        Call { command, group }
    }
}

/// The command that finds all poses at once.
pub(crate) const GLOBAL_MAPPER: &str = "global_mapper";

/// The command that makes a vocabulary of the features: it tells which photographs are alike.
pub(crate) const BUILDER: &str = "vocab_tree_builder";

/// The setting of guided matching.
const GUIDED: &str = "guided";

/// COLMAP's options for guided matching, in newer and older versions.
const GUIDED_MATCHING: [&str; 2] =
    ["FeatureMatching.guided_matching", "SiftMatching.guided_matching"];

/// The largest ratio of the distances to the best and the second best feature, in guided matching:
/// epipolar lines leave few wrong ones. COLMAP's default is 0.8.
const GUIDED_RATIO: f64 = 0.9;

/// Whether the installed version can guide its matching.
pub(crate) fn can_guide(help: &Help) -> bool {
    GUIDED_MATCHING.iter().any(|name| help.has(name))
}

impl Entry {
    /// Whether it is a guided matching.
    pub(crate) fn is_guided(&self) -> bool {
        self.settings.contains_key(GUIDED)
    }
}

/// The folders of a step.
pub(crate) struct Places<'a> {
    /// The photographs.
    pub(crate) images: &'a Path,
    /// The result of the step before: a database, or a model.
    pub(crate) input: &'a Path,
    /// The folder of the results.
    pub(crate) output: &'a Path,
    /// The list of the photographs of a call, for the first step.
    pub(crate) list: &'a Path,
}

/// The name of a list of photographs in the results of the first step.
pub(crate) fn list_name(group: usize) -> String {
    format!("images-{group}.txt")
}

/// The name of a vocabulary, beside the database of the matches.
const VOCABULARY: &str = "vocabulary.bin";

/// The name of a database.
pub(crate) const DATABASE: &str = "database.db";

/// The arguments of COLMAP for a step, with names of options that its `help` lists.
///
/// # Errors
/// If it lacks an option.
pub(crate) fn arguments(
    entry: &Entry,
    options: &Options,
    photographs: &Photographs,
    threads: usize,
    places: &Places<'_>,
    help: &Help,
) -> Result<Vec<String>, Error> {
    let path = |path: &Path| path.display().to_string();
    let database = path(&places.output.join(DATABASE));
    let mut line = Line { help, words: Vec::new() };
    match entry.step {
        Step::Features => {
            line.add(&["database_path"], database)?;
            line.add(&["image_path"], path(places.images))?;
            line.add(&["image_list_path"], path(places.list))?;
            line.add(&["ImageReader.camera_model"], options.model())?;
            let is_each = options.cameras == CameraChoice::Each;
            line.add(&["ImageReader.single_camera"], u8::from(!is_each))?;
            if is_each {
                line.add(&["ImageReader.single_camera_per_image"], 1)?;
            }
            line.add(&["FeatureExtraction.use_gpu", "SiftExtraction.use_gpu"], 0)?;
            let max_size = options.max_size_of(photographs.count());
            let threads = threads.min(threads_for(photographs.most_pixels(max_size)));
            line.add(&["FeatureExtraction.num_threads", "SiftExtraction.num_threads"], threads)?;
            let size = ["FeatureExtraction.max_image_size", "SiftExtraction.max_image_size"];
            line.add(&size, max_size)?;
            let features = options.features_of(photographs.count());
            line.add_if_known("SiftExtraction.max_num_features", features);
        }
        Step::Matching => {
            let count = photographs.count();
            matching_arguments(entry, options, (count, threads), places, &mut line)?;
        }
        Step::Mapping => {
            line.add(&["database_path"], path(places.input))?;
            line.add(&["image_path"], path(places.images))?;
            line.add(&["output_path"], path(places.output))?;
            line.add_if_known("Mapper.num_threads", threads);
            line.add_if_known("GlobalMapper.num_threads", threads);
            // The default, 10, refuses a model of 9 of 12 photographs.
            line.add_if_known("Mapper.min_model_size", (photographs.count() / 4).clamp(3, 10));
        }
        Step::Undistortion => {
            line.add(&["image_path"], path(places.images))?;
            line.add(&["input_path"], path(places.input))?;
            line.add(&["output_path"], path(places.output))?;
            line.add_if_known("output_type", "COLMAP");
            line.add_if_known("jpeg_quality", 100);
        }
    }
    for seed in ["random_seed", "default_random_seed", "TwoViewGeometry.random_seed"] {
        line.add_if_known(seed, options.seed);
    }
    line.add_if_known("Mapper.random_seed", options.seed);
    line.add_if_known("GlobalMapper.random_seed", options.seed);
    Ok(line.words)
}

/// Adds the arguments of a command that compares photographs, or makes the vocabulary for it.
fn matching_arguments(
    entry: &Entry,
    options: &Options,
    (photographs, threads): (usize, usize),
    places: &Places<'_>,
    line: &mut Line<'_>,
) -> Result<(), Error> {
    let path = |name: &str| places.output.join(name).display().to_string();
    line.add(&["database_path"], path(DATABASE))?;
    if line.help.command() == BUILDER {
        line.add(&["vocab_tree_path"], path(VOCABULARY))?;
        let words = (WORDS_PER_PHOTOGRAPH * photographs).min(MOST_WORDS);
        line.add_if_known("num_visual_words", words);
        // COLMAP 3.8 ends by a failed check if there are fewer.
        line.add_if_known("max_num_images", photographs.min(VOCABULARY_PHOTOGRAPHS));
        // The tree of the words: 64 branches twice.
        line.add_if_known("branching", 64);
        line.add_if_known("num_iterations", 5);
        line.add_if_known("num_threads", threads);
        return Ok(());
    }
    line.add(&["FeatureMatching.use_gpu", "SiftMatching.use_gpu"], 0)?;
    line.add(&["FeatureMatching.num_threads", "SiftMatching.num_threads"], threads)?;
    if entry.is_guided() {
        line.add(&GUIDED_MATCHING, 1)?;
        line.add_if_known("SiftMatching.max_ratio", GUIDED_RATIO);
    }
    match line.help.command() {
        "sequential_matcher" => {
            line.add(&["SequentialMatching.overlap"], options.overlap)?;
        }
        "vocab_tree_matcher" => {
            let vocabulary = path(VOCABULARY);
            line.add(&["VocabTreeMatching.vocab_tree_path"], vocabulary)?;
            // A photograph is the one most alike to itself.
            line.add(&["VocabTreeMatching.num_images"], ALIKE + 1)?;
        }
        // Small blocks show more of the progress. The pairs are the same.
        _ => line.add_if_known("ExhaustiveMatching.block_size", 10),
    }
    Ok(())
}

/// The threads for which half of the memory suffices.
fn threads_for(pixels: u64) -> usize {
    let need = MEMORY_PER_PIXEL * pixels.max(1);
    files::memory_limit().map_or(usize::MAX, |limit| (limit / 2 / need).max(1) as usize)
}

/// A command line that grows.
struct Line<'a> {
    help: &'a Help,
    words: Vec<String>,
}

impl Line<'_> {
    /// Adds an option by the first of its names that COLMAP has.
    fn add(&mut self, names: &[&str], value: impl ToString) -> Result<(), Error> {
        let Some(name) = names.iter().find(|name| self.help.has(name)) else {
            let (command, names) = (self.help.command(), names.join(" and no --"));
            let expected = "COLMAP 3.6 or later";
            return Err(Error::Colmap(format!(
                "colmap {command}: options: found no --{names}, expected {expected}"
            )));
        };
        self.words.extend([format!("--{name}"), value.to_string()]);
        Ok(())
    }

    /// Adds an option if COLMAP has it.
    fn add_if_known(&mut self, name: &str, value: impl ToString) {
        if self.help.has(name) {
            self.words.extend([format!("--{name}"), value.to_string()]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four photographs in a folder.
    fn photographs(folder: &Path) -> Photographs {
        for name in ["a.png", "b.png", "c.png", "d.png"] {
            image::GrayImage::new(8, 6).save(folder.join(name)).unwrap();
        }
        Photographs::in_folder(folder).unwrap()
    }

    /// The arguments of a step with a help of these options.
    fn line(step: Step, options: &Options, help: &str) -> Result<String, Error> {
        let folder = tempfile::tempdir().unwrap();
        let (photographs, here) = (photographs(folder.path()), Path::new("x"));
        let places = Places { images: here, input: here, output: here, list: here };
        let help = Help::new("some_command", help);
        let entry = Entry { step, settings: Settings::new() };
        arguments(&entry, options, &photographs, 2, &places, &help).map(|words| words.join(" "))
    }

    const FEATURES: &str = "--database_path arg --image_path arg --image_list_path arg \
        --ImageReader.camera_model arg (=X) --ImageReader.single_camera arg (=0) \
        --ImageReader.single_camera_per_image arg";

    #[test]
    fn options_have_the_names_of_the_installed_version() {
        let rest = "use_gpu arg (=1) --#.num_threads arg --#.max_image_size arg".to_owned();
        let of = |group: &str| format!("{FEATURES} --#.{rest}").replace('#', group);
        for (group, seed) in
            [("SiftExtraction", "random_seed"), ("FeatureExtraction", "default_random_seed")]
        {
            let help = format!("{} --{seed} arg (=0)", of(group));
            let text = line(Step::Features, &Options::default(), &help).unwrap();
            let expected = format!("--{group}.use_gpu 0 --{group}.num_threads 2");
            assert!(text.contains(&expected), "{text}");
            assert!(text.contains("--ImageReader.single_camera 1 "), "{text}");
            assert!(text.ends_with(&format!(".max_image_size 3200 --{seed} 0")), "{text}");
            let each = Options { cameras: CameraChoice::Each, ..Options::default() };
            let text = line(Step::Features, &each, &help).unwrap();
            assert!(text.contains("single_camera 0 --ImageReader.single_camera_per_image 1 "));
        }
        let error = line(Step::Features, &Options::default(), FEATURES).unwrap_err().to_string();
        assert!(error.contains("found no --FeatureExtraction.use_gpu and no --Sift"), "{error}");
    }

    #[test]
    fn a_step_runs_again_only_if_its_options_change() {
        let folder = tempfile::tempdir().unwrap();
        let photographs = photographs(folder.path());
        let all = |options: Options| options.settings(&photographs, false);
        let settings = all(Options::default());
        let overlap = all(Options { overlap: 5, ..Options::default() });
        assert_eq!(settings, overlap, "it has no effect on exhaustive matching");
        let matching = Matching::Sequential;
        let sequential = all(Options { matching, ..Options::default() });
        assert!(settings[0] == sequential[0] && settings[1] != sequential[1]);
        let size = all(Options { max_size: Some(900), ..Options::default() });
        assert!(settings[0] != size[0] && settings[1..] == size[1..]);
        let guided = Options::default().settings(&photographs, true);
        assert!(guided[1].is_guided() && !settings[1].is_guided() && guided[2..] == settings[2..]);
        let options = Options::default();
        assert_eq!(options.matching_of(150), Matching::Exhaustive);
        assert_eq!(options.matching_of(151), Matching::Alike);
    }

    #[test]
    fn many_pairs_have_fewer_features() {
        let of = |photographs| Options::default().features_of(photographs);
        assert_eq!([2, 16, 25].map(of), [8192; 3]);
        assert_eq!([48, 80, 150].map(of), [4224, 2524, 2048]);
        // Neighbours alone are few pairs.
        assert_eq!(of(300), 2048);
        let sizes = [2, 25, 80, 151].map(|count| Options::default().max_size_of(count));
        assert_eq!(sizes, [3200, 3200, 1776, 1600]);
        let asked = Options { features: Some(5000), ..Options::default() };
        assert_eq!(asked.features_of(150), 5000);
        let folder = tempfile::tempdir().unwrap();
        let photographs = photographs(folder.path());
        let all = |options: Options| options.settings(&photographs, false);
        let settings = all(Options::default());
        // Of many photographs, too, as in the folders of earlier versions.
        assert!(!settings[0].settings.contains_key("features"));
        assert_eq!(all(asked)[0].settings["features"], "5000");
        let help =
            "--#.use_gpu arg --#.num_threads arg --#.max_image_size arg --#.max_num_features arg";
        let help = format!("{FEATURES} {}", help.replace('#', "SiftExtraction"));
        let text = line(Step::Features, &Options::default(), &help).unwrap();
        assert!(text.ends_with("--SiftExtraction.max_num_features 8192"), "{text}");
    }

    #[test]
    fn one_lens_for_several_sizes_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        photographs(folder.path());
        image::GrayImage::new(6, 8).save(folder.path().join("e.png")).unwrap();
        let photographs = Photographs::in_folder(folder.path()).unwrap();
        let one = Options { cameras: CameraChoice::One, ..Options::default() };
        let error = one.check(&photographs).unwrap_err().to_string();
        assert!(error.starts_with("arguments: --cameras: found one, for"), "{error}");
        let auto = Options::default();
        assert_eq!(auto.groups(&photographs), [vec![0, 1, 2, 3], vec![4]]);
        assert_eq!(auto.lenses(&photographs), "alike");
        let each = Options { cameras: CameraChoice::Each, ..Options::default() };
        assert_eq!((each.groups(&photographs).len(), each.lenses(&photographs)), (1, "each"));
    }

    #[test]
    fn few_threads_search_large_photographs() {
        assert_eq!(threads_for(u64::MAX / MEMORY_PER_PIXEL / 2), 1);
        assert!(threads_for(1) > 100_000);
    }
}
