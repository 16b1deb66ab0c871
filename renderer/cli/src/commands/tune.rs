//! `treewright-render tune`: searches, measures the winner again, prints the results.

use std::sync::Arc;
use std::time::{Duration, Instant};

use treewright_client::blocking::{Client, Study};
use treewright_client::{Configuration, ConfirmationStage, Indicators, Source};

pub(crate) use super::tune_arguments::Arguments;
use super::{rounds, tune_output};
use crate::arguments::{note_retired, read_configuration};
use crate::error::{CliError, Result, check_folder, write_file};
use crate::{interrupt::Interrupt, output, report, server::machine};
use treewright_renderer::frame::{Renderer, milliseconds};
use treewright_renderer::measure::{Conditions, Contender, Standing, delay_note, standings};
use treewright_renderer::tuning::ending::{Ending, Progress};
use treewright_renderer::tuning::objective::{specification, study_id};
use treewright_renderer::tuning::patience::{Patience, PatientTuner};
use treewright_renderer::tuning::results::{Milestone, Overhead, Prediction, SceneFacts, TuningResults};
use treewright_renderer::tuning::search::{self, SearchOutcome, SearchSetting};
use treewright_renderer::tuning::verdict::{self, Gains, Rival};
use treewright_renderer::{
    disturbance::Disturbance, limits::ITERATIONS_MAX, space::TuningSpace, tuning::confirmation,
    tuning::who::Who, tuning::workload::Workload,
};
use treewright_scene::{Scene, camera_path::CameraPath, indicators::SceneIndicators};

