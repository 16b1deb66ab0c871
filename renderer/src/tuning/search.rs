//! The tuning loop: ask for a configuration, build, render, report.
//!
//! A build that fails is an outcome like any other, and the frame is skipped. A daemon that is away costs one
//! deadline at most, and the frame is rendered with the last good configuration. Nobody looks at the frames
//! of a search, so a frame that costs more than its trial is allowed
//! ([`abort_above`](treewright_client::Suggestion::abort_above)) is left unfinished.

use std::{sync::Arc, time::Instant};

use serde::Serialize;
use treewright_accel::BuildError;
use treewright_client::{
    ClientError, Configuration, Finished, FrameSet, FrameSetResult, Indicators, Measurements, Mode, OpenEnum,
    Outcome, Rule, Source,
};

use super::apart::{Apart, Timed};
use super::objective::{Objective, measurements};
use super::patience::NextTrial;
use crate::disturbance::{Disturbance, Watch};
use crate::frame::{FrameTimes, Ready, Renderer, milliseconds};
use crate::space::{Choice, TuningSpace};
use crate::{
    film::Film, integrator::View, limits::FRAMES_PER_SLOW_BUILD_MAX, scheduling::ThreadTimes,
    statistics::Summary,
};

/// One frame of the search.
#[derive(Clone, Debug, Serialize)]
pub struct Iteration {
    /// Counted from 1.
    pub number: u32,
    /// Name of the trial; absent when the daemon was away.
    pub trial: Option<String>,
    /// Why this configuration.
    pub mode: OpenEnum<Mode>,
    /// Where it came from.
    pub source: Source,
    /// The reason in one sentence.
    pub reason: String,
    /// The step of the search, e.g. `reflect`.
    pub step: String,
    /// The rule that decided; absent when the daemon was away.
    pub rule: Option<OpenEnum<Rule>>,
    /// The configuration that was run.
    pub configuration: Configuration,
    /// The cost that the service expected.
    pub predicted_cost: Option<f64>,
    /// Whether the trial was measured, stopped early, or could not be built.
    pub outcome: Outcome,
    /// The frame's times; absent when the structure could not be built, or the trial was stopped.
    pub times: Option<FrameTimes>,
    /// The objective.
    pub cost: Option<f64>,
    /// Time that the trial waited for the service: the previous report and this suggestion.
    pub waiting_ms: f64,
    /// Everything this iteration took.
    pub total_ms: f64,
}

impl Iteration {
    /// Its cost when it was stopped, if it was.
    pub fn stopped_at(&self) -> Option<f64> {
        match self.outcome {
            Outcome::Aborted { lower_bound } => Some(lower_bound),
            _ => None,
        }
    }

    /// The frames that it showed, `frames` unless it says otherwise; 0 where none was rendered whole.
    pub fn frames(&self, frames: u32) -> u32 {
        self.times.map_or(0, |times| times.frames.unwrap_or(frames))
    }

    /// Whether there is neither a cost nor a bound of one.
    pub fn has_failed(&self) -> bool {
        self.cost.is_none() && self.stopped_at().is_none()
    }
}

/// The constant part of a search.
#[derive(Clone, Debug)]
pub struct SearchSetting {
    /// The objective.
    pub objective: Objective,
    /// The tuning space.
    pub space: Arc<TuningSpace>,
    /// The choice that trials are compared with while the search runs.
    pub baseline: Choice,
    /// The rendered view.
    pub view: View,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Frames of each trial; the median counts.
    pub frames: u32,
    /// The state, as the service sees it.
    pub indicators: Indicators,
}

impl SearchSetting {
    /// The measurements to report of a trial.
    pub fn measurements(&self, times: Option<FrameTimes>) -> Measurements {
        measurements(times, self.frames, self.objective)
    }
}

/// The result of a search.
#[derive(Clone, Debug)]
pub struct SearchOutcome {
    /// Every frame.
    pub trials: Vec<Iteration>,
    /// Median cost of the baseline before and after the search, which its costs are compared with.
    pub reference_ms: f64,
    /// The other work of the machine meanwhile, and the spread of these frames of the baseline.
    pub disturbance: Disturbance,
}

