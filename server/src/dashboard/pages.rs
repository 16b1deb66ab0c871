//! The pages. They read through the handlers of the RPCs, so that a token sees equal data in both.

mod compare;
mod front;
mod index;
mod map;
mod others;
mod parameters;
mod standing;
mod studies;
mod study;
mod summaries;
mod trial;
mod trials;

use std::collections::BTreeMap;

use askama::Template;
use treewright_core::cost_view::CostView;
use treewright_core::front::Front;
use treewright_proto::v1;

use super::charts::figure;
use super::{Query, Visitor};
use crate::error::{Error, Result};
use crate::rpc;

pub(super) use compare::compare;
pub(super) use front::front;
pub(super) use map::map;
pub(super) use parameters::parameters;
pub(super) use studies::StudyIndex;
pub(super) use study::{policy, study};
pub(super) use trial::trial;
pub(super) use trials::trials;

/// Most trials in pictures: the latest.
const TRIALS: usize = 1000;

#[derive(Clone, Copy)]
pub(super) struct PageFrame {
    /// The visitor has logged in, and may log out.
    pub(super) has_token: bool,
}

struct Head {
    id: String,
    /// `ID@UID`, for forms: they change no other study that got the id after the page was read.
    name: String,
    what: String,
    tab: &'static str,
    defaults: Defaults,
    view: CostView,
    /// The front that it was made for.
    front: Option<Front>,
    /// The query that the links of tabs carry along.
    query: String,
    states: i64,
    trials: i64,
    completed: i64,
    open: i64,
}

struct TrialRow {
    number: u64,
    state: i64,
    mode: String,
    outcome: String,
    is_excluded: bool,
    reason: String,
    cost: String,
    client: String,
    begun: String,
    until: String,
    configuration: String,
}

#[derive(Template)]
#[template(path = "login.html")]
struct Login {
    frame: PageFrame,
    problem: Option<String>,
}

#[derive(Template)]
#[template(path = "problem.html")]
struct Problem<'a> {
    frame: PageFrame,
    title: &'a str,
    problem: &'a str,
}

pub(super) fn render(page: &impl Template) -> Result<String> {
    page.render().map_err(|_| Error::Defect("a page could not be written"))
}

pub(super) fn login(problem: Option<String>) -> Result<String> {
    render(&Login { frame: PageFrame { has_token: false }, problem })
}

pub(super) fn problem(frame: PageFrame, title: &str, problem: &str) -> Result<String> {
    render(&Problem { frame, title, problem })
}

pub(super) fn id(name: &str) -> &str {
    name.strip_prefix("studies/").unwrap_or(name)
}

/// The head of a page of a study, which is asked for by its id or as `ID@UID`. Everything else on the page is
/// read by the id that the study has by now.
async fn head(visitor: &Visitor<'_>, asked: &str, tab: &'static str) -> Result<(Head, v1::Study)> {
    let request = v1::GetStudyRequest { name: format!("studies/{asked}") };
    let study = rpc::studies::get(visitor.call(), request).await?;
    let counts = study.statistics.unwrap_or_default();
    let id = self::id(&study.name);
    let spec = visitor.tuning.get_study(id).await?.spec;
    let head = Head {
        id: id.to_owned(),
        name: format!("{id}@{}", study.uid),
        what: study.display_name.clone(),
        tab,
        defaults: Defaults::of(&study),
        view: spec.objective.view(),
        front: spec.front(),
        query: String::new(),
        states: counts.states,
        trials: counts.trials,
        completed: counts.completed_trials,
        open: counts.open_trials,
    };
    Ok((head, study))
}

/// Each tag with the address of the list of the studies that have it.
fn tag_links(tags: &[String]) -> Vec<(String, String)> {
    tags.iter().map(|tag| (tag.clone(), format!("/?{}", Query::written(&[("tag", tag)])))).collect()
}

/// The state that a field of an address asks for.
fn asked_state(query: &Query, field: &str, states: i64) -> Result<Option<i64>> {
    match query.number(field)? {
        Some(state) if state > states => Err(Error::invalid(
            field,
            format!("the study has met {states} states; leave it out, or give the number of one"),
        )),
        asked => Ok(asked),
    }
}

/// The place among some names of the one that an address asks for.
fn asked_axis<'a>(
    query: &Query,
    axis: &str,
    mut names: impl Iterator<Item = &'a str>,
) -> Result<Option<usize>> {
    let asked = query.text(axis);
    match names.position(|name| name == asked) {
        None if !asked.is_empty() => {
            let problem = format!("the study has no {asked:?}; leave it out, or choose one on the page");
            Err(Error::invalid(axis, problem))
        }
        found => Ok(found),
    }
}

