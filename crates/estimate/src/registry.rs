//! Estimators by name.

use field::Precision;

use crate::band::Band;
use crate::contour::Contour;
use crate::convolution::Convolution;
use crate::estimator::{Estimator, Filter};
use crate::interior::Interior;
use crate::options::EstimatorOptions;
use crate::refined::Refined;
use crate::warped::WarpedArea;

/// A function that makes an estimator from its options.
pub type Constructor<R> = fn(&EstimatorOptions) -> Box<dyn Estimator<R>>;

/// An estimator with its name.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// The name on the command line.
    pub name: &'static str,
    /// A description of one line, for `--help`.
    pub summary: &'static str,
    /// Its constructor in single precision.
    pub single: Constructor<f32>,
    /// Its constructor in double precision.
    pub double: Constructor<f64>,
}

/// A precision that has a constructor in every [`Entry`]: `f32` or `f64`.
pub trait EstimatorPrecision: Precision {
    /// The constructor of an entry in this precision.
    fn constructor(entry: &Entry) -> Constructor<Self>;
}

impl EstimatorPrecision for f32 {
    fn constructor(entry: &Entry) -> Constructor<f32> {
        entry.single
    }
}

impl EstimatorPrecision for f64 {
    fn constructor(entry: &Entry) -> Constructor<f64> {
        entry.double
    }
}

impl Entry {
    /// The estimator with these options.
    pub fn estimator<R: EstimatorPrecision>(
        &self,
        options: &EstimatorOptions,
    ) -> Box<dyn Estimator<R>> {
        R::constructor(self)(options)
    }

    /// The pixel filter of the image that is differentiated.
    pub fn filter(&self) -> Filter {
        self.estimator::<f64>(&EstimatorOptions::default()).filter()
    }
}

/// A list of estimators with unique names.
#[derive(Clone, Debug)]
pub struct Registry {
    entries: Vec<Entry>,
}

/// An entry with one constructor for both precisions.
macro_rules! entry {
    ($name:literal, $summary:literal, $make:expr) => {
        Entry {
            name: $name,
            summary: $summary,
            single: |options| Box::new($make(options)),
            double: |options| Box::new($make(options)),
        }
    };
}

impl Default for Registry {
    /// The estimators of this crate.
    fn default() -> Self {
        Registry {
            entries: vec![
                entry!("refined", "silhouettes found along random lines of the film", |_| Refined),
                entry!(
                    "paper",
                    "top-k warp with the pixel-boundary integral, as published",
                    WarpedArea::published
                ),
                entry!("paper-all", "paper with every point", WarpedArea::of_all_points),
                entry!(
                    "gaussian",
                    "the warp of paper under a Gaussian filter",
                    WarpedArea::gaussian
                ),
                entry!("was", "warp by convolution with harmonic weights", |_| {
                    Convolution::harmonic()
                }),
                entry!("loubet", "warp by the mean motion of auxiliary rays", |_| {
                    Convolution::mean()
                }),
                entry!("band", "boundary integral widened to a band", |_| Band),
                entry!("interior", "no silhouette term", |_| Interior),
                entry!("contour", "ground truth: silhouettes traced on a fine grid", |_| Contour),
            ],
        }
    }
}

impl Registry {
    /// Adds an estimator. It replaces an estimator of the same name.
    ///
    /// # Panics
    /// If the name is empty or has white space.
    pub fn add(&mut self, entry: Entry) {
        let name = entry.name;
        let usable = !name.is_empty() && !name.contains(char::is_whitespace);
        assert!(usable, "{name:?} cannot be the name of an estimator");
        self.entries.retain(|known| known.name != entry.name);
        self.entries.push(entry);
    }

    /// The estimators, in the order in which they were added; those of this crate first.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// The names, separated by commas.
    pub fn names(&self) -> String {
        self.entries.iter().map(|entry| entry.name).collect::<Vec<_>>().join(", ")
    }

    /// The estimator with this name.
    pub fn get(&self, name: &str) -> Option<&Entry> {
        self.entries.iter().find(|entry| entry.name == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_add_replaces_an_estimator_of_the_same_name() {
        let mut registry = Registry::default();
        let mut names: Vec<&str> = registry.entries().iter().map(|entry| entry.name).collect();
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count);
        registry.add(entry!("refined", "replaced", |_| Interior));
        assert_eq!(registry.entries().len(), count);
        assert_eq!(registry.get("refined").map(|entry| entry.summary), Some("replaced"));
        assert!(registry.get("none").is_none());
    }
}
