//! Comparing acceleration structures: all of them in each round, one after the other.
//!
//! The speed of a machine drifts, so contenders are measured interleaved, and each round begins with another
//! one. Results are ratios within rounds, of times without waits ([`FrameTimes::undelayed`]). Equal
//! contenders are measured once.

use std::time::Instant;

use serde::{Deserialize, Serialize};
use treewright_accel::Structure;

use crate::frame::{FrameTimes, Renderer, milliseconds};
use crate::scheduling::{ThreadTimes, of_process};
use crate::statistics::{Ratio, Summary};
pub use crate::tuning::objective::Yardstick;
use crate::tuning::who::{NativeUse, Who};
use crate::{
    film::Film, integrator::View, light_sampling::LearningTimes, processes::Processes, space::Choice,
    tuning::objective::frame_cost,
};

/// Longest time of a measurement's rebuilds in seconds; beyond it only some rounds rebuild.
const REBUILD_S: f64 = 60.0;
/// Share of the time from which on a note says that frames waited for processors.
const DELAY_NOTE_MIN: f64 = 0.02;

/// A structure to be measured.
#[derive(Clone, Debug)]
pub struct Contender {
    /// Whose it is.
    pub who: Who,
    /// The structure, and how it is rendered with.
    pub choice: Choice,
}

/// The conditions of a measurement.
#[derive(Clone, Copy, Debug)]
pub struct Conditions {
    /// The rendered view.
    pub view: View,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Measurements of each contender.
    pub rounds: u32,
    /// The number of frames that share a build. Structures are rebuilt for each round all the same, as far as
    /// a minute goes, because equal configurations differ from build to build.
    pub frames_per_build: u32,
    /// The measured quantity.
    pub yardstick: Yardstick,
}

/// The times of one contender.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Measured {
    /// The contender.
    pub who: Who,
    /// Each frame with the build behind it, in the order of rounds.
    pub frames: Vec<FrameTimes>,
    /// Memory of the structure that was built last, in bytes.
    pub structure_bytes: Option<usize>,
    /// Why there is nothing, if the structure cannot be built.
    pub failure: Option<String>,
    /// Rounds of this process and of a second one, where there was one.
    pub processes: Option<[usize; 2]>,
}

/// Median and quartiles of a contender, and of its speed-ups over the first one.
#[derive(Clone, Debug, Serialize)]
pub struct Standing {
    /// The contender.
    #[serde(rename = "name")]
    pub who: Who,
    /// The way to use native Embree that was the fastest, e.g. `high` or `medium path by path`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub variant: Option<NativeUse>,
    /// Build times.
    pub build_ms: Summary,
    /// Render times of one sample a pixel.
    pub render_ms: Summary,
    /// A frame with its share of the build.
    pub frame_ms: Summary,
    /// Frame time of the first contender over this one's, pair by pair.
    pub speedup: Summary,
    /// `frame_ms` round by round.
    pub rounds_ms: Vec<f64>,
    /// `rounds_ms` without the time in which threads waited, which compares any two contenders.
    pub undelayed_ms: Vec<f64>,
    /// Memory of the structure, in bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub structure_bytes: Option<usize>,
    /// Why there is nothing, if the structure cannot be built.
    pub failure: Option<String>,
    /// The processes that ran the rounds, where there were two.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub processes: Option<Processes>,
}

impl Standing {
    /// The ratio of another one's time to this one's, pair by pair.
    pub fn speedup_over(&self, other: &Standing) -> Summary {
        Summary::of_ratios(&other.undelayed_ms, &self.undelayed_ms)
    }

    /// That ratio with its interval.
    pub fn gain_over(&self, other: &Standing) -> Ratio {
        match self.processes.filter(|_| other.processes.is_some()) {
            Some(processes) => processes.ratio(&other.undelayed_ms, &self.undelayed_ms),
            None => Ratio::of(&other.undelayed_ms, &self.undelayed_ms),
        }
    }

