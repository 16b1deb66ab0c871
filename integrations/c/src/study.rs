//! A study, and the per-frame loop over it.

use std::mem::MaybeUninit;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use treewright_client::{ConfirmationStage, Finished, Outcome, blocking};

use crate::configuration::{Configuration, from_json};
use crate::edge::{Array, ErrorOut, Number, Text, guard, indicators, need, put, store};
use crate::suggestion::Suggestion;

/// A study. May be used by several threads at once.
#[derive(Debug)]
pub(crate) struct Study(pub(crate) blocking::Study);

/// A frame loop: the last result and the next question travel together.
#[derive(Debug)]
pub(crate) struct Tuner {
    study: blocking::Study,
    process: u32,
    frames: Mutex<Loop>,
    /// Of the child of a fork: a lock that another thread held when the process was forked stays locked.
    child: OnceLock<Box<Tuner>>,
}

#[derive(Debug)]
struct Loop {
    tuner: blocking::Tuner,
    previous: Option<Finished>,
}

impl Tuner {
    fn new(study: &blocking::Study) -> Self {
        let frames = Mutex::new(Loop { tuner: study.tuner(), previous: None });
        Self { study: study.clone(), process: std::process::id(), frames, child: OnceLock::new() }
    }

    fn frames(&self) -> MutexGuard<'_, Loop> {
        if self.process != std::process::id() {
            return self.child.get_or_init(|| Box::new(Self::new(&self.study))).frames();
        }
        self.frames.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

exports! {
    fn tw_study_free(study: Study);

    fn tw_study_suggest(
        study: Option<&Study>, numbers: Array<Number>, count: usize; error
    ) -> Option<Box<Suggestion>> {
        let study = need(study, "study")?;
        Ok(Suggestion::new(study.0.suggest(&indicators(numbers, count)?)))
    }

    fn tw_study_trial_of(
        study: Option<&Study>, numbers: Array<Number>, count: usize, configuration_json: Text; error
    ) -> Option<Box<Suggestion>> {
        let configuration = from_json(configuration_json.read("the configuration")?)?;
        let study = need(study, "study")?;
        Ok(Suggestion::new(study.0.trial_of(&indicators(numbers, count)?, &configuration)?))
    }

    fn tw_study_set_start(study: Option<&Study>, configuration_json: Text; error) -> bool {
        let start = configuration_json.optional()?.map(from_json).transpose()?;
        Ok(need(study, "study")?.0.set_start(start.as_ref())?)
    }

    fn tw_study_predict(
        study: Option<&Study>, numbers: Array<Number>, count: usize,
        cost: Option<&mut MaybeUninit<f64>>; error
    ) -> Option<Box<Configuration>> {
        let known = need(study, "study")?.0.predict(&indicators(numbers, count)?)?;
        put(cost, known.predicted_cost.unwrap_or(f64::NAN));
        Ok(Configuration::noted(known.configuration, ["", &known.reason.summary, ""]))
    }

    fn tw_study_best(
        study: Option<&Study>, numbers: Array<Number>, count: usize,
        cost: Option<&mut MaybeUninit<f64>>; error
    ) -> Option<Box<Configuration>> {
        let best = need(study, "study")?.0.best(&indicators(numbers, count)?)?;
        put(cost, best.cost);
        Ok(Configuration::new(best.configuration))
    }
}

/// The standing of an answer; see the header.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub(crate) struct Standing {
    cost: f64,
    cost_low: f64,
    cost_high: f64,
    gain: f64,
    gain_low: f64,
    gain_high: f64,
    probability_better: f64,
    stage: i32,
    nothing_better: bool,
    default_cost: f64,
    measurements: i32,
    status: Text,
    verdict: Text,
    trial: Text,
}

impl Standing {
    /// With texts that live as long as `answer`.
    fn of(best: &treewright_client::Best, answer: &Configuration) -> Self {
        let known = best.standing;
        let gain = known.and_then(|known| known.gain);
        let [status, verdict, trial] = answer.notes();
        let number = |value: Option<f64>| value.unwrap_or(f64::NAN);
        Self {
            cost: number(known.map(|known| known.cost)),
            cost_low: number(known.map(|known| known.cost_low)),
            cost_high: number(known.map(|known| known.cost_high)),
            gain: number(gain.map(|gain| gain.share)),
            gain_low: number(gain.and_then(|gain| gain.low)),
            gain_high: number(gain.and_then(|gain| gain.high)),
            probability_better: number(gain.and_then(|gain| gain.probability_better)),
            stage: known.map_or(0, |known| match known.confirmation.stage {
                ConfirmationStage::Off => 1,
                ConfirmationStage::Searching => 2,
                ConfirmationStage::Racing => 3,
                ConfirmationStage::Better => 4,
                ConfirmationStage::NothingBetter => 5,
            }),
            nothing_better: known.is_some_and(|known| known.nothing_better),
            default_cost: number(best.default_cost),
            measurements: best.measurements,
            status,
            verdict,
            trial,
        }
    }
}

exports! {
    fn tw_study_best_standing(
        study: Option<&Study>, numbers: Array<Number>, count: usize, cost: Option<&mut MaybeUninit<f64>>,
        standing: Option<&mut MaybeUninit<Standing>>; error
    ) -> Option<Box<Configuration>> {
        let study = &need(study, "study")?.0;
        let best = study.best(&indicators(numbers, count)?)?;
        let view = study.spec().objective.view();
        let status = best.standing.map_or("", |known| known.in_short());
        let verdict = best.standing.map_or_else(String::new, |known| known.sentence_by(&view));
        let answer = Configuration::noted(best.configuration.clone(), [status, &verdict, &best.trial]);
        store(standing, Standing::of(&best, &answer))?;
        put(cost, best.cost);
        Ok(answer)
    }

    fn tw_study_value(study: Option<&Study>, cost: f64) -> f64 {
        let body = || Ok(need(study, "study")?.0.spec().objective.view().value(cost));
        guard(ErrorOut::nowhere(), body).unwrap_or(f64::NAN)
    }

    fn tw_tuner_new(study: Option<&Study>; error) -> Option<Box<Tuner>> {
        Ok(Tuner::new(&need(study, "study")?.0))
    }

    fn tw_tuner_free(tuner: Tuner);

    fn tw_tuner_next(
        tuner: Option<&Tuner>, numbers: Array<Number>, count: usize; error
    ) -> Option<Box<Suggestion>> {
        let indicators = indicators(numbers, count)?;
        let mut frames = need(tuner, "tuner")?.frames();
        let previous = frames.previous.take();
        Ok(Suggestion::new(frames.tuner.next(&indicators, previous)))
    }

    fn tw_tuner_finish(
        tuner: Option<&Tuner>, suggestion: Option<Box<Suggestion>>, numbers: Array<Number>,
        count: usize; error
    ) -> bool {
        let tuner = need(tuner, "tuner")?;
        let suggestion = need(suggestion, "suggestion")?;
        let measured = suggestion.measured(numbers, count)?;
        let finished = suggestion.inner.finished(measured, Outcome::Ok)?;
        // One that was not sent yet goes into the outbox here.
        drop(tuner.frames().previous.replace(finished));
        Ok(())
    }
}
