#![doc = include_str!("../README.md")]
#![allow(clippy::doc_markdown, reason = "the subscripts of formulas are no code")]

use std::collections::HashMap;

/// A unit segment of the border of one pixel or of two neighbours. Its normal points along +x or +y
/// of the film, out of the pixel `inside` and into the pixel `outside`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    axis: usize,
    /// The end of the segment with the smaller coordinates, in pixels.
    origin: [u32; 2],
    inside: Option<usize>,
    outside: Option<usize>,
}

impl Edge {
    /// The film axis of the normal: 0 for x, 1 for y.
    pub fn axis(&self) -> usize {
        self.axis
    }

    /// The index of the pixel before the edge along its axis (left or above), if it is in the set.
    pub fn inside(&self) -> Option<usize> {
        self.inside
    }

    /// The index of the pixel after the edge along its axis (right or below), if it is in the set.
    pub fn outside(&self) -> Option<usize> {
        self.outside
    }

    /// The same edge with the pixel indices `index(inside)` and `index(outside)`.
    #[must_use]
    pub fn renamed(self, index: impl Fn(usize) -> usize) -> Self {
        Edge { inside: self.inside.map(&index), outside: self.outside.map(&index), ..self }
    }

    /// The unit normal on the film.
    pub fn normal(&self) -> [f64; 2] {
        std::array::from_fn(|e| if e == self.axis { 1.0 } else { 0.0 })
    }

    /// The film position, in pixels, at the fraction `along` in [0, 1) of the segment.
    pub fn point(&self, along: f64) -> [f64; 2] {
        let mut u = self.origin.map(f64::from);
        u[1 - self.axis] += along;
        u
    }

    /// Adds the boundary term of this edge to the derivatives of its pixels, for a baseline c that
    /// both pixels share. `flux` is the mean of (L − c) V·n over the edge, per colour channel. It
    /// is subtracted from `inside` and added to `outside`.
    ///
    /// # Panics
    /// If `derivative` has no element for a pixel of this edge.
    pub fn scatter(&self, flux: [f64; 3], derivative: &mut [[f64; 3]]) {
        self.scatter_each(|_| flux, derivative);
    }

    /// Like [`scatter`](Self::scatter), with a baseline per pixel: `flux(p)` is the mean of
    /// (L − c_p) V·n for pixel p.
    ///
    /// # Panics
    /// If `derivative` has no element for a pixel of this edge.
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

    /// VJP of −V·n ↦ derivatives of the edge's pixels, the transpose of
    /// [`scatter_each`](Self::scatter_each).
    ///
    /// `weighted(p)` is δ_p·(L − c_p), with δ_p the adjoint of pixel p. The result is the adjoint
    /// of −V·n, which is the coefficient of +(a·n) ∂_θ f for a warp V = −Σ a ∂_θ f.
    pub fn gather<R: num_traits::Float>(&self, weighted: impl Fn(usize) -> R) -> R {
        let side = |pixel: Option<usize>| pixel.map_or(R::zero(), &weighted);
        side(self.inside) - side(self.outside)
    }
}

/// The edges of a list of pixels. An edge that two pixels share is stored once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Edges(Vec<Edge>);