    /// The name for people, e.g. `native used well (high)`.
    pub fn title(&self) -> String {
        match &self.variant {
            Some(variant) => format!("{} ({variant})", self.who),
            None => self.who.to_string(),
        }
    }
}

impl Measured {
    /// With the rounds of a second process after its own; one that failed there keeps its own alone.
    #[must_use]
    pub fn joined(mut self, second: Measured) -> Self {
        self.failure = self.failure.or(second.failure);
        if self.failure.is_some() {
            return self;
        }
        self.processes = Some([self.frames.len(), second.frames.len()]);
        self.frames.extend(second.frames);
        self
    }
}

impl Conditions {
    fn build_each_round(&self) -> bool {
        self.frames_per_build == 1
    }

    /// Whether a frame is rendered with what was built before. An episode builds by itself.
    fn keeps_builds(&self) -> bool {
        !self.build_each_round() && self.yardstick != Yardstick::Episode
    }
}

/// Measures all contenders after a warming round, until `go_on` says no, which is asked each round.
pub fn interleaved(
    renderer: &mut Renderer,
    contenders: &[Contender],
    conditions: &Conditions,
    go_on: impl FnMut() -> bool,
) -> Vec<Measured> {
    let mut distinct: Vec<Contender> = Vec::new();
    let mut place = Vec::new();
    for contender in contenders {
        let known = distinct.iter().position(|one| one.choice == contender.choice);
        place.push(known.unwrap_or(distinct.len()));
        if known.is_none() {
            distinct.push(contender.clone());
        }
    }
    let measured = in_turns(renderer, &distinct, conditions, go_on);
    let of = |(contender, place): (&Contender, &usize)| Measured {
        who: contender.who.clone(),
        ..measured[*place].clone()
    };
    contenders.iter().zip(&place).map(of).collect()
}

struct Built {
    structure: Structure,
    times: FrameTimes,
}

impl Built {
    fn of(renderer: &Renderer, choice: &Choice, learning: &LearningTimes) -> Result<Self, String> {
        let (built, threads) = of_process(|| renderer.build(&choice.build));
        let (structure, build_ms) = built.map_err(|error| error.to_string())?;
        let build_ms = build_ms + learning.of(&choice.light);
        let times = FrameTimes::of(build_ms, 0.0);
        let times = times.with_threads(renderer.threads(), threads, ThreadTimes::default());
        Ok(Built { structure, times })
    }
}

/// One in this number of rounds rebuilds, where all builds of a round take `round_ms`.
fn rounds_per_build(round_ms: f64, rounds: u32) -> usize {
    assert!(round_ms >= 0.0, "builds of {round_ms} ms");
    ((round_ms * f64::from(rounds) / (1e3 * REBUILD_S)).ceil() as usize).max(1)
}

fn in_turns(
    renderer: &mut Renderer,
    contenders: &[Contender],
    conditions: &Conditions,
    mut go_on: impl FnMut() -> bool,
) -> Vec<Measured> {
    let learning = match conditions.yardstick {
        Yardstick::Noise => study(renderer, contenders, conditions),
        Yardstick::Frame | Yardstick::Episode => LearningTimes::default(),
    };
    let mut structures: Vec<Option<Built>> = Vec::new();
    let mut measured: Vec<Measured> = Vec::new();
    let begin = Instant::now();
    for contender in contenders {
        let built = Built::of(renderer, &contender.choice, &learning);
        let failure = built.as_ref().err().cloned();
        measured.push(Measured { who: contender.who.clone(), failure, ..Measured::default() });
        structures.push(built.ok());
    }
    // Not what frames are charged: light is learnt once.
    let rounds_per_build = rounds_per_build(milliseconds(begin), conditions.rounds);
    let mut film = Film::new(conditions.size);
    let count = contenders.len();
    for round in 0..=conditions.rounds as usize {
        if !go_on() {
            break;
        }
        let is_due = round > 1 && (round - 1).is_multiple_of(rounds_per_build);
        for turn in 0..count {
            let index = (round + turn) % count;
            let Some(built) = &mut structures[index] else { continue };
            let choice = &contenders[index].choice;
            let rebuilt = match is_due && conditions.keeps_builds() {
                true => Built::of(renderer, choice, &learning).map(|fresh| *built = fresh),
                false => Ok(()),
            };
            let times =
                rebuilt.and_then(|()| frame(renderer, &mut built.structure, choice, conditions, &mut film));
            match times {
                Ok(times) if round > 0 => {
                    let FrameTimes { build_ms, build_cpu_ms, build_delay_ms, .. } =
                        if conditions.build_each_round() { times } else { built.times };
                    let times = FrameTimes { build_ms, build_cpu_ms, build_delay_ms, ..times };
                    measured[index].frames.push(times);
                }
                Ok(_) => {}
                Err(reason) => {
                    measured[index].failure = Some(reason);
                    structures[index] = None;
                }
            }
        }
    }
    for (one, built) in measured.iter_mut().zip(structures) {
        one.structure_bytes = built.map(|built| built.structure.statistics().bytes);
    }
    measured
}

