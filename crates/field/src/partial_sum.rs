//! Parts of sums over parameters of which each value depends on few.

use std::ops::Range;

use crate::real::Real;

/// The number of parameters of a bin, as a power of two.
const BIN: u32 = 11;

/// The sums of the parameters of a table.
///
/// It is no type parameter of its users: they are large, and would be compiled for each kind.
#[derive(Debug)]
pub enum TableSum<'a, R> {
    /// A vector, to which numbers are added at once.
    Vector(&'a mut [R]),
    /// Numbers to be added later.
    Additions(&'a mut Additions<R>),
}

impl<R: Real> TableSum<'_, R> {
    /// Adds two numbers to the elements at the index, an even number, and after it.
    #[inline(always)]
    pub fn add_pair(&mut self, index: usize, values: [R; 2]) {
        match self {
            TableSum::Vector(vector) => {
                let pair = &mut vector[index..index + 2];
                pair[0] += values[0];
                pair[1] += values[1];
            }
            TableSum::Additions(additions) => additions.add_pair(index, values),
        }
    }

    /// Adds the first `N` pairs of numbers to the elements from the index, an even number, on.
    #[inline(always)]
    pub fn add_pairs<const N: usize>(&mut self, index: usize, pairs: &[[R; 2]]) {
        let pairs = &pairs[..N];
        match self {
            TableSum::Vector(vector) => {
                let vector = &mut vector[index..index + 2 * N];
                vector.iter_mut().zip(pairs.as_flattened()).for_each(|(sum, v)| *sum += *v);
            }
            TableSum::Additions(additions) => additions.add_pairs::<N>(index, pairs),
        }
    }

    /// Adds a number to the element at the index.
    #[inline(always)]
    pub fn add_at(&mut self, index: usize, value: R) {
        match self {
            TableSum::Vector(vector) => vector[index] += value,
            TableSum::Additions(additions) => {
                let zero = R::zero();
                let pair = if index.is_multiple_of(2) { [value, zero] } else { [zero, value] };
                additions.add_pair(index & !1, pair);
            }
        }
    }
}

/// Numbers to be added to a long vector, in the order in which they came.
///
/// A part of a batch changes few elements of a long vector. Its additions take far less memory than
/// a vector of its own. They are kept in bins, by their places, so that several threads can add
/// them up.
#[derive(Clone, Debug, Default)]
pub struct Additions<R> {
    bins: Vec<Vec<Pair<R>>>,
}

/// An even place, and the numbers for it and the next one.
type Pair<R> = (u32, [R; 2]);

impl<R: Real> Additions<R> {
    /// No additions to a vector of this length.
    fn new(length: usize) -> Self {
        assert!(length <= u32::MAX as usize, "a table of {length} parameters");
        Additions { bins: vec![Vec::new(); length.div_ceil(1 << BIN)] }
    }

    #[inline(always)]
    fn add_pair(&mut self, index: usize, values: [R; 2]) {
        debug_assert!(index.is_multiple_of(2), "the place of a pair is {index}");
        self.bins[index >> BIN].push((index as u32, values));
    }

    #[inline(always)]
    fn add_pairs<const N: usize>(&mut self, index: usize, pairs: &[[R; 2]]) {
        let bin = index >> BIN;
        if (index + 2 * N - 2) >> BIN != bin {
            let places = (index..).step_by(2);
            places.zip(pairs).for_each(|(index, pair)| self.add_pair(index, *pair));
            return;
        }
        debug_assert!(index.is_multiple_of(2), "the place of a pair is {index}");
        // An iterator of known length writes to the bin without a copy on the way.
        self.bins[bin].extend((0..N).map(|n| ((index + 2 * n) as u32, pairs[n])));
    }

    /// The places of a bin.
    pub const BIN: usize = 1 << BIN;