/// Place on the camera path of the fresh camera for which the predictor is asked.
const FRESH_STEP: f32 = 0.2;
/// Longest time for the last reports to reach the service.
const FLUSH: Duration = Duration::from_secs(10);

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let arguments = &arguments.with_space()?;
    for path in arguments.json.iter().chain(&arguments.report) {
        check_folder(path)?;
    }
    let candidates = arguments.candidate.iter().map(|path| read_configuration(path));
    let candidates = candidates.collect::<Result<Vec<_>, _>>()?;
    let client = arguments.server.connect_within(arguments.view.frame.threads, arguments.patience())?;
    let scene = arguments.view.scene.load()?;
    let recommended = arguments.space.of(&scene, arguments.objective)?;
    let (start, whole) = arguments.start.of(&recommended)?;
    let space = Arc::new(arguments.narrowing.of(&whole)?);
    let camera = arguments.view.camera.find(&scene)?;
    let mut renderer = arguments.view.frame.renderer(&scene)?;
    let id = match &arguments.server.study {
        Some(id) => id.clone(),
        None => {
            let id = study_id(arguments.objective, &whole) + &start.mark(&whole);
            id + &arguments.narrowing.mark(&space) + if arguments.paper { "-as-published" } else { "" }
        }
    };
    let mut workload = arguments.view.frame.workload(&scene, arguments.view.size);
    workload.motion =
        arguments.episode.prepare(arguments.objective, &arguments.view.scene, &recommended, &mut renderer)?;
    workload.frames_per_build = arguments.objective.frames_asked();
    let state = workload.state(&SceneIndicators::of(&scene).with_camera(&camera));
    let study = open_study(&client, &id, &space, &state, arguments)?;
    println!(
        "Tuning {} ({} triangles) at {} for {} in the {} space, {} iterations, study {id}",
        scene.name,
        scene.triangles.len(),
        arguments.view.size,
        arguments.objective.about(),
        space.preset().name(),
        arguments.iterations,
    );

    let interrupt = Interrupt::listen();
    let baseline = verdict::baseline_from(&whole, &start);
    let setting = SearchSetting {
        objective: arguments.objective,
        space: Arc::clone(&space),
        baseline: baseline.choice,
        view: arguments.view.frame.view(camera),
        size: arguments.view.size.0,
        frames: arguments.frames(),
        indicators: state,
    };
    let go_on = || !interrupt.requested();
    let patience = Patience { limit: arguments.patience(), go_on: &go_on };
    // Gone before the confirmation begins, so that the trial that it has asked for ahead is given back.
    let mut tuner = PatientTuner::new(&study, patience);
    let Searched { mut found, milestones, ending } =
        search(&mut renderer, &mut tuner, &setting, arguments, &study, interrupt)?;
    let searched = found.trials.len();
    drop(tuner);
    let mut notes = Vec::new();
    if let Some(ending) = ending {
        // The service ends the search as well, and begins its race.
        study.set_session_policy(arguments.session_policy(1))?;
        notes.push(format!(
            "the search ended after {searched} of {} trials: {ending} (--worth)",
            arguments.iterations
        ));
    }
    if let Err(error) = patience.call(|| client.flush(FLUSH)) {
        notes.push(error.to_string());
    }

    let premises = arguments.space.premises(&scene, arguments.objective);
    let mut rivals = verdict::rivals(&whole, &premises, &start);
    rivals.extend(verdict::for_stills(arguments.objective, &whole, &premises));
    let spinner = output::spinner("the best few run against the start and native Embree");
    let candidates = with_names(candidates, &space)?;
    let known: Vec<Rival> = rivals
        .iter()
        .filter(|rival| verdict::is_had(&rival.contender.who, &start))
        .filter_map(|rival| within(rival, &space))
        .chain(candidates)
        .collect();
    let confirmed =
        confirmation::confirm(&mut renderer, &client, &study, patience, &setting, searched, &known);
    let (winner, proof) = match confirmed {
        Ok(confirmed) => {
            found.append(confirmed.trials);
            (confirmed.configuration, confirmed.standing)
        }
        Err(error) => {
            notes.push(format!("the winner is not confirmed: {error}"));
            // The measurements of this run are known anyway.
            let best = found.lowest().map(|trial| trial.configuration.clone());
            (best.unwrap_or_else(|| space.default_configuration()), None)
        }
    };
    let mut judge =
        Judge { renderer: &mut renderer, study: &study, space: &space, workload, arguments, interrupt };
    let conditions = arguments.conditions(camera);
    spinner.set_message("measuring everybody in fresh rounds");
    let start_name = verdict::start_name(space.preset(), &start);
    let (mut standings, disturbance) =
        judge.standings(&winner, &rivals, &milestones, &baseline.who, &conditions, &mut notes)?;
    let milestones = judge.milestones(milestones, &mut standings, &winner, &start_name);
    let is_proven = proof.as_ref().is_some_and(|proof| proof.confirmation.stage == ConfirmationStage::Better);
    let may_win = |who: &Who| verdict::is_had(who, &start);
    let best = verdict::crown(&mut standings, &start_name, is_proven, may_win);
    // The contender shown to be the fastest is recommended, also where the search did not find it.
    let own = rivals.iter().find(|rival| verdict::is_of(&rival.contender.who, &best, &standings));
    let tuned = match own.and_then(|rival| rival.configuration.clone()) {
        Some(configuration) => configuration,
        None if best == start_name => space.default_configuration(),
        None => winner.clone(),
    };
    spinner.set_message("asking the predictor for another camera");
    let prediction = judge.prediction(&scene, &rivals, &baseline).unwrap_or_else(|error| {
        notes.push(format!("the predictor could not be asked: {error}"));
        None
    });
    spinner.finish_and_clear();
    if interrupt.requested() {
        // Contenders that were not measured have no figures.
        println!(
            "stopped after {} trials, which the study {id} holds; this command goes on from there. Nobody was measured to the end, \
             so there are no results yet",
            found.trials.len()
        );
        return Err(CliError::Interrupted);
    }

    renderer.set_light_sampling(space.choice(&tuned)?.light);
    let frames = arguments.frames();
    let break_even =
        verdict::break_even(&found, arguments.objective, frames, &standings, &best, &baseline.who);
    let whiles = [("searched", found.disturbance), ("measured again", disturbance)];
    for (when, note) in whiles.into_iter().filter_map(|(when, seen)| Some((when, seen.description()?))) {
        notes.push(format!("while it was {when}, {note}"));
    }
    notes.extend(delay_note(&standings));
    notes.extend(verdict::fewer_rounds_note(&standings, arguments.rounds));
    let confirming = found.trials.len() - searched;
    notes.push(format!("{searched} trials searched, and {confirming} more ran the best few in turns"));
    let results = TuningResults {
        scene: SceneFacts::of(&scene, &renderer),
        size: arguments.view.size.0,
        frames_per_trial: arguments.frames(),
        objective: arguments.objective,
        space: space.preset(),
        parameters: space.explained().collect(),
        start: space.with_held(&space.default_configuration()),
        milestones,
        baseline: baseline.who,
        server: client.url().to_owned(),
        study: id,
        machine: machine().threads(u32::try_from(renderer.threads()).unwrap_or(u32::MAX)),
        indicators: setting.indicators.clone(),
        safety: None,
        overhead: Overhead::of(&found.trials),
        trials: found.whole_trials(&space),
        confirmation: proof,
        reference_ms: found.reference_ms,
        found: space.with_held(&winner),
        tuned: space.with_held(&tuned),
        gains: Gains::of(&standings, &best, &start_name),
        began_at: start_name,
        best,
        standings,
        disturbance,
        prediction,
        break_even,
        break_even_frame: break_even.frame(),
        client: client.stats(),
        notes,
    }
    .judged();
    tune_output::print(&results);
    if let Some(path) = &arguments.json {
        write_file(path, output::to_json(&results)?.as_bytes())?;
        println!("wrote {}", path.display());
    }
    if let Some(path) = &arguments.report {
        let html = report::html(&mut renderer, &setting, &results)?;
        write_file(path, html.as_bytes())?;
        println!("wrote {}", path.display());
    }
    Ok(())
}

