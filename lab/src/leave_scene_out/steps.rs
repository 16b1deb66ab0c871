//! The measurements. Every step takes a loaded scene and adds its results to the book.

use std::{collections::BTreeMap, sync::Arc, time::Duration};

use treewright_client::blocking::{Client, Study};
use treewright_client::{Indicators, Options, Policy, Prediction, SessionPolicy};
use treewright_render_cli::{error::CliError, error::Result, interrupt::Interrupt, server::machine};
use treewright_renderer::measure::{Conditions, Contender, Yardstick, interleaved};
use treewright_renderer::space::{Premises, Preset, TuningSpace};
use treewright_renderer::tuning::objective::{Objective, measurements, specification, study_id};
use treewright_renderer::tuning::search::{self, SearchSetting};
use treewright_renderer::tuning::verdict::{self, Rival};
use treewright_renderer::tuning::who::{NATIVE_DEFAULT, Who};
use treewright_renderer::{
    disturbance::Watch, frame::Renderer, integrator::View, tuning::workload::Workload,
};
use treewright_scene::{Scene, indicators::SceneIndicators};

use super::book::{Book, RecordedContender, RecordedRounds, RecordedSearch, RecordedTrial};
use super::judge::{self, ALONE, CANDIDATES, FIXED_OF_OTHERS, LEFT_OUT, key};
use super::{daemon::Daemon, hand, suite::Context};

/// Numbers of reported trials after which the service is asked for the best.
pub(crate) const CHECKPOINTS: [u32; 5] = [1, 8, 16, 32, 60];
pub(crate) const DEADLINE: Duration = Duration::from_secs(10);
const SEED: u64 = 1;
const BOUNCES: u32 = 3;

/// A scene on render threads of a context.
pub(crate) struct Stage {
    renderer: Renderer,
    workload: Workload,
    context: Context,
    scene: String,
    pub(crate) interrupt: Interrupt,
}

impl Stage {
    pub(crate) fn new(
        name: &str,
        scene: &Arc<Scene>,
        context: Context,
        interrupt: Interrupt,
    ) -> Result<Self> {
        let workload = Workload::of(scene, context.size.0, BOUNCES);
        let renderer = Renderer::new(scene.clone(), context.threads)?;
        Ok(Self { renderer, workload, context, scene: name.to_owned(), interrupt })
    }

    fn view(&self) -> View {
        View { camera: self.renderer.scene().cameras[0], seed: SEED, bounces: BOUNCES }
    }

    /// Every configuration for all scenes, in shared rounds: native, by hand, and every scene's winner.
    pub(crate) fn candidates(
        &mut self,
        book: &Book,
        objective: Objective,
        rounds: u32,
    ) -> Result<RecordedRounds> {
        let space = space(objective);
        let mut all = hand::rivals(&space, objective)?;
        for scene in book.scenes.keys() {
            let search = book.searches.get(&key(ALONE, objective, scene, &self.context.to_string()));
            if let Some(winner) = search.and_then(|search| search.answers.values().next_back()) {
                hand::push(&mut all, &space, winner.clone())?;
            }
        }
        Ok(self.rounds(all, objective, rounds))
    }

    /// The answers of a search beside all candidates.
    pub(crate) fn finals(
        &mut self,
        book: &Book,
        objective: Objective,
        rounds: u32,
    ) -> Result<Option<RecordedRounds>> {
        let context = self.context.to_string();
        let (Some(search), Some(fixed)) = (
            book.searches.get(&key(LEFT_OUT, objective, &self.scene, &context)),
            judge::fixed_of_others(book, objective, &self.scene, &context),
        ) else {
            return Ok(None);
        };
        let space = space(objective);
        let mut all = hand::natives(&space);
        let mut entrants = vec![(FIXED_OF_OTHERS, fixed)];
        entrants.push((Who::AfterFrames(0), search.first_answer.clone()));
        let answers = search.answers.iter();
        entrants.extend(answers.map(|(frames, answer)| (Who::AfterFrames(*frames), answer.clone())));
        entrants.push((Who::BestFixed, space.default_configuration()));
        // The roofline: what its own search found, and the two that were fastest here of everything that ran.
        if let Some(alone) = book.searches.get(&key(ALONE, objective, &self.scene, &context)) {
            let own = alone.answers.values().next_back();
            entrants.extend(own.map(|own| (Who::Named("its own search".into()), own.clone())));
        }
        let ran = book.rounds.get(&key(CANDIDATES, objective, &self.scene, &context));
        let costs = ran.map(|ran| judge::relative_costs(ran, objective.frames_per_build()));
        let mut ranked: Vec<_> = costs.unwrap_or_default().into_iter().collect();
        ranked.sort_by(|(_, a), (_, b)| a.total_cmp(b));
        let best = ["fastest 1", "fastest 2"].into_iter().zip(ranked);
        entrants.extend(best.map(|(place, (configuration, _))| (Who::Named(place.into()), configuration)));
        for (who, configuration) in entrants {
            all.push(Rival::of(who, &space, configuration)?);
        }
        Ok(Some(self.rounds(all, objective, rounds)))
    }

