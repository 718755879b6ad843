//! Solids with closed-form intervals along rays.

use glam::DVec3;
use serde_json::Value;

use super::camera::vector;
use super::look::Look;
use super::rows::Seen;

/// An end of an interval.
#[derive(Clone, Copy, Debug)]
struct End {
    t: f64,
    /// The outward normal of the solid.
    normal: DVec3,
    /// The number of the smooth part of the surface, 1 or more.
    face: u32,
}

/// The intervals of a ray in a solid, in order.
type Intervals = Vec<[End; 2]>;

fn interval(t: [f64; 2], end: impl Fn(f64) -> (DVec3, u32)) -> Intervals {
    if t[0] >= t[1] {
        return Vec::new();
    }
    let end = |t: f64| {
        let (normal, face) = end(t);
        End { t, normal, face }
    };
    vec![t.map(end)]
}

/// The roots of t² + 2 b t + c.
fn roots(b: f64, c: f64) -> Option<[f64; 2]> {
    let d = b * b - c;
    (d > 0.0).then(|| [-b - d.sqrt(), -b + d.sqrt()])
}

fn ball(center: DVec3, radius: f64, o: DVec3, d: DVec3) -> Intervals {
    let r = o - center;
    let t = roots(r.dot(d), r.dot(r) - radius * radius);
    t.map_or(Vec::new(), |t| interval(t, |t| ((r + d * t) / radius, 1)))
}

fn cuboid(center: DVec3, half: DVec3, o: DVec3, d: DVec3) -> Intervals {
    let (a, b) = ((center - half - o) / d, (center + half - o) / d);
    let (near, far) = (a.min(b), a.max(b));
    let t = [near.max_element(), far.min_element()];
    interval(t, |at| {
        let ends = if at == t[0] { near } else { far };
        let axis = (0..3).find(|&axis| ends[axis] == at).unwrap();
        let outwards = if at == t[0] { -d[axis].signum() } else { d[axis].signum() };
        let mut normal = DVec3::ZERO;
        normal[axis] = outwards;
        (normal, 1 + 2 * axis as u32 + u32::from(outwards > 0.0))
    })
}

fn half_space(normal: DVec3, offset: f64, o: DVec3, d: DVec3) -> Intervals {
    let n = normal.normalize();
    let t = (offset - n.dot(o)) / n.dot(d);
    let t = if n.dot(d) < 0.0 { [t, f64::INFINITY] } else { [f64::NEG_INFINITY, t] };
    interval(t, |_| (n, 1))
}

fn capsule(a: DVec3, b: DVec3, radius: f64, o: DVec3, d: DVec3) -> Intervals {
    let (length, e) = ((b - a).length(), (b - a).normalize());
    // The infinite cylinder, between the planes through a and b.
    let across = |v: DVec3| v - e * e.dot(v);
    let (r, q) = (across(o - a), across(d));
    let square = q.dot(q);
    let cylinder = roots(r.dot(q) / square, (r.dot(r) - radius * radius) / square);
    let planes = [0.0, length].map(|h| (h - e.dot(o - a)) / e.dot(d));
    let (low, high) = (planes[0].min(planes[1]), planes[0].max(planes[1]));
    let mut t = [f64::INFINITY, f64::NEG_INFINITY];
    let parts = [
        cylinder.map(|t| [t[0].max(low), t[1].min(high)]),
        ball(a, radius, o, d).first().map(|ends| ends.map(|end| end.t)),
        ball(b, radius, o, d).first().map(|ends| ends.map(|end| end.t)),
    ];
    for part in parts.into_iter().flatten().filter(|part| part[0] < part[1]) {
        t = [t[0].min(part[0]), t[1].max(part[1])];
    }
    interval(t, |t| {
        let x = o + d * t;
        let along = e.dot(x - a);
        // The normal changes its derivatives where the cylinder meets its caps.
        let face = if along < 0.0 { 1 } else { 2 + u32::from(along > length) };
        ((x - a - e * along.clamp(0.0, length)) / radius, face)
    })
}

