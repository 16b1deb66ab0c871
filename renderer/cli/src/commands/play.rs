//! `treewright-render play`: the camera moves, and the service answers frame by frame.
//!
//! This is the hybrid of the paper's section 6: each time the state changes the service either searches a
//! little or answers at once by a prediction. In progressive rendering a structure is kept as long as the
//! configuration does not change; in real-time rendering each frame builds its own.
//!
//! With `--rounds` the scene moves as well, and the structure follows: parts that have decayed are rebuilt,
//! in the paper's space all of it.

mod flight;

use std::{path::PathBuf, time::Instant};

use clap::{Args, builder::TypedValueParser};
use serde::Serialize;
use treewright_client::{
    Configuration, Finished, Mode, OpenEnum, Policy, SessionPolicy, Source, Stats, Suggestion,
};

use crate::arguments::{FrameArguments, SceneArguments, Size, SpaceArguments, StartArguments, unit_interval};
use crate::error::{CliError, Result, write_file};
use crate::{interrupt::Interrupt, names::one_of, output, server::ServerArguments};
use flight::{Flight, Setting, Shown};
use treewright_renderer::frame::{FrameTimes, milliseconds};
use treewright_renderer::space::{Preset, Start, TuningSpace};
use treewright_renderer::tuning::objective::{Objective, frame_cost, measurements, specification, study_id};
use treewright_renderer::{
    integrator::View, limits::ITERATIONS_MAX, statistics::Summary, tuning::reuse::Reuse,
    tuning::safety::Safety, tuning::verdict,
};
use treewright_scene::{Scene, camera_path::CameraPath, indicators::SceneIndicators};

#[derive(Args, Clone, Debug)]
pub(crate) struct Arguments {
    #[command(flatten)]
    server: ServerArguments,
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    frame: FrameArguments,

    #[command(flatten)]
    space: SpaceArguments,
    #[command(flatten)]
    start: StartArguments,

    /// Objective to minimise; with the space, this selects the study.
    #[arg(long, value_parser = aim(), default_value = Objective::Render.name())]
    objective: Objective,

    /// Number of frames of the flight.
    #[arg(long, value_name = "N", default_value_t = 50, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(ITERATIONS_MAX)))]
    frames: u32,

    /// Size in pixels.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "320x240")]
    size: Size,

    /// Start of the flight on the camera path, 0 to 1.
    #[arg(long, value_name = "T", default_value_t = 0.0, value_parser = unit_interval)]
    from: f32,

    /// End of the flight on the camera path.
    #[arg(long, value_name = "T", default_value_t = 1.0, value_parser = unit_interval)]
    to: f32,

    /// Number of cycles of a scene that moves (see --motion) during the flight; the structure follows in each
    /// frame in which it moves.
    #[arg(long, value_name = "N", default_value_t = 0.0, allow_negative_numbers = true)]
    rounds: f32,

    /// A scene that moves does so in every N-th frame only, and rests between.
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(ITERATIONS_MAX)))]
    every: u32,

    /// Build a quick structure first whenever the geometry changes. That of the answer is built behind the
    /// frames once it is expected to pay, and swapped in when it is ready.
    #[arg(long)]
    swap: bool,

    /// Probability of exploring when the state changes. Default: the study's own.
    #[arg(long, value_name = "P", value_parser = unit_interval)]
    epsilon: Option<f32>,

    /// Also render each frame with native Embree's default (in the paper's space: with the paper's
    /// recommended default), and show the difference.
    #[arg(long)]
    compare: bool,

    /// Write every frame as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

impl Arguments {
    fn check(&self) -> Result<()> {
        if self.swap && self.objective != Objective::Render {
            return Err(CliError::Usage(
                "--swap decides itself how many frames a structure has to serve; leave --objective at render"
                    .into(),
            ));
        }
        // Objectives that single frames cannot measure are not tuned while it plays.
        self.space.judged_by(Objective::Total).map(|_| ())
    }

    fn setting(&self, scene: &Scene) -> Setting {
        let FrameArguments { seed, bounces, .. } = self.frame;
        Setting {
            view: View { camera: scene.cameras[0], seed, bounces },
            size: self.size.0,
            each_frame: self.objective == Objective::Total,
            swaps: self.swap,
            compares: self.compare,
        }
    }
}