/// Creates or finds the study, and explores this scene and view in this session.
fn open_study(
    client: &Client,
    id: &str,
    space: &TuningSpace,
    state: &Indicators,
    arguments: &Arguments,
) -> Result<Study> {
    let study = client.study(id, specification(space, arguments.objective, arguments.policy())?)?;
    let insight = study.predict(state)?.state;
    let done = insight.map_or(0, |insight| insight.tried);
    let room = u32::try_from(done).unwrap_or(0).saturating_add(arguments.iterations).min(ITERATIONS_MAX);
    study.set_session_policy(arguments.session_policy(room))?;
    if done > 0 {
        println!("{done} configurations were tried here already; the search goes on where it stood.");
    }
    Ok(study)
}

/// Configurations of the user's, to run with the others.
fn with_names(candidates: Vec<Configuration>, space: &TuningSpace) -> Result<Vec<Rival>> {
    let named = candidates.into_iter().map(|candidate| {
        let configuration = space.complete(&candidate)?;
        note_retired(space, &candidate);
        Ok(Rival::of(Who::Named(configuration.to_string().into()), space, configuration)?)
    });
    named.collect()
}

/// A rival as one of a part of the space; `None` for a configuration that has no place there.
fn within(rival: &Rival, space: &TuningSpace) -> Option<Rival> {
    let configuration = match &rival.configuration {
        Some(configuration) => Some(space.complete(configuration).ok()?),
        None => None,
    };
    Some(Rival { contender: rival.contender.clone(), configuration })
}

/// Whether the service is asked for its best after this number of trials: 1, 2, 3, 4, 6, 8, 12, 16, ….
fn is_milestone(trials: u32) -> bool {
    trials.is_power_of_two() || trials.is_multiple_of(3) && (trials / 3).is_power_of_two()
}

struct Searched {
    found: SearchOutcome,
    milestones: Vec<Milestone>,
    ending: Option<Ending>,
}

/// Runs the search under a progress bar, with the study's outlook at each milestone.
fn search(
    renderer: &mut Renderer,
    tuner: &mut PatientTuner<'_>,
    setting: &SearchSetting,
    arguments: &Arguments,
    study: &Study,
    interrupt: Interrupt,
) -> Result<Searched> {
    let iterations = arguments.iterations;
    let bar = output::bar(u64::from(iterations), "trials");
    let (mut spent, mut ending) = (Duration::ZERO, None);
    let mut best: Option<f64> = None;
    let mut away = false;
    let mut milestones = Vec::new();
    let found = search::run(renderer, tuner, setting, iterations, |iteration| {
        spent += Duration::from_secs_f64(iteration.total_ms / 1e3);
        if let Some(cost) = iteration.cost {
            best = Some(best.map_or(cost, |best| best.min(cost)));
        }
        let now_away = iteration.source != Source::Daemon;
        if now_away != away {
            bar.suspend(|| match now_away {
                true => eprintln!(
                    "trial {}: the daemon does not answer; going on with the last good configuration",
                    iteration.number
                ),
                false => eprintln!("trial {}: the daemon answers again", iteration.number),
            });
            away = now_away;
        }
        if !away && is_milestone(iteration.number) {
            let trials = iteration.number;
            if let Ok(best) = study.best(&setting.indicators) {
                milestones.push(Milestone { trials, configuration: best.configuration, over_start: None });
            }
            let insight = study.predict(&setting.indicators).ok().and_then(|answer| answer.state);
            if let Some(insight) = insight {
                let tried = u32::try_from(insight.tried).unwrap_or(u32::MAX);
                let progress = Progress { trials, trials_max: iterations, tried, spent };
                // A state whose search the service takes for finished has no outlook.
                ending = insight.expected_gain.and_then(|gain| Ending::of(progress, gain, arguments.worth()));
            }
        }
        let best = best.map(|best| format!("best {best:.1} ms"));
        bar.set_message(best.unwrap_or_else(|| "nothing could be built yet".to_owned()));
        bar.inc(1);
        ending.is_none() && !interrupt.requested()
    })?;
    bar.finish_and_clear();
    Ok(Searched { found, milestones, ending })
}