    pub(crate) fn rounds(&mut self, rivals: Vec<Rival>, objective: Objective, rounds: u32) -> RecordedRounds {
        let conditions = Conditions {
            view: self.view(),
            size: self.context.size.0,
            rounds,
            frames_per_build: objective.frames_per_build(),
            yardstick: Yardstick::Frame,
        };
        let contenders: Vec<Contender> = rivals.iter().map(|rival| rival.contender.clone()).collect();
        let watch = Watch::begin();
        let measured =
            interleaved(&mut self.renderer, &contenders, &conditions, || !self.interrupt.requested());
        let native = measured.iter().find(|one| one.who == NATIVE_DEFAULT);
        let times: Vec<f64> =
            native.iter().flat_map(|one| &one.frames).map(|times| times.render_ms).collect();
        let disturbance = watch.end(self.renderer.threads(), &times);
        let contenders = measured
            .into_iter()
            .zip(rivals)
            .map(|(measured, rival)| RecordedContender::new(measured, rival.configuration))
            .collect();
        RecordedRounds { contenders, disturbed: disturbance.disturbed }
    }

    /// A search by a fresh daemon, which with `others` first gets what the other scenes measured.
    pub(crate) fn search(
        &mut self,
        book: &Book,
        objective: Objective,
        iterations: u32,
        others: bool,
    ) -> Result<RecordedSearch> {
        let daemon = Daemon::start()?;
        let threads = u32::try_from(self.context.threads).unwrap_or(u32::MAX);
        let options = Options::new().fingerprint(machine().threads(threads));
        let (client, study) = join(&daemon, objective, &space(objective), options)?;
        if others {
            teach(book, objective, &self.scene, &self.context.to_string(), (&client, &study))?;
        }
        self.explore(&client, &study, objective, iterations)
    }

    /// The first answer of a study to this scene, and a search there that explores in every frame.
    pub(crate) fn explore(
        &mut self,
        client: &Client,
        study: &Study,
        objective: Objective,
        iterations: u32,
    ) -> Result<RecordedSearch> {
        let space = Arc::new(space(objective));
        let camera = self.renderer.scene().cameras[0];
        let state = self.workload.state(&SceneIndicators::of(self.renderer.scene()).with_camera(&camera));
        let first_answer = study.predict(&state)?.configuration;
        study.set_session_policy(SessionPolicy {
            epsilon: Some(1.0),
            trials_per_state: Some(iterations),
            abort_above: None,
            ..SessionPolicy::default()
        })?;
        let setting = SearchSetting {
            objective,
            baseline: verdict::baseline(Preset::Full).choice,
            space,
            view: self.view(),
            size: self.context.size.0,
            frames: 1,
            indicators: state.clone(),
        };
        let mut answers = BTreeMap::new();
        let interrupt = self.interrupt;
        let mut failure = None;
        let found = search::run(&mut self.renderer, &mut study.tuner(), &setting, iterations, |trial| {
            // The report of this trial goes out with the next question; those before it are known.
            let known = trial.number - 1;
            if CHECKPOINTS.contains(&known) {
                match study.best(&state) {
                    Ok(best) => drop(answers.insert(known, best.configuration)),
                    Err(error) => failure = Some(error),
                }
            }
            !interrupt.requested()
        })?;
        client.flush(DEADLINE)?;
        if let Some(error) = failure {
            return Err(error.into());
        }
        if interrupt.requested() {
            return Err(CliError::Interrupted);
        }
        answers.insert(iterations, study.best(&state)?.configuration);
        let trials = found.trials.into_iter().map(|trial| RecordedTrial {
            configuration: trial.configuration,
            outcome: trial.outcome,
            times: trial.times,
        });
        Ok(RecordedSearch {
            state,
            trials: trials.collect(),
            first_answer,
            answers,
            disturbed: found.disturbance.disturbed,
        })
    }
}

/// Reports the measurements of all scenes but one, without what only that scene's search found.
fn teach(
    book: &Book,
    objective: Objective,
    without: &str,
    context: &str,
    (client, study): (&Client, &Study),
) -> Result<()> {
    let own = judge::found_only_in(book, objective, without, context);
    for scene in book.scenes.keys().filter(|scene| *scene != without) {
        let Some(search) = book.searches.get(&key(ALONE, objective, scene, context)) else { continue };
        for trial in &search.trials {
            tell(study, &search.state, trial, objective)?;
        }
        // Then what ran beside all others there, frame by frame in the order in which it ran.
        if let Some(rounds) = book.rounds.get(&key(CANDIDATES, objective, scene, context)) {
            for (configuration, outcome, times) in rounds.frames(&own) {
                let suggestion = study.trial_of(&search.state, configuration)?;
                suggestion.report(measurements(times, 1, objective), outcome)?;
            }
        }
    }
    client.flush(DEADLINE)?;
    Ok(())
}

