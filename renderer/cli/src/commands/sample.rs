//! `treewright-render sample`: measures random configurations (paper, section 4.1) and records them as
//! trials.
//!
//! Sample 17 of a camera is a fixed configuration, drawn evenly over the space
//! ([`sampling`](treewright_renderer::tuning::sampling)). Its number stands among the measurements, so that a
//! run that was killed goes on with the missing ones.
//!
//! Several renderers share a study. Each takes a sample by opening a trial of it, then reads all trials since
//! its last look, and gives its own back if the sample was opened under a lower number. Of any two at least
//! the later one sees the other. A result after the end of the trial's lease is thrown away.

mod claims;

use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::HumanDuration;
use treewright_client::blocking::Client;
use treewright_client::{ClientError, Options, Outcome, Policy, PredictorMethod, Question, TrialRecord};

use crate::arguments::{FrameArguments, SceneArguments, Size, SpaceArguments};
use crate::{
    error::CliError, error::Result, interrupt::Interrupt, narrowing::NarrowingArguments, output,
    server::ServerArguments,
};
use claims::Claims;
use treewright_renderer::limits::{FRAMES_PER_TRIAL_MAX, SAMPLES_PER_PLACE_MAX};
use treewright_renderer::space::{Narrowing, TuningSpace};
use treewright_renderer::tuning::objective::{Objective, space_in_ids, specification};
use treewright_renderer::tuning::sampling::{SAMPLE, SEQUENCE, Sequence};
use treewright_renderer::tuning::search::{SearchSetting, trial};
use treewright_renderer::{film::Film, frame::Renderer, tuning::verdict};
use treewright_scene::{camera_path::CameraPath, indicators::SceneIndicators};

/// Pause before another look at the trials of other renderers, or for a daemon that is away.
const PAUSE: Duration = Duration::from_millis(500);
/// Interval of lines of progress where no bar is shown.
const TELL_EVERY: Duration = Duration::from_secs(30);
/// Of the drawn configurations.
const SAMPLE_SEED: u64 = 1;

#[derive(Args, Clone, Debug)]
pub(crate) struct Arguments {
    #[command(flatten)]
    server: ServerArguments,

    /// A glTF, GLB, OBJ or PLY file, or `builtin:NAME`; may be given several times.
    #[arg(long, value_name = "PATH|builtin:NAME", required = true)]
    scene: Vec<String>,

    /// Factor for the number of triangles of built-in scenes, 0.001 to 8.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    detail: f32,

    /// Seed of built-in scenes.
    #[arg(long, value_name = "N")]
    scene_seed: Option<u64>,

    /// Cameras along each scene's path, at the centres of equal parts.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    cameras: u32,

    /// Samples per camera.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(SAMPLES_PER_PLACE_MAX)))]
    samples: u32,

    /// Randomise only these parameters; others keep their recommended values. Default: all.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    parameters: Vec<String>,

    #[command(flatten)]
    narrowing: NarrowingArguments,

    #[command(flatten)]
    frame: FrameArguments,

    #[command(flatten)]
    space: SpaceArguments,

    /// Size in pixels.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "320x240")]
    size: Size,

    /// Frames of each sample; their median counts.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=i64::from(FRAMES_PER_TRIAL_MAX)))]
    frames: u32,

    /// Who this is, unique among renderers at one time. One that is restarted under its old name takes up at
    /// once what it held; else that waits for the end of a lease.
    #[arg(long, value_name = "ID")]
    name: Option<String>,
}

