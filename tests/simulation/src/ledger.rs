//! The books of a world: the promises of the service to its clients, and their breaches.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use tonic::{Code, Status};
use treewright_core::trial::{Outcome, RawTrial, TrialState};
use treewright_proto::v1 as wire;
use treewright_store::Store as _;

use crate::durable::{Durable, now};
use crate::requests::{Answer, Request, client_name, is_of_frozen};

macro_rules! counts {
    ($($name:ident,)*) => {
        /// Counts of events.
        #[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
        #[allow(missing_docs)] // The names say it.
        pub struct Counts {
            $(pub $name: u64,)*
        }

        impl Counts {
            /// Adds the counts of another world.
            pub fn add(&mut self, other: &Counts) {
                $(self.$name += other.$name;)*
            }
        }
    };
}

counts! {
    suggestions, acknowledged_reports, duplicate_reports, late_reports, refusals, crashes, torn_writes,
    failed_writes, full_disks, lost_messages, duplicated_messages, partitions, clock_jumps, client_restarts,
    vanished_clients, absences, sleeps, unsure_writes, forwarded_messages, checkpoints, removed_trials,
    explored_frames, frames, replays, frozen_answers,
}

/// Something that should not be.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Violation {
    /// When, in milliseconds of the world's time.
    pub at_ms: i64,
    /// The violation in words.
    pub what: String,
}

/// The true cost of a client's session, and the part of it that exploring caused.
#[derive(Clone, Copy, Debug, Default)]
struct Purse {
    session: u64,
    paid_ms: f64,
    regret_ms: f64,
}

#[derive(Default)]
pub(crate) struct Ledger {
    pub(crate) counts: Counts,
    pub(crate) violations: Vec<Violation>,
    /// The client of each trial, and the configuration that it was handed.
    handed: BTreeMap<u64, (String, wire::Configuration)>,
    /// The cost of each acknowledged report.
    acknowledged: BTreeMap<u64, Option<f64>>,
    /// Trials that retention has removed.
    removed: BTreeSet<u64>,
    purses: BTreeMap<u32, Purse>,
}

fn number(name: &str) -> u64 {
    name.rsplit('/').next().and_then(|number| number.parse().ok()).unwrap_or(0)
}

impl Ledger {
    fn wrong(&mut self, at_ms: i64, what: String) {
        self.violations.push(Violation { at_ms, what });
    }

    /// The number of reports that were acknowledged so far.
    pub(crate) fn known(&self) -> i64 {
        self.acknowledged.len() as i64
    }

    /// A machine answers a client. The answer binds it from now on, whether it arrives or not. `known` is the
    /// number of acknowledged reports when the request came.
    pub(crate) fn answered(
        &mut self,
        (at_ms, known): (i64, i64),
        client: u32,
        request: &Request,
        answer: &Result<Answer, Status>,
        durable: &Durable,
    ) {
        match (request, answer) {
            (Request::Report(report), Err(status))
                if status.code() == Code::FailedPrecondition
                    && self.acknowledged.contains_key(&number(&report.trial)) =>
            {
                // A client that lost the answer has to hear again that the report was taken.
                let what =
                    format!("{} was acknowledged, and refused when it was reported again", report.trial);
                self.wrong(at_ms, what);
            }
            (_, Err(status)) => self.refused(at_ms, request, status.code(), status.message()),
            (Request::Suggest(question), Ok(Answer::Trial(trial))) => {
                self.suggested(at_ms, client, question, trial, durable);
            }
            (Request::Frame(_, question), Ok(Answer::Frame(reported, suggested))) => {
                match reported {
                    Ok(reported) => self.reported(at_ms, reported, durable),
                    Err(code) => self.refused(at_ms, request, *code, "report"),
                }
                match suggested {
                    Ok(trial) => self.suggested(at_ms, client, question, trial, durable),
                    Err(code) => self.refused(at_ms, request, *code, "suggest"),
                }
            }
            (Request::Report(_), Ok(Answer::Reported(reported))) => self.reported(at_ms, reported, durable),
            (Request::Abandon(name), Ok(_)) if self.acknowledged.contains_key(&number(name)) => {
                self.wrong(at_ms, format!("{name} was abandoned after its report was acknowledged"));
            }
            (Request::GetTrial(_), Ok(Answer::Trial(trial))) => self.read(at_ms, trial),
            (Request::Query(_), Ok(Answer::Trials(trials))) => {
                trials.iter().for_each(|trial| self.read(at_ms, trial));
            }
            (Request::GetStudy, Ok(Answer::Study(study))) => {
                let completed = study.statistics.map_or(0, |counts| counts.completed_trials);
                if completed < known {
                    self.wrong(at_ms, format!("{completed} trials count as completed after {known} reports"));
                }
            }
            _ => {}
        }
    }