    /// Adds the numbers of a bin to its part of the vector: to the elements from
    /// `bin` × [`BIN`](Self::BIN) on.
    pub fn add_bin(&self, bin: usize, vector: &mut [R]) {
        for (index, [first, second]) in &self.bins[bin] {
            let at = *index as usize - bin * Self::BIN;
            vector[at] += *first;
            // The last number of an odd length has no partner.
            match vector.get_mut(at + 1) {
                Some(partner) => *partner += *second,
                None => debug_assert!(*second == R::zero(), "a number after the last"),
            }
        }
    }
}

/// The part of a batch in a sum over parameters.
///
/// The parameters of a table, of which each value depends on few, are additions; the others are a
/// vector.
#[derive(Clone, Debug, Default)]
pub struct PartialSum<R> {
    /// The sums of the parameters outside of the table, in order.
    pub others: Vec<R>,
    /// The additions to the parameters of the table.
    pub table: Additions<R>,
    place: Range<usize>,
}

impl<R: Real> PartialSum<R> {
    /// A sum of zero over this number of parameters, with a table at `place` among them.
    pub fn zero(parameters: usize, place: Range<usize>) -> Self {
        let others = vec![R::zero(); parameters - place.len()];
        PartialSum { others, table: Additions::new(place.len()), place }
    }

    /// Becomes a sum of zero, and keeps its memory if the size is the same.
    pub fn reset(&mut self, parameters: usize, place: Range<usize>) {
        if self.place != place || self.others.len() + place.len() != parameters {
            *self = Self::zero(parameters, place);
        }
        self.others.fill(R::zero());
        self.table.bins.iter_mut().for_each(Vec::clear);
    }

    /// The place of the table among the parameters.
    pub fn place(&self) -> Range<usize> {
        self.place.clone()
    }

    /// Adds this sum to a vector of all parameters.
    ///
    /// # Panics
    /// If the vector has another length.
    pub fn add_to(&self, sum: &mut [R]) {
        let Range { start, end } = self.place;
        assert_eq!(sum.len(), self.others.len() + self.place.len(), "number of parameters");
        let (before, after) = self.others.split_at(start);
        let add = |sum: &mut [R], part: &[R]| sum.iter_mut().zip(part).for_each(|(s, p)| *s += *p);
        add(&mut sum[..start], before);
        add(&mut sum[end..], after);
        for (bin, part) in sum[start..end].chunks_mut(Additions::<R>::BIN).enumerate() {
            self.table.add_bin(bin, part);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn additions_are_the_sums_of_a_vector_at_all_places() {
        let (count, place) = (30_000, 7..29_990);
        let mut sum = PartialSum::<f64>::zero(count, place.clone());
        let mut expected = vec![1.0; count];
        for i in 0..1000 {
            let at = (i * 7919) % place.len();
            TableSum::Additions(&mut sum.table).add_at(at, i as f64);
            expected[place.start + at] += i as f64;
            if at / 2 * 2 + 6 <= place.len() {
                let pairs = [1, 2, 3].map(|n| [f64::from(n), 0.5 * i as f64]);
                TableSum::Additions(&mut sum.table).add_pairs::<3>(at & !1, &pairs);
                let to = &mut expected[place.start + (at & !1)..];
                to.iter_mut().zip(pairs.as_flattened()).for_each(|(sum, v)| *sum += *v);
            }
            if (at | 1) < place.len() {
                sum.table.add_pair(at & !1, [2.0, -3.0]);
                expected[place.start + (at & !1)] += 2.0;
                expected[place.start + (at | 1)] -= 3.0;
            }
        }
        for i in 0..sum.others.len() {
            sum.others[i] = 0.5 + i as f64;
            expected[if i < place.start { i } else { i + place.len() }] += 0.5 + i as f64;
        }
        let mut found = vec![1.0; count];
        sum.add_to(&mut found);
        assert_eq!(found, expected);
        sum.reset(count, place);
        let mut found = vec![1.0; count];
        sum.add_to(&mut found);
        assert_eq!(found, vec![1.0; count]);
        sum.reset(3, 0..0);
        sum.others[2] = 1.0;
        let mut found = [0.0; 3];
        sum.add_to(&mut found);
        assert_eq!(found, [0.0, 0.0, 1.0]);
    }
}
