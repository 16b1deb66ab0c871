//! The Pareto front of a study's runs, by the metrics that it was made for, or by any that it measured.

use std::collections::BTreeMap;

use askama::Template;
use treewright_core::assignment::Assignment;
use treewright_core::front::{Front, FrontPoint, ParetoFront};
use treewright_core::study::StudySpec;
use treewright_proto::convert::{configuration_from_wire, configuration_to_wire};
use treewright_proto::v1;

use super::super::charts::{self, figure};
use super::super::{Query, Visitor};
use super::{Head, PageFrame, asked_state, head, machine, read_all, render};
use crate::error::{Error, Result};

/// Most trials that are read, the latest: a run of a front is stored once for each of its directions.
const TRIALS: usize = 5000;

#[derive(Template)]
#[template(path = "front.html")]
struct Page {
    frame: PageFrame,
    head: Head,
    metrics: String,
    state: String,
    note: String,
    pictures: Vec<String>,
    /// The names of the metrics, and which side is better.
    titles: Vec<String>,
    rows: Vec<FrontRow>,
}

/// A configuration of the front, or the default.
struct FrontRow {
    configuration: String,
    runs: usize,
    /// Each metric, and its ratio to the default.
    values: Vec<(String, String)>,
}

pub(in super::super) async fn front(visitor: &Visitor<'_>, id: &str, query: &Query) -> Result<String> {
    let (head, _) = head(visitor, id, "front").await?;
    query.only(&["metrics", "state"])?;
    let metrics = query.text("metrics");
    let front = if metrics.is_empty() { head.front.clone() } else { Some(asked_front(&metrics)?) };
    let state = asked_state(query, "state", head.states)?;
    let mut page = Page {
        frame: visitor.frame,
        metrics: front.as_ref().map(written).unwrap_or_default(),
        state: state.map(|state| state.to_string()).unwrap_or_default(),
        note: "Name two or three measurements of the study; 1/rate for one that is to be large.".to_owned(),
        pictures: Vec::new(),
        titles: Vec::new(),
        rows: Vec::new(),
        head,
    };
    if let Some(front) = front {
        let spec = visitor.tuning.get_study(&page.head.id).await?.spec;
        let (trials, whose) = comparable(visitor, &page.head, &spec, state).await?;
        let runs: Vec<_> = trials.iter().filter_map(run).collect();
        let default = Assignment::from(spec.space.default_configuration());
        let pairs = runs.iter().map(|(configuration, measured)| (configuration, measured));
        page.fill(&front.of(pairs, &default, None), &whose);
    }
    render(&page)
}

impl Page {
    fn fill(&mut self, found: &ParetoFront, whose: &str) {
        if found.points.is_empty() {
            self.note = format!("No run{whose} measured all of {}.", found.metrics.join(", "));
            return;
        }
        let ParetoFront { runs, configurations, points, .. } = found;
        self.note = format!(
            "{} of {configurations} configurations are on the front, by the medians of {runs} runs{whose}.",
            points.len()
        );
        if let Some(volume) = found.hypervolume {
            self.note += &format!(
                " They leave behind {} of the box between zero and the default (hypervolume).",
                figure(volume)
            );
        }
        let beside = |point: &FrontPoint| {
            self.head.defaults.beside(Some(&configuration_to_wire(point.configuration.as_raw())))
        };
        self.pictures = charts::fronts(found, beside);
        self.titles = found.metrics.iter().map(|metric| found.title(metric)).collect();
        let default = found.default.iter().filter(|default| !points.contains(default));
        self.rows = points
            .iter()
            .chain(default)
            .map(|point| FrontRow {
                configuration: beside(point),
                runs: point.runs,
                values: found.metrics.iter().map(|metric| values(point, metric)).collect(),
            })
            .collect();
    }
}

