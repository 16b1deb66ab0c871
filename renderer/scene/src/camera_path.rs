//! Camera paths: a smooth flight through key cameras.
//!
//! The paper moves its cameras along "a simple spline" and takes 100 positions of it (section 7.1.1). Ours is
//! a centripetal Catmull-Rom spline (Yuksel, Schaefer and Keyser, "Parameterization and applications of
//! Catmull-Rom curves", 2011). It passes through its keys. Unlike the uniform kind, it makes neither loops
//! nor cusps between keys at uneven distances.

use glam::Vec3;

use crate::{Camera, Scene, probe};

/// A flight from the first key camera to the last.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPath {
    keys: Vec<Camera>,
    /// Moment of each key, rising from 0 to 1; keys far from each other are far apart in time too.
    moments: Vec<f32>,
}

impl CameraPath {
    /// A scene's path: through its keys, else a gentle swing around its first camera and back.
    pub fn of(scene: &Scene) -> Self {
        Self::through(if scene.path_keys.is_empty() { swing(scene) } else { scene.path_keys.clone() })
    }

    /// A path through keys, in order; at least one.
    fn through(keys: Vec<Camera>) -> Self {
        // Centripetal: time goes with the root of the distance, the target's too, for turns on the spot.
        let mut moments = vec![0.0_f32];
        for pair in keys.windows(2) {
            let distance =
                pair[0].position.distance(pair[1].position) + 0.5 * pair[0].target.distance(pair[1].target);
            let last = moments.last().copied().unwrap_or(0.0);
            moments.push(last + distance.sqrt());
        }
        let total = moments.last().copied().unwrap_or(0.0);
        if total > 0.0 && total.is_finite() {
            moments.iter_mut().for_each(|moment| *moment /= total);
        } else {
            let last = (keys.len() - 1).max(1) as f32;
            moments = (0..keys.len()).map(|index| index as f32 / last).collect();
        }
        Self { keys, moments }
    }

    /// The camera at a moment from 0 (first key) to 1 (last key), clamped; NaN counts as 0.
    pub fn sample(&self, moment: f32) -> Camera {
        let moment = if moment.is_finite() { moment.clamp(0.0, 1.0) } else { 0.0 };
        let last = self.keys.len() - 1;
        if last == 0 {
            return self.keys[0];
        }
        let segment = self.moments[1..last].iter().filter(|begin| **begin <= moment).count();
        let along = Segment::new(&self.moments, segment, moment);
        let vector = |of: fn(&Camera) -> Vec3| along.blend(|key| of(&self.keys[key]));
        let fov = along.blend(|key| Vec3::splat(self.keys[key].vertical_fov_deg)).x;
        Camera {
            position: vector(|key| key.position),
            target: vector(|key| key.target),
            up: vector(|key| key.up).normalize_or(Vec3::Y),
            // The spline may overshoot its keys a little, the angle must not leave its range.
            vertical_fov_deg: fov.clamp(1.0, 170.0),
            framed_aspect: self.keys[along.around[1]].framed_aspect,
        }
    }
}

/// A place between two keys, as a cubic with the slopes of the spline at both.
struct Segment {
    /// The four keys that matter, the second and third around the place; clamped at the ends.
    around: [usize; 4],
    /// Their moments, with steps mirrored at the ends.
    moments: [f32; 4],
    /// Share of the way from the second to the third.
    share: f32,
}

impl Segment {
    fn new(moments: &[f32], segment: usize, moment: f32) -> Self {
        let last = moments.len() - 1;
        let around = [segment.saturating_sub(1), segment, segment + 1, (segment + 2).min(last)];
        let mut times = around.map(|index| moments[index]);
        let span = times[2] - times[1];
        if segment == 0 {
            times[0] = times[1] - span;
        }
        if segment + 1 == last {
            times[3] = times[2] + span;
        }
        let share = if span > 0.0 { ((moment - times[1]) / span).clamp(0.0, 1.0) } else { 0.0 };
        Self { around, moments: times, share }
    }

    fn blend(&self, of: impl Fn(usize) -> Vec3) -> Vec3 {
        let [mut before, from, to, mut after] = self.around.map(of);
        // Beyond the ends the path is thought to go straight on.
        if self.around[0] == self.around[1] {
            before = from + (from - to);
        }
        if self.around[2] == self.around[3] {
            after = to + (to - from);
        }
        let [t0, t1, t2, t3] = self.moments;
        let span = t2 - t1;
        let slope = |a: Vec3, b: Vec3, ta: f32, tb: f32| {
            if tb > ta { (b - a) / (tb - ta) } else { Vec3::ZERO }
        };
        // Slopes at the inner keys of the non-uniform spline; keys at one place have none.
        let leave = slope(before, from, t0, t1) - slope(before, to, t0, t2) + slope(from, to, t1, t2);
        let arrive = slope(from, to, t1, t2) - slope(from, after, t1, t3) + slope(to, after, t2, t3);
        let (t, t2, t3) = (self.share, self.share.powi(2), self.share.powi(3));
        from * (2.0 * t3 - 3.0 * t2 + 1.0)
            + leave * (span * (t3 - 2.0 * t2 + t))
            + to * (3.0 * t2 - 2.0 * t3)
            + arrive * (span * (t3 - t2))
    }
}

