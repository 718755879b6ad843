//! The pieces of silhouettes and creases in a cell of the grid.

use field::Real;

use super::edge::Event;

/// A piece of a silhouette or a crease in one cell.
pub(super) struct Piece<R: Real> {
    /// The events at its ends. A piece that ends inside the cell has the same one twice.
    pub(super) ends: [Event<R>; 2],
    /// Its length, in pixels.
    pub(super) length: f64,
}

/// The weight, in pixels per world unit, of a difference in depth beside a distance on the film
/// when events are paired: the depth decides.
const DEPTH_WEIGHT: f64 = 1e3;

/// The pieces of curves between events of one kind on the edges of a cell.
///
/// Events are paired by the least mismatch. The curve of one event alone ends inside the cell: on
/// average it has half the length `side` of the cell's sides there, in pixels.
pub(super) fn pieces<R: Real>(events: &[Event<R>], side: f64) -> Vec<Piece<R>> {
    match events.len() {
        1 => vec![Piece { ends: [events[0]; 2], length: 0.5 * side }],
        2 => vec![piece(events, 0, 1)],
        3 => three(events),
        4 => {
            let options = [[(0, 1), (2, 3)], [(0, 2), (1, 3)], [(0, 3), (1, 2)]];
            let sum = |o: &[(usize, usize); 2]| {
                mismatch(events, o[0].0, o[0].1) + mismatch(events, o[1].0, o[1].1)
            };
            let best = options.iter().min_by(|x, y| sum(x).total_cmp(&sum(y)));
            best.map_or(Vec::new(), |pairs| {
                pairs.iter().map(|(a, b)| piece(events, *a, *b)).collect()
            })
        }
        _ => Vec::new(),
    }
}

/// The mismatch of two events as the ends of one piece, in pixels.
fn mismatch<R: Real>(events: &[Event<R>], a: usize, b: usize) -> f64 {
    let (a, b) = (&events[a], &events[b]);
    (a.t - b.t).abs().to_double() * DEPTH_WEIGHT + (a.u - b.u).length()
}

fn piece<R: Real>(events: &[Event<R>], a: usize, b: usize) -> Piece<R> {
    Piece { ends: [events[a], events[b]], length: (events[a].u - events[b].u).length() }
}

/// Three events: one curve ends at another or behind it, and its last piece reaches the other's
/// chord.
fn three<R: Real>(events: &[Event<R>]) -> Vec<Piece<R>> {
    let options = [(0, 1, 2), (0, 2, 1), (1, 2, 0)];
    let best = options
        .into_iter()
        .min_by(|x, y| mismatch(events, x.0, x.1).total_cmp(&mismatch(events, y.0, y.1)));
    best.map_or(Vec::new(), |(a, b, rest)| {
        let (p, q) = (events[a].u, events[b].u);
        let square = (q - p).length_squared().max(1e-300);
        let along = ((events[rest].u - p).dot(q - p) / square).clamp(0.0, 1.0);
        let length = (events[rest].u - (p + (q - p) * along)).length();
        vec![piece(events, a, b), Piece { ends: [events[rest], events[rest]], length }]
    })
}
