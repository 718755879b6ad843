//! The report as text: a label of 13 columns, then a sentence.

use std::fmt::{Display, Formatter, Result};

use dataset::Distortion;

use crate::{Exposure, ExposureSource, Report};

impl Display for Report {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        self.write_images(f)?;
        self.write_cameras(f)?;
        self.write_surroundings(f)
    }
}

impl Report {
    /// The warnings as lines of the text, which has them behind all other rows.
    pub fn warning_rows(&self) -> String {
        self.warnings.iter().map(|warning| format!("\nWARNING      {warning}")).collect()
    }

    fn write_images(&self, f: &mut Formatter<'_>) -> Result {
        let [fx, fy] = self.focal;
        writeln!(f, "format       {}", self.format)?;
        let (train, test) = (self.train_views, self.test_views);
        writeln!(f, "views        {train} to fit, {test} held out")?;
        writeln!(
            f,
            "images       {} pixels, {:.1} degrees across (focal {fx:.1}, {fy:.1} pixels)",
            self.sizes_text(),
            self.field_of_view
        )?;
        match self.distortion {
            Some(distortion) => writeln!(f, "lens         {}", lens_text(&distortion)),
            None => Ok(()),
        }
    }

    /// The size of all images, or the number of images of each size.
    fn sizes_text(&self) -> String {
        let size = |[width, height]: [u32; 2]| format!("{width} x {height}");
        match self.image_sizes.as_slice() {
            [(all, _)] => size(*all),
            sizes => {
                let each: Vec<String> =
                    sizes.iter().map(|(s, count)| format!("{count} of {}", size(*s))).collect();
                each.join(", ")
            }
        }
    }

    fn write_cameras(&self, f: &mut Formatter<'_>) -> Result {
        let [low, high] = self.elevation;
        let [near, mean, far] = self.distance.map(|d| files::length(d, self.radius));
        writeln!(
            f,
            "cameras      {near} to {far} from the centre (mean {mean}), \
             up to {:.0} degrees apart",
            self.spread
        )?;
        writeln!(
            f,
            "             {low:.0} to {high:.0} degrees above the centre (z up), \
             within 30 degrees of {:.0} % of all directions",
            100.0 * self.surrounded
        )?;
        let (through, all) = (self.axes_through, self.train_views + self.test_views);
        writeln!(
            f,
            "             {through} of {all} axes pass through the sphere, \
             {:.1} degrees off its centre on average",
            self.off_axis
        )
    }

    fn write_surroundings(&self, f: &mut Formatter<'_>) -> Result {
        writeln!(
            f,
            "sphere       centre {}, radius {}, {}",
            files::point(self.center, self.radius),
            files::length(self.radius, self.radius),
            self.bounds_from
        )?;
        let least = self.coverage.iter().copied().fold(1.0, f64::min);
        let largest = self.coverage.iter().copied().fold(0.0, f64::max);
        writeln!(
            f,
            "coverage     the sphere covers {:.0} to {:.0} % of each image",
            100.0 * least,
            100.0 * largest
        )?;
        let (spread, confidence) = (self.background_spread, self.background_confidence);
        writeln!(
            f,
            "background   linear RGB {:.3?}, spread {spread:.3}, confidence {confidence:.2}",
            self.background
        )?;
        if self.is_backdrop_still() {
            writeln!(
                f,
                "backdrop     stands still in the image while the cameras move: an object turned in \
                 front of a fixed camera; --background picture models it"
            )?;
        }
        write!(f, "exposure     {}", self.exposure_text())
    }
}

impl Report {
    /// The spread of the exposures in words.
    pub fn exposure_text(&self) -> String {
        let Some(Exposure { stops, from }) = self.exposure else {
            return "spread not known (too few views, or a black background)".to_owned();
        };
        let from = match from {
            ExposureSource::Background => "the background",
            ExposureSource::Sphere => "the sphere's image",
        };
        format!("spread {stops:.2} stops (robust standard deviation, by {from})")
    }
}

/// The distortion of lenses in words.
fn lens_text(distortion: &Distortion) -> String {
    let Distortion { views, fisheye, pixels } = *distortion;
    let brown = views - fisheye;
    let mut parts = Vec::new();
    if fisheye > 0 {
        parts.push(format!("fisheye, undistorted in {fisheye} views"));
    }
    if brown > 0 {
        parts.push(format!("distortion of up to {pixels:.2} pixels, removed in {brown} views"));
    }
    if parts.is_empty() { "no distortion".to_owned() } else { parts.join("; ") }
}
