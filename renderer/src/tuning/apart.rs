//! Real time: frames that need not be rendered again.
//!
//! Every frame pays for its build, whose noise is mostly several times a frame's. So the mean of a
//! configuration's known frames may stand for a new one, if its error adds little to that of the mean of the
//! builds.
//!
//! The machine's speed drifts, so only the last trials are known; a measurement that contradicts them ends
//! that.

use treewright_accel::BuildChoice;

use crate::{limits::TRIALS_APART_MAX, scheduling::ThreadTimes, space::Choice};

/// Least frames of a configuration whose mean may stand for new ones.
const KNOWN_LEAST: usize = 2;
/// Least degrees of freedom of an estimate of noise.
const DEGREES_LEAST: usize = 4;
/// The error of the mean frame may add this share to the variance of the mean of the builds.
const ERROR_SHARE_MAX: f64 = 0.25;
/// A measurement that is off by more than this number of standard deviations contradicts what is known.
const DEVIATIONS_MAX: f64 = 3.0;

/// The time of a build or of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Timed {
    /// By the clock on the wall.
    pub(super) ms: f64,
    /// Processor times of its threads.
    pub(super) threads: ThreadTimes,
}

impl Timed {
    fn mean(all: &[Timed]) -> Self {
        let count = all.len().max(1) as f64;
        let mean = |of: fn(&Timed) -> f64| all.iter().map(of).sum::<f64>() / count;
        let delays: Option<Vec<f64>> = all.iter().map(|one| one.threads.delay_ms).collect();
        let delay_ms = delays.map(|delays| delays.iter().sum::<f64>() / count);
        let threads = ThreadTimes { cpu_ms: mean(|one| one.threads.cpu_ms), delay_ms };
        Self { ms: mean(|one| one.ms), threads }
    }
}

/// A build or a frame in a trial of that number.
#[derive(Debug)]
struct Seen<K> {
    trial: u64,
    of: K,
    times: Timed,
}

/// All builds of one choice, or all frames of one configuration.
#[derive(Clone, Copy, Debug)]
struct Known {
    mean: Timed,
    count: usize,
    /// Of one measurement, in square milliseconds.
    variance: f64,
}

impl Known {
    /// Of those alike; `None` where that is too little. Noise is the same share of every mean.
    fn of<K: PartialEq>(of: &K, all: &[Seen<K>]) -> Option<Self> {
        let alike =
            |of: &K| -> Vec<Timed> { all.iter().filter(|one| one.of == *of).map(|one| one.times).collect() };
        let is_first = |place: usize| all[..place].iter().all(|before| before.of != all[place].of);
        let means = (0..all.len()).filter(|place| is_first(*place)).count();
        let (own, degrees) = (alike(of), all.len() - means);
        if own.len() < KNOWN_LEAST || degrees < DEGREES_LEAST {
            return None;
        }
        let square = |one: &Seen<K>| (one.times.ms / Timed::mean(&alike(&one.of)).ms - 1.0).powi(2);
        let noise = all.iter().map(square).sum::<f64>() / degrees as f64;
        let mean = Timed::mean(&own);
        Some(Self { mean, count: own.len(), variance: noise * mean.ms.powi(2) })
    }

    /// Whether its mean may stand for a new measurement beside one more of `other`.
    fn may_stand_beside(&self, other: &Known) -> bool {
        let error = self.variance / self.count as f64;
        error <= ERROR_SHARE_MAX * other.variance / (other.count + 1) as f64
    }

    fn agrees(&self, new: Timed) -> bool {
        let variance = self.variance * (1.0 + 1.0 / self.count as f64);
        (new.ms - self.mean.ms).abs() <= DEVIATIONS_MAX * variance.sqrt()
    }
}

/// Builds by their choice and frames by their configuration, of the last trials of one view.
#[derive(Debug, Default)]
pub(super) struct Apart {
    trial: u64,
    builds: Vec<Seen<BuildChoice>>,
    frames: Vec<Seen<Choice>>,
}

impl Apart {
    /// Begins a trial with its build. Returns the time of its frame where that need not be rendered.
    pub(super) fn built(&mut self, choice: &Choice, build: Timed) -> Option<Timed> {
        self.trial += 1;
        let trial = self.trial;
        self.builds.retain(|one| one.trial + TRIALS_APART_MAX > trial);
        self.frames.retain(|one| one.trial + TRIALS_APART_MAX > trial);
        let builds = Known::of(&choice.build, &self.builds);
        if !self.accepts(choice, builds, build) {
            return None;
        }
        self.builds.push(Seen { trial, of: choice.build, times: build });
        let frames = Known::of(choice, &self.frames)?;
        frames.may_stand_beside(&builds?).then_some(frames.mean)
    }

    pub(super) fn rendered(&mut self, choice: &Choice, frame: Timed) {
        if self.accepts(choice, Known::of(choice, &self.frames), frame) {
            self.frames.push(Seen { trial: self.trial, of: *choice, times: frame });
        }
    }

    /// Whether a measurement agrees with what is known, which else is forgotten.
    fn accepts(&mut self, choice: &Choice, known: Option<Known>, new: Timed) -> bool {
        let agrees = known.is_none_or(|known| known.agrees(new));
        if !agrees {
            self.builds.retain(|one| one.of != choice.build);
            self.frames.retain(|one| one.of != *choice);
        }
        agrees
    }
}

