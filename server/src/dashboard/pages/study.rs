//! The overview of a study and its policy.

use std::ops::RangeInclusive;

use askama::Template;
use treewright_core::cost_view::CostView;
use treewright_core::policy::Operation;
use treewright_core::space::Condition;
use treewright_figures::Colour;
use treewright_proto::v1;

use super::super::benefit::{self, Fixed};
use super::super::charts::{self, CurvePoint, Kind, Level, Span, figure};
use super::super::{Query, Visitor, may_steer};
use super::standing::{StateStands, benefits, read_state, roofline};
use super::{
    Defaults, Head, PageFrame, TRIALS, TrialRow, asked_state, head, machine, number, read_trials, render,
    row, seconds, tag_links,
};
use crate::error::Result;

/// Most states with their best.
const STATES: i64 = 24;
/// Most rows of leases and failures.
const ROWS: usize = 20;
/// Most bars of the timeline.
const SPANS: usize = 300;

#[derive(Template)]
#[template(path = "study.html")]
struct Page {
    frame: PageFrame,
    head: Head,
    note: String,
    tags: Vec<(String, String)>,
    /// The tags as the form has them.
    words: String,
    may_steer: bool,
    state: Option<i64>,
    best: Option<BestCard>,
    curve: String,
    curve_note: String,
    session: String,
    timeline: String,
    states: Vec<StateRow>,
    /// Seconds saved in a day, with the interval; none where the objective is no time.
    saved: Option<String>,
    /// The queries of the states before those that are listed and of those after them.
    states_before: Option<String>,
    states_after: Option<String>,
    leases: Vec<TrialRow>,
    failures: Vec<TrialRow>,
}

struct BestCard {
    cost: String,
    interval: String,
    gain: String,
    verdict: String,
    state: i64,
}

struct StateRow {
    state: i64,
    is_shown: bool,
    cost: String,
    gain: String,
    stands: &'static str,
    saved: String,
    runs: String,
    machine: String,
    configuration: String,
}

