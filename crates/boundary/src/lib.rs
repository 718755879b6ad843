//! The pixel-boundary integral of a box-filtered warp.
//!
//! A box filter ends at its pixel's border, and a warp field V carries radiance L across it, so the
//! derivative of a pixel p has the term −∮ (L − c_p) V·n dl over the border, n pointing out of the
//! pixel (Bangaru et al. 2022, supplement, section 1, equation 2). The border is four unit segments
//! along the film's axes. A segment is shared by two pixels, and what leaves the one enters the
//! other: it is sampled once, and its flux given to both with opposite sign.
//!
//! This crate knows where edges are and how their samples enter pixels and gradients; what L and V
//! are is up to the caller. Film coordinates are in pixels, x right, y down; pixel (i, j) covers
//! [i, i+1) × [j, j+1).
//!
//! ```
//! use boundary::Edges;
//!
//! // Two pixels side by side have seven edges; the one between them has a pixel on both sides.
//! let edges = Edges::of(&[(4, 2), (5, 2)], 640, 480);
//! assert_eq!(edges.as_slice().len(), 7);
//! let shared = edges.as_slice().iter().find(|e| e.inside() == Some(0) && e.outside() == Some(1)).unwrap();
//! assert_eq!(shared.axis(), 0);
//! assert_eq!(shared.point(0.25), [5.0, 2.25]);
//!
//! // The flux of L V·n = 3 through it leaves pixel 0 and enters pixel 1.
//! let mut derivative = [[0.0; 3]; 2];
//! shared.scatter([3.0; 3], &mut derivative);
//! assert_eq!(derivative, [[-3.0; 3], [3.0; 3]]);
//! ```

use std::collections::HashMap;

/// A unit segment between two pixels, or at the edge of a set of pixels. Its normal points along +x
/// or +y of the film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    axis: usize,
    origin: [u32; 2],
    inside: Option<usize>,
    outside: Option<usize>,
}

impl Edge {
    /// The film axis of the normal: 0 for x, 1 for y. The normal points out of `inside` and into
    /// `outside`.
    pub fn axis(&self) -> usize {
        self.axis
    }

    /// The index of the pixel on the lower side, if it is in the set.
    pub fn inside(&self) -> Option<usize> {
        self.inside
    }

    /// The index of the pixel on the upper side, if it is in the set.
    pub fn outside(&self) -> Option<usize> {
        self.outside
    }

    /// The same edge with its pixels under other numbers.
    #[must_use]
    pub fn renamed(self, name: impl Fn(usize) -> usize) -> Self {
        Edge { inside: self.inside.map(&name), outside: self.outside.map(&name), ..self }
    }

    /// The unit normal on the film.
    pub fn normal(&self) -> [f64; 2] {
        std::array::from_fn(|e| if e == self.axis { 1.0 } else { 0.0 })
    }

    /// The film position at `along` in [0, 1) of the segment.
    pub fn point(&self, along: f64) -> [f64; 2] {
        let mut u = self.origin.map(f64::from);
        u[1 - self.axis] += along;
        u
    }

    /// Adds the boundary term of a mean flux (L − c) V·n through this edge to the derivatives of
    /// its pixels, for a c that both share: minus where the flux leaves, plus where it enters.
    pub fn scatter(&self, flux: [f64; 3], derivative: &mut [[f64; 3]]) {
        self.scatter_each(|_| flux, derivative);
    }

    /// [`scatter`](Self::scatter) where every pixel has its own c: `flux(p)` is the mean of (L −
    /// c_p) V·n.
    pub fn scatter_each(&self, flux: impl Fn(usize) -> [f64; 3], derivative: &mut [[f64; 3]]) {
        for (side, sign) in [(self.inside, -1.0), (self.outside, 1.0)] {
            if let Some(pixel) = side {
                let flux = flux(pixel);
                for c in 0..3 {
                    derivative[pixel][c] += sign * flux[c];
                }
            }
        }
    }

    /// The reverse of [`scatter_each`](Self::scatter_each): `carried(p)` is δ_p·(L − c_p), and the
    /// result the adjoint of −V·n, i.e. the coefficient of +a·n ∂_θ f.
    pub fn gather<R: num_traits::Float>(&self, carried: impl Fn(usize) -> R) -> R {
        let side = |pixel: Option<usize>| pixel.map_or(R::zero(), &carried);
        side(self.inside) - side(self.outside)
    }
}