#[cfg(test)]
pub(super) mod testing {
    use super::*;

    /// A time whose threads worked twice as long and waited half as long.
    pub(super) fn timed(ms: f64) -> Timed {
        Timed { ms, threads: ThreadTimes { cpu_ms: 2.0 * ms, delay_ms: Some(ms / 2.0) } }
    }

    /// The knowledge after trials of a choice with these times. All of them had to render.
    pub(in crate::tuning) fn after(choice: &Choice, builds_ms: &[f64], frames_ms: &[f64]) -> Apart {
        let mut apart = Apart::default();
        for (build_ms, frame_ms) in builds_ms.iter().zip(frames_ms) {
            assert_eq!(apart.built(choice, timed(*build_ms)), None);
            apart.rendered(choice, timed(*frame_ms));
        }
        apart
    }
}

#[cfg(test)]
mod tests {
    use super::testing::{after, timed};
    use super::*;
    use treewright_accel::NativeQuality;

    /// Times around a mean, off by at most `noise_ms`.
    fn around(mean_ms: f64, noise_ms: f64) -> [f64; 5] {
        [-1.0, 0.6, 1.0, -0.6, 0.0].map(|share| mean_ms + share * noise_ms)
    }

    fn choice() -> Choice {
        Choice::native(NativeQuality::Medium)
    }

    /// The numbers of the trials that have to render, counted from 1, and the mean of all costs.
    fn rendering(builds_ms: [f64; 5], frames_ms: [f64; 5], trials: usize) -> (Vec<usize>, f64) {
        let (mut apart, mut rendering, mut sum_ms) = (Apart::default(), Vec::new(), 0.0);
        for trial in 1..=trials {
            let build = timed(builds_ms[trial % 5]);
            let frame = apart.built(&choice(), build).unwrap_or_else(|| {
                rendering.push(trial);
                timed(frames_ms[rendering.len() % 5])
            });
            if rendering.last() == Some(&trial) {
                apart.rendered(&choice(), frame);
            }
            sum_ms += build.ms + frame.ms;
        }
        (rendering, sum_ms / trials as f64)
    }

    #[test]
    fn frames_are_rendered_as_often_as_their_noise_asks() {
        let (few, mean_ms) = rendering(around(300.0, 9.0), around(80.0, 0.1), 30);
        assert_eq!(few, [1, 2, 3, 4, 5]);
        assert!((mean_ms - 380.0).abs() < 1e-6, "{mean_ms}");
        // A third of the builds' noise: four frames for nine builds.
        let (some, mean_ms) = rendering(around(300.0, 9.0), around(80.0, 3.0), 30);
        assert!((12..=16).contains(&some.len()), "{some:?}");
        assert!((mean_ms - 380.0).abs() < 0.5, "{mean_ms}");
        for builds_ms in [around(300.0, 3.0), around(300.0, 0.1)] {
            assert_eq!(rendering(builds_ms, around(80.0, 3.0), 30).0.len(), 30);
        }
    }

    #[test]
    fn what_is_known_grows_old() {
        let (rendering, _) = rendering(around(300.0, 9.0), around(80.0, 0.1), 40);
        assert_eq!(rendering, [1, 2, 3, 4, 5, 33, 34, 35, 36, 37]);
    }

    #[test]
    fn the_first_trial_of_a_configuration_renders() {
        let mut apart = after(&choice(), &around(300.0, 9.0), &around(80.0, 0.1));
        let mut render = choice().render;
        render.staged = !render.staged;
        let other = Choice { render, ..choice() };
        assert_eq!(apart.built(&other, timed(300.0)), None);
        apart.rendered(&other, timed(60.0));
        assert_eq!(apart.built(&other, timed(300.0)), None, "one frame is known with all of its noise");
    }

    #[test]
    fn a_frame_that_is_spared_is_the_mean_of_those_that_were_rendered() {
        let mut apart = after(&choice(), &around(300.0, 9.0), &around(80.0, 0.5));
        let spared = apart.built(&choice(), timed(303.0)).expect("it is known");
        let (wanted, near) = (timed(80.0), |a: f64, b: f64| (a - b).abs() < 1e-9);
        assert!(near(spared.ms, wanted.ms) && near(spared.threads.cpu_ms, wanted.threads.cpu_ms));
        let delays = spared.threads.delay_ms.zip(wanted.threads.delay_ms);
        assert!(delays.is_some_and(|(a, b)| near(a, b)), "{spared:?}");
    }

    #[test]
    fn what_contradicts_it_makes_known_times_void() {
        let (builds_ms, frames_ms) = (around(300.0, 9.0), around(80.0, 0.1));
        let mut apart = after(&choice(), &builds_ms, &frames_ms);
        // The machine has become slower by a fifth.
        for build_ms in builds_ms.into_iter().chain([300.0]) {
            assert_eq!(apart.built(&choice(), timed(1.2 * build_ms)), None);
            apart.rendered(&choice(), timed(96.0));
        }
        let spared = apart.built(&choice(), timed(360.0)).expect("it is known again");
        assert!((spared.ms - 96.0).abs() < 1e-9, "{spared:?}");
        // A frame may tell as well.
        let mut apart = after(&choice(), &builds_ms, &frames_ms);
        apart.rendered(&choice(), timed(96.0));
        assert_eq!(apart.built(&choice(), timed(300.0)), None);
    }
}