#[derive(Template)]
#[template(path = "policy.html")]
struct PolicyPage {
    frame: PageFrame,
    head: Head,
    may_steer: bool,
    is_frozen: bool,
    is_pinned: bool,
    /// Each field with its value and its meaning.
    policy: Vec<(&'static str, String, String)>,
    parameters: Vec<(String, String, String, String)>,
    objective: String,
    limits: Vec<String>,
}

pub(in super::super) async fn study(visitor: &Visitor<'_>, id: &str, query: &Query) -> Result<String> {
    let (mut head, study) = head(visitor, id, "overview").await?;
    query.only(&["state", "from"])?;
    let (asked, listed) = (asked_state(query, "state", head.states)?, listed(query, head.states)?);
    let id = super::id(&study.name);
    visitor.tuning.begin_loading(id);
    let latest = read_trials(visitor, id, "", "number desc", TRIALS).await?;
    // Without a requested state, the state that was met last.
    let state = asked.or_else(|| latest.first().map(|trial| trial.state_id));
    if let Some(state) = asked {
        head.query = format!("?state={state}");
    }
    let mut states = Vec::new();
    for number in listed.clone().chain(state.filter(|state| !listed.contains(state))) {
        states.extend(read_state(visitor, id, number).await?);
    }
    let in_state = match state {
        // The trials at hand may be all trials of the state.
        Some(state) if head.states > 1 || latest.len() == TRIALS => {
            read_trials(visitor, id, &format!("state_id = {state}"), "number desc", TRIALS).await?
        }
        _ => latest.clone(),
    };
    let unit_s = benefit::unit_s(study.objective.as_ref());
    let saved = benefits(&states, &latest, latest.len() == TRIALS, unit_s, visitor.tuning.now_ms());
    let chosen = states.iter().find(|one| Some(one.state) == state);
    let fixed = fixed(&states, &latest, &head.defaults);
    let levels = match chosen {
        Some(chosen) => levels(visitor, id, chosen, fixed.as_ref()).await,
        None => Vec::new(),
    };
    let session = session(&in_state, chosen, fixed.as_ref(), &head.view);
    let mut curve_note = chosen.and_then(|chosen| luck_note(chosen, &head.view)).unwrap_or_default();
    curve_note += &fixed.map(|fixed| format!("Best fixed is {}. ", fixed.configuration)).unwrap_or_default();
    if in_state.len() == TRIALS {
        curve_note += &format!("These are the latest {TRIALS}.");
    }
    let leases = read_trials(visitor, id, "state = OPEN", "", ROWS).await?;
    let failures = latest.iter().filter(|trial| is_failure(trial)).take(ROWS);
    let mut total = benefit::Benefit::default();
    saved.values().for_each(|one| total += *one);
    let page = Page {
        frame: visitor.frame,
        tags: tag_links(&study.tags),
        words: study.tags.join(" "),
        note: study.note,
        may_steer: may_steer(visitor.caller),
        best: chosen.and_then(|chosen| card(chosen, &head.view)),
        curve: charts::curve(&points(&in_state), &levels, &head.view),
        curve_note,
        session,
        timeline: charts::timeline(&spans(&latest)),
        states_before: (*listed.start() > 1).then(|| stretch((listed.start() - STATES).max(1), asked)),
        states_after: (*listed.end() < head.states).then(|| stretch(listed.end() + 1, asked)),
        leases: leases.iter().map(|trial| row(trial, &head)).collect(),
        failures: failures.map(|trial| row(trial, &head)).collect(),
        saved: (!total.is_empty()).then(|| total.words()),
        states: states
            .iter()
            .map(|one| {
                let saved = saved.get(&one.state).map(benefit::Benefit::words).unwrap_or_default();
                state_row(one, Some(one.state) == state, saved, &head)
            })
            .collect(),
        head,
        state,
    };
    render(&page)
}

/// The states that an address lists: from its first on, as many as fit.
fn listed(query: &Query, states: i64) -> Result<RangeInclusive<i64>> {
    let from = asked_state(query, "from", states)?.unwrap_or(1);
    Ok(from..=states.min(from.saturating_add(STATES - 1)))
}

/// The query of the states from a first one on, beside the curve of a state.
fn stretch(from: i64, state: Option<i64>) -> String {
    let state = state.map(|state| state.to_string()).unwrap_or_default();
    Query::written(&[("from", &from.to_string()), ("state", &state)])
}

/// The one configuration that serves all states best, of the latest trials.
fn fixed(states: &[StateStands], latest: &[v1::Trial], beside: &Defaults) -> Option<Fixed> {
    let defaults =
        states.iter().filter_map(|one| Some((one.state, one.best.as_ref()?.default_cost?))).collect();
    let run =
        |trial: &v1::Trial| Some((trial.state_id, beside.beside(trial.configuration.as_ref()), trial.cost?));
    let runs: Vec<_> = latest.iter().filter_map(run).collect();
    benefit::best_fixed(&runs, &defaults)
}

/// The levels beside the curve of a state: its default, the best fixed configuration, the search's
/// expectation, and what the answer costs by all measurements, with its interval.
async fn levels(visitor: &Visitor<'_>, id: &str, chosen: &StateStands, fixed: Option<&Fixed>) -> Vec<Level> {
    let fixed = fixed.and_then(|fixed| fixed.by_state.get(&chosen.state).copied());
    let level =
        |cost: Option<f64>, name, colour| cost.map(|cost| Level { cost, ends: None, kind: (colour, name) });
    let answer = chosen.standing.map(|standing| Level {
        cost: standing.cost,
        ends: Some([standing.cost_low, standing.cost_high]),
        kind: (Colour::Sky, "answer by all measurements, with its 95 % interval"),
    });
    [
        level(chosen.best.as_ref().and_then(|best| best.default_cost), "default", Colour::Purple),
        level(fixed, "best fixed", Colour::Green),
        level(roofline(visitor, id, chosen).await, "roofline", Colour::Vermilion),
        answer,
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// The answer's cost by all measurements, beside the line of the luckiest single runs.
fn luck_note(chosen: &StateStands, view: &CostView) -> Option<String> {
    let standing = chosen.standing?;
    let (low, high) = view.interval(standing.cost_low, standing.cost_high);
    let (name, cost) = (view.title(), figure(view.value(standing.cost)));
    let (low, high) = (figure(low), figure(high));
    Some(format!(
        "The solid line follows the luckiest single runs; by all measurements the answer is at {cost} [{low}, {high}] \
         of {name}. "
    ))
}

fn card(chosen: &StateStands, view: &CostView) -> Option<BestCard> {
    let standing = chosen.standing?;
    let (low, high) = view.interval(standing.cost_low, standing.cost_high);
    Some(BestCard {
        cost: figure(view.value(standing.cost)),
        interval: format!("{} to {}", figure(low), figure(high)),
        gain: chosen.gain(view),
        verdict: standing.sentence_by(view),
        state: chosen.state,
    })
}

fn state_row(of: &StateStands, is_shown: bool, saved: String, head: &Head) -> StateRow {
    let best = of.best.as_ref();
    StateRow {
        state: of.state,
        is_shown,
        cost: of.standing.map(|standing| figure(head.view.value(standing.cost))).unwrap_or_default(),
        gain: of.gain(&head.view),
        stands: of.standing.map(|standing| standing.in_short()).unwrap_or_default(),
        saved,
        runs: best.map(|best| best.measurements.to_string()).unwrap_or_default(),
        machine: machine(of.trial.fingerprint.as_ref()),
        configuration: head.defaults.beside(best.and_then(|best| best.configuration.as_ref())),
    }
}

fn is_failure(trial: &v1::Trial) -> bool {
    use v1::outcome::Kind;
    let kind = trial.outcome.as_ref().and_then(|outcome| outcome.kind.as_ref());
    matches!(kind, Some(Kind::Infeasible(_) | Kind::Failed(_)))
}

fn kind(trial: &v1::Trial) -> Kind {
    match trial.mode() {
        v1::Mode::Default => (Colour::Purple, "the default is measured"),
        v1::Mode::Explore => (Colour::Blue, "exploring"),
        _ => (Colour::Grey, "other trials"),
    }
}

/// The completed full trials, oldest first. One at a cheaper level is to have no cost, which is no failure.
fn points(trials: &[v1::Trial]) -> Vec<CurvePoint> {
    let is_full = |trial: &&v1::Trial| trial.outcome.is_some() && trial.fidelity.is_empty();
    let completed = trials.iter().rev().filter(is_full);
    completed
        .map(|trial| CurvePoint {
            number: number(trial) as f64,
            cost: trial.cost.filter(|_| !is_failure(trial)),
            kind: kind(trial),
        })
        .collect()
}

/// The cost of a state's trials so far, beside its default.
fn session(
    trials: &[v1::Trial],
    chosen: Option<&StateStands>,
    fixed: Option<&Fixed>,
    view: &CostView,
) -> String {
    // Values of a metric that is maximised do not add up.
    let chosen = chosen.filter(|_| !view.is_maximised());
    let default = chosen.and_then(|one| one.best.as_ref()?.default_cost).filter(|cost| *cost > 0.0);
    let fixed = fixed.zip(chosen).and_then(|(fixed, one)| fixed.by_state.get(&one.state).copied());
    charts::session(&points(trials), default, fixed)
}

fn spans(trials: &[v1::Trial]) -> Vec<Span> {
    let span = |trial: &v1::Trial| {
        let begin_s = seconds(trial.create_time)?;
        let end_s = seconds(trial.complete_time).unwrap_or(begin_s);
        Some(Span { row: trial.client_id.clone(), begin_s, end_s, kind: kind(trial) })
    };
    trials.iter().take(SPANS).filter_map(span).collect()
}

pub(in super::super) async fn policy(visitor: &Visitor<'_>, id: &str, query: &Query) -> Result<String> {
    query.only(&[])?;
    let (head, _) = head(visitor, id, "policy").await?;
    let spec = visitor.tuning.get_study(&head.id).await?.spec;
    let settings = treewright_core::policy::PolicySettings::from(spec.policy.clone());
    let field = |field: &treewright_core::policy::PolicyField| {
        let said = settings.show(field.name).unwrap_or_else(|| field.unset.to_owned());
        (field.name, said, field.summary())
    };
    let policy = treewright_core::policy::PolicySettings::FIELDS.iter().map(field).collect();
    let parameters = spec.space.parameters().iter().map(|parameter| {
        let condition = parameter.active_if.as_ref().map(Condition::to_string).unwrap_or_default();
        (parameter.name.clone(), parameter.default.to_string(), parameter.domain.to_string(), condition)
    });
    let page = PolicyPage {
        frame: visitor.frame,
        may_steer: may_steer(visitor.caller),
        is_frozen: spec.policy.operation == Operation::Freeze,
        is_pinned: spec.policy.pinned.is_some(),
        head,
        policy,
        parameters: parameters.collect(),
        objective: spec.objective.to_string(),
        limits: spec.objective.limits().iter().map(ToString::to_string).collect(),
    };
    render(&page)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trials_at_cheaper_levels_are_no_points_of_the_curve() {
        use v1::outcome::Kind;
        let trial = |number: u32, fidelity: &str, cost| v1::Trial {
            name: format!("studies/hall/trials/{number}"),
            outcome: Some(v1::Outcome { kind: Some(Kind::Ok(v1::Ok {})) }),
            fidelity: fidelity.to_owned(),
            cost,
            ..v1::Trial::default()
        };
        let shown = points(&[trial(3, "", None), trial(2, "16", None), trial(1, "", Some(4.0))]);
        let shown: Vec<_> = shown.into_iter().map(|point| (point.number, point.cost)).collect();
        assert_eq!(shown, [(1.0, Some(4.0)), (3.0, None)]);
    }

    #[test]
    fn all_states_can_be_turned_to() {
        let of = |query: &str, states: i64| listed(&Query::read(query), states);
        assert!(of("", 0).expect("there is nothing to list").is_empty());
        assert_eq!(of("", 70), Ok(1..=STATES));
        assert_eq!(of("from=49", 70), Ok(49..=70));
        let error = of("from=71", 70).expect_err("there are only 70").to_string();
        assert!(error.contains("70 states") && error.contains("leave it out"), "{error}");
        assert_eq!([stretch(25, None), stretch(1, Some(3))], ["from=25", "from=1&state=3"]);
    }
}