/// Prepares the measurement of noise; returns what the learning took.
fn study(renderer: &mut Renderer, contenders: &[Contender], conditions: &Conditions) -> LearningTimes {
    contenders
        .iter()
        .find_map(|contender| {
            if renderer.structure().is_none() {
                renderer.rebuild(&contender.choice.build).ok()?;
            }
            renderer.study_view(&conditions.view, &contender.choice.render, conditions.size)
        })
        .unwrap_or_default()
}

fn frame(
    renderer: &mut Renderer,
    structure: &mut Structure,
    choice: &Choice,
    conditions: &Conditions,
    film: &mut Film,
) -> Result<FrameTimes, String> {
    if conditions.yardstick == Yardstick::Episode {
        let episode = renderer.episode(choice, &conditions.view, film, None);
        return episode.map(|episode| episode.mean()).map_err(|error| error.to_string());
    }
    let (mut build_ms, mut build) = (0.0, ThreadTimes::default());
    if conditions.build_each_round() {
        let built;
        (built, build) = of_process(|| renderer.build(&choice.build));
        (*structure, build_ms) = built.map_err(|error| error.to_string())?;
    }
    if conditions.yardstick == Yardstick::Noise {
        renderer.set_light_sampling(choice.light);
        let measured = renderer.noisy_frame(structure, &choice.render);
        let (times, threads) = measured.ok_or("the view was not studied")?;
        return Ok(times.with_threads(renderer.threads(), build, threads));
    }
    renderer.set_light_sampling(choice.light);
    // The sample number is fixed, so that every contender traces equal rays.
    film.clear();
    let rendered = || renderer.render_with(structure, &conditions.view, &choice.render, film).0;
    let (render_ms, render) = renderer.watching_threads(rendered);
    Ok(FrameTimes::of(build_ms, render_ms).with_threads(renderer.threads(), build, render))
}

/// In words, if worth one: which share of their time frames only waited for processors.
pub fn delay_note(standings: &[Standing]) -> Option<String> {
    let sum = |of: fn(&Standing) -> &Vec<f64>| -> f64 { standings.iter().flat_map(of).sum() };
    let (all_ms, undelayed_ms) = (sum(|one| &one.rounds_ms), sum(|one| &one.undelayed_ms));
    let share = if all_ms > 0.0 { 1.0 - undelayed_ms / all_ms } else { 0.0 };
    (share > DELAY_NOTE_MIN).then(|| {
        format!("frames waited for processors that other programs held {:.0} % of their time; ratios leave that out", 1e2 * share)
    })
}

