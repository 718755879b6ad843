//! Sums over chunks, with bits that do not depend on the number of threads.

use rayon::prelude::*;

/// The number of partial sums: enough to balance many threads, few enough to keep their memory
/// small.
const PARTIAL_SUMS: usize = 16;

/// The length of the part of a sum that a thread adds up at a time.
const PART: usize = 1 << 14;

/// The sum of vectors of `length` numbers, to which `work` adds the part of each chunk 0..chunks.
///
/// Chunks are dealt round-robin to 16 partial sums. Each partial sum is filled in the order of its
/// chunks, and the partial sums are added in order, so the bits do not depend on the number of
/// threads. The second result has the value that `work` returned for each chunk, in order.
///
/// # Errors
/// The error of a chunk. If several chunks fail, that of the first partial sum with an error.
pub fn ordered_sum<R, T, E>(
    chunks: usize,
    length: usize,
    work: impl Fn(usize, &mut [R]) -> Result<T, E> + Sync,
) -> Result<(Vec<R>, Vec<T>), E>
where
    R: num_traits::Float + std::ops::AddAssign + Send + Sync,
    T: Send,
    E: Send,
{
    let lanes: Vec<Result<_, E>> = (0..PARTIAL_SUMS.min(chunks))
        .into_par_iter()
        .with_max_len(1)
        .map(|lane| {
            let mut sum = vec![R::zero(); length];
            let values: Result<Vec<T>, E> =
                (lane..chunks).step_by(PARTIAL_SUMS).map(|chunk| work(chunk, &mut sum)).collect();
            Ok((sum, values?))
        })
        .collect();
    let (mut sums, mut values) = (Vec::new(), Vec::new());
    for lane in lanes {
        let (sum, lane_values) = lane?;
        sums.push(sum);
        values.push(lane_values.into_iter());
    }
    let mut sums = sums.into_iter();
    let (mut total, others) = (sums.next().unwrap_or_else(|| vec![R::zero(); length]), sums);
    let others: Vec<Vec<R>> = others.collect();
    total.par_chunks_mut(PART).enumerate().for_each(|(number, total)| {
        for sum in &others {
            let part = &sum[number * PART..][..total.len()];
            total.iter_mut().zip(part).for_each(|(total, part)| *total += *part);
        }
    });
    let ordered = (0..chunks).filter_map(|chunk| values[chunk % PARTIAL_SUMS].next()).collect();
    Ok((total, ordered))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bits_of_sums_and_the_order_of_values_do_not_depend_on_threads() {
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                ordered_sum(100, 3, |chunk, sum: &mut [f32]| {
                    for (i, s) in sum.iter_mut().enumerate() {
                        *s += 1.0 / (1.0 + chunk as f32 + i as f32);
                    }
                    Ok::<_, ()>(chunk)
                })
                .unwrap()
            })
        };
        let (one, two) = (run(1), run(2));
        assert_eq!(
            one.0.iter().map(|s| s.to_bits()).collect::<Vec<_>>(),
            two.0.iter().map(|s| s.to_bits()).collect::<Vec<_>>()
        );
        assert_eq!(one.1, (0..100).collect::<Vec<_>>());
    }

    #[test]
    fn an_error_ends_the_sum() {
        let result =
            ordered_sum(10, 1, |chunk, _: &mut [f64]| if chunk == 7 { Err(chunk) } else { Ok(()) });
        assert_eq!(result.unwrap_err(), 7);
    }
}
