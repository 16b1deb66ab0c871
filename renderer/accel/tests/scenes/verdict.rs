//! The right answers to a ray: the truth in double precision, within the error that single precision makes.
//!
//! A test of Moeller and Trumbore's kind computes weights and distance as quotients of triple products. With
//! inputs taken as exact, each product of magnitude `m` is off by some `m * epsilon`, which divided by the
//! determinant bounds the error of the quotient (Higham, "Accuracy and Stability of Numerical Algorithms",
//! 2002, chapter 3, gives the rules). Boxes add an error of some roundings of the coordinates. Within these
//! bounds an answer is as good as any; outside them it is wrong.

#![allow(dead_code, reason = "each user takes some of it")]

use std::sync::Arc;

use glam::Vec3A;
use treewright_accel::{Hit, Intersector, Ray, Triangles};

use super::back_ends::each;

/// Roundings that add up in one triple product or box test.
const ROUNDINGS: f64 = 12.0;

/// Where a ray meets a triangle's plane, and how sure that is.
#[derive(Clone, Copy, Debug)]
struct Meeting {
    triangle: u32,
    t: f64,
    /// Bound of the error of `t`.
    t_error: f64,
    u: f64,
    v: f64,
    weight_error: f64,
    /// Whether it must be found, were it alone.
    sure: bool,
}

/// All meetings of one ray that an answer may name.
#[derive(Clone, Debug)]
pub(crate) struct Verdict {
    possible: Vec<Meeting>,
}

impl Verdict {
    pub(crate) fn of(triangles: &Triangles, ray: &Ray) -> Self {
        if !ray.is_valid() {
            return Self { possible: Vec::new() };
        }
        let possible = (0..triangles.len()).filter_map(|triangle| meet(triangles, triangle, ray)).collect();
        Self { possible }
    }

    /// Whether only one answer is right: hit or miss, though not which of several triangles.
    pub(crate) fn is_clear(&self) -> bool {
        self.possible.is_empty() || self.possible.iter().any(|meeting| meeting.sure)
    }

    pub(crate) fn must_hit(&self) -> bool {
        self.possible.iter().any(|meeting| meeting.sure)
    }

    /// The fault of an answer, if it has one.
    pub(crate) fn objection(&self, found: Option<Hit>) -> Option<String> {
        self.placement_objection(found).or_else(|| {
            let hit = found?;
            let meeting = self.possible.iter().find(|meeting| meeting.triangle == hit.triangle)?;
            let wrong =
                off(hit.u, meeting.u, meeting.weight_error) || off(hit.v, meeting.v, meeting.weight_error);
            let Meeting { u, v, weight_error, .. } = meeting;
            wrong.then(|| format!("weights {}, {} are not within {weight_error:e} of {u}, {v}", hit.u, hit.v))
        })
    }

    /// The fault of an answer, its weights left aside.
    pub(crate) fn placement_objection(&self, found: Option<Hit>) -> Option<String> {
        let nearest =
            self.possible.iter().filter(|meeting| meeting.sure).map(|meeting| meeting.t + meeting.t_error);
        let nearest = nearest.fold(f64::INFINITY, f64::min);
        let Some(hit) = found else {
            return (nearest < f64::INFINITY).then(|| format!("missed what lies before {nearest:e}"));
        };
        let Some(meeting) = self.possible.iter().find(|meeting| meeting.triangle == hit.triangle) else {
            return Some("hit a triangle that the ray does not meet".into());
        };
        if off(hit.t, meeting.t, meeting.t_error) {
            return Some(format!(
                "distance {:e} is not within {:e} of {:e}",
                hit.t, meeting.t_error, meeting.t
            ));
        }
        (meeting.t - meeting.t_error > nearest).then(|| format!("something nearer lies before {nearest:e}"))
    }

