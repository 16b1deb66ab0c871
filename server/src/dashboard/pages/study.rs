//! The overview of a study and its policy.

use askama::Template;
use treewright_core::space::Condition;
use treewright_proto::v1;

use super::super::charts::{self, CurvePoint, Span, figure};
use super::super::{Query, Visitor};
use super::{
    Head, PageFrame, TRIALS, TrialRow, configuration, gain, head, machine, number, read_trials, render, row,
    seconds,
};
use crate::error::Error;
use crate::rpc;

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
    is_cut: bool,
    leases: Vec<TrialRow>,
    failures: Vec<TrialRow>,
}

struct BestCard {
    cost: String,
    gain: String,
    state: i64,
}

struct StateRow {
    state: i64,
    /// Its curve is the one that is shown.
    is_shown: bool,
    cost: String,
    default_cost: String,
    gain: String,
    runs: String,
    machine: String,
    configuration: String,
}

#[derive(Template)]
#[template(path = "policy.html")]
struct PolicyPage {
    frame: PageFrame,
    head: Head,
    policy: Vec<(String, String)>,
    parameters: Vec<(String, String, String, String)>,
    objective: String,
}

/// What is best in a state, as the state's own machine sees it, with one trial of it.
async fn best(
    visitor: &Visitor<'_>,
    id: &str,
    state: i64,
) -> Result<Option<(v1::Trial, Option<v1::Best>)>, Error> {
    let filter = format!("state_id = {state}");
    let Some(trial) = read_trials(visitor, id, &filter, "", 1).await?.pop() else { return Ok(None) };
    let request = v1::GetBestRequest {
        study: format!("studies/{id}"),
        indicators: trial.indicators.clone(),
        fingerprint: trial.fingerprint.clone(),
    };
    // Nothing may be measured there, or another replica may have the study.
    let best = rpc::trials::best(visitor.tuning, visitor.caller, request).await.ok();
    Ok(Some((trial, best)))
}

pub(in super::super) async fn study(visitor: &Visitor<'_>, id: &str, query: &Query) -> Result<String, Error> {
    let (mut head, _) = head(visitor, id, "overview").await?;
    let latest = read_trials(visitor, id, "", "number desc", TRIALS).await?;
    // Without a wish the state that was met last.
    let state = query.number("state").or_else(|| latest.first().map(|trial| trial.state_id));
    if let Some(state) = query.number("state") {
        head.query = format!("?state={state}");
    }
    let mut states = Vec::new();
    let shown = (1..=head.states.min(STATES)).chain(state.filter(|state| *state > STATES));
    let mut chosen = None;
    for number in shown {
        let Some((trial, best)) = best(visitor, id, number).await? else { continue };
        states.push(state_row(number, Some(number) == state, &trial, best.as_ref()));
        if Some(number) == state {
            chosen = best;
        }
    }
    let in_state = match state {
        // What was read already may be all there is of it.
        Some(state) if head.states > 1 || latest.len() == TRIALS => {
            read_trials(visitor, id, &format!("state_id = {state}"), "number desc", TRIALS).await?
        }
        _ => latest.clone(),
    };
    let default = chosen.as_ref().and_then(|best| best.default_cost);
    let curve_note = match in_state.len() {
        TRIALS => format!("These are the latest {TRIALS}."),
        _ => String::new(),
    };
    let page = Page {
        frame: visitor.frame,
        best: chosen.zip(state).map(|(best, state)| BestCard {
            cost: figure(best.cost),
            gain: gain(best.cost, best.default_cost),
            state,
        }),
        curve: charts::curve(&points(&in_state), default),
        curve_note,
        timeline: charts::timeline(&spans(&latest)),
        is_cut: head.states > STATES,
        leases: read_trials(visitor, id, "state = OPEN", "", ROWS).await?.iter().map(row).collect(),
        failures: latest.iter().filter(|trial| is_failure(trial)).take(ROWS).map(row).collect(),
        head,
        state,
        states,
    };
    render(&page)
}

fn state_row(state: i64, is_shown: bool, trial: &v1::Trial, best: Option<&v1::Best>) -> StateRow {
    let of = |value: Option<f64>| value.map(figure).unwrap_or_default();
    StateRow {
        state,
        is_shown,
        cost: of(best.map(|best| best.cost)),
        default_cost: of(best.and_then(|best| best.default_cost)),
        gain: best.map(|best| gain(best.cost, best.default_cost)).unwrap_or_default(),
        runs: best.map(|best| best.measurements.to_string()).unwrap_or_default(),
        machine: machine(trial.fingerprint.as_ref()),
        configuration: configuration(best.and_then(|best| best.configuration.as_ref())),
    }
}

fn is_failure(trial: &v1::Trial) -> bool {
    use v1::outcome::Kind;
    let kind = trial.outcome.as_ref().and_then(|outcome| outcome.kind.as_ref());
    matches!(kind, Some(Kind::Infeasible(_) | Kind::Failed(_)))
}

/// The completed trials, oldest first.
fn points(trials: &[v1::Trial]) -> Vec<CurvePoint> {
    let completed = trials.iter().rev().filter(|trial| trial.outcome.is_some());
    completed
        .map(|trial| CurvePoint {
            number: number(trial) as f64,
            cost: trial.cost.filter(|_| !is_failure(trial)),
            class: match trial.mode() {
                v1::Mode::Default => "start",
                v1::Mode::Explore => "explore",
                _ => "",
            },
        })
        .collect()
}

fn spans(trials: &[v1::Trial]) -> Vec<Span> {
    let span = |trial: &v1::Trial| {
        let begin_s = seconds(trial.create_time)?;
        let end_s = seconds(trial.complete_time).unwrap_or(begin_s);
        let class = match trial.mode() {
            v1::Mode::Explore => "point explore",
            v1::Mode::Default => "point start",
            _ => "point",
        };
        Some(Span { row: trial.client_id.clone(), begin_s, end_s, class })
    };
    trials.iter().take(SPANS).filter_map(span).collect()
}

pub(in super::super) async fn policy(visitor: &Visitor<'_>, id: &str) -> Result<String, Error> {
    let (head, _) = head(visitor, id, "policy").await?;
    let spec = visitor.tuning.get_study(id).await?.spec;
    let settings = treewright_core::policy::PolicySettings::from(spec.policy.clone());
    let field = |field: &treewright_core::policy::PolicyField| {
        let said = settings.show(field.name).unwrap_or_else(|| field.unset.to_owned());
        (field.name.to_owned(), said)
    };
    let policy = treewright_core::policy::PolicySettings::FIELDS.iter().map(field).collect();
    let parameters = spec.space.parameters().iter().map(|parameter| {
        let condition = parameter.active_if.as_ref().map(Condition::to_string).unwrap_or_default();
        (parameter.name.clone(), parameter.default.to_string(), parameter.domain.to_string(), condition)
    });
    let terms: Vec<String> =
        spec.objective.terms().iter().map(|term| format!("{} × {}", term.weight, term.metric)).collect();
    let page = PolicyPage {
        frame: visitor.frame,
        head,
        policy,
        parameters: parameters.collect(),
        objective: terms.join(" + "),
    };
    render(&page)
}
