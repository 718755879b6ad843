//! Exposures of views with known gains, measured on the background and on a lit ball.

use field::fibonacci_direction;
use film::Film;
use glam::DVec2;
use render::Camera;

use super::*;

const BOUNDS: Sphere<f64> = Sphere { center: DVec3::new(1.0, 2.0, 3.0), radius: 0.6 };

/// `count` views around a diffuse ball of radius 0.5 in a directional light, with a texture, in
/// front of a background of one grey. View i has the exposure `gain(i)`.
fn views(count: usize, grey: f32, gain: impl Fn(usize) -> f32) -> Vec<View> {
    let ball = Sphere { radius: 0.5, ..BOUNDS };
    let light = DVec3::new(1.0, 2.0, 2.0).normalize();
    let view = |i: usize| {
        let eye = BOUNDS.center + 4.0 * fibonacci_direction(i, count, 0.0);
        let (focal, middle) = (DVec2::splat(100.0), DVec2::splat(20.0));
        let up = DVec3::new(0.1, 0.2, 1.0);
        let camera = Camera::look_at(40, 40, focal, middle, eye, BOUNDS.center, up).unwrap();
        let mut image = Film::new(40, 40);
        for (j, pixel) in image.pixels.iter_mut().enumerate() {
            let u = DVec2::new((j % 40) as f64 + 0.5, (j / 40) as f64 + 0.5);
            let direction = camera.direction(u);
            let radiance = ball.clip(eye, direction).map_or(grey, |(near, _)| {
                let x = eye + direction * near - BOUNDS.center;
                let texture = 0.5 + 0.2 * (40.0 * x.x).sin() * (40.0 * x.z).sin();
                (texture * (0.3 + x.normalize().dot(light).max(0.0))) as f32
            });
            *pixel = [radiance * gain(i); 3];
        }
        View { name: format!("{i}"), path: Default::default(), camera, image, mask: None }
    };
    (0..count).map(view).collect()
}

/// Exposures of ±`stops`, in a fixed order that does not follow the direction.
fn alternating(stops: f32) -> impl Fn(usize) -> f32 {
    move |i| (if i * 7 % 5 < 2 { -stops } else { stops }).exp2()
}

fn spread(views: &[View]) -> Option<Exposure> {
    exposure_spread(views, &BOUNDS, &BackgroundEstimate::estimate(views, &BOUNDS))
}

#[test]
fn a_grey_background_shows_the_exposures_without_the_object() {
    let equal = spread(&views(12, 0.3, |_| 1.0)).unwrap();
    assert_eq!(equal, Exposure { stops: 0.0, from: ExposureSource::Background });
    // A ramp from −0.2 to 0.2 stops: the median deviation is a quarter of its length.
    let ramp = |i: usize| (0.4 * i as f32 / 11.0 - 0.2).exp2();
    let found = spread(&views(12, 0.3, ramp)).unwrap();
    assert_eq!(found.from, ExposureSource::Background);
    assert!((found.stops - 0.109 / 0.6745).abs() < 0.01, "{found:?}");
}

#[test]
fn a_black_background_shows_nothing_and_the_object_does() {
    let equal = spread(&views(40, 0.0, |_| 1.0)).unwrap();
    assert!(equal.from == ExposureSource::Sphere && equal.stops < MOST_SPREAD / 2.0, "{equal:?}");
    let found = spread(&views(40, 0.0, alternating(0.3))).unwrap();
    assert!((0.2..0.6).contains(&found.stops), "{found:?}");
    // Light from one side changes the brightness of the views by more than a stop: that is no
    // exposure.
    let of = |view: &View| brightness_in(view, &BOUNDS, &|rgb| rgb[0] > 0.0).unwrap().1;
    let stops: Vec<f64> = views(40, 0.0, |_| 1.0).iter().map(of).collect();
    assert!(deviation(&stops) > 4.0 * equal.stops, "{} and {equal:?}", deviation(&stops));
}

#[test]
fn few_or_black_views_have_no_known_exposures() {
    assert_eq!(spread(&views(LEAST_VIEWS - 1, 0.0, alternating(0.3))), None);
    assert_eq!(spread(&views(LEAST_VIEWS, 0.0, |_| 0.0)), None);
    assert_eq!(spread(&views(1, 0.3, |_| 1.0)), None);
}

#[test]
fn a_polynomial_of_degree_two_is_removed_also_from_cameras_on_a_circle() {
    let smooth = |d: DVec3| 1.0 + d.x - 2.0 * d.y + 3.0 * d.x * d.y + d.z * d.z;
    let all: Vec<DVec3> = (0..30).map(|i| fibonacci_direction(i, 30, 0.0)).collect();
    let circle = |i: usize| DVec3::new((0.2 * i as f64).cos(), (0.2 * i as f64).sin(), 0.0);
    let circle: Vec<DVec3> = (0..30).map(circle).collect();
    // On a circle z = 0, and x² + y² = 1: four columns depend on others.
    for (directions, independent) in [(all, 9), (circle, 5)] {
        let mut values: Vec<f64> = directions.iter().map(|d| smooth(*d)).collect();
        assert_eq!(remove_part(directional_terms(&directions), &mut values), independent);
        assert!(values.iter().all(|v| v.abs() < 1e-9), "{values:?}");
    }
}
