//! The verdict on a fit: its most likely fault, and the option to try.

use std::fmt::{Display, Formatter};

use dataset::{Dataset, View};
use field::Sphere;
use render::{InvalidField, Scene};
use serde::Serialize;

use crate::accuracy::sampled_psnr;
use crate::surface::{SurfaceShares, surface_shares};
use inspect::{MOST_SPREAD, exposure_spread};

/// The numbers that a verdict follows from.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evidence {
    /// Views that were fitted.
    pub training_views: usize,
    /// Whether the background of the fit is one colour.
    pub uniform_background: bool,
    /// The confidence that the photographs have a uniform background, 0 to 1.
    pub background_confidence: f32,
    /// The spread of the exposures, in stops; `None` if it is not known.
    pub exposure_spread: Option<f64>,
    /// Whether the fit has an exposure for each photograph.
    pub fits_exposures: bool,
    /// The shares of the surface's area; `None` without a surface.
    pub surface: Option<SurfaceShares>,
    /// The PSNR of samples of training views inside the sphere, in dB; see [`sampled_psnr`]. The
    /// PSNR of whole views is that of `dsdf eval`.
    pub training_match: Option<f64>,
    /// Like `training_match`, of held-out views; `None` without such views.
    pub held_out_match: Option<f64>,
}

impl Evidence {
    /// The PSNR of samples of training views and, if there are any, of held-out views, as text.
    pub fn match_text(&self) -> String {
        let sides = [(self.training_match, "training"), (self.held_out_match, "held-out")];
        let known = sides.into_iter().filter_map(|(psnr, name)| Some((psnr?, name)));
        let texts: Vec<_> =
            known.map(|(psnr, name)| format!("{psnr:.1} dB on {name} views")).collect();
        match texts.is_empty() {
            true => "no sample inside the sphere".to_owned(),
            false => texts.join(", ") + " (samples inside the sphere, not whole views)",
        }
    }

    /// Examines a fit. `scene` is its solid with the cameras of the training views and then those
    /// of the held-out views, and `sphere` is its bounding sphere. `uniform_background` tells
    /// whether its background is one colour, or one for each view, and `fits_exposures` whether it
    /// has an exposure for each view.
    ///
    /// It takes about a second, and gives the same numbers on any number of threads.
    ///
    /// # Errors
    /// If the field gives a NaN or an infinity along a ray.
    pub fn collect(
        scene: &Scene<'_, f32>,
        sphere: &Sphere<f64>,
        dataset: &Dataset,
        background: &inspect::BackgroundEstimate,
        uniform_background: bool,
        fits_exposures: bool,
    ) -> Result<Evidence, InvalidField> {
        let (train, all) = (dataset.train.len(), dataset.train.len() + dataset.test.len());
        let psnr = |views: &[View], numbers| {
            sampled_psnr(scene, sphere, views, numbers, !uniform_background)
        };
        Ok(Evidence {
            training_views: train,
            uniform_background,
            background_confidence: background.confidence,
            exposure_spread: exposure_spread(&dataset.train, sphere, background).map(|e| e.stops),
            fits_exposures,
            surface: surface_shares(scene, sphere, 0..train)?,
            training_match: psnr(&dataset.train, 0..train)?,
            held_out_match: psnr(&dataset.test, train..all)?,
        })
    }
}

/// The most likely fault of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fault {
    /// There is no surface in the bounding sphere.
    NoSurface,
    /// The bounding sphere carries the image of the background.
    PaintedBackground,
    /// The bounding sphere cuts the object off.
    SmallSphere,
    /// There are too few views for the shape.
    FewViews,
    /// Held-out views are much worse than training views.
    Inconsistent,
    /// The photographs have different exposures.
    Exposure,
    /// Training views are not matched.
    LowAccuracy,
    /// No photograph sees a large part of the surface.
    Unseen,
}

// The evidence for the thresholds is in the README.

/// The share of the surface that lies on the bounding sphere in view of a photograph, above which
/// something is wrong there.
const MOST_ON_SPHERE: f64 = 0.1;

/// The same share of the surface above the table, from which on the sphere is the first fault, before
/// poses and views: a sphere that cuts the object off spoils all views.
const MOST_CUT_OFF: f64 = 0.3;

/// The confidence in a uniform background below which one colour cannot explain it.
const LEAST_CONFIDENCE: f32 = 0.5;

/// The number of views below which a gap between training and held-out views is laid to them.
const FEW_VIEWS: usize = 12;

/// The gap between the PSNR of training and of held-out views above which the views contradict each
/// other, dB.
const LARGEST_GAP: f64 = 4.0;

/// The PSNR of held-out views from which on they are good enough, however well training views are
/// matched, dB.
const GOOD_PSNR: f64 = 30.0;

/// The PSNR of training views below which exposures that differ are blamed, dB.
const LEAST_PSNR_OF_EXPOSURES: f64 = 26.0;

/// The PSNR of training views below which they are not matched, dB.
const LEAST_PSNR: f64 = 23.5;

/// The unseen share of the sides and the top of a surface above which it is reported.
const MOST_UNSEEN: f64 = 0.3;

