//! One trial with its reason.

use askama::Template;
use treewright_core::cost_view::CostView;
use treewright_proto::v1;

use super::super::charts::figure;
use super::super::{Query, Visitor, may_steer};
use super::{Head, PageFrame, TrialRow, head, machine, render, row, time, value, word};
use crate::error::Result;
use crate::rpc;

type Pairs = Vec<(String, String)>;

#[derive(Template)]
#[template(path = "trial.html")]
struct Page {
    frame: PageFrame,
    head: Head,
    /// Whether the visitor may pin its configuration, and may exclude it or count it again.
    may_pin: bool,
    may_exclude: bool,
    row: TrialRow,
    facts: Pairs,
    summary: String,
    reasons: Pairs,
    neighbours: Vec<(i64, String, String)>,
    configuration: Vec<(String, String, String)>,
    tables: Vec<(&'static str, Pairs)>,
}

pub(in super::super) async fn trial(
    visitor: &Visitor<'_>,
    id: &str,
    number: &str,
    query: &Query,
) -> Result<String> {
    query.only(&[])?;
    let (head, study) = head(visitor, id, "trials").await?;
    let request = v1::GetTrialRequest { name: format!("studies/{}/trials/{number}", head.id) };
    let trial = rpc::trials::get(visitor.call(), request).await?;
    let reason = trial.reason.clone().unwrap_or_default();
    let row = row(&trial, &head);
    let view = head.view.clone();
    let shown = |cost: Option<f64>| cost.map(|cost| figure(view.value(cost))).unwrap_or_default();
    let (name, stop) = (view.name(), if view.is_maximised() { "below" } else { "above" });
    let given = |name: &str, value: String| (!value.is_empty()).then(|| (name.to_owned(), value));
    let facts = [
        given("Mode", row.mode.clone()),
        given("Outcome", row.outcome.clone()),
        given("Reason for the outcome", row.reason.clone()),
        given("Excluded", trial.exclusion.clone()),
        given(&view.heading(), row.cost.clone()),
        given(&format!("Predicted {name}"), shown(trial.predicted_cost)),
        given(&format!("Stop {stop} {name}"), shown(trial.abort_above)),
        given("Client", row.client.clone()),
        given("Machine", machine(trial.fingerprint.as_ref())),
        given("Started", row.begun.clone()),
        given("Reported", time(trial.complete_time)),
        given("Late", if trial.late { "yes".to_owned() } else { String::new() }),
        given("Imported from", trial.origin.clone()),
        given("Level", trial.fidelity.clone()),
    ];
    let neighbours = reason.neighbours.iter();
    let neighbours =
        neighbours.map(|near| (near.state_id, figure(near.distance), shown(Some(near.best_cost))));
    let sorted = |values: Vec<(String, f64)>| {
        let mut values: Pairs = values.into_iter().map(|(name, value)| (name, figure(value))).collect();
        values.sort_unstable();
        values
    };
    let page = Page {
        frame: visitor.frame,
        may_pin: may_steer(visitor.caller) && row.outcome == "OK" && trial.fidelity.is_empty(),
        may_exclude: may_steer(visitor.caller) && trial.state() == v1::TrialState::Completed,
        facts: facts.into_iter().flatten().collect(),
        summary: reason.summary.clone(),
        reasons: reasons(&reason, &view),
        neighbours: neighbours.collect(),
        configuration: beside_default(&trial, &study),
        tables: vec![
            ("Indicators", sorted(trial.indicators.clone().into_iter().collect())),
            ("Measurements", sorted(trial.measurements.clone().into_iter().collect())),
            ("Standard errors", sorted(trial.standard_errors.clone().into_iter().collect())),
        ],
        head,
        row,
    };
    render(&page)
}

fn reasons(reason: &v1::Reason, view: &CostView) -> Pairs {
    let explanation = reason.explanation.clone().unwrap_or_default();
    let given = |name: &str, value: Option<f64>| value.map(|value| (name.to_owned(), figure(value)));
    let text = |name: &str, value: &str| (!value.is_empty()).then(|| (name.to_owned(), value.to_owned()));
    let rule =
        if explanation.rule == 0 { String::new() } else { word(explanation.rule().as_str_name(), "RULE_") };
    [
        text("Chosen by", &reason.source),
        text("Step", &reason.step),
        text("Rule", &rule),
        given("Probability of exploring", explanation.epsilon),
        given("Budget left", explanation.budget_left),
        given("Budget reserved", explanation.set_aside),
        given(&format!("Reference {}", view.name()), explanation.reference_cost.map(|cost| view.value(cost))),
        given(
            "Expected gain (share)",
            explanation.expected_gain.map(|share| view.share(share)).filter(|share| share.is_finite()),
        ),
        given("Expected frames", explanation.expected_frames),
        given("Cost of exploring (frames)", explanation.exploring_cost),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Each parameter of the space: here, and by default. Then what the trial ran with in an earlier space.
fn beside_default(trial: &v1::Trial, study: &v1::Study) -> Vec<(String, String, String)> {
    let mut values = trial.configuration.clone().unwrap_or_default().values;
    let parameters = study.space.iter().flat_map(|space| &space.parameters);
    let mut rows: Vec<_> = parameters
        .map(|parameter| {
            let here = values.remove(&parameter.name);
            let here = here.as_ref().map_or_else(|| "(inactive)".to_owned(), value);
            let default = parameter.default_value.as_ref().map(value).unwrap_or_default();
            (parameter.name.clone(), here, default)
        })
        .collect();
    let gone =
        values.iter().map(|(name, here)| (name.clone(), value(here), "(no parameter any more)".to_owned()));
    let mut gone: Vec<_> = gone.collect();
    gone.sort_unstable();
    rows.extend(gone);
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_ran_in_an_earlier_space_is_shown() {
        let integer = |value| v1::Value { kind: Some(v1::value::Kind::Integer(value)) };
        let parameter = |name: &str| v1::Parameter {
            name: name.to_owned(),
            default_value: Some(integer(3)),
            ..v1::Parameter::default()
        };
        let space =
            v1::Space { parameters: ["level", "threads"].map(parameter).into(), ..v1::Space::default() };
        let study = v1::Study { space: Some(space), ..v1::Study::default() };
        let values = [("level", 4), ("gone", 5)].map(|(name, value)| (name.to_owned(), integer(value)));
        let configuration = Some(v1::Configuration { values: values.into() });
        let rows = beside_default(&v1::Trial { configuration, ..v1::Trial::default() }, &study);
        let rows: Vec<_> = rows.iter().map(|(name, here, by)| [name.as_str(), here, by]).collect();
        assert_eq!(
            rows,
            [["level", "4", "3"], ["threads", "(inactive)", "3"], ["gone", "5", "(no parameter any more)"]]
        );
    }
}
