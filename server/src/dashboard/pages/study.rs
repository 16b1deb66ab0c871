//! The overview of a study and its policy.

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
    Defaults, Head, PageFrame, TRIALS, TrialRow, head, machine, number, read_trials, render, row, seconds,
};
use crate::error::Error;

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
    state: Option<i64>,
    best: Option<BestCard>,
    curve: String,
    curve_note: String,
    timeline: String,
    states: Vec<StateRow>,
    /// Seconds saved in a day, with the interval; none where the objective is no time.
    saved: Option<String>,
    is_cut: bool,
    leases: Vec<TrialRow>,
    failures: Vec<TrialRow>,
}

/// The best configuration of the shown state.
struct BestCard {
    cost: String,
    interval: String,
    gain: String,
    verdict: String,
    state: i64,
}

struct StateRow {
    state: i64,
    /// Its curve is shown.
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
    /// Whether the visitor may change it.
    may_steer: bool,
    is_frozen: bool,
    is_pinned: bool,
    /// Each field with its value and its meaning.
    policy: Vec<(&'static str, String, String)>,
    parameters: Vec<(String, String, String, String)>,
    objective: String,
    limits: Vec<String>,
}

pub(in super::super) async fn study(visitor: &Visitor<'_>, id: &str, query: &Query) -> Result<String, Error> {
    let (mut head, study) = head(visitor, id, "overview").await?;
    let id = super::id(&study.name);
    visitor.tuning.begin_loading(id);
    let latest = read_trials(visitor, id, "", "number desc", TRIALS).await?;
    // Without a requested state, the state that was met last.
    let state = query.number("state").or_else(|| latest.first().map(|trial| trial.state_id));
    if let Some(state) = query.number("state") {
        head.query = format!("?state={state}");
    }
    let mut states = Vec::new();
    for number in (1..=head.states.min(STATES)).chain(state.filter(|state| *state > STATES)) {
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
    let mut curve_note =
        fixed.map(|fixed| format!("Best fixed is {}. ", fixed.configuration)).unwrap_or_default();
    if in_state.len() == TRIALS {
        curve_note += &format!("These are the latest {TRIALS}.");
    }
    let leases = read_trials(visitor, id, "state = OPEN", "", ROWS).await?;
    let failures = latest.iter().filter(|trial| is_failure(trial)).take(ROWS);
    let mut total = benefit::Benefit::default();
    saved.values().for_each(|one| total += *one);
    let page = Page {
        frame: visitor.frame,
        best: chosen.and_then(|chosen| card(chosen, &head.view)),
        curve: charts::curve(&points(&in_state), &levels, &head.view),
        curve_note,
        timeline: charts::timeline(&spans(&latest)),
        is_cut: head.states > STATES,
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

/// The one configuration that serves all states best, of the latest trials.
fn fixed(states: &[StateStands], latest: &[v1::Trial], beside: &Defaults) -> Option<Fixed> {
    let defaults =
        states.iter().filter_map(|one| Some((one.state, one.best.as_ref()?.default_cost?))).collect();
    let run =
        |trial: &v1::Trial| Some((trial.state_id, beside.beside(trial.configuration.as_ref()), trial.cost?));
    let runs: Vec<_> = latest.iter().filter_map(run).collect();
    benefit::best_fixed(&runs, &defaults)
}

/// The levels beside the curve of a state: its default, the best fixed configuration, and the search's
/// expectation.
async fn levels(visitor: &Visitor<'_>, id: &str, chosen: &StateStands, fixed: Option<&Fixed>) -> Vec<Level> {
    let fixed = fixed.and_then(|fixed| fixed.by_state.get(&chosen.state).copied());
    let level = |cost: Option<f64>, name, colour| cost.map(|cost| Level { cost, kind: (colour, name) });
    [
        level(chosen.best.as_ref().and_then(|best| best.default_cost), "default", Colour::Purple),
        level(fixed, "best fixed", Colour::Green),
        level(roofline(visitor, id, chosen).await, "roofline", Colour::Vermilion),
    ]
    .into_iter()
    .flatten()
    .collect()
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

/// The completed trials, oldest first.
fn points(trials: &[v1::Trial]) -> Vec<CurvePoint> {
    let completed = trials.iter().rev().filter(|trial| trial.outcome.is_some());
    completed
        .map(|trial| CurvePoint {
            number: number(trial) as f64,
            cost: trial.cost.filter(|_| !is_failure(trial)),
            kind: kind(trial),
        })
        .collect()
}

fn spans(trials: &[v1::Trial]) -> Vec<Span> {
    let span = |trial: &v1::Trial| {
        let begin_s = seconds(trial.create_time)?;
        let end_s = seconds(trial.complete_time).unwrap_or(begin_s);
        Some(Span { row: trial.client_id.clone(), begin_s, end_s, kind: kind(trial) })
    };
    trials.iter().take(SPANS).filter_map(span).collect()
}

pub(in super::super) async fn policy(visitor: &Visitor<'_>, id: &str) -> Result<String, Error> {
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
