//! The result of a session, as JSON and in words. The last words name one configuration: the one to use.

use std::collections::BTreeMap;

use serde::{Serialize, Serializer};
use treewright_client::{Configuration, CostView, ObjectiveTerm, ParetoFront, Standing, StudySpec};

use super::pairs::Gain;
use super::shell_words;
use crate::show::{self, figure};

/// The version of the JSON. It rises when a field changes its meaning or goes.
const FORMAT: u32 = 1;

#[derive(Debug, Default, Serialize)]
pub(super) struct Summary {
    format: u32,
    pub(super) study: String,
    /// The objective: a metric, with its unit in its name, or the weighted sum of several.
    pub(super) objective: String,
    /// Trials of this call, the pairs left out.
    pub(super) trials: u64,
    /// Measurements at cheaper levels, which are not among them.
    #[serde(skip_serializing_if = "is_none")]
    pub(super) cheaper: u64,
    /// In how many of them the configuration cannot be used.
    pub(super) infeasible: u64,
    /// The number that failed otherwise.
    pub(super) failed: u64,
    pub(super) end: &'static str,
    /// The error, if that is why.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) error: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) best: Option<Winner>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) confirmation: Option<Confirmed>,
    #[serde(skip)]
    view: CostView,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) front: Option<ParetoFront>,
}

/// The configuration that ran against the default in pairs, and its gain.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Confirmed {
    pub(super) configuration: Configuration,
    #[serde(flatten)]
    pub(super) gain: Gain,
    /// The interval says which of the two is better.
    pub(super) is_certain: bool,
}

/// The configuration to use.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Winner {
    pub(super) configuration: Configuration,
    /// Of the objective, in its unit.
    pub(super) cost: f64,
    pub(super) default_cost: Option<f64>,
    /// The metric's own value where one metric is maximised and nothing else counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) value: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) default_value: Option<f64>,
    pub(super) command: Vec<String>,
    pub(super) source: WinnerSource,
    /// The service's verdict on it; after pairs they have the last word.
    #[serde(rename = "status", serialize_with = "in_short", skip_serializing_if = "Option::is_none")]
    pub(super) standing: Option<Standing>,
}

/// The source of the best configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum WinnerSource {
    /// The service, from all that was ever measured in this study.
    Service,
    /// The pairs of this call.
    Pairs,
    /// The mean costs of this call's runs, because the daemon could not be asked.
    Runs,
}

impl Summary {
    pub(super) fn new(study: &str, spec: &StudySpec) -> Self {
        Self {
            format: FORMAT,
            study: study.to_owned(),
            objective: objective(spec),
            end: "the search has ended",
            view: spec.objective.view(),
            ..Self::default()
        }
    }

    pub(super) fn words(&self, default: &Configuration) -> String {
        let mut text = format!("{}: {} trial(s), {}", self.study, self.trials, self.end);
        let parts = [
            (self.cheaper, "more at cheaper levels"),
            (self.infeasible, "could not be used"),
            (self.failed, "failed"),
        ];
        for (count, what) in parts {
            if count > 0 {
                text += &format!("; {count} {what}");
            }
        }
        text.push('\n');
        if let Some(front) = &self.front {
            return text + &show::front(front) + "\n";
        }
        let Some(best) = &self.best else { return text + "nothing measured\n" };
        let is_default = best.configuration == *default;
        let who = if is_default { "the default, " } else { "" };
        text += &format!("best: {who}{}\n  {}\n", best.configuration, shell_words(&best.command));
        text += &format!("{} {}", self.objective, figure(best.value.unwrap_or(best.cost)));
        if let Some(cost) = best.default_value.or(best.default_cost).filter(|_| !is_default) {
            text += &format!(", default {}", figure(cost));
        }
        if self.view.is_maximised() {
            text += "; higher is better";
        }
        if best.source == WinnerSource::Runs {
            text += " (by this call's runs alone, because the daemon cannot be asked)";
        }
        text.push('\n');
        if let Some(standing) = &best.standing {
            text += &format!("{}\n", standing.sentence_by(&self.view));
        }
        if let Some(confirmed) = &self.confirmation {
            text += &confirmed.words(best.configuration == confirmed.configuration, &self.view);
        }
        text
    }
}

impl Confirmed {
    /// `is_best`: it is the recommended configuration.
    fn words(&self, is_best: bool, view: &CostView) -> String {
        let Gain { pairs, gain, low, high, confidence, .. } = self.gain;
        let found = format!(
            "{} % {} the default, {} to {} % ({:.0} % interval of the median)",
            view.percent(gain),
            view.better_side(),
            view.percent(low),
            view.percent(high),
            100.0 * confidence
        );
        let noise = "that is within the noise; more pairs (--confirm=30) may decide it\n";
        match (is_best, self.is_certain) {
            (true, true) => format!("confirmed in {pairs} interleaved pairs: {found}\n"),
            (true, false) => format!("in {pairs} interleaved pairs: {found}\n{noise}"),
            (false, true) => {
                format!("nothing better in {pairs} interleaved pairs: the best of the others was {found}\n")
            }
            (false, false) => {
                format!(
                    "nothing better is proven in {pairs} interleaved pairs: the best of the others was {found}\n{noise}"
                )
            }
        }
    }
}