impl SearchOutcome {
    /// The measured trial of the lowest cost.
    pub fn lowest(&self) -> Option<&Iteration> {
        let measured = self.trials.iter().filter_map(|trial| Some((trial.cost?, trial)));
        measured.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, trial)| trial)
    }

    /// Adds trials that came after the others.
    pub fn append(&mut self, trials: Vec<Iteration>) {
        let last = self.trials.last().map_or(0, |trial| trial.number);
        let numbered = trials.into_iter().map(|trial| Iteration { number: last + trial.number, ..trial });
        self.trials.extend(numbered);
    }

    /// The trials of a search in a part of a space, with the values that it [holds](TuningSpace::with_held).
    pub fn whole_trials(&self, part: &TuningSpace) -> Vec<Iteration> {
        let whole = |trial: &Iteration| part.with_held(&trial.configuration);
        self.trials.iter().map(|trial| Iteration { configuration: whole(trial), ..trial.clone() }).collect()
    }
}

/// Frames of the baseline before the search, and again after it.
const REFERENCE_FRAMES: usize = 3;
/// Frames per build from which a structure is used again: a build is a sixteenth of the cost at most then.
const REUSE_FROM_FRAMES_PER_BUILD: u32 = 16;
/// Frames that follow a slow build may take this share of it.
const FRAMES_SHARE_OF_BUILD: f64 = 0.1;

/// Runs iterations until `on_iteration` says no. The last report may not be acknowledged yet.
pub fn run(
    renderer: &mut Renderer,
    tuner: &mut dyn NextTrial,
    setting: &SearchSetting,
    iterations: u32,
    on_iteration: impl FnMut(&Iteration) -> bool,
) -> Result<SearchOutcome, ClientError> {
    let mut film = Film::new(setting.size);
    // First frames are slower: memory is touched, threads start, clocks rise. So some do not count.
    reference(renderer, setting, &mut film);
    let watch = Watch::begin();
    let mut references = reference(renderer, setting, &mut film);
    let all = trials(renderer, tuner, setting, iterations, on_iteration)?;
    references.extend(reference(renderer, setting, &mut film));
    let disturbance = watch.end(renderer.threads(), &references);
    Ok(SearchOutcome { trials: all, reference_ms: Summary::of(&references).median, disturbance })
}

pub(super) fn trials(
    renderer: &mut Renderer,
    tuner: &mut dyn NextTrial,
    setting: &SearchSetting,
    iterations: u32,
    mut on_iteration: impl FnMut(&Iteration) -> bool,
) -> Result<Vec<Iteration>, ClientError> {
    let mut film = Film::new(setting.size);
    let mut apart = Apart::default();
    let mut all = Vec::new();
    let mut previous: Option<Finished> = None;
    for number in 1..=iterations {
        let begin = Instant::now();
        let suggestion = tuner.next(&setting.indicators, previous.take());
        let waiting_ms = milliseconds(begin);
        let (configuration, cap_ms) = (suggestion.configuration(), suggestion.abort_above());
        let (outcome, times) = trial_beside(renderer, configuration, cap_ms, setting, &mut film, &mut apart);
        let iteration = Iteration {
            number,
            trial: suggestion.trial().map(str::to_owned),
            mode: suggestion.mode(),
            source: suggestion.source(),
            reason: suggestion.reason().summary.clone(),
            step: suggestion.reason().step.clone(),
            rule: suggestion.reason().explanation.rule,
            configuration: configuration.clone(),
            predicted_cost: suggestion.predicted_cost(),
            outcome: outcome.clone(),
            times,
            cost: times.map(|times| setting.objective.cost(times)),
            waiting_ms,
            total_ms: milliseconds(begin),
        };
        previous = Some(suggestion.finished(setting.measurements(times), outcome)?);
        let go_on = on_iteration(&iteration);
        all.push(iteration);
        if !go_on {
            break;
        }
    }
    // The last result is put on its way here, before more frames are rendered.
    drop(previous);
    Ok(all)
}

fn reference(renderer: &mut Renderer, setting: &SearchSetting, film: &mut Film) -> Vec<f64> {
    (0..REFERENCE_FRAMES)
        .filter_map(|_| run_choice(renderer, &setting.baseline, None, setting, film, &mut Apart::default()).1)
        .map(|times| setting.objective.cost(times))
        .collect()
}

/// Builds and renders one trial of a fixed sample, stopped beyond `cap_ms` but for the build.
pub fn trial(
    renderer: &mut Renderer,
    configuration: &Configuration,
    cap_ms: Option<f64>,
    setting: &SearchSetting,
    film: &mut Film,
) -> (Outcome, Option<FrameTimes>) {
    trial_beside(renderer, configuration, cap_ms, setting, film, &mut Apart::default())
}

/// A [`trial`] after others, which may spare it a frame.
fn trial_beside(
    renderer: &mut Renderer,
    configuration: &Configuration,
    cap_ms: Option<f64>,
    setting: &SearchSetting,
    film: &mut Film,
    apart: &mut Apart,
) -> (Outcome, Option<FrameTimes>) {
    match setting.space.choice(configuration) {
        Ok(choice) => run_choice(renderer, &choice, cap_ms, setting, film, apart),
        Err(error) => (Outcome::failed(error.to_string()), None),
    }
}