impl Edges {
    /// The edges of a list of pixels (column, row) of a film of `width` × `height` pixels. Edges
    /// refer to pixels by their index in the list.
    ///
    /// Pixels outside the film are left out. A pixel that is listed twice counts as two pixels, and
    /// each has its own four edges or shares them with a neighbour: every entry gets its whole
    /// border. The order of the edges depends on the list alone.
    pub fn of(pixels: &[(u32, u32)], width: u32, height: u32) -> Self {
        let mut edges: Vec<Edge> = Vec::with_capacity(4 * pixels.len());
        let mut known = HashMap::with_capacity(4 * pixels.len());
        let on_film = |&(_, &(x, y)): &(usize, &(u32, u32))| x < width && y < height;
        for (index, &pixel) in pixels.iter().enumerate().filter(on_film) {
            for (axis, origin, inside) in sides(pixel) {
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

    /// The edges of all pixels of a film of `width` × `height` pixels, row after row. Pixel (x, y)
    /// has index y · width + x.
    pub fn film(width: u32, height: u32) -> Self {
        let pixels: Vec<(u32, u32)> =
            (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).collect();
        Self::of(&pixels, width, height)
    }

    /// The edges in the order of their construction.
    pub fn as_slice(&self) -> &[Edge] {
        &self.0
    }
}

/// The left, right, top and bottom edge of a pixel: axis, origin, and whether the pixel is the
/// edge's `inside`.
fn sides((x, y): (u32, u32)) -> [(usize, [u32; 2], bool); 4] {
    [(0, [x, y], false), (0, [x + 1, y], true), (1, [x, y], false), (1, [x, y + 1], true)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    fn radiance(u: [f64; 2]) -> f64 {
        (0.7 * u[0]).sin() + 0.3 * u[1] * u[1]
    }
    fn warp(u: [f64; 2]) -> [f64; 2] {
        [(0.4 * u[1]).cos() + u[0], 0.5 * u[0] * u[1]]
    }
    /// ∇·(L V).
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
    fn the_boundary_term_is_minus_the_integrated_divergence() {
        let terms = boundary_term(&Edges::film(4, 3), 12);
        for (p, term) in terms.iter().enumerate() {
            let (x, y) = ((p % 4) as f64, (p / 4) as f64);
            let area = mean(200, |a| mean(200, |b| divergence([x + a, y + b])));
            assert_relative_eq!(term[0], -area, epsilon = 1e-4);
        }
    }

    #[test]
    fn a_film_has_each_edge_once_and_inner_fluxes_sum_to_zero() {
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
        fn pixels_of_a_list_get_the_terms_of_the_whole_film_also_when_listed_twice(
            pixels in prop::collection::vec((0u32..5, 0u32..4), 0..24),
        ) {
            let all = boundary_term(&Edges::film(5, 4), 20);
            let terms = boundary_term(&Edges::of(&pixels, 5, 4), pixels.len());
            for (p, term) in terms.iter().enumerate() {
                let (x, y) = pixels[p];
                assert_relative_eq!(term[0], all[(y * 5 + x) as usize][0], epsilon = 1e-12);
            }
        }

        /// Every pixel has its own baseline, and may be listed twice.
        #[test]
        fn gather_is_the_transpose_of_scatter(
            pixels in prop::collection::vec((0u32..4, 0u32..3), 1..9),
            delta in prop::collection::vec(-1.0..1.0f64, 9),
            baseline in prop::collection::vec(-1.0..1.0f64, 9),
            radiance_and_crossing in prop::collection::vec((-1.0..1.0f64, -1.0..1.0f64), 36),
        ) {
            let edges = Edges::of(&pixels, 4, 3);
            let mut out = vec![[0.0; 3]; pixels.len()];
            let mut reverse = 0.0;
            for (edge, (l, crossing)) in edges.as_slice().iter().zip(&radiance_and_crossing) {
                edge.scatter_each(|p| [(l - baseline[p]) * crossing; 3], &mut out);
                // gather is the adjoint of −V·n.
                reverse -= crossing * edge.gather(|p| delta[p] * (l - baseline[p]));
            }
            let forward: f64 = out.iter().zip(&delta).map(|(o, d)| o[1] * d).sum();
            assert_relative_eq!(forward, reverse, epsilon = 1e-12);
        }

        #[test]
        fn every_listed_pixel_has_its_four_edges(
            pixels in prop::collection::vec((0u32..4, 0u32..3), 0..20),
        ) {
            let edges = Edges::of(&pixels, 4, 3);
            for (p, &(x, y)) in pixels.iter().enumerate() {
                let is_own = |e: &&Edge| e.inside() == Some(p) || e.outside() == Some(p);
                let own: Vec<_> = edges.as_slice().iter().filter(is_own).collect();
                prop_assert_eq!(own.len(), 4);
                for edge in own {
                    let outwards = if edge.inside() == Some(p) { 0.5 } else { -0.5 };
                    let centre = [f64::from(x) + 0.5, f64::from(y) + 0.5];
                    let expected: [f64; 2] =
                        std::array::from_fn(|e| centre[e] + outwards * edge.normal()[e]);
                    prop_assert_eq!(edge.point(0.5), expected);
                }
            }
        }
    }

    /// A baseline changes the area term and the boundary term by opposite amounts: their sum stays
    /// the same.
    #[test]
    fn the_boundary_term_with_baselines_is_minus_the_integrated_divergence() {
        let (edges, baseline) = (Edges::film(3, 2), |p: usize| 0.1 + 0.3 * p as f64);
        let mut border = vec![[0.0; 3]; 6];
        for edge in edges.as_slice() {
            let flux = |p: usize, s: f64| {
                (radiance(edge.point(s)) - baseline(p)) * warp(edge.point(s))[edge.axis()]
            };
            edge.scatter_each(|p| [mean(400, |s| flux(p, s)); 3], &mut border);
        }
        for (p, border) in border.iter().enumerate() {
            let (x, y) = ((p % 3) as f64, (p / 3) as f64);
            // ∇·((L − c) V) = ∇·(L V) − c ∇·V, with ∇·V = 1 + u_x/2.
            let density = |u: [f64; 2]| divergence(u) - baseline(p) * (1.0 + 0.5 * u[0]);
            let area = mean(200, |a| mean(200, |b| density([x + a, y + b])));
            assert_relative_eq!(border[0], -area, epsilon = 1e-4);
        }
    }

    #[test]
    fn a_renamed_edge_keeps_its_place_and_has_the_new_indices() {
        for edge in Edges::film(3, 2).as_slice() {
            let renamed = edge.renamed(|p| 10 * p + 7);
            assert_eq!(renamed.inside(), edge.inside().map(|p| 10 * p + 7));
            assert_eq!(renamed.outside(), edge.outside().map(|p| 10 * p + 7));
            assert_eq!((renamed.point(0.3), renamed.axis()), (edge.point(0.3), edge.axis()));
        }
    }

    /// A flux leaves `inside` and enters `outside`, in each colour channel for itself.
    #[test]
    fn a_flux_goes_from_pixel_to_pixel_in_every_channel() {
        let edges = Edges::film(2, 1);
        let is_shared = |e: &&Edge| e.inside() == Some(0) && e.outside() == Some(1);
        let shared: Vec<&Edge> = edges.as_slice().iter().filter(is_shared).collect();
        assert_eq!((shared.len(), shared[0].normal(), shared[0].axis()), (1, [1.0, 0.0], 0));
        let mut out = [[10.0; 3]; 2];
        shared[0].scatter([1.0, 2.0, 4.0], &mut out);
        assert_eq!(out, [[9.0, 8.0, 6.0], [11.0, 12.0, 14.0]]);
        assert_eq!(shared[0].gather(|p| [3.0, 5.0][p]), -2.0);
        assert_eq!((shared[0].point(0.0), shared[0].point(0.25)), ([1.0, 0.0], [1.0, 0.25]));
    }

    #[test]
    fn pixels_outside_the_film_are_left_out() {
        // The last pixel of a row and of a column is inside, the next one is not.
        assert_eq!(Edges::of(&[(4, 3)], 5, 4).as_slice().len(), 4);
        assert!(Edges::of(&[(5, 0), (0, 4)], 5, 4).as_slice().is_empty());
        assert!(Edges::of(&[(7, 0), (0, 9)], 5, 4).as_slice().is_empty());
        assert!(Edges::film(0, 0).as_slice().is_empty());
    }
}
