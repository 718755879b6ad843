//! Pictures of a fit while it runs.

use std::borrow::Cow;

use metrics::psnr_where;
use pictures::write_preview;

use super::Fit;
use crate::exposure::match_exposures;
use crate::solid::Solid;

impl Fit {
    /// PSNR of the last preview of a held-out view, in dB.
    pub fn held_out_psnr(&self) -> Option<f64> {
        self.held_out_psnr
    }

    /// Writes the preview picture of the first held-out view, or else of the first view. The PSNR
    /// of a held-out view enters the next metrics.
    ///
    /// # Errors
    /// If the field gives a NaN or an infinity along a ray, or the picture cannot be written.
    pub fn preview(&mut self) -> anyhow::Result<()> {
        let held_out = self.dataset.test.first();
        let Some(view) = held_out.or(self.dataset.train.first()) else { return Ok(()) };
        let cameras = [match (self.corrections.calibration(), held_out) {
            (Some(calibration), Some(view)) => calibration.apply_lens(&view.camera),
            (Some(calibration), None) => calibration.apply(0, &view.camera),
            (None, _) => view.camera,
        }];
        let path = self.folder.join("preview").join(format!("{:06}.png", self.iteration));
        let mut shown = Cow::Borrowed(std::slice::from_ref(view));
        if self.gains.is_some() {
            match_exposures(&self.model, &self.file, shown.to_mut(), &|_| {})?;
        }
        let solid = Solid::new(&self.model, &self.file);
        let colors = self.file.background_of(&*shown);
        let scene = solid.scene_in_front_of(colors.as_ref(), &cameras);
        let image = write_preview(&path, &scene, 0, &shown[0].image)?;
        self.held_out_psnr = held_out.map(|view| psnr_where(&image, &shown[0].image, view.used()));
        Ok(())
    }
}
