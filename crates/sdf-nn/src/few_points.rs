//! Passes over a few points, which would leave most lanes of a block empty.

use lanes::{FEW_POINTS, HALF, Isa, LANES, Lane};

use crate::mlp::{FewMemory, MAX_SWEEP_POINTS};
use crate::network::Network;
use crate::pool::Taken;
use crate::spline_block::{self, Jets};

/// The number of points of a chunk of at most `LANES` points that are computed as one block; the
/// others, at most [`FEW_POINTS`], take the sweeps for a few points.
pub(crate) fn block_points(count: usize) -> usize {
    let rest = count % HALF;
    if count < LANES && rest <= FEW_POINTS { count - rest } else { count }
}

/// The passes over at most [`FEW_POINTS`] points, with their working memory.
pub(crate) struct FewPoints<'a, R: Lane>(Taken<'a, FewMemory<R>>);

impl<'a, R: Lane> FewPoints<'a, R> {
    /// Passes of a network, for gradients too if `store`.
    pub(crate) fn of(network: &'a Network<R>, store: bool) -> Self {
        FewPoints(network.mlp.few_memory(store))
    }

    /// Values of the network.
    #[inline(always)]
    pub(crate) fn values<I: Isa>(&mut self, network: &Network<R>, x: &[R::Vec3], f: &mut [R]) {
        network.encoder.encode::<I, FEW_POINTS>(x, &mut self.0.features);
        I::call(network.grid_values(x.len(), &mut self.0.features));
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
        network.encoder.encode::<I, FEW_POINTS>(x, &mut self.0.features);
        let values = network.grid_values(x.len(), &mut self.0.features);
        I::call(spline_block::Slopes { values, jets: &mut *jets });
        self.sweeps::<I, true>(network, f);
        network.write_gradients::<I>(&self.0.features, &self.0.adjoint, jets, gradient);
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
        let (mlp, FewMemory { features, adjoint, scratch }) = (&network.mlp, &mut *self.0);
        mlp.forward_few::<I, P, STORE>(features, first, scratch, &mut f[first..first + P]);
        if STORE {
            mlp.backward_few::<I, P>(scratch, first, adjoint);
        }
        P
    }
}
