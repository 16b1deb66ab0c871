//! Trials of several frames, where a study asks for them ([`crate::StudyBuilder::episode_frames`]). A trial's
//! measurements are then the means of its frames; it ends early once its mean must be above its cap.

use std::collections::BTreeMap;
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant, SystemTime};

use treewright_model::objective::Objective;

use crate::{Indicators, Measurements, Outcome, StudySpec, checks, limits};

/// Name of the measurement of [`episode_trend`].
const TREND: &str = "trend";

#[derive(Debug)]
pub(crate) struct Episode {
    planned: usize,
    /// The study's limits hold.
    has_limits: bool,
    /// The state of the first frame.
    indicators: Arc<Indicators>,
    /// The objective of each frame.
    costs: Vec<f64>,
    /// Of each measurement that every frame had; of maximised ones, of their reciprocals.
    sums: Measurements,
    /// The sums of squares of their standard errors.
    squares: BTreeMap<String, f64>,
    /// The lease is renewed after this time; `None` for a lease without an end.
    renew_after: Option<Duration>,
    renewed: Instant,
}

impl Episode {
    pub(crate) fn new(frames: u32, indicators: &Indicators, lease_expires: Option<SystemTime>) -> Self {
        let planned = frames as usize;
        // For a daemon whose clock is behind, a lease seems to have ended.
        let left = lease_expires.map(|end| end.duration_since(SystemTime::now()).unwrap_or_default());
        Self {
            planned,
            has_limits: true,
            indicators: Arc::new(indicators.clone()),
            costs: Vec::with_capacity(planned),
            sums: Measurements::new(),
            squares: BTreeMap::new(),
            // A renewal that fails is repeated before the lease ends.
            renew_after: left.map(|left| (left / 3).max(limits::LEAST_RENEWAL)),
            renewed: Instant::now(),
        }
    }

    /// Of a trial at a cheaper level.
    pub(crate) fn without_limits(self) -> Self {
        Self { has_limits: false, ..self }
    }

    /// Whether a frame of these indicators can be its next: their state is that of its first frame.
    pub(crate) fn is_in(&self, spec: &StudySpec, indicators: &Indicators) -> bool {
        checks::are_one_state(spec, &self.indicators, indicators)
    }

    /// Its state, for as long as the trial has not ended.
    pub(crate) fn state(&self) -> Weak<Indicators> {
        Arc::downgrade(&self.indicators)
    }

    pub(crate) fn has_one_frame_left(&self) -> bool {
        self.costs.len() + 1 == self.planned
    }

    /// Whether a third of the lease is over since this was last the answer.
    pub(crate) fn renewal_is_due(&mut self) -> bool {
        let is_due = self.renew_after.is_some_and(|after| self.renewed.elapsed() >= after);
        if is_due {
            self.renewed = Instant::now();
        }
        is_due
    }

    /// The cost of the next frame from which on the mean must be above `cap`.
    pub(crate) fn frame_cap(&self, cap: f64) -> f64 {
        (cap * self.planned as f64 - self.spent()).max(0.0)
    }

    fn spent(&self) -> f64 {
        self.costs.iter().sum()
    }

    /// Takes the result of a frame, which was checked. Returns that of the trial, once it is known.
    pub(crate) fn push(
        &mut self,
        objective: &Objective,
        cap: Option<f64>,
        measured: Measurements,
        outcome: Outcome,
    ) -> Option<(Measurements, Outcome)> {
        let planned = self.planned as f64;
        match outcome {
            Outcome::Ok => {}
            Outcome::Aborted { lower_bound } => {
                // The frames that are left would have cost at least nothing.
                let bound = (self.spent() + lower_bound) / planned;
                return Some((Measurements::new(), Outcome::aborted(bound)));
            }
            Outcome::Infeasible { .. } | Outcome::Failed { .. } => return Some((measured, outcome)),
        }
        // A frame beyond a limit needs no cost. It makes the trial infeasible, whatever the others are.
        let beyond = if self.has_limits { objective.beyond(&measured.0) } else { Ok(None) };
        let cost = match (beyond, objective.cost(&measured.0)) {
            (Ok(None), Ok(cost)) => cost,
            _ => return Some((measured, Outcome::Ok)),
        };
        self.add(objective, &measured);
        self.costs.push(cost);
        if self.costs.len() == self.planned {
            return Some((self.means(objective), Outcome::Ok));
        }
        let bound = self.spent() / planned;
        cap.is_some_and(|cap| bound > cap).then(|| (Measurements::new(), Outcome::aborted(bound)))
    }

