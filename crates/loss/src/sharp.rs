//! The stages of pixels with a sharp surface: pixels without silhouettes through their hit points,
//! the others by the estimator.

use std::ops::Range;

use estimate::record::{Pass, Record};
use estimate::{
    Estimator, SampleCounts, SilhouetteMargin, SilhouetteMask, Terms, near_silhouettes,
};
use glam::Vec3;
use lanes::LANES;
use random::Name;
use render::{InvalidField, Primary, Sample};

use crate::carve::carve;
use crate::coverage::{MeanLosses, TypicalLosses};
use crate::drawn::{Drawn, NearPoint, PARTS, pixels_of, portion};
use crate::objective::{Objective, PixelLoss};
use crate::patches::patches;
use crate::photometry::Draw;
use crate::regularisers::regularise;
use crate::reversed::Reversed;
use crate::stats::BatchStats;
use crate::sums::PartSums;

const FIT_SILHOUETTES: Name = Name::new("samples of a fit's pixels with silhouettes", 16);

/// Pixels with one sample each, traced and shaded.
pub(crate) struct Shaded<'a> {
    round: &'a Objective<'a>,
    draws: &'a [Draw],
    /// The hits and the radiance of the samples.
    primary: Primary<f32>,
    /// Whether a silhouette may cross the pixel of each sample.
    is_crossed: Vec<bool>,
}

impl<'a> Shaded<'a> {
    /// Traces one sample in each pixel of a range of the draws, and shades the hits.
    pub(crate) fn new(round: &'a Objective<'a>, range: Range<usize>) -> Result<Self, InvalidField> {
        let samples: Vec<Sample> = range.clone().map(|number| round.sample(number)).collect();
        let primary = round.scene.within_reach(SilhouetteMargin::REACH).primary(&samples)?;
        let is_crossed = near_silhouettes(&round.scene, &primary, SilhouetteMargin::LARGE);
        Ok(Shaded { round, draws: &round.draws[range], primary, is_crossed })
    }

    /// Compares the radiance with the photographs. A pixel that a silhouette may cross has no loss:
    /// [`Compared::crossed`] samples it again.
    pub(crate) fn compare(self) -> Compared {
        let Shaded { round, draws, primary, is_crossed } = self;
        let shown = draws.iter().zip(&primary.samples).zip(is_crossed);
        let loss = |((draw, traced), is_crossed): ((&Draw, &render::TracedSample<f32>), bool)| {
            (!is_crossed).then(|| round.targets.loss(traced.radiance, draw))
        };
        let losses = shown.map(loss).collect();
        Compared { record: Record::uniform(primary, 1), draws: draws.to_vec(), losses }
    }
}

/// Pixels that were compared with the photographs: their record and losses.
#[derive(Default)]
pub(crate) struct Compared {
    record: Record<f32>,
    draws: Vec<Draw>,
    /// `None` for a pixel without a part in the loss.
    losses: Vec<Option<PixelLoss>>,
}

impl Compared {
    /// Samples pixels that a silhouette may cross by the estimator, and compares them.
    pub(crate) fn crossed(
        round: &Objective<'_>,
        estimator: &dyn Estimator<f32>,
        counts: SampleCounts,
        draws: &[Draw],
    ) -> Result<Self, InvalidField> {
        let pixel = |draw: &Draw| render::Pixel {
            camera: draw.view as usize,
            x: draw.x.into(),
            y: draw.y.into(),
        };
        let pixels: Vec<render::Pixel> = draws.iter().map(pixel).collect();
        let stream = round.stream.named(FIT_SILHOUETTES);
        let batch = estimate::Batch { pixels: &pixels, counts, stream, terms: Terms::All };
        let mut mask = SilhouetteMask::all(pixels.len());
        let record = estimator.record(&round.scene, &batch, &mut mask)?;

        let shown = draws.iter().zip(&record.radiance);
        let losses = shown.map(|(draw, shown)| Some(round.targets.loss(*shown, draw))).collect();
        Ok(Compared { record, draws: draws.to_vec(), losses })
    }

    /// The pixels of several tasks, in their order.
    ///
    /// # Panics
    /// If a record has a border or a warp.
    pub(crate) fn joined(of_tasks: Vec<Self>) -> Self {
        let mut all = Self::default();
        for Compared { record, draws, losses } in of_tasks {
            all.record.append(record);
            all.draws.extend(draws);
            all.losses.extend(losses);
        }
        all
    }

    /// The pixels that a silhouette may cross.
    pub(crate) fn crossed_draws(&self) -> Vec<Draw> {
        let crossed = self.draws.iter().zip(&self.losses).filter(|(_, loss)| loss.is_none());
        crossed.map(|(draw, _)| *draw).collect()
    }

    /// The losses of the object and the background.
    pub(crate) fn mean_losses(&self) -> MeanLosses {
        let hits = self.record.area.first().map(|area| area.primary.hit_mask());
        MeanLosses::of(&self.draws, &hits.unwrap_or_default(), &self.photometric())
    }

    /// The photometric loss of each pixel; `None` for one that a silhouette may cross.
    pub(crate) fn photometric(&self) -> Vec<Option<f32>> {
        self.losses.iter().map(|loss| loss.map(|loss| loss.loss)).collect()
    }

    /// The hits, each with the number of its pixel.
    fn hits(&self) -> impl Iterator<Item = (usize, Vec3)> {
        self.record.area.iter().flat_map(|area| {
            let pixel = |sample: usize| area.weights[sample].pixel as usize;
            let hits = area.primary.hits.iter().zip(&area.primary.surface.x);
            hits.map(move |(hit, x)| (pixel(hit.sample), *x))
        })
    }