struct Place {
    renderer: usize,
    setting: SearchSetting,
    sequence: Sequence,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let client = arguments.server.connect(arguments.frame.threads)?;
    let mut renderers = Vec::new();
    let mut places = Vec::new();
    let mut study: Option<String> = None;
    for scene in &arguments.scene {
        let scene =
            SceneArguments::plain(scene.clone(), arguments.detail, arguments.scene_seed, 0.0).load()?;
        let whole = arguments.space.judged_by(Objective::Render)?.of(&scene, Objective::Render)?;
        let id = arguments.server.study.clone().unwrap_or_else(|| format!("sample-{}", space_in_ids(&whole)));
        if study.as_ref() != Some(&id) {
            // A model is of no use here, and fitting one would disturb the next measurement.
            let policy = Policy::new().predictor(PredictorMethod::NearestNeighbour).epsilon(0.0);
            client.study(&id, specification(&whole, Objective::Render, policy)?)?;
            if study.replace(id).is_some() {
                return Err(CliError::Usage(
                    "scenes with and without instances have different parameters; sample them in runs of their own"
                        .to_owned(),
                ));
            }
        }
        let part = Arc::new(part(arguments, &whole)?);
        let path = CameraPath::of(&scene);
        let workload = arguments.frame.workload(&scene, arguments.size);
        for camera in 0..arguments.cameras {
            let camera = path.sample((camera as f32 + 0.5) / arguments.cameras as f32);
            let state = workload.state(&SceneIndicators::of(&scene).with_camera(&camera));
            let setting = SearchSetting {
                objective: Objective::Render,
                space: Arc::clone(&part),
                baseline: verdict::baseline(whole.preset()).choice,
                view: arguments.frame.view(camera),
                size: arguments.size.0,
                frames: arguments.frames,
                indicators: state,
            };
            let sequence = Sequence::new(&part, &setting.indicators, SAMPLE_SEED);
            places.push(Place { renderer: renderers.len(), setting, sequence });
        }
        renderers.push(arguments.frame.renderer(&scene)?);
    }
    let study = study.ok_or_else(|| CliError::Usage("name a scene with --scene".to_owned()))?;
    let name = arguments.name.clone().unwrap_or_else(|| format!("sample-{}", Options::new().client_id));
    let sampler = Sampler {
        client: &client,
        study: &study,
        name,
        samples: arguments.samples,
        interrupt: Interrupt::listen(),
    };
    sampler.run(&mut renderers, &places)
}

fn part(arguments: &Arguments, whole: &TuningSpace) -> Result<TuningSpace> {
    let part = arguments.narrowing.of(whole)?;
    if arguments.parameters.is_empty() {
        return Ok(part);
    }
    let known = |name: &String| part.explained().any(|one| one.parameter.name == *name);
    if let Some(unknown) = arguments.parameters.iter().find(|name| !known(name)) {
        return Err(CliError::Usage(format!("there is no parameter {unknown} in this part of the space")));
    }
    let others = part.explained().filter(|one| !arguments.parameters.contains(&one.parameter.name));
    let fixed: Vec<Narrowing> =
        others.map(|one| Narrowing::Fix { name: one.parameter.name, value: one.parameter.default }).collect();
    Ok(part.narrowed(&fixed)?)
}

struct Sampler<'a> {
    client: &'a Client,
    study: &'a str,
    name: String,
    samples: u32,
    interrupt: Interrupt,
}

struct Progress {
    bar: indicatif::ProgressBar,
    begin: Instant,
    shown: Instant,
    /// Samples of this run, and how many of them cannot be run.
    own: u64,
    failed: u64,
    all: u64,
}

impl Progress {
    fn step(&mut self, done: u64, is_ok: bool) {
        self.own += 1;
        self.failed += u64::from(!is_ok);
        let each_s = self.begin.elapsed().as_secs_f64() / self.own as f64;
        let left = HumanDuration(Duration::from_secs_f64(each_s * (self.all - done) as f64));
        self.bar.set_position(done);
        self.bar.set_message(format!("about {left} left"));
        if self.bar.is_hidden() && self.shown.elapsed() >= TELL_EVERY {
            self.shown = Instant::now();
            eprintln!("{done} of {} samples, about {left} left", self.all);
        }
    }
}