/// Builds and renders one choice; see [`trial`]. A kept structure serves again, a slow build is followed by
/// more frames, and in real time a frame that is known well enough ([`Apart`]) is not rendered.
pub(super) fn run_choice(
    renderer: &mut Renderer,
    choice: &Choice,
    cap_ms: Option<f64>,
    setting: &SearchSetting,
    film: &mut Film,
    apart: &mut Apart,
) -> (Outcome, Option<FrameTimes>) {
    match setting.objective {
        Objective::Error => return run_noisy(renderer, choice, setting),
        Objective::Motion => return run_episode(renderer, choice, cap_ms, setting, film),
        Objective::Render | Objective::Total | Objective::Auto(_) => {}
    }
    let shares_builds = setting.objective.frames_per_build() >= REUSE_FROM_FRAMES_PER_BUILD;
    let ready = match renderer.make_ready(&choice.build, shares_builds) {
        Ok(ready) => ready,
        Err(error) => return (not_built(&error), None),
    };
    let is_real_time = setting.objective == Objective::Total;
    let build = Timed { ms: ready.build_ms, threads: ready.threads };
    if is_real_time && let Some(frame) = apart.built(choice, build) {
        return (Outcome::Ok, Some(times_of(renderer, ready, frame, Some(0))));
    }
    // The time limit of a frame, so that it and its share of the build stay below the cap.
    let built = setting.objective.cost(FrameTimes::of(ready.build_ms, 0.0));
    let limit_ms = cap_ms.map(|cap_ms| cap_ms - built);
    renderer.set_light_sampling(choice.light);
    // A structure that comes back finds the caches full of others.
    let warm_up = usize::from(ready.trials_before > 0);
    let mut frames = FrameSet::with_cap(limit_ms, setting.frames as usize).leave_out(warm_up);
    let (mut cpu_ms, mut delay_ms) = (Vec::new(), Vec::new());
    while frames.goes_on() {
        film.clear();
        let (rendered, threads) = renderer
            .watching_threads(|| renderer.render_within(limit_ms, &setting.view, &choice.render, film));
        match rendered {
            Some((frame_ms, true)) => {
                frames.push(frame_ms);
                if frames.counted() > cpu_ms.len() {
                    cpu_ms.push(threads.cpu_ms);
                    delay_ms.extend(threads.delay_ms);
                }
                if shares_builds {
                    frames.plan_at_least(frames_beside(ready.build_ms, frame_ms));
                }
            }
            Some((stopped_ms, false)) => frames.push_stopped(stopped_ms),
            None => return (Outcome::failed("no structure was built"), None),
        }
    }
    match frames.result() {
        FrameSetResult::Measured(ms) => {
            let delay_ms = (!delay_ms.is_empty()).then(|| Summary::of(&delay_ms).median);
            let frame = Timed { ms, threads: ThreadTimes { cpu_ms: Summary::of(&cpu_ms).median, delay_ms } };
            if is_real_time {
                apart.rendered(choice, frame);
            }
            let counted = u32::try_from(frames.counted()).unwrap_or(u32::MAX);
            let more = (counted > setting.frames.max(1)).then_some(counted);
            (Outcome::Ok, Some(times_of(renderer, ready, frame, more)))
        }
        FrameSetResult::Stopped { lower_bound } => (Outcome::aborted(built + lower_bound), None),
    }
}

/// The times of a trial in which the current structure was made ready.
fn times_of(renderer: &Renderer, ready: Ready, frame: Timed, frames: Option<u32>) -> FrameTimes {
    let times = FrameTimes { frames, ..FrameTimes::of(ready.build_ms, frame.ms) };
    served(renderer, ready, times.with_threads(renderer.threads(), ready.threads, frame.threads))
}

/// The times of a trial with what is known of its structure.
fn served(renderer: &Renderer, ready: Ready, times: FrameTimes) -> FrameTimes {
    let trials_before = (ready.trials_before > 0).then_some(ready.trials_before);
    FrameTimes { trials_before, structure_bytes: renderer.structure_bytes(), ..times }
}