    /// Adds the term of patches to the hits of pixels that no silhouette may cross.
    fn compare_patches(&mut self, drawn: &Drawn<'_>, stats: &mut BatchStats) {
        let Compared { record, draws, losses } = self;
        for area in &mut record.area {
            let own = |sample: usize| {
                let pixel = area.weights[sample].pixel as usize;
                losses[pixel].map(|_| &draws[pixel])
            };
            area.of_hits = patches(drawn, &area.primary, own, stats);
        }
    }

    /// Adds the losses of these pixels, and the adjoints of their record.
    fn reverse(self, objective: &Objective<'_>, pass: Pass<f32>, out: &mut Reversed) {
        let Compared { record, draws, losses } = self;
        let Objective { scene, wanted, .. } = objective;
        out.stats.rays += record.rays;

        let mut adjoint = |(draw, loss): (&Draw, &Option<PixelLoss>)| {
            loss.as_ref().map_or(Vec3::ZERO, |loss| out.add_loss(objective, loss, draw))
        };
        let delta: Vec<Vec3> = draws.iter().zip(&losses).map(&mut adjoint).collect();

        if let Some(cameras) = &mut out.records.cameras {
            cameras.continue_with(draws.iter().map(|draw| draw.view as usize).collect());
        }
        record.vjp(scene, &delta, pass, &mut out.sums.shader, &mut out.records);
        if wanted.background {
            let sum = &mut out.sums.background;
            record.area.iter().for_each(|area| area.background_vjp(scene, &delta, sum));
        }
    }

    /// The same for pixels that a silhouette may cross, with the term of their coverage.
    pub(crate) fn reverse_crossed(
        self,
        objective: &Objective<'_>,
        (typical, pass): (Option<TypicalLosses>, Pass<f32>),
        out: &mut Reversed,
    ) {
        out.stats.edge_pixels += pixels_of(&self.draws);
        if let Some(typical) = typical {
            let weight = |draw: &Draw| objective.pixel_weight() * f32::from(draw.count);
            let own = self.draws.iter().zip(&self.losses).zip(self.record.coverage());
            let slope = own.map(|((draw, loss), coverage)| {
                let loss = loss.as_ref();
                loss.map_or(0.0, |loss| typical.slope(coverage, loss.loss) * weight(draw))
            });
            self.record.coverage_vjp(&slope.collect::<Vec<f32>>(), &mut out.records);
        }
        self.reverse(objective, pass, out);
    }

    /// Deals pixels to [`PARTS`] parts: about the same number of hits for each, in whole blocks of
    /// the networks.
    pub(crate) fn deal(self) -> Vec<Self> {
        let count = self.draws.len();
        let mut hits = vec![0; count];
        self.hits().for_each(|(pixel, _)| hits[pixel] += 1);
        let blocks = hits.iter().sum::<usize>().div_ceil(LANES);

        let (mut places, mut before) = (vec![0], 0);
        for (pixel, own) in hits.into_iter().enumerate() {
            before += own;
            while places.len() < PARTS && before > places.len() * blocks / PARTS * LANES {
                places.push(pixel);
            }
        }
        if blocks == 0 {
            places = (0..PARTS).map(|part| portion(count, part, PARTS).start).collect();
        }
        places.resize(PARTS, count);
        places.push(count);
        let sizes: Vec<usize> = places.windows(2).map(|place| place[1] - place[0]).collect();

        let (mut draws, mut losses) = (self.draws.into_iter(), self.losses.into_iter());
        let own = |(record, size): (Record<f32>, &usize)| Compared {
            record,
            draws: draws.by_ref().take(*size).collect(),
            losses: losses.by_ref().take(*size).collect(),
        };
        self.record.deal(&sizes).into_iter().zip(&sizes).map(own).collect()
    }
}

/// A part of the pixels of a round, each compared by one sample.
pub(crate) struct SmoothPart<'a> {
    /// The pixels of the part in the round.
    drawn: Drawn<'a>,
    compared: Compared,
}

impl<'a> SmoothPart<'a> {
    /// The parts of a round, of which `compared` has all pixels.
    pub(crate) fn parts(round: &'a Objective<'a>, compared: Compared) -> Vec<Self> {
        let mut first = 0;
        let part = |(drawn, compared): (Drawn<'a>, Compared)| {
            let place = first..first + compared.draws.len();
            first = place.end;
            SmoothPart { drawn: drawn.with(place), compared }
        };
        Drawn::parts(round).into_iter().zip(compared.deal()).map(part).collect()
    }

    /// The adjoints of all terms of these pixels, but the photometric loss of those that a
    /// silhouette may cross. `sums` are zero, and `pushes` has one number for each pixel of the
    /// round, or is empty.
    pub(crate) fn reverse(self, pass: Pass<f32>, sums: PartSums, pushes: &[f32]) -> Reversed {
        let SmoothPart { drawn, mut compared } = self;
        let mut out = Reversed::new(&drawn, sums);
        out.stats.pixels += pixels_of(drawn.draws);

        let is_smooth = |pixel: usize| compared.losses[pixel].is_some();
        carve(&drawn, compared.hits().filter(|(pixel, _)| is_smooth(*pixel)), pushes, &mut out);

        let weight = |pixel: usize| f32::from(drawn.draws[pixel].count);
        let near = compared.hits().map(|(pixel, x)| NearPoint { pixel, x, weight: weight(pixel) });
        regularise(&drawn, &near.collect::<Vec<NearPoint>>(), &mut out);

        compared.compare_patches(&drawn, &mut out.stats);
        compared.reverse(drawn.objective, pass, &mut out);
        out
    }
}