/// The first answer to a recorded scene by a daemon that knows the others. Nothing is rendered.
pub(crate) fn first_answer(
    book: &Book,
    objective: Objective,
    scene: &str,
    context: Context,
) -> Result<Option<Prediction>> {
    let name = context.to_string();
    let Some(search) = book.searches.get(&key(ALONE, objective, scene, &name)) else { return Ok(None) };
    let daemon = Daemon::start()?;
    let options = Options::new().fingerprint(book.machine.clone());
    let (client, study) = join(&daemon, objective, &space(objective), options)?;
    teach(book, objective, scene, &name, (&client, &study))?;
    Ok(Some(study.predict(&search.state)?))
}

/// A client of a daemon, and the study of an objective and a space there, which it creates.
pub(crate) fn join(
    daemon: &Daemon,
    objective: Objective,
    space: &TuningSpace,
    options: Options,
) -> Result<(Client, Study)> {
    let client = Client::connect(&daemon.url, options.deadline(DEADLINE))?;
    let study = client.study(&study_id(objective, space), specification(space, objective, Policy::new())?)?;
    Ok((client, study))
}

/// Reports a recorded trial, as its client would have.
pub(crate) fn tell(
    study: &Study,
    state: &Indicators,
    trial: &RecordedTrial,
    objective: Objective,
) -> Result<()> {
    let suggestion = study.trial_of(state, &trial.configuration)?;
    Ok(suggestion.report(measurements(trial.times, 1, objective), trial.outcome.clone())?)
}

/// The space of an objective: one for all scenes of the suite, so that each can teach the others.
pub(crate) fn space(objective: Objective) -> TuningSpace {
    let premises = Premises { builds_each_frame: objective.builds_each_frame(), ..Premises::all() };
    TuningSpace::new(Preset::Full, &premises)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use treewright_scene::builtin;

    #[test]
    fn final_rounds_hold_answers_rivals_and_the_fastest() {
        let options = builtin::Options { detail: 0.02, ..builtin::Options::default() };
        let scene = Arc::new(builtin::build("quick", &options).expect("it is built in"));
        let context: Context = "0@16x12".parse().expect("it is sound");
        let mut stage = Stage::new("a", &scene, context, Interrupt::listen()).expect("Embree starts");
        let objective = Objective::Render;
        let mut book = Book::default();
        let candidates = stage.candidates(&book, Objective::Render, 2).expect("they are sound");
        let own = candidates.contenders.iter().filter(|one| one.configuration.is_some()).count();
        let frames = candidates.frames(&BTreeSet::new());
        assert_eq!(frames.len(), 2 * own, "each of them in every round, and native Embree's default in none");
        let without = BTreeSet::from([frames[0].0.to_string()]);
        let others = candidates.frames(&without);
        assert!(others.len() == 2 * (own - 1) && others.iter().all(|frame| frame.0 != frames[0].0));
        assert_eq!(frames[0].0, frames[own].0, "one round after the other");
        let facts = super::super::book::SceneFacts { triangles: 1, instanced: false };
        for scene in ["a", "b"] {
            book.scenes.insert(scene.to_owned(), facts);
            book.rounds.insert(key(CANDIDATES, objective, scene, "0@16x12"), candidates.clone());
        }
        assert!(stage.finals(&book, objective, 1).expect("it is sound").is_none(), "there was no search");
        let answer = space(objective).default_configuration();
        let search = RecordedSearch {
            first_answer: answer.clone(),
            answers: BTreeMap::from([(8, answer.clone())]),
            ..RecordedSearch::default()
        };
        book.searches.insert(key(LEFT_OUT, objective, "a", "0@16x12"), search);
        let finals = stage.finals(&book, objective, 2).expect("it is sound").expect("everything is there");
        let configuration = |who: Who| finals.find(&who).and_then(|one| one.configuration.as_ref());
        assert_eq!(configuration(Who::AfterFrames(8)), Some(&answer));
        for who in [FIXED_OF_OTHERS, Who::Named("fastest 1".into())] {
            assert!(configuration(who).is_some());
        }
        assert!(finals.contenders.iter().all(|one| one.failure.is_some() || one.render_ms.len() == 2));
        book.rounds.insert(key(judge::FINAL, objective, "a", "0@16x12"), finals);
        assert_eq!(judge::rows(&book, &[objective]).len(), 1);
    }
}