fn values(point: &FrontPoint, metric: &str) -> (String, String) {
    let ratio = point.ratios.as_ref().and_then(|ratios| ratios.get(metric));
    let value = point.metrics.get(metric).map(|value| figure(*value));
    (value.unwrap_or_default(), ratio.map(|ratio| format!("{ratio:.3}")).unwrap_or_default())
}

/// The front that an address asks for.
fn asked_front(text: &str) -> Result<Front> {
    let metrics: Vec<&str> = text.split(',').collect();
    Front::new(&metrics).map_err(|problem| Error::invalid("metrics", problem.to_string()))
}

/// As an address asks for it.
fn written(front: &Front) -> String {
    let is_large = |name: &str| front.maximised().any(|large| large == name);
    let each = front.metrics().map(|name| if is_large(name) { format!("1/{name}") } else { name.to_owned() });
    each.collect::<Vec<_>>().join(",")
}

/// The trials of one input and one machine, newest first, and whose they are. The directions of a front are
/// states of one input.
async fn comparable(
    visitor: &Visitor<'_>,
    head: &Head,
    spec: &StudySpec,
    state: Option<i64>,
) -> Result<(Vec<v1::Trial>, String)> {
    let has_inputs = spec.indicators.indicators().iter().any(|one| one.name != Front::DIRECTION);
    let of_state = |state: i64| format!(" AND state_id = {state}");
    let Some(chosen) = newest(visitor, head, &state.map(of_state).unwrap_or_default(), 1).await?.pop() else {
        return Ok((Vec::new(), state.map(|state| format!(" of state {state}")).unwrap_or_default()));
    };
    let machine = machine(chosen.fingerprint.as_ref());
    let (filter, whose) = match has_inputs {
        true => (of_state(chosen.state_id), format!(" of state {} ({machine})", chosen.state_id)),
        false if machine.is_empty() => (String::new(), String::new()),
        false => (String::new(), format!(" on {machine}")),
    };
    let mut trials = newest(visitor, head, &filter, TRIALS).await?;
    let cut =
        if trials.len() == TRIALS { format!(" among the latest {TRIALS} trials") } else { String::new() };
    trials.retain(|trial| trial.fingerprint == chosen.fingerprint);
    Ok((trials, whose + &cut))
}

/// The latest trials that succeeded and for which a filter holds, in the present space.
async fn newest(visitor: &Visitor<'_>, head: &Head, filter: &str, most: usize) -> Result<Vec<v1::Trial>> {
    let request = v1::QueryTrialsRequest {
        study: format!("studies/{}", head.id),
        filter: format!("outcome = OK AND excluded = false{filter}"),
        order_by: "number desc".to_owned(),
        in_present_space: true,
        ..v1::QueryTrialsRequest::default()
    };
    read_all(visitor, request, most).await
}

/// A full run of this study, not a report of one to another direction.
fn run(trial: &v1::Trial) -> Option<(Assignment, BTreeMap<String, f64>)> {
    let has_direction = trial.indicators.contains_key(Front::DIRECTION);
    if !trial.fidelity.is_empty() || has_direction && Front::repeated_run(&trial.origin).is_some() {
        return None;
    }
    let values = configuration_from_wire("configuration", trial.configuration.clone()?).ok()?;
    Some((Assignment::from(values), trial.measurements.clone()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_names_metrics_as_the_command_line_does() {
        let front = asked_front("time_ms, 1/rate").expect("a front");
        assert_eq!(written(&front), "time_ms,1/rate");
        let error = asked_front("time_ms").expect_err("one metric").to_string();
        assert!(error.starts_with("metrics: ") && error.contains("two or three"), "{error}");
    }

    #[test]
    fn only_directions_repeat_runs() {
        let origin = "studies/before/trials/1".to_owned();
        let mut trial = v1::Trial { configuration: Some(Default::default()), origin, ..v1::Trial::default() };
        assert!(run(&trial).is_some());
        trial.indicators.insert(Front::DIRECTION.to_owned(), 0.0);
        assert!(run(&trial).is_none());
    }
}