/// The intervals where `inside` holds for the children that contain the ray.
///
/// A child whose number is 1 or more is turned inside out if `subtract` is set.
fn combined(children: &[Intervals], subtract: bool, inside: impl Fn(&[bool]) -> bool) -> Intervals {
    let mut ends: Vec<(usize, usize, End)> = Vec::new();
    for (i, child) in children.iter().enumerate() {
        for pair in child {
            for (side, end) in pair.iter().enumerate() {
                let mut end = *end;
                end.face = end.face * 8 + i as u32 + 1;
                if subtract && i > 0 {
                    end.normal = -end.normal;
                }
                ends.push((i, side, end));
            }
        }
    }
    ends.sort_by(|a, b| a.2.t.total_cmp(&b.2.t));
    let mut status = vec![false; children.len()];
    let (mut out, mut open): (Intervals, Option<End>) = (Vec::new(), None);
    let nowhere = End { t: f64::NEG_INFINITY, normal: DVec3::ZERO, face: 1 };
    if inside(&status) {
        open = Some(nowhere);
    }
    for (child, side, end) in ends {
        let before = inside(&status);
        status[child] = side == 0;
        match (before, inside(&status)) {
            (false, true) => open = Some(end),
            (true, false) => out.extend(open.take().map(|start| [start, end])),
            _ => {}
        }
    }
    out.extend(open.map(|start| [start, End { t: f64::INFINITY, ..nowhere }]));
    out
}

/// A solid.
pub(crate) enum Solid {
    Ball { center: DVec3, radius: f64 },
    Cuboid { center: DVec3, half: DVec3 },
    HalfSpace { normal: DVec3, offset: f64 },
    Capsule { ends: [DVec3; 2], radius: f64 },
    Union(Vec<Solid>),
    Intersection(Vec<Solid>),
    Subtraction(Vec<Solid>),
}

impl Solid {
    /// The solid of a scene file.
    pub(crate) fn of(sdf: &Value) -> Self {
        let number = |key: &str| sdf[key].as_f64().unwrap();
        let children = || sdf["children"].as_array().unwrap().iter().map(Self::of).collect();
        let (center, radius) = (|| vector(&sdf["center"]), || number("radius"));
        match sdf["type"].as_str().unwrap() {
            "sphere" => Solid::Ball { center: center(), radius: radius() },
            "box" => Solid::Cuboid { center: center(), half: vector(&sdf["half_size"]) },
            "plane" => {
                Solid::HalfSpace { normal: vector(&sdf["normal"]), offset: number("offset") }
            }
            "capsule" => {
                Solid::Capsule { ends: ["a", "b"].map(|end| vector(&sdf[end])), radius: radius() }
            }
            "union" => Solid::Union(children()),
            "intersection" => Solid::Intersection(children()),
            "subtraction" => Solid::Subtraction(children()),
            other => panic!("{other}"),
        }
    }

    /// The intervals of the ray o + t d.
    fn intervals(&self, o: DVec3, d: DVec3) -> Intervals {
        let all = |children: &[Solid]| -> Vec<Intervals> {
            children.iter().map(|child| child.intervals(o, d)).collect()
        };
        match self {
            Solid::Ball { center, radius } => ball(*center, *radius, o, d),
            Solid::Cuboid { center, half } => cuboid(*center, *half, o, d),
            Solid::HalfSpace { normal, offset } => half_space(*normal, *offset, o, d),
            Solid::Capsule { ends: [a, b], radius } => capsule(*a, *b, *radius, o, d),
            Solid::Union(children) => combined(&all(children), false, |s| s.contains(&true)),
            Solid::Intersection(children) => {
                combined(&all(children), false, |s| !s.contains(&false))
            }
            Solid::Subtraction(children) => {
                combined(&all(children), true, |s| s[0] && !s[1..].contains(&true))
            }
        }
    }

    /// The surface that the ray from `o` along `d` hits first. The solid ends at the ball of radius
    /// `reach` around `o`.
    pub(crate) fn see(&self, look: &Look, reach: f64, o: DVec3, d: DVec3) -> Seen {
        let first = self.intervals(o, d).into_iter().map(|pair| pair[0]).find(|e| e.t > 0.0);
        match first.filter(|end| end.t < reach) {
            Some(End { t, normal, face }) => {
                let (part, radiance) = look.lit(normal);
                Seen { face: 2 * face + part, t, radiance }
            }
            None => look.nothing(),
        }
    }
}