fn aim() -> impl TypedValueParser<Value = Objective> {
    one_of([
        (Objective::Render, "render", "The render time: a structure serves a thousand frames"),
        (Objective::Total, "total", "Build and render time together: a structure serves one frame"),
        (
            Objective::Auto(1),
            "auto",
            "Whatever is true: how many frames a structure serves is estimated from what changes",
        ),
    ])
}

/// The objective of a flight, with the present estimate of the frames that share a build.
fn at_present(aim: Objective, reuse: &Reuse) -> Objective {
    if matches!(aim, Objective::Auto(_)) { Objective::Auto(reuse.frames_per_build()) } else { aim }
}

#[derive(Debug, Serialize)]
struct PlayedFrame {
    number: u32,
    /// Estimated number of frames that share a build.
    frames_per_build: u32,
    camera_at: f32,
    mode: OpenEnum<Mode>,
    source: Source,
    reason: String,
    configuration: Configuration,
    /// Whether a structure was built for this frame.
    rebuilt: bool,
    /// Whether it is the first one with a structure that was built behind the frames.
    swapped: bool,
    /// Whether the configuration of the structure is another than the answer, which is built behind or waits.
    stands_in: bool,
    times: Option<FrameTimes>,
    waiting_ms: f64,
    default_times: Option<FrameTimes>,
}

impl PlayedFrame {
    fn of(suggestion: &Suggestion, shown: &Shown) -> Self {
        Self {
            number: 0,
            frames_per_build: 1,
            camera_at: 0.0,
            mode: suggestion.mode(),
            source: suggestion.source(),
            reason: suggestion.reason().summary.clone(),
            configuration: suggestion.configuration().clone(),
            rebuilt: shown.rebuilt,
            swapped: shown.swapped,
            stands_in: shown.stands_in,
            times: shown.times,
            waiting_ms: 0.0,
            default_times: None,
        }
    }

    /// What it took, with the build before it.
    fn spent_ms(&self) -> Option<f64> {
        let times = self.times?;
        Some(times.render_ms + if self.rebuilt { times.build_ms } else { 0.0 })
    }

    /// Its cost with its configuration and with the baseline, where both ran.
    fn costs(&self) -> Option<[f64; 2]> {
        let cost = |times| frame_cost(times, self.frames_per_build);
        Some([cost(self.times?), cost(self.default_times?)])
    }
}

#[derive(Debug, Serialize)]
struct FlightResults {
    scene: String,
    study: String,
    objective: &'static str,
    /// Name of what frames are compared with.
    baseline: String,
    /// Frames that cost more than with the baseline; absent where they were not compared.
    safety: Option<Safety>,
    frames: Vec<PlayedFrame>,
    client: Stats,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let moves = arguments.rounds != 0.0;
    let moving = moves.then(|| arguments.scene.moving()).transpose()?;
    arguments.check()?;
    let client = arguments.server.connect(arguments.frame.threads)?;
    let scene = arguments.scene.load()?;
    let renderer = arguments.frame.renderer(&scene)?;
    let mut reuse = Reuse::default();
    let objective = at_present(arguments.objective, &reuse);
    let space = arguments.space.of(&scene, objective)?;
    let (start, space) = arguments.start.of(&space)?;
    let made = || study_of_flight(objective, &space, &start, moves);
    let id = arguments.server.study.clone().unwrap_or_else(made);
    let study = client.study(&id, specification(&space, objective, Policy::new())?)?;
    if let Some(epsilon) = arguments.epsilon {
        let epsilon = Some(f64::from(epsilon));
        study.set_session_policy(SessionPolicy { epsilon, ..SessionPolicy::default() })?;
    }
    println!("Flying through {} in {} frames, study {id}\n", scene.name, arguments.frames);
    println!(
        "frame   path  mode        build ms  render ms{}  waited ms",
        if arguments.compare { "  baseline ms  speed-up" } else { "" }
    );