    fn refused(&mut self, at_ms: i64, request: &Request, code: Code, message: &str) {
        self.counts.refusals += 1;
        let may_be = match code {
            Code::Unavailable | Code::ResourceExhausted => true,
            Code::NotFound => request.trial().is_some_and(|name| self.removed.contains(&number(name))),
            // Of a trial that is no longer open.
            Code::FailedPrecondition => matches!(
                request,
                Request::Report(_) | Request::Frame(..) | Request::Abandon(_) | Request::Extend(_)
            ),
            _ => false,
        };
        if !may_be {
            self.wrong(at_ms, format!("{request:?} was refused with {code:?}: {message}"));
        }
    }

    fn suggested(
        &mut self,
        at_ms: i64,
        client: u32,
        question: &wire::SuggestRequest,
        trial: &wire::Trial,
        durable: &Durable,
    ) {
        self.counts.suggestions += 1;
        let number = number(&trial.name);
        if trial.client_id != client_name(client) {
            self.wrong(at_ms, format!("{} of {} went to client {client}", trial.name, trial.client_id));
        }
        let configuration = trial.configuration.clone().unwrap_or_default();
        let handed = (trial.client_id.clone(), configuration);
        match self.handed.get(&number) {
            Some(before) if *before != handed => {
                let what = format!("trial {number} was handed to {} and to {}", before.0, handed.0);
                self.wrong(at_ms, what);
            }
            Some(_) => {}
            None => {
                self.handed.insert(number, handed);
            }
        }
        // The answer may have been under way for so long that the lease ran out and retention removed the
        // trial.
        let is_gone = now(durable.store.get_trial("world", number)).is_err();
        if is_gone && !self.removed.contains(&number) {
            self.wrong(at_ms, format!("trial {number} was handed out and is not stored"));
        }
        let never_explores = question.session_policy.as_ref().is_some_and(|own| own.epsilon == Some(0.0));
        let is_frozen = is_of_frozen(trial);
        self.counts.frozen_answers += u64::from(is_frozen);
        if (never_explores || is_frozen) && !self.ran(trial, durable) {
            let why = if is_frozen { "is answered by a frozen study" } else { "never explores" };
            let what = format!("client {client} {why}, and nobody has run trial {number}'s configuration");
            self.wrong(at_ms, what);
        }
    }

    /// Whether a trial has the default, or a configuration that ran to its end before.
    fn ran(&self, trial: &wire::Trial, durable: &Durable) -> bool {
        let is_same = |handed: &wire::Configuration| Some(handed) == trial.configuration.as_ref();
        let has_run = |number: &u64| {
            let stored = now(durable.store.get_trial("world", *number));
            stored.is_ok_and(|stored| stored.outcome == Some(Outcome::Ok))
        };
        let mut alike = self.handed.iter().filter(|(_, (_, handed))| is_same(handed));
        trial.mode == wire::Mode::Default as i32
            || alike.any(|(number, _)| self.removed.contains(number) || has_run(number))
    }