    /// The fault of an answer to "is anything there", if it has one.
    pub(crate) fn occlusion_objection(&self, occluded: bool) -> Option<String> {
        match occluded {
            true if self.possible.is_empty() => Some("occluded by nothing".into()),
            false if self.must_hit() => Some("not occluded, though something is there".into()),
            _ => None,
        }
    }
}

/// Verdicts on rays, of which at least `clear` in a hundred must have one right answer.
fn verdicts(name: &str, triangles: &Triangles, rays: &[Ray], clear: usize) -> Vec<Verdict> {
    let verdicts: Vec<Verdict> = rays.iter().map(|ray| Verdict::of(triangles, ray)).collect();
    let decided = verdicts.iter().filter(|verdict| verdict.is_clear()).count();
    assert!(decided * 100 >= clear * rays.len(), "{name}: only {decided} of {} rays are clear", rays.len());
    assert!(clear == 0 || verdicts.iter().any(Verdict::must_hit), "{name}: no ray must hit anything");
    verdicts
}

/// Asks every back end about every ray.
pub(crate) fn check(name: &str, triangles: &Arc<Triangles>, rays: &[Ray], clear: usize) {
    let verdicts = verdicts(name, triangles, rays, clear);
    each(triangles, |what, structure| hold(&format!("{name}, {what}"), structure, rays, &verdicts));
}

/// Holds the answers of a structure against the verdicts on these rays.
fn hold(what: &str, structure: &dyn Intersector, rays: &[Ray], verdicts: &[Verdict]) {
    for (ray, verdict) in rays.iter().zip(verdicts) {
        let objection = verdict
            .objection(structure.closest(ray))
            .or_else(|| verdict.occlusion_objection(structure.occluded(ray)));
        assert_eq!(objection, None, "{what}: {ray:?}");
    }
}

/// Whether a number is off by more than its error. NaN always is.
fn off(found: f32, truth: f64, error: f64) -> bool {
    let distance = (f64::from(found) - truth).abs();
    distance.is_nan() || distance > error
}

fn meet(triangles: &Triangles, triangle: usize, ray: &Ray) -> Option<Meeting> {
    let [a, b, c] = triangles.corners(triangle).map(Vec3A::as_dvec3);
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let (first, second) = (b - a, c - a);
    let normal = first.cross(second);
    let determinant = normal.dot(direction);
    if determinant == 0.0 {
        return None;
    }
    let to_corner = a - origin;
    let aside = direction.cross(to_corner);
    let (u, v) = (-aside.dot(second) / determinant, aside.dot(first) / determinant);
    let t = normal.dot(to_corner) / determinant;

    let unit = ROUNDINGS * f64::from(f32::EPSILON) / 2.0;
    let longest = first.length().max(second.length()).max((c - b).length());
    let reach = direction.length();
    // Each corner is as good a start as the first, and some tests subtract the origin from all of them.
    let distance = [a, b, c].map(|corner| (corner - origin).length()).into_iter().fold(0.0, f64::max);
    let products = first.length() * second.length();
    let weight_error = unit * reach * (longest * distance + products) / determinant.abs();
    // Watertight tests take the distance as the weighted mean of the corners' depths.
    let t_error = unit * products * (distance + t.abs() * reach) / determinant.abs()
        + unit * t.abs()
        + weight_error * longest / reach;
    let least = u.min(v).min(1.0 - u - v);

    let spread = a.abs().max(b.abs()).max(c.abs()).max(origin.abs()).length();
    let slant = determinant.abs() / (normal.length() * reach);
    // Distance to the nearest edge, as the ray sees it.
    let margin = least * normal.length() / longest * slant;
    let begins = t - f64::from(ray.t_min);
    let ends = f64::from(ray.t_max) - t;
    let outside = least < -weight_error && margin < -unit * spread;
    if outside || begins < -t_error || ends < -t_error || !weight_error.is_finite() {
        return None;
    }
    let sure = least > weight_error && margin > unit * spread && begins > t_error && ends > t_error;
    Some(Meeting { triangle: triangle as u32, t, t_error, u, v, weight_error: weight_error + unit, sure })
}
