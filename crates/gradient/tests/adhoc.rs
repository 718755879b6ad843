#![allow(dead_code, unused)]
mod truth;
use serde_json::{Value, json};
use truth::{Camera, derivative, solid};
#[test]
fn adhoc() {
    let scene = std::env::var("SC").unwrap();
    let wrt = std::env::var("WRT").unwrap();
    let out = std::env::var("OUT").unwrap();
    let tol: f64 = std::env::var("TOL").unwrap().parse().unwrap();
    let value: Value = serde_json::from_slice(&std::fs::read(scene).unwrap()).unwrap();
    let camera = Camera::of(&value);
    let t = derivative(&camera, 1e-5, tol, |offset| {
        let mut value = value.clone();
        let number = value.pointer_mut(&wrt).unwrap();
        *number = json!(number.as_f64().unwrap() + offset);
        let eye = camera.eye;
        move |d| solid::see(&value, f64::INFINITY, eye, d)
    });
    let s: Vec<String> = t.iter().flatten().map(|x| format!("{x}")).collect();
    std::fs::write(out, s.join(" ")).unwrap();
}

#[test]
fn scan() {
    let scene = std::env::var("SC").unwrap();
    let wrt = std::env::var("WRT").unwrap();
    let tol: f64 = std::env::var("TOL").unwrap().parse().unwrap();
    let pixel: usize = std::env::var("PX").unwrap().parse().unwrap();
    let value: Value = serde_json::from_slice(&std::fs::read(scene).unwrap()).unwrap();
    let camera = Camera::of(&value);
    let mut last = 0.0;
    for k in 0..=1 {
        let mut value = value.clone();
        let number = value.pointer_mut(&wrt).unwrap();
        *number = json!(number.as_f64().unwrap() + 1e-5 * k as f64);
        let eye = camera.eye;
        let i = truth::image(&camera, tol, |d| solid::see(&value, f64::INFINITY, eye, d));
        println!("{k} {:.9} slope {:.5}", i[pixel][0], (i[pixel][0] - last) / 1e-5);
        last = i[pixel][0];
    }
}