/// At most `most` trials that count and for which a filter holds.
async fn read_trials(
    visitor: &Visitor<'_>,
    id: &str,
    filter: &str,
    order: &str,
    most: usize,
) -> Result<Vec<v1::Trial>> {
    let joint = if filter.is_empty() { "" } else { " AND " };
    let request = v1::QueryTrialsRequest {
        study: format!("studies/{id}"),
        filter: format!("{filter}{joint}excluded = false"),
        order_by: order.to_owned(),
        ..v1::QueryTrialsRequest::default()
    };
    read_all(visitor, request, most).await
}

/// At most `most` trials of a query, over its pages.
async fn read_all(
    visitor: &Visitor<'_>,
    mut request: v1::QueryTrialsRequest,
    most: usize,
) -> Result<Vec<v1::Trial>> {
    let mut found = Vec::new();
    while found.len() < most {
        request.page_size = i32::try_from(most - found.len()).unwrap_or(i32::MAX).min(1000);
        let page = rpc::trials::query(visitor.call(), request.clone()).await?;
        found.extend(page.trials);
        request.page_token = page.next_page_token;
        if request.page_token.is_empty() {
            break;
        }
    }
    assert!(found.len() <= most, "{} trials, and at most {most} were asked for", found.len());
    Ok(found)
}

fn number(trial: &v1::Trial) -> u64 {
    let number: Option<u64> = trial.name.rsplit_once('/').and_then(|(_, number)| number.parse().ok());
    debug_assert!(number.is_some(), "{:?} names no trial", trial.name);
    number.unwrap_or_default()
}

fn row(trial: &v1::Trial, head: &Head) -> TrialRow {
    let (outcome, reason) = outcome(trial, &head.view);
    TrialRow {
        number: number(trial),
        state: trial.state_id,
        mode: word(trial.mode().as_str_name(), "MODE_"),
        outcome,
        is_excluded: !trial.exclusion.is_empty(),
        reason,
        cost: trial.cost.map(|cost| figure(head.view.value(cost))).unwrap_or_default(),
        client: trial.client_id.clone(),
        begun: time(trial.create_time),
        until: time(trial.lease_expire_time),
        configuration: head.defaults.beside(trial.configuration.as_ref()),
    }
}

/// Its outcome or its state, and why.
fn outcome(trial: &v1::Trial, view: &CostView) -> (String, String) {
    use v1::outcome::Kind;
    match trial.outcome.as_ref().and_then(|outcome| outcome.kind.as_ref()) {
        Some(Kind::Ok(_)) => ("OK".to_owned(), String::new()),
        Some(Kind::Infeasible(bad)) => ("INFEASIBLE".to_owned(), bad.reason.clone()),
        Some(Kind::Failed(bad)) => ("FAILED".to_owned(), bad.reason.clone()),
        Some(Kind::Aborted(bad)) => {
            ("ABORTED".to_owned(), format!("{} {}", view.bound(), figure(view.value(bad.lower_bound))))
        }
        None => (word(trial.state().as_str_name(), "TRIAL_STATE_"), String::new()),
    }
}

fn word(name: &str, prefix: &str) -> String {
    name.strip_prefix(prefix).unwrap_or(name).to_owned()
}

fn value(value: &v1::Value) -> String {
    use v1::value::Kind;
    match &value.kind {
        Some(Kind::Integer(integer)) => integer.to_string(),
        Some(Kind::Float(float)) => figure(*float),
        Some(Kind::Text(text)) => text.clone(),
        Some(Kind::Boolean(boolean)) => boolean.to_string(),
        None => "?".to_owned(),
    }
}

struct Defaults(BTreeMap<String, v1::Value>);

impl Defaults {
    fn of(study: &v1::Study) -> Self {
        let parameters = study.space.iter().flat_map(|space| &space.parameters);
        Self(parameters.filter_map(|one| Some((one.name.clone(), one.default_value.clone()?))).collect())
    }

    /// The values of a configuration that differ from the default: few of thirty parameters.
    fn beside(&self, configuration: Option<&v1::Configuration>) -> String {
        let Some(configuration) = configuration else { return String::new() };
        let others = configuration.values.iter().filter(|(name, of)| self.0.get(*name) != Some(*of));
        let mut words: Vec<String> = others.map(|(name, of)| format!("{name}={}", value(of))).collect();
        words.sort_unstable();
        if words.is_empty() { "the default".to_owned() } else { words.join(" ") }
    }
}

fn machine(fingerprint: Option<&v1::Fingerprint>) -> String {
    let machine = fingerprint.map(|one| format!("{}, {} threads", one.cpu_model, one.threads));
    machine.unwrap_or_default()
}

fn seconds(time: Option<prost_types::Timestamp>) -> Option<f64> {
    time.map(|time| time.seconds as f64 + f64::from(time.nanos) / 1e9)
}

fn time(time: Option<prost_types::Timestamp>) -> String {
    let Some(time) = time else { return String::new() };
    match std::time::SystemTime::try_from(time) {
        Ok(time) => humantime::format_rfc3339_seconds(time).to_string().replace('T', " ").replace('Z', ""),
        Err(_) => String::new(),
    }
}
