//! The total loss of a fit over some pixels, and its gradient.

use field::{BackgroundPerCamera, Counted, Evaluations};
use film::srgb_decode;
use glam::Vec3;
use loss::photometry::{Draw, MaskUse, without_gains};
use loss::schedule::{is_carving, sharpness};
use loss::{
    Gradient, Objective, Patches, Regulariser, Stage, Surface, Targets, Wanted, Workspace, gradient,
};
use multiview::calibrate::Calibration;
use random::{Name, Stream};
use render::{InvalidField, Scene};

use crate::cameras::corrected;
use crate::fit::Fit;
use crate::lattice::FieldLattice;

const BACKGROUND_COLOR: Name = Name::new("colour behind the object of a view", 26);

/// The pixels of an iteration.
#[derive(Clone, Debug)]
pub(crate) struct DrawnPixels {
    /// The level of the pyramid.
    pub(crate) level: usize,
    /// The pixels.
    pub(crate) draws: Vec<Draw>,
    /// The expected number of pixels that they stand for.
    pub(crate) pixel_count: f32,
}

/// The gradient of the total loss of drawn pixels, with cameras that are corrected by
/// `calibration`, and the number of its field evaluations.
pub(crate) fn differentiate(
    fit: &Fit,
    drawn: &DrawnPixels,
    calibration: Option<&Calibration>,
    stream: Stream,
    work: &mut Workspace,
) -> Result<(Gradient, Evaluations), InvalidField> {
    let Fit { file, model, photographs, .. } = fit;
    let (progress, options) = (fit.progress(), &file.options);
    let level = &photographs.levels[drawn.level];
    let counted = Counted::new(&model.field);
    let cameras = corrected(calibration, &level.cameras);
    let lattice = fit.lattice.as_ref().and_then(FieldLattice::get);
    let reach = fit.estimator.reach().unwrap_or(f64::INFINITY);
    let scene = work.run(Stage::Caller, || fit.scene(&cameras)).with_lattice(lattice, reach);

    // The background: a colour for each view, or the model's own with random points on its rays.
    let gains = photographs.factors();
    let behind =
        (file.masks == MaskUse::Coverage).then(|| random_colors(level.cameras.len(), stream));
    let colors = behind.as_ref().or(photographs.colors.as_ref());
    // The photographs show these colours as they are.
    let divided = without_gains(colors, &gains);
    let colors = divided.as_ref().or(colors);
    let trained = model.background.jittered(stream);
    let trained = trained.as_ref().map_or(scene.background, |trained| trained);
    let background = colors.map_or(trained, |colors| colors);

    let depths = photographs.guide(drawn.level);
    let surface = match sharpness(progress, options.soft()) {
        Some(sharpness) => Surface::Soft { sharpness, depths },
        None => Surface::Sharp {
            estimator: &*fit.estimator,
            counts: options.counts(),
            pass: options.pass(),
        },
    };
    let consistency = photographs.consistency.as_ref().map(|own| own.with_cameras(&cameras));
    let objective = Objective {
        scene: Scene { field: &counted, background, ..scene },
        targets: Targets {
            level,
            behind: behind.as_ref().map_or(&[], |colors| &colors.0),
            gains: &gains,
        },
        draws: &drawn.draws,
        pixel_count: drawn.pixel_count,
        surface,
        regularisers: &[
            Regulariser::Eikonal(options.eikonal as f32),
            Regulariser::Bending(options.bending_weight(progress) as f32),
        ],
        carving: depths.filter(|_| is_carving(progress, options.soft())),
        patches: consistency.as_ref().map(|own| Patches {
            consistency: own,
            weight: options.patch_weight() as f32,
            fall: options.patch_fall(progress) as f32,
        }),
        wanted: Wanted {
            background: file.background_kind.is_trained(),
            cameras: calibration.is_some() && photographs.corrections.adjusted().is_none(),
        },
        stream,
    };
    Ok((gradient(&objective, work)?, counted.evaluations()))
}

/// A random colour for each view, uniform in display space.
fn random_colors(views: usize, stream: Stream) -> BackgroundPerCamera<f32> {
    let stream = stream.named(BACKGROUND_COLOR);
    let channel = |view: u64, c: u64| srgb_decode(stream.at(view).at(c).unit() as f32);
    let color = |view| Vec3::from([0, 1, 2].map(|c| channel(view, c)));
    BackgroundPerCamera((0..views as u64).map(color).collect())
}