    fn add(&mut self, objective: &Objective, measured: &Measurements) {
        let summand = |metric: &str, value: f64| {
            if is_maximised(objective, metric) { 1.0 / value } else { value }
        };
        for (metric, error) in &measured.1 {
            let value = measured.get(metric).unwrap_or_default();
            // The relative errors of a value and of its reciprocal are equal.
            let error = if is_maximised(objective, metric) { error / value / value } else { *error };
            *self.squares.entry(metric.clone()).or_default() += error * error;
        }
        if self.costs.is_empty() {
            self.sums = measured.iter().map(|(metric, value)| (metric, summand(metric, value))).collect();
            return;
        }
        self.sums.0.retain(|metric, sum| {
            let value = measured.get(metric);
            *sum += value.map_or(0.0, |value| summand(metric, value));
            value.is_some()
        });
    }

    /// The means of all frames. That of a maximised metric is the harmonic one, so that the trial's cost is
    /// the mean of its frames' costs. The errors of frames are independent.
    fn means(&self, objective: &Objective) -> Measurements {
        let frames = self.costs.len() as f64;
        let mean = |(metric, sum): (&str, f64)| {
            let mean = if is_maximised(objective, metric) { frames / sum } else { sum / frames };
            (metric.to_owned(), within_limits(objective, metric, mean))
        };
        let mut means: Measurements = self.sums.iter().map(mean).collect();
        for (metric, square) in &self.squares {
            if let Some((sum, mean)) = self.sums.get(metric).zip(means.get(metric)) {
                let of_sum = if is_maximised(objective, metric) { mean / sum } else { 1.0 / frames };
                means.1.insert(metric.clone(), square.sqrt() * of_sum);
            }
        }
        if let Some(trend) = episode_trend(&self.costs)
            && means.get(TREND).is_none()
            && means.len() < Measurements::MOST
        {
            means.set(TREND, trend);
        }
        means
    }
}

fn is_maximised(objective: &Objective, metric: &str) -> bool {
    objective.maximised().iter().any(|one| one == metric)
}

/// The mean of frames of which none was beyond a limit: so it is not, whatever its last digit is.
fn within_limits(objective: &Objective, metric: &str, mean: f64) -> f64 {
    let limit = objective.limits().iter().find(|limit| limit.metric == metric);
    limit.map_or(mean, |limit| {
        mean.clamp(limit.at_least.unwrap_or(f64::NEG_INFINITY), limit.at_most.unwrap_or(f64::INFINITY))
    })
}

