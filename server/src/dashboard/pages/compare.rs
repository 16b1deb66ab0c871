//! Several studies side by side: the fall of their best cost so far relative to their own defaults, and their
//! proven gains.

use askama::Template;
use treewright_core::standing::{Gain, StandingVerdict};
use treewright_proto::v1;

use super::super::charts::{self, Runner};
use super::super::{Query, Visitor, benefit};
use super::standing::{StateStands, benefits, read_state};
use super::summaries::mean_gain;
use super::{PageFrame, TRIALS, head, read_trials, render};
use crate::error::Result;

/// Most studies at once.
const STUDIES: usize = 5;
/// Most states of each.
const STATES: i64 = 12;

#[derive(Template)]
#[template(path = "compare.html")]
struct Page {
    frame: PageFrame,
    rows: Vec<Row>,
    race: String,
    is_cut: bool,
}

struct Row {
    id: String,
    states: i64,
    trials: i64,
    better: usize,
    nothing: usize,
    /// The mean gain of the answers over the default by the posteriors of their states, with its interval.
    answer: String,
    /// The lowest and the highest gain over the default.
    gains: String,
    saved: String,
    shared: String,
}

pub(in super::super) async fn compare(visitor: &Visitor<'_>, query: &Query) -> Result<String> {
    query.only(&["study"])?;
    let mut ids = query.texts("study");
    ids.sort_unstable();
    ids.dedup();
    let is_cut = ids.len() > STUDIES;
    ids.truncate(STUDIES);
    let (mut rows, mut runners, mut spaces, mut heads) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for asked in &ids {
        let (head, study) = head(visitor, asked, "compare").await?;
        // All of them at once, while the first is being shown.
        visitor.tuning.begin_loading(&head.id);
        heads.push((head, study));
    }
    for (head, study) in heads {
        let id = head.id.as_str();
        let latest = read_trials(visitor, id, "", "number desc", TRIALS).await?;
        let mut states = Vec::new();
        for number in 1..=head.states.min(STATES) {
            states.extend(read_state(visitor, id, number).await?);
        }
        rows.push(row(visitor, &head, &study, &states, &latest));
        let (ratios, answer) = (ratios(&states, &latest), mean_gain(&gains(&states)));
        runners.push(Runner { name: id.to_owned(), ratios, answer, view: head.view.clone() });
        spaces.push(names(&study));
    }
    for (row, names) in rows.iter_mut().zip(&spaces) {
        let shared = names.iter().filter(|name| spaces.iter().all(|other| other.contains(name))).count();
        row.shared = format!("{shared} of {}", names.len());
    }
    render(&Page { frame: visitor.frame, rows, race: charts::race(&runners), is_cut })
}

fn names(study: &v1::Study) -> Vec<String> {
    study.space.iter().flat_map(|space| &space.parameters).map(|one| one.name.clone()).collect()
}

fn row(
    visitor: &Visitor<'_>,
    head: &super::Head,
    study: &v1::Study,
    states: &[StateStands],
    latest: &[v1::Trial],
) -> Row {
    let count = |verdicts: &[StandingVerdict]| {
        let stands =
            |one: &&StateStands| one.standing.is_some_and(|standing| verdicts.contains(&standing.verdict()));
        states.iter().filter(stands).count()
    };
    let gains = gains(states);
    let (low, high) = gains.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), gain| {
        (low.min(gain.share), high.max(gain.share))
    });
    let unit_s = benefit::unit_s(study.objective.as_ref());
    let mut saved = benefit::Benefit::default();
    for one in benefits(states, latest, latest.len() == TRIALS, unit_s, visitor.tuning.now_ms()).values() {
        saved += *one;
    }
    Row {
        id: head.id.clone(),
        states: head.states,
        trials: head.trials,
        better: count(&[StandingVerdict::Proven]),
        nothing: count(&[StandingVerdict::NothingBetter, StandingVerdict::NothingToWin]),
        answer: mean_gain(&gains)
            .map(|gain| format!("{} {}", gain.by(&head.view), head.view.better_side()))
            .unwrap_or_default(),
        gains: match low.is_finite() {
            true => {
                let [low, high] = [low, high].map(|share| head.view.percent(share));
                format!("{low} to {high} % {}", head.view.better_side())
            }
            false => String::new(),
        },
        saved: if saved.is_empty() { String::new() } else { saved.words() },
        shared: String::new(),
    }
}

/// The gains of the answers over the defaults of their states.
fn gains(states: &[StateStands]) -> Vec<Gain> {
    states.iter().filter_map(|one| one.standing?.gain).collect()
}

/// The costs of the trials over the default of their own state, oldest first.
fn ratios(states: &[StateStands], latest: &[v1::Trial]) -> Vec<f64> {
    let default = |state: i64| {
        let one = states.iter().find(|one| one.state == state)?;
        one.best.as_ref()?.default_cost.filter(|cost| *cost > 0.0)
    };
    latest.iter().rev().filter_map(|trial| Some(trial.cost? / default(trial.state_id)?)).collect()
}