/// The edges of some pixels, each once for all pixels that share it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Edges(Vec<Edge>);

impl Edges {
    /// The edges of some pixels (column, row) of a film; edges refer to pixels by their index in
    /// the list. Pixels outside the film are left out. A pixel that is listed twice is two pixels,
    /// each with four edges of its own or shared with a neighbour: every entry gets its whole
    /// border.
    ///
    /// The order depends on the list alone.
    pub fn of(pixels: &[(u32, u32)], width: u32, height: u32) -> Self {
        let mut edges: Vec<Edge> = Vec::with_capacity(4 * pixels.len());
        let mut known = HashMap::with_capacity(4 * pixels.len());
        for (index, &(x, y)) in
            pixels.iter().enumerate().filter(|(_, (x, y))| *x < width && *y < height)
        {
            // Left, right, top, bottom: the lower side of an edge is the pixel that it ends.
            let four = [
                (0, [x, y], false),
                (0, [x + 1, y], true),
                (1, [x, y], false),
                (1, [x, y + 1], true),
            ];
            for (axis, origin, inside) in four {
                let side = |edge: &Edge| if inside { edge.inside } else { edge.outside };
                let shared = known
                    .get(&(axis, origin))
                    .copied()
                    .filter(|&at: &usize| side(&edges[at]).is_none());
                let at = shared.unwrap_or_else(|| {
                    edges.push(Edge { axis, origin, inside: None, outside: None });
                    known.insert((axis, origin), edges.len() - 1);
                    edges.len() - 1
                });
                *(if inside { &mut edges[at].inside } else { &mut edges[at].outside }) =
                    Some(index);
            }
        }
        Edges(edges)
    }

    /// The edges of all pixels of a film, row after row; pixel (x, y) has index y · width + x.
    pub fn film(width: u32, height: u32) -> Self {
        let pixels: Vec<(u32, u32)> =
            (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).collect();
        Self::of(&pixels, width, height)
    }