/// Reach of a swing to each side, as a share of the distance to the target.
const SWING: f32 = 0.22;
/// Share of the free way before the next wall that a swing may use.
const FREE: f32 = 0.5;

/// Keys of a swing to the left and right, with a step forward between, that stays clear of walls.
fn swing(scene: &Scene) -> Vec<Camera> {
    let first = scene.cameras[0];
    let bounds = scene.bounds();
    let [right, up, forward] = first.axes();
    let reach = first.target.distance(first.position).min(bounds.diagonal()) * SWING;
    let directions = [-right, right, forward, up];
    let free = probe::nearest(&scene.placed(), first.position, &directions);
    let [left_way, right_way, forward_way, up_way] =
        [0, 1, 2, 3].map(|index| reach.min(free[index].distance * FREE));
    let is_inside = bounds.contains(first.position);
    let at = |offset: Vec3| {
        let mut position = first.position + offset;
        if is_inside {
            position = position.clamp(bounds.min, bounds.max);
        }
        Camera { position, ..first }
    };
    vec![
        first,
        at(right * (right_way * 0.8) + forward * (forward_way * 0.3)),
        at(forward * forward_way + up * (up_way * 0.3)),
        at(-right * (left_way * 0.8) + forward * (forward_way * 0.3)),
        at(-right * (left_way * 0.5) + up * (up_way * 0.2)),
        first,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin;
    use proptest::prelude::*;

    fn camera(x: f32, y: f32, z: f32) -> Camera {
        Camera::upright(Vec3::new(x, y, z), Vec3::new(z, x, y), 30.0 + x.abs())
    }

    /// Cameras at even moments, the first and the last key included.
    fn positions(path: &CameraPath, count: usize) -> Vec<Camera> {
        (0..count).map(|index| path.sample(index as f32 / (count - 1) as f32)).collect()
    }

    #[test]
    fn one_key_and_equal_keys_stand_still() {
        let key = camera(1.0, 2.0, 3.0);
        for keys in [vec![key], vec![key; 4]] {
            let path = CameraPath::through(keys);
            assert!(positions(&path, 7).iter().all(|sample| sample.position == key.position));
        }
    }

    #[test]
    fn a_straight_line_is_walked_straight_on() {
        let path = CameraPath::through((0..4).map(|x| camera(x as f32, 0.0, 0.0)).collect());
        let walked = positions(&path, 31);
        for pair in walked.windows(2) {
            assert!((pair[1].position.x - pair[0].position.x - 0.1).abs() < 1e-4);
            assert!(pair[0].position.y.abs() < 1e-6);
        }
        assert_eq!(path.sample(f32::NAN), path.sample(-3.0));
    }

    #[test]
    fn built_in_scenes_are_flown_through_their_keys() {
        let scene = builtin::build("quick", &builtin::Options { detail: 0.2, ..builtin::Options::default() })
            .unwrap();
        let path = CameraPath::of(&scene);
        assert_eq!(path.keys, scene.path_keys);
    }

    #[test]
    fn a_swing_stays_in_the_room_and_comes_back() {
        let mut scene =
            builtin::build("quick", &builtin::Options { detail: 0.2, ..builtin::Options::default() })
                .unwrap();
        scene.path_keys.clear();
        let bounds = scene.bounds();
        let samples = positions(&CameraPath::of(&scene), 100);
        assert!(samples.iter().all(|sample| bounds.contains(sample.position)));
        assert!(samples[0].position.distance(samples[99].position) < 1e-4);
        assert!(samples.iter().any(|sample| sample.position.distance(samples[0].position) > 0.2));
    }

    proptest! {
        #[test]
        fn every_key_is_passed(coordinates in proptest::collection::vec((-50.0_f32..50.0, -5.0_f32..5.0, -50.0_f32..50.0), 1..8)) {
            let keys: Vec<Camera> = coordinates.into_iter().map(|(x, y, z)| camera(x, y, z)).collect();
            let path = CameraPath::through(keys.clone());
            for (key, moment) in keys.iter().zip(&path.moments) {
                let sample = path.sample(*moment);
                prop_assert!(sample.position.distance(key.position) < 1e-3);
                prop_assert!(sample.target.distance(key.target) < 1e-3);
                prop_assert!((sample.vertical_fov_deg - key.vertical_fov_deg).abs() < 1e-3);
            }
        }

        #[test]
        fn nothing_jumps(coordinates in proptest::collection::vec((-50.0_f32..50.0, -5.0_f32..5.0, -50.0_f32..50.0), 2..8)) {
            let path = CameraPath::through(coordinates.into_iter().map(|(x, y, z)| camera(x, y, z)).collect());
            let fine = positions(&path, 2001);
            let length: f32 = fine.windows(2).map(|pair| pair[0].position.distance(pair[1].position)).sum();
            for pair in fine.windows(2) {
                prop_assert!(pair[0].position.distance(pair[1].position) <= length * 0.02 + 1e-3);
            }
        }
    }
}