/// Builds, renders and measures the noise of one choice. The time of learning counts as a part of its build.
fn run_noisy(
    renderer: &mut Renderer,
    choice: &Choice,
    setting: &SearchSetting,
) -> (Outcome, Option<FrameTimes>) {
    let ready = match renderer.make_ready(&choice.build, true) {
        Ok(ready) => ready,
        Err(error) => return (not_built(&error), None),
    };
    let measured = renderer.study_view(&setting.view, &choice.render, setting.size).and_then(|learning| {
        renderer.set_light_sampling(choice.light);
        let (times, threads) = renderer.noisy_frame(renderer.structure()?, &choice.render)?;
        let build_ms = ready.build_ms + learning.of(&choice.light);
        let times = FrameTimes { build_ms, ..times };
        Some(times.with_threads(renderer.threads(), ready.threads, threads))
    });
    let bias = measured.and_then(|times| times.noise?.bias);
    if let Some(bias) = bias.filter(|bias| renderer.finds_again(bias, &choice.render)) {
        return (Outcome::infeasible(bias.to_string()), None);
    }
    match measured {
        None => (Outcome::failed("no structure was built"), None),
        Some(times) if times.noise.is_none_or(|noise| noise.relative_variance <= 0.0) => {
            (Outcome::failed("the picture has no noise that could be measured"), None)
        }
        Some(times) => (Outcome::Ok, Some(served(renderer, ready, times))),
    }
}

fn run_episode(
    renderer: &mut Renderer,
    choice: &Choice,
    cap_ms: Option<f64>,
    setting: &SearchSetting,
    film: &mut Film,
) -> (Outcome, Option<FrameTimes>) {
    let frames = renderer.episode_frames().max(1) as f64;
    let limit_ms = cap_ms.map(|cap_ms| cap_ms * frames);
    match renderer.episode(choice, &setting.view, film, limit_ms) {
        // The time so far is a lower bound of that of the whole episode.
        Ok(episode) if episode.is_stopped => (Outcome::aborted(episode.total_ms() / frames), None),
        Ok(episode) => (Outcome::Ok, Some(episode.mean())),
        Err(error) => (not_built(&error), None),
    }
}

/// A build that fails is an outcome like any other.
pub fn not_built(error: &BuildError) -> Outcome {
    match error.is_infeasible() {
        true => Outcome::infeasible(error.to_string()),
        false => Outcome::failed(error.to_string()),
    }
}

/// Number of frames that take a tenth of a build, within bounds.
fn frames_beside(build_ms: f64, frame_ms: f64) -> usize {
    let frames = build_ms * FRAMES_SHARE_OF_BUILD / frame_ms.max(f64::MIN_POSITIVE);
    // A cast saturates.
    (frames as usize).min(FRAMES_PER_SLOW_BUILD_MAX)
}

#[cfg(test)]
pub(super) mod testing {
    use super::*;