/// Compares all contenders with the first one.
pub fn standings(measured: &[Measured], frames_per_build: u32) -> Vec<Standing> {
    let cost = |times: FrameTimes| frame_cost(times, frames_per_build);
    let undelayed =
        |one: &Measured| -> Vec<f64> { one.frames.iter().map(|times| cost(times.undelayed())).collect() };
    let costs: Vec<Vec<f64>> = measured.iter().map(undelayed).collect();
    let first = costs.first().cloned().unwrap_or_default();
    let joined = measured.iter().zip(&costs).filter(|(one, _)| one.processes.is_some());
    let joined: Vec<&[f64]> = joined.map(|(_, costs)| costs.as_slice()).collect();
    let rounds = measured.iter().find_map(|one| one.processes);
    let processes = rounds.map(|rounds| Processes::of(&joined, rounds));
    measured
        .iter()
        .zip(costs.iter().cloned())
        .map(|(one, undelayed_ms)| {
            let each = |of: &dyn Fn(FrameTimes) -> f64| -> Vec<f64> {
                one.frames.iter().map(|times| of(*times)).collect()
            };
            let rounds_ms = each(&cost);
            Standing {
                who: one.who.clone(),
                variant: None,
                build_ms: Summary::of(&each(&|times| times.build_ms)),
                render_ms: Summary::of(&each(&|times| times.render_ms)),
                frame_ms: Summary::of(&rounds_ms),
                speedup: Summary::of_ratios(&first, &undelayed_ms),
                rounds_ms,
                undelayed_ms,
                structure_bytes: one.structure_bytes,
                failure: one.failure.clone(),
                processes: one.processes.and(processes),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render_options::RenderOptions;
    use std::sync::Arc;
    use treewright_accel::NativeQuality;
    use treewright_scene::builtin;

    #[test]
    fn speedups_are_those_of_pairs() {
        let one = |name: &str, build_ms: f64, render_ms: [f64; 3]| Measured {
            who: Who::Named(name.to_owned().into()),
            frames: render_ms.map(|render_ms| FrameTimes::of(build_ms, render_ms)).into(),
            ..Measured::default()
        };
        let measured = [one("default", 10.0, [20.0, 40.0, 30.0]), one("tuned", 5.0, [10.0, 20.0, 15.0])];
        let built_once = standings(&measured, 1000);
        assert_eq!(built_once[0].speedup.median, 1.0);
        assert_eq!(
            built_once[1].speedup,
            Summary { lower_quartile: 2.0, median: 2.0, upper_quartile: 2.0, count: 3 }
        );
        assert_eq!(built_once[1].frame_ms.median, 15.005);
        assert_eq!(built_once[0].speedup_over(&built_once[1]).median, 0.5);
        let built_each = standings(&measured, 1);
        assert_eq!(built_each[1].frame_ms.median, 20.0);
        assert_eq!(built_each[1].speedup.median, 2.0);
        assert_eq!(built_each[1].gain_over(&built_each[0]).count, 3);
    }

    #[test]
    fn costly_builds_are_shared_by_rounds() {
        assert_eq!(rounds_per_build(0.0, 9), 1);
        assert_eq!(rounds_per_build(1e3 * REBUILD_S / 9.0, 9), 1, "a minute in all");
        assert_eq!(rounds_per_build(20_000.0, 9), 3, "three times three minutes");
        assert_eq!(rounds_per_build(1e6, 9), 150, "never again");
    }

    #[test]
    fn ratios_leave_out_what_frames_waited_for() {
        let (render_cpu_ms, render_delay_ms) = (Some(30.0), Some(30.0));
        let waited = FrameTimes { render_cpu_ms, render_delay_ms, ..FrameTimes::of(10.0, 60.0) };
        let one = |name: &'static str, frames: [FrameTimes; 2]| Measured {
            who: Who::Named(name.into()),
            frames: frames.into(),
            ..Measured::default()
        };
        let loaded = one("loaded", [FrameTimes::of(10.0, 30.0), waited]);
        let quiet = one("quiet", [FrameTimes::of(10.0, 40.0); 2]);
        let all = standings(&[loaded, quiet], 1);
        assert_eq!((&all[0].rounds_ms, &all[0].undelayed_ms), (&vec![40.0, 70.0], &vec![40.0, 40.0]));
        assert_eq!(all[0].gain_over(&all[1]).median, 1.25);
        assert_eq!(all[1].speedup.median, 0.8);
        let note = delay_note(&all).expect("30 of 210 ms");
        assert!(note.contains("14 %"), "{note}");
        assert_eq!(delay_note(&all[1..]), None);
    }

    #[test]
    fn rounds_of_a_second_process_follow_and_widen_the_interval() {
        let of = |name: &'static str, render_ms: &[f64], failure: Option<&str>| Measured {
            who: Who::Named(name.into()),
            frames: render_ms.iter().map(|&render_ms| FrameTimes::of(0.0, render_ms)).collect(),
            failure: failure.map(str::to_owned),
            ..Measured::default()
        };
        let own = [of("a", &[30.0; 4], None), of("b", &[20.0; 4], None), of("c", &[10.0; 4], None)];
        let second = [of("", &[30.0; 4], None), of("", &[24.0; 4], None), of("", &[10.0], Some("full"))];
        let joined: Vec<Measured> = own.into_iter().zip(second).map(|(one, two)| one.joined(two)).collect();
        let all = standings(&joined, 1);
        assert_eq!(all[1].rounds_ms, [20.0, 20.0, 20.0, 20.0, 24.0, 24.0, 24.0, 24.0]);
        assert_eq!(all[1].processes.map(|processes| processes.rounds), Some([4, 4]));
        let [low, high] = all[1].gain_over(&all[0]).interval.expect("there are eight rounds");
        assert!(low < 1.24 && high > 1.51, "beyond [1.25, 1.5]: [{low}, {high}]");
        assert_eq!((all[2].failure.as_deref(), all[2].rounds_ms.len()), (Some("full"), 4));
        assert_eq!(all[2].gain_over(&all[0]).interval, None, "one process alone, of four rounds");
        let text = serde_json::to_string(&joined[1]).expect("it is JSON");
        let read: Measured = serde_json::from_str(&text).expect("it is one");
        assert_eq!((read.frames, read.processes), (joined[1].frames.clone(), Some([4, 4])));
    }

    fn quick(rounds: u32, frames_per_build: u32) -> (Renderer, Conditions) {
        let options = builtin::Options { detail: 0.02, ..builtin::Options::default() };
        let scene = Arc::new(builtin::build("quick", &options).expect("it is built in"));
        let view = View { camera: scene.cameras[0], seed: 1, bounces: 1 };
        let yardstick = Yardstick::Frame;
        let conditions = Conditions { view, size: [8, 8], rounds, frames_per_build, yardstick };
        (Renderer::new(scene, 0).expect("Embree starts"), conditions)
    }

    #[test]
    fn structures_are_built_anew_for_each_round() {
        let (mut renderer, conditions) = quick(4, 1000);
        let choice = Choice::native(NativeQuality::Low);
        let contenders = [Contender { who: Who::Found, choice }];
        let all = interleaved(&mut renderer, &contenders, &conditions, || true);
        let [one] = all.as_slice() else { panic!("one was measured") };
        assert_eq!(one.frames.len(), 4);
        assert!(one.structure_bytes.is_some_and(|bytes| bytes > 0));
        // Two builds take equal numbers of nanoseconds now and then, four of them do not.
        assert!(one.frames.iter().any(|times| times.build_ms != one.frames[0].build_ms), "{:?}", one.frames);
    }

    #[test]
    fn the_same_work_under_two_names_is_measured_once() {
        let (mut renderer, conditions) = quick(2, 1);
        let native = Choice::native(NativeQuality::Low);
        let staged = Choice { render: RenderOptions { staged: true, ..native.render }, ..native };
        let contenders = [("a", native), ("b", staged), ("c", native)]
            .map(|(name, choice)| Contender { who: Who::Named(name.into()), choice });
        let all = interleaved(&mut renderer, &contenders, &conditions, || true);
        let names: Vec<String> = all.iter().map(|one| one.who.to_string()).collect();
        assert_eq!(names, ["a", "b", "c"]);
        assert_eq!(all[0].frames, all[2].frames);
        assert!(all[0].frames.len() == 2 && all[0].frames != all[1].frames);
    }
}