    let baseline = verdict::baseline_from(&space, &start);
    let mut flight = Flight::new(renderer, space, baseline.choice, &arguments.setting(&scene))?;
    let (path, mut scene_indicators) = (CameraPath::of(&scene), SceneIndicators::of(&scene));
    let mut workload = arguments.frame.workload(&scene, arguments.size);
    let interrupt = Interrupt::listen();
    let mut tuner = study.prefetching_tuner();
    let mut previous: Option<Finished> = None;
    let mut frames = Vec::new();
    let mut time_before = 0.0;
    for number in 0..arguments.frames {
        let share = number as f32 / (arguments.frames - 1).max(1) as f32;
        let camera_at = arguments.from + (arguments.to - arguments.from) * share;
        let camera = path.sample(camera_at);
        let rested = number - number % arguments.every;
        let time = arguments.rounds * rested as f32 / (arguments.frames - 1).max(1) as f32;
        let moved = moves && (number == 0 || time != time_before);
        time_before = time;
        if let Some(moving) = moving.as_ref().filter(|_| moved) {
            let moment = moving.at(arguments.scene.time + time)?;
            scene_indicators = SceneIndicators::of(&moment);
            flight.moment = Some(moment);
        }
        flight.moved = flight.moment.is_some();
        reuse.frame(moved);
        let objective = at_present(arguments.objective, &reuse);
        let frames_per_build = objective.frames_per_build();
        workload.frames_per_build = matches!(objective, Objective::Auto(_)).then_some(frames_per_build);
        let indicators = workload.state(&scene_indicators.with_camera(&camera));
        // Where the camera will be is known, and of a scene that moves that it will not have moved far.
        let next_share = (number + 1) as f32 / (arguments.frames - 1).max(1) as f32;
        let next_at = arguments.from + (arguments.to - arguments.from) * next_share.min(1.0);
        let upcoming = workload.state(&scene_indicators.with_camera(&path.sample(next_at)));
        let begin = Instant::now();
        let suggestion = tuner.next_before(&indicators, &upcoming, previous.take());
        let waiting_ms = milliseconds(begin);
        flight.view.camera = camera;
        let is_trial = suggestion.source() == Source::Daemon && !suggestion.is_answer();
        let shown = flight.frame(suggestion.configuration(), is_trial);
        let frame = PlayedFrame {
            number,
            frames_per_build,
            camera_at,
            waiting_ms,
            default_times: flight.default_frame(),
            ..PlayedFrame::of(&suggestion, &shown)
        };
        print(&frame);
        frames.push(frame);
        // A frame of another structure says nothing about the answer, which goes back unmeasured.
        previous = match shown.stands_in {
            true => None,
            // A frame without a new build cannot be reported where builds are part of the objective.
            false => Some(suggestion.finished(measurements(shown.times, 1, objective), shown.outcome)?),
        };
        if interrupt.requested() {
            break;
        }
    }
    drop(previous);
    if let Err(error) = client.flush(std::time::Duration::from_secs(10)) {
        println!("note: {error}");
    }
    summarise(&frames, &baseline.who.to_string());
    if let Some(path) = &arguments.json {
        let results = FlightResults {
            scene: scene.name.clone(),
            study: id,
            objective: arguments.objective.name(),
            baseline: baseline.who.to_string(),
            safety: safety(&frames),
            frames,
            client: client.stats(),
        };
        write_file(path, output::to_json(&results)?.as_bytes())?;
    }
    if interrupt.requested() { Err(CliError::Interrupted) } else { Ok(()) }
}

/// The study of a flight; one whose structure follows motion has a study of its own.
fn study_of_flight(objective: Objective, space: &TuningSpace, start: &Start, moves: bool) -> String {
    let fits = moves && space.preset() == Preset::Full;
    study_id(objective, space) + if fits { "-moving" } else { "" } + &start.mark(space)
}

fn print(frame: &PlayedFrame) {
    let mode = match (frame.source, frame.mode) {
        (Source::LastGood, _) => "last good",
        (Source::Default, _) => "away",
        (Source::Daemon, OpenEnum::Known(Mode::Default)) => "default",
        (Source::Daemon, OpenEnum::Known(Mode::Explore)) => "explore",
        (Source::Daemon, OpenEnum::Known(Mode::Exploit)) => "exploit",
        (Source::Daemon, OpenEnum::Known(Mode::Pinned)) => "pinned",
        (Source::Daemon, OpenEnum::Unrecognised(_)) => "other",
    };
    let Some(times) = frame.times else {
        println!(
            "{:5}  {:.3}  {mode:10}  this configuration cannot be built; shown with the one before",
            frame.number + 1,
            frame.camera_at
        );
        return;
    };
    let build = match (frame.rebuilt, frame.swapped, frame.stands_in) {
        (true, ..) => format!("{:9.1}", times.build_ms),
        (_, true, _) => format!("{:>9}", "swapped"),
        (_, _, true) => format!("{:>9}", "stands in"),
        _ => format!("{:>9}", "kept"),
    };
    let compared = frame.costs().map_or_else(String::new, |[own_ms, default_ms]| {
        format!("  {default_ms:11.1}  {:6.2} ×", default_ms / own_ms)
    });
    println!(
        "{:5}  {:.3}  {mode:10} {build}  {:9.1}{compared}  {:9.2}",
        frame.number + 1,
        frame.camera_at,
        times.render_ms,
        frame.waiting_ms
    );
}