    /// A trial with this cost and leaf size.
    pub(crate) fn trial(cost: Option<f64>, leaf: u32) -> Iteration {
        Iteration {
            number: 1,
            trial: None,
            mode: Mode::Explore.into(),
            source: Source::Daemon,
            reason: String::new(),
            step: String::new(),
            rule: None,
            configuration: Configuration::new().with("max_leaf_size", leaf),
            predicted_cost: None,
            outcome: Outcome::Ok,
            times: cost.map(|cost| FrameTimes::of(5.0, cost)),
            cost,
            waiting_ms: 1.0,
            total_ms: cost.unwrap_or(0.0) + 6.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::{Narrowing, Premises, Preset};
    use crate::{tuning::apart::testing::after, tuning::verdict::baseline};
    use treewright_accel::NativeQuality;
    use treewright_scene::builtin::{self, Options};

    /// A small scene, and a search of single frames over the full space.
    fn small(objective: Objective) -> (Renderer, SearchSetting) {
        let scene =
            builtin::build("quick", &Options { detail: 0.02, ..Options::default() }).expect("a scene");
        let renderer = Renderer::new(Arc::new(scene), 0).expect("Embree is set up");
        let setting = SearchSetting {
            objective,
            space: Arc::new(TuningSpace::new(Preset::Full, &Premises::all())),
            baseline: baseline(Preset::Full).choice,
            view: View { camera: renderer.scene().cameras[0], seed: 1, bounces: 1 },
            size: [40, 30],
            frames: 1,
            indicators: Indicators::new(),
        };
        (renderer, setting)
    }

    #[test]
    fn trials_in_a_part_of_a_space_are_told_with_what_was_fixed() {
        let fixed = Narrowing::fix("robust=true").expect("it reads");
        let part = TuningSpace::paper().narrowed(&[fixed]).expect("something is left");
        let start = part.default_configuration();
        let trials = vec![Iteration { configuration: start.clone(), ..testing::trial(Some(10.0), 1) }];
        let found = SearchOutcome { trials, reference_ms: 10.0, disturbance: Disturbance::default() };
        let told = found.whole_trials(&part);
        assert_eq!((&told[0].configuration, told[0].cost), (&part.with_held(&start), Some(10.0)));
        assert_ne!(told[0].configuration, start);
    }

    #[test]
    fn a_trial_is_stopped_by_its_cap_and_by_nothing_else() {
        let (mut renderer, mut setting) = small(Objective::Total);
        let default = setting.space.default_configuration();
        let mut film = Film::new(setting.size);
        for frames in [1, 3] {
            setting.frames = frames;
            let (outcome, times) = trial(&mut renderer, &default, Some(0.0), &setting, &mut film);
            let Outcome::Aborted { lower_bound } = outcome else { panic!("{outcome:?}") };
            assert!(lower_bound > 0.0 && lower_bound.is_finite() && times.is_none());
            assert_eq!(film.samples(), 0, "what was stopped is no sample");
            for cap_ms in [None, Some(1e9), Some(f64::MAX)] {
                let (outcome, times) = trial(&mut renderer, &default, cap_ms, &setting, &mut film);
                assert_eq!((outcome, film.samples()), (Outcome::Ok, 1));
                assert!(times.is_some_and(|times| times.render_ms > 0.0));
            }
        }
    }

    #[test]
    fn a_structure_serves_a_few_trials_where_builds_are_shared_and_one_where_they_are_not() {
        let (mut renderer, mut setting) = small(Objective::Render);
        let mut film = Film::new(setting.size);
        // Not the baseline, which is another on each kind of processor.
        let [quick, good] = [NativeQuality::Low, NativeQuality::High].map(Choice::native);
        let mut served = |setting: &SearchSetting, choice: &Choice| {
            let apart = &mut Apart::default();
            let (outcome, times) = run_choice(&mut renderer, choice, None, setting, &mut film, apart);
            assert_eq!(outcome, Outcome::Ok);
            let times = times.expect("it was measured");
            assert_eq!(
                setting.measurements(Some(times)).get("trials_before"),
                times.trials_before.map(f64::from)
            );
            let bytes = setting.measurements(Some(times)).get("structure_bytes");
            assert!(bytes.is_some_and(|bytes| bytes > 0.0), "{bytes:?}");
            (times.trials_before.unwrap_or(0), times.build_ms)
        };
        // In turns, as a confirmation runs them.
        let turns: Vec<_> = (0..5).map(|_| (served(&setting, &quick), served(&setting, &good))).collect();
        let numbers: Vec<_> = turns.iter().map(|((quick, _), (good, _))| (*quick, *good)).collect();
        assert_eq!(numbers, [(0, 0), (1, 1), (2, 2), (3, 3), (0, 0)]);
        // A structure that serves again reports its own build time.
        assert!(turns[..4].iter().all(|(quick, _)| quick.1 == turns[0].0.1));
        setting.objective = Objective::Total;
        assert!((0..3).all(|_| served(&setting, &quick).0 == 0));
    }

    #[test]
    fn in_real_time_a_frame_that_is_known_is_not_rendered() {
        let (mut renderer, setting) = small(Objective::Total);
        let mut film = Film::new(setting.size);
        let choice = Choice::native(NativeQuality::Low);
        // Builds of any time that a test may take.
        let builds_ms = [10.0, 10_000.0, 10.0, 10_000.0, 10.0];
        let mut apart = after(&choice, &builds_ms, &[60.0, 61.0, 62.0, 61.0, 61.0]);
        let mut run = |apart: &mut Apart| {
            let (_, times) = run_choice(&mut renderer, &choice, None, &setting, &mut film, apart);
            let times = times.expect("it was measured");
            let frames = setting.measurements(Some(times)).get("frames");
            (times.render_ms, times.build_ms < 10_000.0, frames, film.samples())
        };
        let (render_ms, is_own, frames, samples) = run(&mut apart);
        assert!((render_ms - 61.0).abs() < 1e-9, "{render_ms}");
        assert_eq!((is_own, frames, samples), (true, Some(0.0), 0));
        let (render_ms, _, frames, samples) = run(&mut Apart::default());
        assert!(render_ms > 0.0 && (render_ms - 61.0).abs() > 1e-9, "{render_ms}");
        assert_eq!((frames, samples), (Some(1.0), 1));
    }

    #[test]
    fn frames_that_follow_a_build_take_a_tenth_of_it() {
        assert_eq!([0.0, 350.0, 1_200.0, 1e9].map(|build_ms| frames_beside(build_ms, 40.0)), [0, 0, 3, 5]);
        assert_eq!(frames_beside(1.0, 0.0), FRAMES_PER_SLOW_BUILD_MAX);
    }
}