impl Sampler<'_> {
    fn run(&self, renderers: &mut [Renderer], places: &[Place]) -> Result<()> {
        let mut claims = Claims::new(&self.name);
        self.patiently(|| claims.look(self.client, self.study))?;
        let all = places.len() as u64 * u64::from(self.samples);
        let there = |claims: &Claims| -> u64 {
            places.iter().map(|place| claims.done(place.sequence.identity(), self.samples)).sum()
        };
        let known = there(&claims);
        println!(
            "{all} samples at {} camera(s), {known} of them there already, study {}",
            places.len(),
            self.study
        );
        let now = Instant::now();
        let mut progress =
            Progress { bar: output::bar(all, "samples"), begin: now, shown: now, own: 0, failed: 0, all };
        let mut films: Vec<Film> = places.iter().map(|place| Film::new(place.setting.size)).collect();
        // Ready once a first frame, which is slower than all others, was rendered.
        let mut warm = vec![false; renderers.len()];
        loop {
            let before = progress.own;
            let mut is_missing = false;
            // Number by number over all cameras, so that a run that is stopped has about as many everywhere.
            for number in 0..self.samples {
                for (place, film) in places.iter().zip(&mut films) {
                    if self.interrupt.requested() {
                        progress.bar.finish_and_clear();
                        println!("stopped after {} samples of this run; this command goes on", progress.own);
                        return Err(CliError::Interrupted);
                    }
                    if claims.has(place.sequence.identity(), number) {
                        continue;
                    }
                    is_missing = true;
                    let Some(open) = self.claim(&mut claims, place, number)? else { continue };
                    let renderer = &mut renderers[place.renderer];
                    if !std::mem::replace(&mut warm[place.renderer], true) {
                        trial(
                            renderer,
                            &place.setting.space.default_configuration(),
                            None,
                            &place.setting,
                            film,
                        );
                    }
                    let is_ok = self.measure(&open, renderer, place, number, film)?;
                    claims.note(place.sequence.identity(), number);
                    progress.step(there(&claims), is_ok);
                }
            }
            if !is_missing {
                break;
            }
            if progress.own == before {
                // Other renderers hold the missing samples; the leases of a killed one end.
                std::thread::sleep(PAUSE);
            }
            self.patiently(|| claims.look_at_held(self.client, self.study))?;
        }
        progress.bar.finish_and_clear();
        let Progress { own, failed, begin, .. } = progress;
        let took = HumanDuration(begin.elapsed());
        println!("{all} samples are there: {own} by this run in {took}, {failed} of them cannot be run");
        Ok(())
    }

    /// Opens a trial of a sample; `None` where another renderer has it.
    fn claim(&self, claims: &mut Claims, place: &Place, number: u32) -> Result<Option<TrialRecord>> {
        let configuration = place.sequence.configuration(number);
        let indicators = &place.setting.indicators;
        if claims.is_held(indicators, &configuration) {
            return Ok(None);
        }
        let question = Question {
            indicators: indicators.clone(),
            client_id: Some(self.name.clone()),
            wanted: Some(configuration),
            ..Question::default()
        };
        let open = self.patiently(|| self.client.ask(self.study, &question))?;
        self.patiently(|| claims.look(self.client, self.study))?;
        if claims.has(place.sequence.identity(), number) || claims.is_held_before(&open) {
            self.patiently(|| self.client.give_back(&open.name))?;
            return Ok(None);
        }
        Ok(Some(open))
    }

    /// Measures a sample and reports it; whether it could be run.
    fn measure(
        &self,
        open: &TrialRecord,
        renderer: &mut Renderer,
        place: &Place,
        number: u32,
        film: &mut Film,
    ) -> Result<bool> {
        let begin = Instant::now();
        let (outcome, times) = trial(renderer, &open.configuration, None, &place.setting, film);
        if lease(open).is_some_and(|lease| begin.elapsed() >= lease) {
            return Err(CliError::Failed(format!(
                "a sample took longer than its lease; give the study more: treewright policy {} --lease-s SECONDS",
                self.study
            )));
        }
        let measurements = place
            .setting
            .measurements(times)
            .with(SAMPLE, f64::from(number))
            .with(SEQUENCE, f64::from(place.sequence.identity()));
        self.patiently(|| self.client.tell(&open.name, &measurements, &outcome))?;
        Ok(outcome == Outcome::Ok)
    }

    /// Asks again while the daemon is away. Who interrupts that wants to end, whatever the daemon does.
    fn patiently<T>(&self, mut ask: impl FnMut() -> Result<T, ClientError>) -> Result<T> {
        let mut said = false;
        loop {
            match ask() {
                Err(error) if error.is_unreachable() => {
                    if self.interrupt.requested() {
                        return Err(CliError::Interrupted);
                    }
                    if !std::mem::replace(&mut said, true) {
                        eprintln!("{error}; waiting for it");
                    }
                    std::thread::sleep(PAUSE);
                }
                other => return Ok(other?),
            }
        }
    }
}

/// Longest time of a trial. Clocks of machines differ, their seconds hardly.
fn lease(open: &TrialRecord) -> Option<Duration> {
    open.lease_expire_time?.duration_since(open.create_time?).ok()
}