    /// The edges.
    pub fn as_slice(&self) -> &[Edge] {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    /// A smooth radiance, a smooth warp, and ∇·(L V).
    fn radiance(u: [f64; 2]) -> f64 {
        (0.7 * u[0]).sin() + 0.3 * u[1] * u[1]
    }
    fn warp(u: [f64; 2]) -> [f64; 2] {
        [(0.4 * u[1]).cos() + u[0], 0.5 * u[0] * u[1]]
    }
    fn divergence(u: [f64; 2]) -> f64 {
        let (l, v) = (radiance(u), warp(u));
        0.7 * (0.7 * u[0]).cos() * v[0] + 0.6 * u[1] * v[1] + l * (1.0 + 0.5 * u[0])
    }

    /// The midpoint rule over [0, 1).
    fn mean(n: u32, f: impl Fn(f64) -> f64) -> f64 {
        (0..n).map(|i| f((f64::from(i) + 0.5) / f64::from(n))).sum::<f64>() / f64::from(n)
    }

    fn boundary_term(edges: &Edges, pixels: usize) -> Vec<[f64; 3]> {
        let mut out = vec![[0.0; 3]; pixels];
        for edge in edges.as_slice() {
            let flux = mean(400, |s| radiance(edge.point(s)) * warp(edge.point(s))[edge.axis()]);
            edge.scatter([flux; 3], &mut out);
        }
        out
    }

    #[test]
    fn without_silhouettes_the_boundary_cancels_the_divergence() {
        let terms = boundary_term(&Edges::film(4, 3), 12);
        for (p, term) in terms.iter().enumerate() {
            let (x, y) = ((p % 4) as f64, (p / 4) as f64);
            let area = mean(200, |a| mean(200, |b| divergence([x + a, y + b])));
            assert_relative_eq!(term[0], -area, epsilon = 1e-4);
        }
    }

    #[test]
    fn a_film_has_each_edge_once_and_a_constant_flux_stays_inside() {
        let edges = Edges::film(5, 4);
        assert_eq!(edges.as_slice().len(), 5 * 5 + 4 * 6);
        let mut out = vec![[0.0; 3]; 20];
        for edge in
            edges.as_slice().iter().filter(|e| e.inside().is_some() && e.outside().is_some())
        {
            edge.scatter([1.0; 3], &mut out);
        }
        assert_relative_eq!(out.iter().map(|p| p[0]).sum::<f64>(), 0.0);
    }

    proptest! {
        #[test]
        fn some_pixels_get_the_films_numbers_also_when_listed_twice(pixels in prop::collection::vec((0u32..5, 0u32..4), 0..24)) {
            let all = boundary_term(&Edges::film(5, 4), 20);
            for (p, term) in boundary_term(&Edges::of(&pixels, 5, 4), pixels.len()).iter().enumerate() {
                let (x, y) = pixels[p];
                assert_relative_eq!(term[0], all[(y * 5 + x) as usize][0], epsilon = 1e-12);
            }
        }

        /// Every pixel has its own c, and may be listed twice.
        #[test]
        fn gather_is_the_transpose_of_scatter(
            pixels in prop::collection::vec((0u32..4, 0u32..3), 1..9),
            delta in prop::collection::vec(-1.0..1.0f64, 9),
            constant in prop::collection::vec(-1.0..1.0f64, 9),
            radiance_and_crossing in prop::collection::vec((-1.0..1.0f64, -1.0..1.0f64), 36),
        ) {
            let edges = Edges::of(&pixels, 4, 3);
            let mut out = vec![[0.0; 3]; pixels.len()];
            let mut reverse = 0.0;
            for (edge, (l, crossing)) in edges.as_slice().iter().zip(&radiance_and_crossing) {
                edge.scatter_each(|p| [(l - constant[p]) * crossing; 3], &mut out);
                // gather is the adjoint of −V·n.
                reverse -= crossing * edge.gather(|p| delta[p] * (l - constant[p]));
            }
            let forward: f64 = out.iter().zip(&delta).map(|(o, d)| o[1] * d).sum();
            assert_relative_eq!(forward, reverse, epsilon = 1e-12);
        }

        #[test]
        fn every_listed_pixel_has_its_four_edges(pixels in prop::collection::vec((0u32..4, 0u32..3), 0..20)) {
            let edges = Edges::of(&pixels, 4, 3);
            for (p, &(x, y)) in pixels.iter().enumerate() {
                let own: Vec<_> = edges.as_slice().iter().filter(|e| e.inside() == Some(p) || e.outside() == Some(p)).collect();
                prop_assert_eq!(own.len(), 4);
                for edge in own {
                    let outwards = if edge.inside() == Some(p) { 0.5 } else { -0.5 };
                    let centre = [f64::from(x) + 0.5, f64::from(y) + 0.5];
                    let expected: [f64; 2] = std::array::from_fn(|e| centre[e] + outwards * edge.normal()[e]);
                    prop_assert_eq!(edge.point(0.5), expected);
                }
            }
        }
    }

    /// A constant radiance of c_p leaves nothing to carry; with any c the total over area and
    /// border is the same.
    #[test]
    fn a_control_variate_changes_neither_sum() {
        let (edges, constant) = (Edges::film(3, 2), |p: usize| 0.1 + 0.3 * p as f64);
        let mut border = vec![[0.0; 3]; 6];
        for edge in edges.as_slice() {
            let carried = |p: usize, s: f64| {
                (radiance(edge.point(s)) - constant(p)) * warp(edge.point(s))[edge.axis()]
            };
            edge.scatter_each(|p| [mean(400, |s| carried(p, s)); 3], &mut border);
        }
        for (p, border) in border.iter().enumerate() {
            let (x, y) = ((p % 3) as f64, (p / 3) as f64);
            // ∇·((L − c) V) = ∇·(L V) − c ∇·V, with ∇·V = 1 + u_x/2.
            let density = |u: [f64; 2]| divergence(u) - constant(p) * (1.0 + 0.5 * u[0]);
            let area = mean(200, |a| mean(200, |b| density([x + a, y + b])));
            assert_relative_eq!(border[0], -area, epsilon = 1e-4);
        }
    }

    #[test]
    fn pixels_outside_the_film_are_left_out() {
        assert!(Edges::of(&[(7, 0), (0, 9)], 5, 4).as_slice().is_empty());
        assert!(Edges::film(0, 0).as_slice().is_empty());
    }
}