/// The common part of the measurements after the search.
struct Judge<'a> {
    renderer: &'a mut Renderer,
    study: &'a Study,
    space: &'a TuningSpace,
    workload: Workload,
    arguments: &'a Arguments,
    interrupt: Interrupt,
}

impl Judge<'_> {
    /// All rivals and the search's best, in fresh rounds, with the other work of the machine.
    fn standings(
        &mut self,
        found: &Configuration,
        rivals: &[Rival],
        milestones: &[Milestone],
        baseline: &Who,
        conditions: &Conditions,
        notes: &mut Vec<String>,
    ) -> Result<(Vec<Standing>, Disturbance)> {
        let mut contenders: Vec<Contender> = rivals.iter().map(|rival| rival.contender.clone()).collect();
        contenders.push(verdict::contender(Who::Found, self.space, found)?);
        // Each answer on the way runs once, and those that run anyway not again.
        let mut seen = vec![found.clone()];
        seen.extend(self.start_in_space());
        for milestone in milestones {
            if !seen.contains(&milestone.configuration) {
                seen.push(milestone.configuration.clone());
                let who = Who::AfterTrials(milestone.trials);
                contenders.push(verdict::contender(who, self.space, &milestone.configuration)?);
            }
        }
        let (measured, watch) =
            rounds::in_two_processes(self.renderer, &contenders, conditions, self.interrupt, notes);
        let standings = verdict::keep_best_native(standings(&measured, conditions.frames_per_build));
        let rounds = standings.iter().find(|one| one.who == *baseline).map(|one| one.rounds_ms.clone());
        let disturbance = watch.end(self.renderer.threads(), &rounds.unwrap_or_default());
        Ok((standings, disturbance))
    }

    /// The start as a configuration of the searched space; `None` where a part of it begins elsewhere.
    fn start_in_space(&self) -> Option<Configuration> {
        self.arguments.narrowing.is_empty().then(|| self.space.default_configuration())
    }

    /// Gains of the answers on the way over the start; their standings leave the table.
    fn milestones(
        &self,
        milestones: Vec<Milestone>,
        standings: &mut Vec<Standing>,
        found: &Configuration,
        start: &Who,
    ) -> Vec<Milestone> {
        let find = |who: &Who| standings.iter().find(|one| one.who == *who);
        let mut ran: Vec<(Configuration, Who)> = vec![(found.clone(), Who::Found)];
        ran.extend(self.start_in_space().map(|configuration| (configuration, start.clone())));
        let mut measured = Vec::new();
        for milestone in milestones {
            let known = ran.iter().find(|(configuration, _)| *configuration == milestone.configuration);
            let who = known.map_or(Who::AfterTrials(milestone.trials), |(_, who)| who.clone());
            let pair = find(&who).zip(find(start));
            let over_start = pair.map(|(one, start)| one.gain_over(start)).filter(|ratio| ratio.count > 0);
            ran.push((milestone.configuration.clone(), who));
            measured.push(Milestone { over_start, ..milestone });
        }
        standings.retain(|one| !matches!(one.who, Who::AfterTrials(_)));
        measured
    }

    /// Asks the predictor for a camera that was never tuned, and measures its answer there.
    fn prediction(
        &mut self,
        scene: &Arc<Scene>,
        rivals: &[Rival],
        baseline: &Contender,
    ) -> Result<Option<Prediction>> {
        if self.interrupt.requested() {
            return Ok(None);
        }
        let camera_at = (self.arguments.view.camera.at.unwrap_or(0.0) + FRESH_STEP) % 1.0;
        let camera = CameraPath::of(scene).sample(camera_at);
        let begin = Instant::now();
        let answer =
            self.study.predict(&self.workload.state(&SceneIndicators::of(scene).with_camera(&camera)))?;
        let answer_ms = milliseconds(begin);
        let asked = |rival: &&Rival| {
            let who = &rival.contender.who;
            *who != baseline.who && (who.native_use().is_some() || *who == Who::BestFixed)
        };
        let mut contenders = vec![baseline.clone()];
        contenders.extend(rivals.iter().filter(asked).map(|rival| rival.contender.clone()));
        contenders.push(verdict::contender(Who::Predicted, self.space, &answer.configuration)?);
        let conditions = self.arguments.conditions(camera);
        let stop = || self.interrupt.requested();
        let measured = rounds::measure(self.renderer, &contenders, &conditions, 1, stop);
        Ok(Some(Prediction {
            camera_at,
            mode: answer.mode,
            reason: answer.reason.summary,
            configuration: answer.configuration,
            answer_ms,
            standings: verdict::keep_best_native(standings(&measured, conditions.frames_per_build)),
        }))
    }
}