/// The objective in few words.
pub(super) fn objective(spec: &StudySpec) -> String {
    let (terms, maximised) = (spec.objective.terms(), spec.objective.maximised());
    match terms {
        // Its own value is shown, not the cost.
        [term] if term.weight == 1.0 || !maximised.is_empty() => term.metric.clone(),
        _ => {
            let sign = |metric: &String| if maximised.contains(metric) { "/ " } else { "" };
            let shown = |term: &ObjectiveTerm| {
                format!("{} {}{}", figure(term.weight), sign(&term.metric), term.metric)
            };
            terms.iter().map(shown).collect::<Vec<_>>().join(" + ")
        }
    }
}

/// The measurements of this call: the costs of each configuration.
#[derive(Debug, Default)]
pub(super) struct OwnRuns {
    costs: BTreeMap<String, (Configuration, Vec<f64>)>,
    /// Number of failures of each configuration since it last worked.
    failures: BTreeMap<String, u32>,
}

impl OwnRuns {
    pub(super) fn measured(&mut self, configuration: &Configuration, cost: f64) {
        let name = configuration.to_string();
        self.failures.remove(&name);
        self.costs.entry(name).or_insert_with(|| (configuration.clone(), Vec::new())).1.push(cost);
    }

    /// Counts a failure of a configuration. Returns the number of its failures since it last worked.
    pub(super) fn failed(&mut self, configuration: &Configuration) -> u32 {
        let count = self.failures.entry(configuration.to_string()).or_default();
        *count += 1;
        *count
    }

    pub(super) fn has_worked(&self, configuration: &Configuration) -> bool {
        self.costs.contains_key(&configuration.to_string())
    }

    pub(super) fn is_empty(&self) -> bool {
        self.costs.is_empty()
    }

    /// The configuration of the lowest single cost, `but` one.
    pub(super) fn lowest(&self, but: &Configuration) -> Option<Configuration> {
        let least = |costs: &[f64]| costs.iter().copied().fold(f64::INFINITY, f64::min);
        let others = self.costs.values().filter(|(configuration, _)| configuration != but);
        others.min_by(|(_, one), (_, other)| least(one).total_cmp(&least(other))).map(|(one, _)| one.clone())
    }

    pub(super) fn best(&self) -> Option<(&Configuration, f64)> {
        let all = self.costs.values().map(|(configuration, costs)| (configuration, mean(costs)));
        all.min_by(|(_, one), (_, other)| one.total_cmp(other))
    }

    pub(super) fn mean_cost(&self, configuration: &Configuration) -> Option<f64> {
        self.costs.get(&configuration.to_string()).map(|(_, costs)| mean(costs))
    }
}

#[allow(clippy::ref_option)] // serde hands over a reference to the field
fn in_short<S: Serializer>(standing: &Option<Standing>, serializer: S) -> Result<S::Ok, S::Error> {
    standing.map(|standing| standing.in_short()).serialize(serializer)
}

#[allow(clippy::trivially_copy_pass_by_ref)] // serde hands over a reference
fn is_none(count: &u64) -> bool {
    *count == 0
}

fn mean(costs: &[f64]) -> f64 {
    costs.iter().sum::<f64>() / costs.len() as f64
}

#[cfg(test)]
mod tests {
    use treewright_client::{Confirmation, ConfirmationStage, Space};

    use super::*;

    #[test]
    fn what_is_shown_and_printed_has_the_verdict_of_every_surface() {
        let space = Space::builder().integer("x", 1..=9).default(4).build().expect("valid");
        let spec = StudySpec::builder(space).minimise("loss", 1.0).build().expect("valid");
        let default = Configuration::from(spec.space.default_configuration());
        let stage = ConfirmationStage::NothingBetter;
        let confirmation = Confirmation { stage, rounds: 4, rounds_max: 9, measurements: 16, gain: None };
        let standing = Standing {
            cost: 4.0,
            cost_low: 3.0,
            cost_high: 5.0,
            gain: None,
            nothing_better: true,
            confirmation,
            disturbances: 0,
            gain_at_most: Some(0.02),
        };
        let mut summary = Summary::new("s", &spec);
        summary.best = Some(Winner {
            configuration: default.clone(),
            cost: 4.0,
            default_cost: Some(4.0),
            value: None,
            default_value: None,
            command: vec!["true".to_owned()],
            source: WinnerSource::Service,
            standing: Some(standing),
        });
        let words = summary.words(&default);
        assert!(words.ends_with(&format!("loss 4\n{}\n", standing.sentence())), "{words}");
        let printed = serde_json::to_value(&summary).expect("plain data");
        assert_eq!(printed["best"]["status"], "nothing better");
        summary.best = summary.best.map(|best| Winner { standing: None, ..best });
        assert_eq!(summary.words(&default).lines().count(), 4);
        assert_eq!(serde_json::to_value(&summary).expect("plain data")["best"].get("status"), None);
    }
}