impl Fault {
    /// The most likely fault that follows from the evidence; `None` if nothing was found.
    ///
    /// The rules are tried in this order, since each fault also has effects that later rules see:
    /// 1. no surface;
    /// 2. the background is one colour, and more than 10 % of the surface lies on the bounding
    ///    sphere, in view of a photograph: the background is painted there if it is not uniform,
    ///    and else the sphere cuts the object off;
    /// 3. before another background, more than 30 % of the surface lies there, in view of a photograph
    ///    and above the table, which every sphere cuts;
    /// 4. held-out views are below 30 dB and 4 dB worse than training views: too few views if there
    ///    are fewer than 12, and else inconsistent ones;
    /// 5. a PSNR of training views below 26 dB where their exposures differ and are not fitted;
    /// 6. a PSNR of training views below 23.5 dB;
    /// 7. the same as 3 with more than 10 % of the surface;
    /// 8. more than 30 % of the sides and the top of the surface is unseen, or no sampled pixel of a
    ///    training view counts.
    pub fn of(evidence: &Evidence) -> Option<Fault> {
        let Some(surface) = &evidence.surface else { return Some(Fault::NoSurface) };
        if surface.seen_on_sphere > MOST_ON_SPHERE && evidence.uniform_background {
            let is_clutter = evidence.background_confidence < LEAST_CONFIDENCE;
            return Some(if is_clutter { Fault::PaintedBackground } else { Fault::SmallSphere });
        }
        if surface.seen_above_table > MOST_CUT_OFF {
            return Some(Fault::SmallSphere);
        }
        let both = evidence.training_match.zip(evidence.held_out_match);
        if both.is_some_and(|(t, h)| h < GOOD_PSNR && t - h > LARGEST_GAP) {
            return Some(match evidence.training_views < FEW_VIEWS {
                true => Fault::FewViews,
                false => Fault::Inconsistent,
            });
        }
        let is_below = |least: f64| evidence.training_match.is_some_and(|psnr| psnr < least);
        let differ = evidence.exposure_spread.is_some_and(|stops| stops > MOST_SPREAD);
        if differ && !evidence.fits_exposures && is_below(LEAST_PSNR_OF_EXPOSURES) {
            return Some(Fault::Exposure);
        }
        if is_below(LEAST_PSNR) {
            return Some(Fault::LowAccuracy);
        }
        if surface.seen_above_table > MOST_ON_SPHERE {
            return Some(Fault::SmallSphere);
        }
        let no_view_shows_it = evidence.training_match.is_none();
        (surface.unseen_sides > MOST_UNSEEN || no_view_shows_it).then_some(Fault::Unseen)
    }

    /// The fault and the option to try, in one sentence.
    fn text(self) -> &'static str {
        match self {
            Fault::NoSurface => {
                "there is no surface: try a larger sphere (--bounds), and look at the picture of \
                 `dsdf inspect`"
            }
            Fault::PaintedBackground => {
                "the background is painted on the bounding sphere, since one colour does not \
                 explain it: try --background volume"
            }
            Fault::SmallSphere => {
                "the bounding sphere cuts the surface off: if this is the object, try a larger \
                 sphere (--bounds), and look at the picture of `dsdf inspect`"
            }
            Fault::FewViews => {
                "held-out views are much worse than training views: try more photographs"
            }
            Fault::Inconsistent => {
                "held-out views are much worse than training views: check the poses with \
                 `dsdf inspect` (their order, axes, a mirrored world), or try more photographs"
            }
            Fault::Exposure => {
                "the exposures of the photographs differ: try --exposure per-view, or photographs \
                 with a fixed exposure"
            }
            Fault::LowAccuracy => {
                "training views are not matched: check the poses (their order, axes, a mirrored \
                 world) and the sphere with `dsdf inspect`, or try a longer --time"
            }
            Fault::Unseen => {
                "no photograph sees a large part of the surface: try photographs from other sides"
            }
        }
    }
}

/// A verdict, with the numbers that it follows from.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// The numbers.
    #[serde(flatten)]
    pub evidence: Evidence,
    /// The most likely fault; `None` if nothing was found.
    pub fault: Option<Fault>,
    /// The fault and the option to try, in one sentence.
    pub text: &'static str,
}

impl Verdict {
    /// The verdict that follows from `evidence`.
    pub fn of(evidence: Evidence) -> Self {
        let fault = Fault::of(&evidence);
        Verdict { evidence, fault, text: fault.map_or("nothing wrong was found", Fault::text) }
    }
}

impl Display for Verdict {
    /// Three lines: a label of 13 columns, then a sentence.
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let evidence = &self.evidence;
        if let Some(SurfaceShares { on_sphere, seen_on_sphere, unseen, .. }) = &evidence.surface {
            let [on_sphere, seen_on_sphere, unseen] =
                [on_sphere, seen_on_sphere, unseen].map(|share| 100.0 * share);
            writeln!(
                f,
                "surface      {on_sphere:.1} % of its area on the bounding sphere \
                 ({seen_on_sphere:.1} % in view), {unseen:.1} % seen by no photograph"
            )?;
        }
        writeln!(f, "match        {}", evidence.match_text())?;
        write!(f, "verdict      {}", self.text)
    }
}

#[cfg(test)]
#[path = "verdict_tests.rs"]
mod tests;
