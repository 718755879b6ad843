//! Passes over a few points, which would leave most lanes of a block empty.

use lanes::{FEW_POINTS, HALF, Isa, LANES, Lane, Row};

use crate::mlp::{FewScratch, MAX_SWEEP_POINTS};
use crate::network::Network;
use crate::pool::Taken;
use crate::spline_block::{self, Jets};

/// The number of points of a chunk of at most `LANES` points that are computed as one block; the
/// others, at most [`FEW_POINTS`], take the sweeps for a few points.
pub(crate) fn block_points(count: usize) -> usize {
    let rest = count % HALF;
    if count < LANES && rest <= FEW_POINTS { count - rest } else { count }
}

/// The working memory of passes over at most [`FEW_POINTS`] points. A later call uses it again.
#[derive(Default)]
pub(crate) struct FewPoints<R> {
    features: Vec<Row<R>>,
    adjoint: Vec<Row<R>>,
    scratch: FewScratch<R>,
}

impl<R: Lane> FewPoints<R> {
    /// Working memory, for gradients too if `store`.
    pub(crate) fn of(network: &Network<R>, store: bool) -> Taken<'_, Self> {
        network.few_points[usize::from(store)].take(|| Self::new(network, store))
    }

    fn new(network: &Network<R>, store: bool) -> Self {
        let count = network.mlp.features;
        let adjoint = vec![Row::zero(); if store { count } else { 0 }];
        let scratch = network.mlp.few_scratch(store);
        FewPoints { features: vec![Row::zero(); count], adjoint, scratch }
    }

    /// Values of the network.
    #[inline(always)]
    pub(crate) fn values<I: Isa>(&mut self, network: &Network<R>, x: &[R::Vec3], f: &mut [R]) {
        network.encoder.encode::<I, FEW_POINTS>(x, &mut self.features);
        I::call(network.grid_values(x.len(), &mut self.features));
        self.sweeps::<I, false>(network, f);
    }

    /// Values and gradients of the network.
    #[inline(always)]
    pub(crate) fn gradients<I: Isa>(
        &mut self,
        network: &Network<R>,
        x: &[R::Vec3],
        jets: &mut Jets<R>,
        f: &mut [R],
        gradient: &mut [R::Vec3],
    ) {
        network.encoder.encode::<I, FEW_POINTS>(x, &mut self.features);
        let values = network.grid_values(x.len(), &mut self.features);
        I::call(spline_block::Slopes { values, jets: &mut *jets });
        self.sweeps::<I, true>(network, f);
        network.write_gradients::<I>(&self.features, &self.adjoint, jets, gradient);
    }

    /// Writes the values of all points, and with `STORE` the adjoints of their features.
    #[inline(always)]
    fn sweeps<I: Isa, const STORE: bool>(&mut self, network: &Network<R>, f: &mut [R]) {
        let mut first = 0;
        while first < f.len() {
            first += match f.len() - first {
                MAX_SWEEP_POINTS.. => self.sweep::<I, MAX_SWEEP_POINTS, STORE>(network, first, f),
                2.. => self.sweep::<I, 2, STORE>(network, first, f),
                _ => self.sweep::<I, 1, STORE>(network, first, f),
            };
        }
        let factor = network.output_factor();
        f.iter_mut().for_each(|f| *f *= factor);
    }

    /// The forward sweep of `P` points from `first` on, and with `STORE` the backward sweep.
    /// Returns `P`.
    #[inline(always)]
    fn sweep<I: Isa, const P: usize, const STORE: bool>(
        &mut self,
        network: &Network<R>,
        first: usize,
        f: &mut [R],
    ) -> usize {
        let (mlp, s) = (&network.mlp, &mut self.scratch);
        mlp.forward_few::<I, P, STORE>(&self.features, first, s, &mut f[first..first + P]);
        if STORE {
            mlp.backward_few::<I, P>(s, first, &mut self.adjoint);
        }
        P
    }
}
