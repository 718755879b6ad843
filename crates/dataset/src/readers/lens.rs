//! Lens distortion and skew, and their removal from a photograph.

use glam::{DMat2, DVec2};

use render::Camera;

/// Distortion and skew: the difference between a photograph's camera and a pinhole camera.
///
/// The model is that of Brown ("Decentering Distortion of Lenses", Photogrammetric Engineering
/// 32(3), 1966) and Conrady ("Decentred Lens-Systems", MNRAS 79, 1919) with the rational radial
/// part and the thin prism of OpenCV ("Camera Calibration and 3D Reconstruction") and COLMAP's
/// `FULL_OPENCV` and `THIN_PRISM_FISHEYE`. With tangents (x, y), y down, and r² = x² + y², it is the
/// map
///
/// (x, y) ↦ (x, y) (1 + k₁ r² + k₂ r⁴ + k₃ r⁶ + k₄ r⁸) / (1 + d₁ r² + d₂ r⁴ + d₃ r⁶)
///   + (2 p₁ x y + p₂ (r² + 2 x²), 2 p₂ x y + p₁ (r² + 2 y²)) + (s₁, s₂) r²,
///
/// from the tangents of a point to the tangents at which the photograph shows it. A fisheye lens
/// has it after (x, y) ↦ (x, y) θ/r, where θ = atan r is the angle to the optical axis (Kannala and
/// Brandt, "A Generic Camera Model and Calibration Method for Conventional, Wide-Angle, and
/// Fish-Eye Lenses", IEEE PAMI 28(8), 2006). The film x is then shifted by `skew` pixels per unit
/// of the second tangent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Lens {
    /// Whether angles take the place of tangents: a fisheye lens.
    pub(crate) by_angle: bool,
    /// Radial coefficients k₁ to k₄.
    pub(crate) radial: [f64; 4],
    /// Coefficients d₁ to d₃ of the radial divisor.
    pub(crate) divisor: [f64; 3],
    /// Tangential coefficients p₁, p₂.
    pub(crate) tangential: [f64; 2],
    /// Thin prism coefficients s₁, s₂.
    pub(crate) prism: [f64; 2],
    /// The element of K in row 0, column 1, in pixels.
    pub(crate) skew: f64,
}

/// Displacement in pixels below which a lens is ignored. Resampling would blur the photograph more
/// than such a displacement does.
const NEGLIGIBLE: f64 = 0.01;

/// The largest magnification of an image, beyond which its lens is refused.
const MOST_ZOOM: f64 = 3.0;

/// Tolerance of the search for the magnification, relative to the focal length.
const ZOOM_TOLERANCE: f64 = 1e-4;

/// The largest angle between the optical axis and the middle of an edge of the pinhole image of a
/// fisheye lens, in degrees. A pixel there covers (1 / cos 55°)² = 3 times the solid angle of one
/// in the centre along the radius; at 75 degrees it would be 15 times.
const WIDEST: f64 = 55.0;

/// Intervals along each edge of the film, and along the line from there to the principal point, at
/// whose ends the map is tested.
const TESTS: usize = 32;

impl Lens {
    /// A lens with the coefficients k₁ to k₄.
    pub(crate) fn radial(radial: [f64; 4]) -> Self {
        Lens { radial, ..Lens::default() }
    }

    /// A fisheye lens with the coefficients k₁ to k₄ of powers of the angle.
    pub(crate) fn fisheye(radial: [f64; 4]) -> Self {
        Lens { by_angle: true, radial, ..Lens::default() }
    }

    pub(crate) fn is_fisheye(&self) -> bool {
        self.by_angle
    }

    /// The map of tangents `p` ↦ q of [`Lens`], and its Jacobian ∂q/∂p.
    ///
    /// NaN where the radial divisor is not above 0.
    fn distort(&self, p: DVec2) -> (DVec2, DMat2) {
        if !self.by_angle {
            return self.distort_brown(p);
        }
        let (angles, inner) = to_angles(p);
        let (q, outer) = self.distort_brown(angles);
        (q, outer * inner)
    }

    /// The map of tangents alone, without its Jacobian: that of each pixel of a photograph.
    fn distorted(&self, p: DVec2) -> DVec2 {
        self.distorted_brown(if self.by_angle { to_angles(p).0 } else { p })
    }

