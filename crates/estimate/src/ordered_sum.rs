//! Sums over chunks whose bits do not depend on the number of threads.

use rayon::prelude::*;

/// How many partial sums there are: enough to balance many threads, few enough that their memory
/// does not matter.
const LANES: usize = 16;

/// Adds up what `work` adds to an accumulator for every chunk 0..chunks.
///
/// Chunks are dealt round-robin to a fixed number of accumulators, each filled in order and all
/// added in order. The values that `work` returns come back in the order of the chunks.
///
/// # Errors
/// The error of the first lane that failed.
pub fn ordered_sum<R, T, E>(
    chunks: usize,
    length: usize,
    work: impl Fn(usize, &mut [R]) -> Result<T, E> + Sync,
) -> Result<(Vec<R>, Vec<T>), E>
where
    R: num_traits::Float + std::ops::AddAssign + Send,
    T: Send,
    E: Send,
{
    let lanes: Vec<Result<_, E>> = (0..LANES.min(chunks))
        .into_par_iter()
        .with_max_len(1)
        .map(|lane| {
            let mut sum = vec![R::zero(); length];
            let values: Result<Vec<T>, E> =
                (lane..chunks).step_by(LANES).map(|chunk| work(chunk, &mut sum)).collect();
            Ok((sum, values?))
        })
        .collect();
    let mut total = vec![R::zero(); length];
    let mut values = Vec::new();
    for lane in lanes {
        let (sum, lane_values) = lane?;
        for (total, part) in total.iter_mut().zip(sum) {
            *total += part;
        }
        values.push(lane_values.into_iter());
    }
    let ordered = (0..chunks).filter_map(|chunk| values[chunk % LANES].next()).collect();
    Ok((total, ordered))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_do_not_depend_on_threads_and_values_keep_their_order() {
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
