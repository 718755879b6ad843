//! The choice of the estimator by `--estimator` and `--filter`.

use estimate::{Entry, Filter, Registry};
use files::InputError;

use super::options::Gradient;
use crate::cli::common::ARGUMENTS;

/// The name of finite differences on the command line. They are not in the registry: an estimator
/// differentiates one scene, and finite differences render changed scenes.
pub(in crate::cli) const FINITE_DIFFERENCES: &str = "fd";

/// The line of finite differences in the help of `--estimator`.
pub(in crate::cli) const FD_HELP: &str =
    "\n- fd: ground truth: central differences, only for --wrt";

/// The way to compute a derivative.
pub(super) enum Method<'a> {
    /// An estimator of the registry.
    Estimator(&'a Entry),
    /// Central differences of rendered images.
    FiniteDifferences,
}

impl Gradient {
    /// The method that `--estimator` and `--filter` name.
    ///
    /// # Errors
    /// If a name is unknown, the estimator has another filter, or finite differences are asked for
    /// weights of a network.
    pub(super) fn method<'a>(&self, registry: &'a Registry) -> Result<Method<'a>, InputError> {
        let gaussian = self.wants_gaussian_filter()?;
        let name = self.estimator_name(gaussian);
        let entry = registry.get(name);
        if entry.is_none() && name != FINITE_DIFFERENCES {
            let expected = format!("one of {}, {FINITE_DIFFERENCES}", registry.names());
            return Err(InputError::new(ARGUMENTS, "--estimator", name, expected));
        }
        self.check_filter(gaussian, name, entry.map_or(Filter::Box, Entry::filter))?;
        match entry {
            Some(entry) => Ok(Method::Estimator(entry)),
            None => self.check_no_weights(name).map(|()| Method::FiniteDifferences),
        }
    }

    /// Whether `--filter` is `gaussian`.
    fn wants_gaussian_filter(&self) -> Result<bool, InputError> {
        match self.filter.as_deref() {
            None | Some("box") => Ok(false),
            Some("gaussian") => Ok(true),
            Some(other) => Err(InputError::new(ARGUMENTS, "--filter", other, "box or gaussian")),
        }
    }

    /// The name of the estimator. With `--filter gaussian`, `paper` means its Gaussian version.
    fn estimator_name(&self, gaussian: bool) -> &str {
        match self.estimator.as_deref() {
            None | Some("paper") if gaussian => "gaussian",
            None => "refined",
            Some(name) => name,
        }
    }

    /// Refuses a `--filter` that is not the filter of the estimator.
    fn check_filter(&self, gaussian: bool, name: &str, filter: Filter) -> Result<(), InputError> {
        match &self.filter {
            Some(found) if gaussian != (filter == Filter::Gaussian) => {
                let own = if gaussian { "box" } else { "gaussian" };
                let expected = format!("{own}, the filter of --estimator {name}");
                Err(InputError::new(ARGUMENTS, "--filter", found, expected))
            }
            _ => Ok(()),
        }
    }

    /// Refuses finite differences by weights of a network: they have no JSON pointers to change.
    fn check_no_weights(&self, name: &str) -> Result<(), InputError> {
        if self.target.is_some() || self.wrt.iter().any(|wrt| wrt.starts_with("/sdf/weights/")) {
            let expected = "another estimator for network weights; contour is their reference";
            return Err(InputError::new(ARGUMENTS, "--estimator", name, expected));
        }
        Ok(())
    }
}