    /// The map of [`distort_brown`](Self::distort_brown), without its Jacobian.
    #[inline]
    fn distorted_brown(&self, p: DVec2) -> DVec2 {
        let ([k1, k2, k3, k4], [d1, d2, d3]) = (self.radial, self.divisor);
        let [p1, p2] = self.tangential;
        let r2 = p.length_squared();
        let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)));
        let below = 1.0 + r2 * (d1 + r2 * (d2 + r2 * d3));
        if below <= 0.0 {
            return DVec2::NAN;
        }
        let xy = p.x * p.y;
        let tangential = DVec2::new(
            2.0 * p1 * xy + p2 * (r2 + 2.0 * p.x * p.x),
            2.0 * p2 * xy + p1 * (r2 + 2.0 * p.y * p.y),
        );
        p * (above / below) + tangential + DVec2::from(self.prism) * r2
    }

    /// The map behind the angles of a fisheye lens, and its Jacobian.
    fn distort_brown(&self, p: DVec2) -> (DVec2, DMat2) {
        let ([k1, k2, k3, k4], [d1, d2, d3]) = (self.radial, self.divisor);
        let ([p1, p2], prism) = (self.tangential, DVec2::from(self.prism));
        let r2 = p.length_squared();
        let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)));
        let below = 1.0 + r2 * (d1 + r2 * (d2 + r2 * d3));
        if below <= 0.0 {
            return (DVec2::NAN, DMat2::NAN);
        }
        let radial = above / below;
        let above_slope = k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3 + r2 * 4.0 * k4));
        let below_slope = d1 + r2 * (2.0 * d2 + r2 * 3.0 * d3);
        // The derivative of `radial` by x is this times x; by y, times y.
        let slope = 2.0 * (above_slope - radial * below_slope) / below;
        let xy = p.x * p.y;
        let across = slope * xy + 2.0 * (p1 * p.x + p2 * p.y);
        let dx = DVec2::new(radial + slope * p.x * p.x + 2.0 * p1 * p.y + 6.0 * p2 * p.x, across);
        let dy = DVec2::new(across, radial + slope * p.y * p.y + 2.0 * p2 * p.x + 6.0 * p1 * p.y);
        let jacobian = DMat2::from_cols(dx + 2.0 * p.x * prism, dy + 2.0 * p.y * prism);
        (self.distorted_brown(p), jacobian)
    }

    /// Maps a film position `u` of the pinhole camera `ideal` to the film position of the same
    /// point in the photograph; `source` is the pinhole part of the photograph's camera.
    fn source_position(&self, ideal: &Camera, source: &Camera, u: DVec2) -> DVec2 {
        let q = self.distorted((u - ideal.principal) / ideal.focal);
        source.principal + source.focal * q + DVec2::new(self.skew * q.y, 0.0)
    }

    /// True if every tested point of the film's border is displaced by less than [`NEGLIGIBLE`].
    pub(crate) fn is_negligible(&self, camera: &Camera) -> bool {
        self.displacements(camera).all(|d| d.abs().max_element() < NEGLIGIBLE)
    }

    /// The length of the largest displacement of a point of the film's border, in pixels.
    pub(crate) fn displacement(&self, camera: &Camera) -> f64 {
        self.displacements(camera).map(DVec2::length).fold(0.0, f64::max)
    }

    /// The displacements of the tested points of the film's border, in pixels.
    pub(crate) fn displacements(&self, camera: &Camera) -> impl Iterator<Item = DVec2> {
        border(camera).map(|u| self.source_position(camera, camera, u) - u)
    }

    /// The pinhole camera of the undistorted image: `camera` magnified about its principal point by
    /// the least factor at which the photograph covers its whole film.
    ///
    /// The factor is 1 or more. For a fisheye lens it may be less, down to a film that reaches
    /// [`WIDEST`] degrees from the optical axis.
    ///
    /// Coverage is tested at points of the film's border. `None` if the factor would exceed
    /// [`MOST_ZOOM`], or the distortion folds the image over within the film.
    pub(crate) fn pinhole(&self, camera: &Camera) -> Option<Camera> {
        let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
        let zoomed = |zoom: f64| Camera { focal: camera.focal * zoom, ..*camera };
        let is_covered = |zoom: f64| {
            let ideal = zoomed(zoom);
            border(camera).all(|u| {
                let at = self.source_position(&ideal, camera, u);
                at.cmpge(DVec2::splat(-NEGLIGIBLE)).all()
                    && at.cmple(size + NEGLIGIBLE).all()
                    && self.is_unfolded(&ideal, u)
            })
        };
        let least = if self.by_angle {
            let reach = camera.principal.max(size - camera.principal) / camera.focal;
            reach.max_element() / WIDEST.to_radians().tan()
        } else {
            1.0
        };
        if is_covered(least) {
            return Some(zoomed(least));
        }
        let (mut low, mut high) = (least, MOST_ZOOM);
        if !is_covered(high) || low > high {
            return None;
        }
        while high - low > ZOOM_TOLERANCE {
            let middle = 0.5 * (low + high);
            if is_covered(middle) { high = middle } else { low = middle }
        }
        Some(zoomed(high))
    }

    /// True if the map keeps its orientation along the line from the principal point to `u`.
    fn is_unfolded(&self, ideal: &Camera, u: DVec2) -> bool {
        let p = (u - ideal.principal) / ideal.focal;
        (1..=TESTS).all(|i| self.distort(p * (i as f64 / TESTS as f64)).1.determinant() > 0.0)
    }

    /// Pixel `[x, y]` of the image of the pinhole camera `ideal`, by bilinear interpolation in the
    /// photograph of the camera `source`, in linear radiance. `at` gives the photograph's pixels,
    /// and `size` is its width and height.
    pub(crate) fn undistorted<const C: usize>(
        &self,
        size: [u32; 2],
        at: impl Fn(u32, u32) -> [f32; C],
        [source, ideal]: [&Camera; 2],
        [x, y]: [u32; 2],
    ) -> [f32; C] {
        let u = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        bilinear(size, at, self.source_position(ideal, source, u))
    }
}