/// The mean cost of a trial's frames in their second half over that in their first: above 1 they become
/// dearer while the configuration is in use. The first frame, which pays for what is built once, is left
/// out. `None` for less than five frames, and where frames cost nothing.
pub fn episode_trend(costs: &[f64]) -> Option<f64> {
    let later = costs.get(1..).filter(|later| later.len() > 3)?;
    let mean = |costs: &[f64]| costs.iter().sum::<f64>() / costs.len() as f64;
    let (first, second) = later.split_at(later.len() / 2);
    Some(mean(second) / mean(first)).filter(|trend| trend.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Scale, Space, StudyBuilder};

    fn builder() -> StudyBuilder {
        let space = Space::builder().boolean("compact").default(false).build().unwrap();
        StudySpec::builder(space).indicator("triangles", 0.0..=1e6, Scale::Log)
    }

    fn at(triangles: f64) -> Indicators {
        Indicators::from([("triangles", triangles)])
    }

    /// The number of frames that ran, and the trial's result.
    fn run(
        spec: &StudySpec,
        cap: Option<f64>,
        frames: &[Measurements],
    ) -> (usize, Option<(Measurements, Outcome)>) {
        let mut episode = Episode::new(spec.objective.episode_frames(), &at(10.0), None);
        for (index, measured) in frames.iter().enumerate() {
            if let Some(result) = episode.push(&spec.objective, cap, measured.clone(), Outcome::Ok) {
                return (index + 1, Some(result));
            }
        }
        (frames.len(), None)
    }

    fn of_times(times: &[f64]) -> Vec<Measurements> {
        times.iter().map(|&ms| Measurements::from([("render_ms", ms)])).collect()
    }

    #[test]
    fn a_trial_is_the_mean_of_its_frames() {
        let spec = builder().minimise("render_ms", 1.0).episode_frames(4).build().unwrap();
        let mut frames = of_times(&[8.0, 2.0, 2.0, 4.0]);
        for (frame, cpu_ms) in frames.iter_mut().zip([1.0, 2.0, 3.0, 4.0]) {
            frame.set("cpu_ms", cpu_ms);
        }
        frames[0].set("build_ms", 7.0);
        let means = Measurements::from([("render_ms", 4.0), ("cpu_ms", 2.5)]);
        assert_eq!(run(&spec, None, &frames), (4, Some((means, Outcome::Ok))), "a build of one is no mean");
        assert_eq!(run(&spec, None, &frames[..3]), (3, None));
    }

    #[test]
    fn the_mean_of_a_rate_is_that_of_its_costs() {
        let spec = builder().maximise("fps", 1000.0).episode_frames(2).build().unwrap();
        let frames = [100.0, 25.0].map(|fps| Measurements::from([("fps", fps)]));
        let (_, result) = run(&spec, None, &frames);
        let means = result.unwrap().0;
        assert_eq!(means.get("fps"), Some(40.0));
        assert_eq!(spec.objective.cost(&means.0), Ok(25.0), "of 10 and 40 ms");
    }

    #[test]
    fn standard_errors_of_frames_are_those_of_their_mean() {
        let spec = builder().minimise("error_ms", 1.0).maximise("fps", 1000.0);
        let spec = spec.episode_frames(2).build().unwrap();
        let frame = |fps: f64, errors: [f64; 2]| {
            let measured = Measurements::from([("error_ms", 8.0), ("fps", fps)]);
            measured.with_standard_error("error_ms", errors[0]).with_standard_error("fps", errors[1])
        };
        let frames = [frame(100.0, [3.0, 20.0]), frame(25.0, [4.0, 0.0])];
        let means = run(&spec, None, &frames).1.unwrap().0;
        assert_eq!(means.1.get("error_ms"), Some(&2.5));
        // The times are 10 ms with an error of 2, and 40 ms: 25 ms with an error of 1.
        let relative = spec.objective.relative_error(&means.0, &means.1);
        let expected = (2.5_f64.powi(2) + 1.0).sqrt() / 33.0;
        assert!((relative / expected - 1.0).abs() < 1e-12, "{relative} is not {expected}");
    }

    #[test]
    fn it_ends_once_its_mean_must_be_above_the_cap() {
        let spec = builder().minimise("render_ms", 1.0).episode_frames(4).build().unwrap();
        let frames = of_times(&[8.0, 16.0, 20.0, 1.0]);
        let stopped = Some((Measurements::new(), Outcome::aborted(11.0)));
        assert_eq!(run(&spec, Some(10.0), &frames), (3, stopped));
        // In its last frame there is nothing left to end.
        assert_eq!(run(&spec, Some(11.1), &frames).0, 4);
        assert_eq!(run(&spec, Some(11.0), &frames).1.unwrap().0.get("render_ms"), Some(11.25));
    }

    #[test]
    fn a_frame_that_is_stopped_stops_the_trial() {
        let spec = builder().minimise("render_ms", 1.0).episode_frames(4).build().unwrap();
        let mut episode = Episode::new(4, &at(10.0), None);
        let objective = &spec.objective;
        assert_eq!(episode.frame_cap(10.0), 40.0);
        assert!(episode.push(objective, Some(10.0), of_times(&[30.0]).remove(0), Outcome::Ok).is_none());
        assert_eq!(episode.frame_cap(10.0), 10.0);
        let stopped = episode.push(objective, Some(10.0), Measurements::new(), Outcome::aborted(12.0));
        assert_eq!(stopped, Some((Measurements::new(), Outcome::aborted(10.5))));
        let crashed = Outcome::failed("the device is lost");
        let failed =
            Episode::new(4, &at(10.0), None).push(objective, None, Measurements::new(), crashed.clone());
        assert_eq!(failed, Some((Measurements::new(), crashed)));
    }

    #[test]
    fn a_frame_beyond_a_limit_is_the_result() {
        let limited = builder().minimise("render_ms", 1.0).limit("memory_mb", None, Some(100.0));
        let spec = limited.episode_frames(4).build().unwrap();
        let frames = [90.0, 101.0, 90.0]
            .map(|memory_mb| Measurements::from([("render_ms", 1.0), ("memory_mb", memory_mb)]));
        assert_eq!(run(&spec, None, &frames), (2, Some((frames[1].clone(), Outcome::Ok))));
        let mut cheaper = Episode::new(4, &at(10.0), None).without_limits();
        let mut results =
            frames.map(|frame| cheaper.push(&spec.objective, None, frame, Outcome::Ok)).into_iter();
        assert!(results.all(|result| result.is_none()), "a level knows no limits");
    }

    #[test]
    fn a_mean_of_frames_at_a_limit_is_at_the_limit() {
        // 24 times 0.9 is a little less than 21.6, and three times 0.1 a little more than 0.3.
        for (frames, value, ends) in [(24, 0.9, (Some(0.9), None)), (3, 0.1, (None, Some(0.1)))] {
            let spec = builder().minimise("render_ms", 1.0).limit("ratio", ends.0, ends.1);
            let spec = spec.episode_frames(frames).build().unwrap();
            let frame = Measurements::from([("render_ms", 1.0), ("ratio", value)]);
            let (_, result) = run(&spec, None, &vec![frame; frames as usize]);
            let means = result.unwrap().0;
            assert_eq!(spec.objective.beyond(&means.0), Ok(None), "{means:?}");
        }
    }

    #[test]
    fn the_trend_leaves_the_first_frame_out() {
        assert_eq!(episode_trend(&[90.0, 1.0, 3.0, 4.0, 4.0]), Some(2.0));
        assert_eq!(episode_trend(&[90.0, 1.0, 3.0, 4.0]), None, "too few");
        assert_eq!(episode_trend(&[90.0, 0.0, 0.0, 4.0, 4.0]), None, "no factor");
        let spec = builder().minimise("render_ms", 1.0).episode_frames(5).build().unwrap();
        let (_, result) = run(&spec, None, &of_times(&[90.0, 1.0, 3.0, 4.0, 4.0]));
        assert_eq!(result.unwrap().0.get(TREND), Some(2.0));
        // A measurement of that name is the program's own.
        let own = of_times(&[1.0; 5]).into_iter().map(|frame| frame.with(TREND, 7.0)).collect::<Vec<_>>();
        assert_eq!(run(&spec, None, &own).1.unwrap().0.get(TREND), Some(7.0));
    }

    #[test]
    fn it_stays_in_its_state_and_keeps_its_lease() {
        let spec = builder().minimise("render_ms", 1.0).episode_frames(2).build().unwrap();
        let mut episode = Episode::new(2, &at(1000.0), Some(SystemTime::now() + Duration::from_secs(60)));
        assert!(episode.is_in(&spec, &at(1010.0)) && !episode.is_in(&spec, &at(9000.0)));
        assert!(!episode.is_in(&spec, &Indicators::new()));
        assert!(episode.renew_after.is_some_and(|after| (15.0..=20.0).contains(&after.as_secs_f64())));
        assert!(!episode.renewal_is_due());
        episode.renew_after = Some(Duration::ZERO);
        assert!(episode.renewal_is_due());
        let behind = Episode::new(2, &at(1000.0), Some(SystemTime::UNIX_EPOCH));
        assert_eq!(behind.renew_after, Some(limits::LEAST_RENEWAL), "often instead of never");
        assert!(!Episode::new(2, &at(1000.0), None).renewal_is_due());
    }
}