fn summarise(frames: &[PlayedFrame], baseline: &str) {
    let exploited: Vec<&PlayedFrame> =
        frames.iter().filter(|frame| frame.mode == Mode::Exploit && frame.source == Source::Daemon).collect();
    let waiting: Vec<f64> = frames.iter().map(|frame| frame.waiting_ms).collect();
    println!(
        "\n{} of {} frames were answered by the predictor; the service was waited for {:.2} ms a frame (median)",
        exploited.len(),
        frames.len(),
        Summary::of(&waiting).median,
    );
    let swaps = frames.iter().filter(|frame| frame.swapped).count();
    if swaps > 0 {
        println!("{swaps} structures were built behind the frames and swapped in");
    }
    let spent_ms: f64 = frames.iter().filter_map(PlayedFrame::spent_ms).sum();
    println!("builds before frames, and frames, took {:.2} s", spent_ms / 1e3);
    let costs = exploited.iter().filter_map(|frame| frame.costs());
    let pairs: Vec<f64> = costs.map(|[own_ms, default_ms]| default_ms / own_ms).collect();
    if !pairs.is_empty() {
        let speedup = Summary::of(&pairs);
        println!(
            "predicted frames ran at {:.2} × the speed of the {baseline} (median; middle half {:.2} – {:.2}), without a search for these views",
            speedup.median, speedup.lower_quartile, speedup.upper_quartile,
        );
    }
    if let Some(safety) = safety(frames) {
        let costs = frames.iter().filter_map(PlayedFrame::costs);
        let [own_ms, default_ms] = costs.fold([0.0, 0.0], |[own, default], [a, b]| [own + a, default + b]);
        println!(
            "all frames together cost {:.2} times what they cost with the {baseline}; {}",
            own_ms / default_ms,
            safety.sentence("that"),
        );
    }
}

fn safety(frames: &[PlayedFrame]) -> Option<Safety> {
    let costs = frames.iter().filter_map(PlayedFrame::costs);
    Safety::of(costs.map(|[own_ms, default_ms]| (1, own_ms / default_ms)), 1.0)
}

#[cfg(test)]
mod tests {
    use treewright_renderer::space::Premises;

    use super::*;

    #[test]
    fn frames_are_compared_with_the_same_frames_of_the_baseline() {
        let frame = |times: Option<f64>, default_times: Option<f64>| PlayedFrame {
            number: 0,
            frames_per_build: 1000,
            camera_at: 0.0,
            mode: Mode::Exploit.into(),
            source: Source::Daemon,
            reason: String::new(),
            configuration: Configuration::new(),
            rebuilt: false,
            swapped: false,
            stands_in: false,
            times: times.map(|render_ms| FrameTimes::of(0.0, render_ms)),
            waiting_ms: 0.0,
            default_times: default_times.map(|render_ms| FrameTimes::of(0.0, render_ms)),
        };
        let frames = [
            frame(Some(8.0), Some(10.0)),
            frame(Some(30.0), Some(20.0)),
            frame(None, Some(10.0)),
            frame(Some(9.0), None),
        ];
        assert_eq!(safety(&frames), Some(Safety { frames: 2, dear: 1, worst: 1.5 }));
        assert_eq!(safety(&frames[2..]), None, "nothing was compared");
    }

    #[test]
    fn fits_to_what_moves_are_not_taken_for_builds() {
        let full = TuningSpace::new(Preset::Full, &Premises::all());
        let id = |space: &TuningSpace, start, moves| study_of_flight(Objective::Total, space, &start, moves);
        assert_eq!(id(&full, Start::Recommended, false), study_id(Objective::Total, &full));
        assert_eq!(id(&full, Start::Recommended, true), "total-full-3-moving");
        assert_eq!(id(&full, Start::Native, true), "total-full-3-moving-from-native");
        // There all is rebuilt.
        assert_eq!(id(&TuningSpace::paper(), Start::Recommended, true), "total-paper");
    }
}