/// The map of tangents to angles of a fisheye lens, p ↦ p θ/r, and its Jacobian.
fn to_angles(p: DVec2) -> (DVec2, DMat2) {
    let r2 = p.length_squared();
    let r = r2.sqrt();
    // Near the axis the differences lose all digits: Taylor series of atan.
    let (scale, slope) = if r2 < 1e-6 {
        (1.0 - r2 / 3.0, -2.0 / 3.0 + 0.8 * r2)
    } else {
        let scale = r.atan() / r;
        (scale, (1.0 / (1.0 + r2) - scale) / r2)
    };
    let jacobian = DMat2::from_diagonal(DVec2::splat(scale))
        + DMat2::from_cols(p * (slope * p.x), p * (slope * p.y));
    (p * scale, jacobian)
}

/// Equidistant film positions along the film's border.
fn border(camera: &Camera) -> impl Iterator<Item = DVec2> + use<> {
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    (0..=TESTS).flat_map(move |i| {
        let at = size * (i as f64 / TESTS as f64);
        [
            DVec2::new(at.x, 0.0),
            DVec2::new(at.x, size.y),
            DVec2::new(0.0, at.y),
            DVec2::new(size.x, at.y),
        ]
    })
}

/// The image at a continuous film position, interpolated between the four pixel centres around it,
/// and constant beyond the outermost centres.
fn bilinear<const C: usize>(
    size: [u32; 2],
    at: impl Fn(u32, u32) -> [f32; C],
    u: DVec2,
) -> [f32; C] {
    let most = DVec2::new(f64::from(size[0] - 1), f64::from(size[1] - 1));
    let place = (u - 0.5).clamp(DVec2::ZERO, most);
    let low = place.floor();
    let high = (low + 1.0).min(most);
    let f = (place - low).as_vec2();
    #[expect(clippy::cast_possible_truncation, reason = "whole numbers inside the image")]
    let pixel = |x: f64, y: f64| at(x as u32, y as u32);
    let (a, b, c, d) =
        (pixel(low.x, low.y), pixel(high.x, low.y), pixel(low.x, high.y), pixel(high.x, high.y));
    std::array::from_fn(|i| {
        let (top, bottom) = (a[i] + (b[i] - a[i]) * f.x, c[i] + (d[i] - c[i]) * f.x);
        top + (bottom - top) * f.y
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use film::Film;
    use glam::DVec3;
    use proptest::prelude::*;

    fn camera() -> Camera {
        let (focal, principal) = (DVec2::new(80.0, 82.0), DVec2::new(49.0, 38.0));
        Camera::look_at(100, 80, focal, principal, DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, DVec3::Y)
            .unwrap()
    }

    proptest! {
        #[test]
        fn the_jacobian_matches_differences(
            x in -0.6..0.6f64,
            y in -0.6..0.6f64,
            k in prop::array::uniform4(-0.1..0.1f64),
        ) {
            for by_angle in [false, true] {
                let lens = Lens {
                    by_angle,
                    radial: k,
                    divisor: [k[1], -k[0], k[2]],
                    tangential: [k[2], k[3]],
                    prism: [k[3], k[0]],
                    skew: 0.0,
                };
                let (p, h) = (DVec2::new(x, y), 1e-6);
                let jacobian = lens.distort(p).1;
                for (e, column) in [(DVec2::X, jacobian.x_axis), (DVec2::Y, jacobian.y_axis)] {
                    let (plus, minus) = (lens.distort(p + h * e).0, lens.distort(p - h * e).0);
                    assert_relative_eq!(column, (plus - minus) / (2.0 * h), epsilon = 1e-8);
                }
            }
        }

        #[test]
        fn every_undistorted_pixel_lies_in_the_photograph(
            k in -0.2..0.3f64,
            p in -0.02..0.02f64,
            skew in -5.0..5.0f64,
        ) {
            let lens =
                Lens { tangential: [p, -p], skew, ..Lens::radial([k, 0.0, 0.0, 0.0]) };
            let ideal = lens.pinhole(&camera()).unwrap();
            prop_assert!(ideal.focal.x >= 80.0);
            for i in 0..100 {
                for j in 0..80 {
                    let u = DVec2::new(f64::from(i) + 0.5, f64::from(j) + 0.5);
                    let at = lens.source_position(&ideal, &camera(), u);
                    prop_assert!(at.min_element() >= 0.0 && at.x <= 100.0 && at.y <= 80.0, "{at}");
                }
            }
        }
    }

    /// A photograph through a lens of a smooth pattern in the plane z = 0, exact at each pixel's
    /// centre. It inverts the distortion by Newton's method; the module only applies it.
    fn photograph(lens: &Lens, camera: &Camera) -> Film {
        let mut film = Film::new(camera.width, camera.height);
        for y in 0..camera.height {
            for x in 0..camera.width {
                let u = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - camera.principal;
                let q = DVec2::new(
                    (u.x - lens.skew * u.y / camera.focal.y) / camera.focal.x,
                    u.y / camera.focal.y,
                );
                let mut p = q;
                for _ in 0..20 {
                    let (at, derivative) = lens.distort(p);
                    p -= derivative.inverse() * (at - q);
                }
                film.pixels[(y * camera.width + x) as usize] = pattern(p);
            }
        }
        film
    }

    /// The undistorted photograph.
    fn undistort(lens: &Lens, image: &Film, source: &Camera, ideal: &Camera) -> Film {
        let (width, height) = (image.width, image.height);
        let pixel = |i: u32| {
            let at = |x, y| image.at(x, y);
            lens.undistorted([width, height], at, [source, ideal], [i % width, i / width])
        };
        Film { width, height, pixels: (0..width * height).map(pixel).collect() }
    }

    fn pattern(p: DVec2) -> [f32; 3] {
        let (x, y) = ((4.0 * p.x).sin(), (3.0 * p.y).cos());
        let rgb = DVec3::new(x, y, 0.8 * (3.0 * p.x * p.y).sin());
        (0.5 + 0.5 * rgb).as_vec3().to_array()
    }

    #[test]
    fn undistorting_restores_the_pinhole_image() {
        let camera = camera();
        let lenses = [
            Lens { tangential: [0.003, -0.002], ..Lens::radial([-0.15, 0.02, 0.01, 0.0]) },
            Lens::radial([0.2, 0.0, 0.0, 0.0]),
            Lens { divisor: [0.1, 0.02, 0.0], ..Lens::radial([-0.05, 0.0, 0.0, 0.0]) },
            Lens { prism: [0.01, 0.02], ..Lens::fisheye([0.05, -0.01, 0.0, 0.0]) },
            Lens { skew: 3.0, ..Lens::default() },
        ];
        for lens in lenses {
            assert!(!lens.is_negligible(&camera));
            let ideal = lens.pinhole(&camera).unwrap();
            let found = undistort(&lens, &photograph(&lens, &camera), &camera, &ideal);
            let expected = photograph(&Lens::default(), &ideal);
            let worst = found.pixels.as_flattened().iter().zip(expected.pixels.as_flattened());
            let worst = worst.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            // Bilinear interpolation of these patterns has an error of 1/8 |second derivative|; at
            // the border it is that of half a pixel of constant extrapolation.
            assert!(worst < 0.03, "{lens:?}: largest error {worst}");
        }
    }

    #[test]
    fn a_lens_without_distortion_is_negligible_and_a_folding_one_is_refused() {
        assert!(Lens::default().is_negligible(&camera()));
        assert!(Lens { skew: 0.005, ..Lens::default() }.is_negligible(&camera()));
        assert!(Lens::radial([-30.0, 0.0, 0.0, 0.0]).pinhole(&camera()).is_none());
        assert!(Lens::radial([f64::NAN, 0.0, 0.0, 0.0]).pinhole(&camera()).is_none());
    }

    #[test]
    fn the_image_of_a_fisheye_lens_reaches_at_most_55_degrees() {
        // Equidistant lenses whose film ends 40, 60 and 85 degrees from the axis.
        for (edge, expected) in [(40f64, 40.0), (60.0, 55.0), (85.0, 55.0)] {
            let focal = DVec2::splat(50.0 / edge.to_radians());
            let camera = Camera { focal, principal: DVec2::new(50.0, 40.0), ..camera() };
            let ideal = Lens::fisheye([0.0; 4]).pinhole(&camera).unwrap();
            let found = (50.0 / ideal.focal.x).atan().to_degrees();
            // The corners of the smallest film are not covered at once.
            assert!((expected - 8.0..expected + 0.01).contains(&found), "{edge}: {found}");
        }
    }
}