    fn reported(&mut self, at_ms: i64, response: &wire::ReportResponse, durable: &Durable) {
        let Some(trial) = &response.trial else {
            return self.wrong(at_ms, "a report was acknowledged without its trial".to_owned());
        };
        let number = number(&trial.name);
        self.counts.acknowledged_reports += u64::from(!response.duplicate);
        self.counts.duplicate_reports += u64::from(response.duplicate);
        self.counts.late_reports += u64::from(trial.late && !response.duplicate);
        if let Some(before) = self.acknowledged.insert(number, trial.cost)
            && before != trial.cost
        {
            let what = format!("trial {number} was acknowledged with {before:?} and with {:?}", trial.cost);
            self.wrong(at_ms, what);
        }
        self.check(at_ms, number, trial.cost, durable);
    }

    /// An acknowledged report stands in the durable store as it was acknowledged.
    fn check(&mut self, at_ms: i64, number: u64, cost: Option<f64>, durable: &Durable) {
        match now(durable.store.get_trial("world", number)) {
            Ok(stored) if stored.state == TrialState::Completed && stored.cost == cost => {}
            Ok(stored) => {
                let what = format!(
                    "trial {number} was acknowledged with {cost:?} and is {:?} with {:?}",
                    stored.state, stored.cost
                );
                self.wrong(at_ms, what);
            }
            Err(_) if self.removed.contains(&number) => {}
            Err(error) => self.wrong(at_ms, format!("acknowledged trial {number} is lost: {error}")),
        }
    }

    /// Retention has removed trials: they were over, a checkpoint on the disk covers them, and they are no
    /// longer where a new trial's number could come from.
    pub(crate) fn removed(&mut self, trials: &[RawTrial], covered: u64, durable: &Durable) {
        for trial in
            trials.iter().filter(|trial| now(durable.store.get_trial("world", trial.number)).is_err())
        {
            self.counts.removed_trials += 1;
            self.removed.insert(trial.number);
            let is_last = self.handed.keys().next_back().is_none_or(|last| *last <= trial.number);
            if trial.state == TrialState::Open || is_last || trial.completion.is_some_and(|at| at > covered) {
                let (number, state, completion) = (trial.number, trial.state, trial.completion);
                let what =
                    format!("trial {number} was removed: {state:?}, {completion:?}, {covered} are covered");
                self.wrong(i64::MAX, what);
            }
        }
    }

    fn read(&mut self, at_ms: i64, trial: &wire::Trial) {
        if trial.state == wire::TrialState::Completed as i32
            && let Some(cost) = self.acknowledged.get(&number(&trial.name))
            && *cost != trial.cost
        {
            self.wrong(
                at_ms,
                format!("{} reads {:?} after {cost:?} was acknowledged", trial.name, trial.cost),
            );
        }
    }

    /// All that was ever acknowledged.
    pub(crate) fn check_all(&mut self, durable: &Durable) {
        for (number, cost) in self.acknowledged.clone() {
            self.check(i64::MAX, number, cost, durable);
        }
    }

    /// A client rendered a frame: its true cost, and the cost of the default in its place.
    pub(crate) fn frame(
        &mut self,
        at_ms: i64,
        client: u32,
        session: u64,
        explored: bool,
        (spent_ms, default_ms): (f64, f64),
        budget: Option<f64>,
    ) {
        self.counts.frames += 1;
        self.counts.explored_frames += u64::from(explored);
        let purse = self.purses.entry(client).or_default();
        if purse.session != session {
            *purse = Purse { session, ..Purse::default() };
        }
        purse.paid_ms += spent_ms;
        if explored {
            purse.regret_ms += spent_ms - default_ms;
        }
        let Purse { paid_ms, regret_ms, .. } = *purse;
        if let Some(budget) = budget
            && regret_ms > budget * paid_ms
        {
            let what = format!(
                "exploring has cost client {client} {regret_ms:.3} of {paid_ms:.3} ms, more than {budget:.4} of it"
            );
            self.wrong(at_ms, what);
        }
    }
}
