//! The passes of networks, compiled in this crate for both precisions.
//!
//! A generic function is compiled in every crate that calls it. The passes are large: they have a
//! version for each set of vector instructions. The functions of this trait are not generic where
//! it is implemented, so they are compiled once.

use field::{PartialSum, Real, SurfaceAdjoint, SurfaceBatch, TableSum};
use lanes::{Lane, Pass, dispatch};

use crate::head::{Radiance, RadianceHead, Vjp};
use crate::mlp::Mlp;
use crate::network::Network;
use crate::network_passes::{HessianVector, ParameterVjp, Value, ValueGradient};

/// A precision of networks, `f32` or `f64`, with their passes.
///
/// [`Network`] and [`RadianceHead`] have the same passes as methods, and document them.
pub trait Passes: Lane {
    #[doc(hidden)]
    fn value(network: &Network<Self>, x: &[Self::Vec3], f: &mut [Self]);
    #[doc(hidden)]
    fn value_gradient(
        network: &Network<Self>,
        x: &[Self::Vec3],
        f: &mut [Self],
        gradient: &mut [Self::Vec3],
    );
    #[doc(hidden)]
    fn hessian_vector(
        network: &Network<Self>,
        x: &[Self::Vec3],
        p: &[Self::Vec3],
        gradient: &mut [Self::Vec3],
        product: &mut [Self::Vec3],
    );
    #[doc(hidden)]
    fn parameter_vjp(
        network: &Network<Self>,
        x: &[Self::Vec3],
        coefficients: (&[Self], &[Self::Vec3]),
        adjoint: &mut [Self],
    );
    #[doc(hidden)]
    fn add_parameter_vjp(
        network: &Network<Self>,
        x: &[Self::Vec3],
        coefficients: (&[Self], &[Self::Vec3]),
        sum: &mut PartialSum<Self>,
    );
    #[doc(hidden)]
    fn radiance(head: &RadianceHead<Self>, points: SurfaceBatch<'_, Self>, rgb: &mut [Self::Vec3]);
    #[doc(hidden)]
    fn radiance_vjp(
        head: &RadianceHead<Self>,
        points: SurfaceBatch<'_, Self>,
        rgb_adjoint: &[Self::Vec3],
        surface_adjoint: &mut SurfaceAdjoint<Self>,
        parameter_adjoint: &mut [Self],
    );
    #[doc(hidden)]
    fn add_radiance_vjp(
        head: &RadianceHead<Self>,
        points: SurfaceBatch<'_, Self>,
        rgb_adjoint: &[Self::Vec3],
        surface_adjoint: &mut SurfaceAdjoint<Self>,
        sum: &mut PartialSum<Self>,
    );
}

/// Runs a pass with the instructions of a perceptron.
fn run<R: Lane>(mlp: &Mlp<R>, pass: impl Pass) {
    dispatch(mlp.instructions, pass);
}

/// Implements [`Passes`] for precisions by their names.
macro_rules! passes {
    ($($real:ident),*) => {$(
        impl Passes for $real {
            fn value(network: &Network<$real>, x: &[<$real as Real>::Vec3], f: &mut [$real]) {
                run(&network.mlp, Value { network, x, f });
            }

            fn value_gradient(
                network: &Network<$real>,
                x: &[<$real as Real>::Vec3],
                f: &mut [$real],
                gradient: &mut [<$real as Real>::Vec3],
            ) {
                run(&network.mlp, ValueGradient { network, x, f, gradient });
            }

            fn hessian_vector(
                network: &Network<$real>,
                x: &[<$real as Real>::Vec3],
                p: &[<$real as Real>::Vec3],
                gradient: &mut [<$real as Real>::Vec3],
                product: &mut [<$real as Real>::Vec3],
            ) {
                run(&network.mlp, HessianVector { network, x, p, gradient, product });
            }

            fn parameter_vjp(
                network: &Network<$real>,
                x: &[<$real as Real>::Vec3],
                (alpha, c): (&[$real], &[<$real as Real>::Vec3]),
                adjoint: &mut [$real],
            ) {
                let (weights, table) = adjoint.split_at_mut(network.weight_count());
                let table = TableSum::Vector(table);
                run(&network.mlp, ParameterVjp { network, x, alpha, c, weights, table });
            }

            fn add_parameter_vjp(
                network: &Network<$real>,
                x: &[<$real as Real>::Vec3],
                (alpha, c): (&[$real], &[<$real as Real>::Vec3]),
                sum: &mut PartialSum<$real>,
            ) {
                let (weights, table) = (&mut sum.others[..], TableSum::Additions(&mut sum.table));
                run(&network.mlp, ParameterVjp { network, x, alpha, c, weights, table });
            }

            fn radiance(
                head: &RadianceHead<$real>,
                points: SurfaceBatch<'_, $real>,
                rgb: &mut [<$real as Real>::Vec3],
            ) {
                run(&head.mlp, Radiance { head, points, rgb });
            }

            fn radiance_vjp(
                head: &RadianceHead<$real>,
                points: SurfaceBatch<'_, $real>,
                rgb_adjoint: &[<$real as Real>::Vec3],
                surface_adjoint: &mut SurfaceAdjoint<$real>,
                parameter_adjoint: &mut [$real],
            ) {
                let (weights, tables) = parameter_adjoint.split_at_mut(head.mlp.parameters.len());
                let tables = TableSum::Vector(tables);
                run(&head.mlp, Vjp { head, points, rgb_adjoint, surface_adjoint, weights, tables });
            }

            fn add_radiance_vjp(
                head: &RadianceHead<$real>,
                points: SurfaceBatch<'_, $real>,
                rgb_adjoint: &[<$real as Real>::Vec3],
                surface_adjoint: &mut SurfaceAdjoint<$real>,
                sum: &mut PartialSum<$real>,
            ) {
                let (weights, tables) = (&mut sum.others[..], TableSum::Additions(&mut sum.table));
                run(&head.mlp, Vjp { head, points, rgb_adjoint, surface_adjoint, weights, tables });
            }
        }
    )*};
}

passes!(f32, f64);
