//! Sums over the parameters: of each part of a round, and over all parts.

use std::ops::Range;

use field::{Additions, PartialSum};
use render::Scene;

use crate::objective::Objective;

/// The gradient of a part by the parameters.
#[derive(Debug, Default)]
pub(crate) struct PartSums {
    /// By those of the field.
    pub(crate) field: PartialSum<f32>,
    /// By those of the radiance head.
    pub(crate) shader: PartialSum<f32>,
    /// By those of a trained background.
    pub(crate) background: PartialSum<f32>,
}

impl PartSums {
    /// Becomes zero, for the parameters of an objective.
    pub(crate) fn reset(&mut self, objective: &Objective<'_>) {
        let sums = [&mut self.field, &mut self.shader, &mut self.background];
        sums.into_iter()
            .zip(sizes(objective))
            .for_each(|(sum, (count, table))| sum.reset(count, table));
    }
}

/// The number of parameters, and the place of the table among them: of the field, then of the
/// radiance head, then of a trained background.
pub(crate) fn sizes(objective: &Objective<'_>) -> [(usize, Range<usize>); 3] {
    let Scene { field, shader, background, .. } = &objective.scene;
    let trained = (background.parameter_count(), background.table());
    [
        (field.parameter_count(), field.table()),
        (shader.parameter_count(), shader.table()),
        if objective.wanted.background { trained } else { (0, 0..0) },
    ]
}

/// The partial sum of a part by the parameters of one object.
type OfPart = fn(&PartSums) -> &PartialSum<f32>;

/// The objects with parameters, in their order.
const OBJECTS: [OfPart; 3] = [|part| &part.field, |part| &part.shader, |part| &part.background];

/// Parameters outside of tables that a thread adds up at a time.
pub(crate) const PIECE: usize = 1 << 12;

/// A piece of the sum over all parts.
pub(crate) struct Piece<'a> {
    total: &'a mut [f32],
    of_part: OfPart,
    terms: Terms,
}

/// The terms of a piece in each part.
#[derive(Clone, Copy)]
enum Terms {
    /// The sums outside of the table, from this one on.
    Others(usize),
    /// The additions of this bin.
    Bin(usize),
}

impl Piece<'_> {
    /// Adds the parts up, in their order.
    pub(crate) fn add(self, parts: &[PartSums]) {
        let Piece { total, of_part, terms } = self;
        for part in parts.iter().map(of_part) {
            match terms {
                Terms::Others(first) => {
                    let own = &part.others[first..first + total.len()];
                    total.iter_mut().zip(own).for_each(|(sum, own)| *sum += *own);
                }
                Terms::Bin(bin) => part.table.add_bin(bin, total),
            }
        }
    }
}

/// The pieces of the sum over all parts, of which `part` is one.
pub(crate) fn pieces<'a>(mut total: &'a mut [f32], part: &PartSums) -> Vec<Piece<'a>> {
    let mut pieces = Vec::new();
    for of_part in OBJECTS {
        let (others, place) = (of_part(part).others.len(), of_part(part).place());
        let (before, rest) = total.split_at_mut(place.start);
        let (table, rest) = rest.split_at_mut(place.len());
        let (after, rest) = rest.split_at_mut(others - place.start);
        for (first, own) in [(0, before), (place.start, after)] {
            pieces.extend(own.chunks_mut(PIECE).enumerate().map(|(i, total)| Piece {
                total,
                of_part,
                terms: Terms::Others(first + i * PIECE),
            }));
        }
        let bins = table.chunks_mut(Additions::<f32>::BIN).enumerate();
        pieces.extend(bins.map(|(bin, total)| Piece { total, of_part, terms: Terms::Bin(bin) }));
        total = rest;
    }
    pieces
}
