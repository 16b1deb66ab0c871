//! Trials as columns of numbers.
//!
//! Costs of different states are not comparable: a larger scene takes longer whatever its configuration. So
//! every measurement is divided by the geometric mean of its state. Two kinds of trials with a gap between
//! leave that mean where it is, whereas the median would be one or the other by chance.

use std::collections::BTreeMap;

use treewright_client::{Domain, OpenEnum, Outcome, Parameter, Scale, StudySpec, TrialRecord, Value};

/// Most bins of a parameter or measurement.
pub(super) const BINS: usize = 8;

/// Measurements that describe a trial and are no result of it.
const NO_RESULTS: [&str; 3] = ["sample", "sequence", "frames"];

/// A parameter's values, trial by trial.
#[derive(Clone, Debug)]
pub(super) struct Column {
    pub(super) name: String,
    /// As numbers; those without an order by their place. `None` where the parameter is inactive.
    pub(super) values: Vec<Option<f64>>,
    /// Whether larger means more.
    pub(super) ordered: bool,
    /// Equal ratios are equal steps.
    pub(super) log: bool,
    domain: Domain,
}

impl Column {
    fn of(parameter: &Parameter, trials: &[&TrialRecord]) -> Self {
        let ordered = match &parameter.domain {
            Domain::Categorical { values } => values.iter().all(|value| value.as_number().is_some()),
            _ => true,
        };
        let number = |value: &Value| match (value, &parameter.domain) {
            (Value::Boolean(value), _) => Some(f64::from(u8::from(*value))),
            (value, Domain::Categorical { values }) if !ordered => {
                values.iter().position(|known| known == value).map(|place| place as f64)
            }
            (value, _) => value.as_number(),
        };
        let log = matches!(
            parameter.domain,
            Domain::Integer { scale: Scale::Log, .. } | Domain::Float { scale: Scale::Log, .. }
        );
        Self {
            name: parameter.name.clone(),
            values: trials
                .iter()
                .map(|trial| trial.configuration.get(&parameter.name).and_then(number))
                .collect(),
            ordered,
            log,
            domain: parameter.domain.clone(),
        }
    }

    /// Whether it took more than one value.
    pub(super) fn varies(&self) -> bool {
        let mut values = self.values.iter().flatten();
        let first = values.next();
        values.any(|value| Some(value) != first)
    }

    /// The bin of each value, and how many bins there are: one a value where they are few, else about as many
    /// trials in each.
    pub(super) fn bins(&self) -> (Vec<Option<usize>>, usize) {
        bins(&self.values)
    }

    /// A value as it is written on the command line.
    pub(super) fn written(&self, value: f64) -> String {
        match &self.domain {
            Domain::Boolean => (value > 0.5).to_string(),
            Domain::Categorical { values } if !self.ordered => {
                values.get(value as usize).map(Value::to_string).unwrap_or_default()
            }
            _ => rounded(value),
        }
    }
}

/// Four significant digits, without trailing noughts.
pub(super) fn rounded(value: f64) -> String {
    let digits = if value == 0.0 { 0 } else { (3 - value.abs().log10().floor() as i32).clamp(0, 9) };
    let text = format!("{value:.*}", digits as usize);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Bins of numbers, see [`Column::bins`].
pub(super) fn bins(values: &[Option<f64>]) -> (Vec<Option<usize>>, usize) {
    let sorted = sorted(values.iter().flatten().copied());
    let mut distinct = sorted.clone();
    distinct.dedup();
    let edges: Vec<f64> = if distinct.len() <= BINS {
        distinct.into_iter().skip(1).collect()
    } else {
        let mut edges: Vec<f64> = (1..BINS).map(|bin| sorted[bin * sorted.len() / BINS]).collect();
        edges.dedup();
        edges.retain(|edge| sorted.first() < Some(edge));
        edges
    };
    let bin = |value: f64| edges.iter().filter(|edge| value >= **edge).count();
    (values.iter().map(|value| value.map(bin)).collect(), edges.len() + 1)
}

#[derive(Clone, Debug)]
pub(super) struct Measured {
    pub(super) name: String,
    /// Over the geometric mean of the trial's state; `None` where it was not measured.
    pub(super) relative: Vec<Option<f64>>,
    /// Of all trials, in the measurement's own unit.
    pub(super) median: f64,
    /// The study maximises it.
    pub(super) higher_is_better: bool,
}

impl Measured {
    pub(super) fn quartiles(&self) -> [f64; 2] {
        let sorted = sorted(self.relative.iter().flatten().copied());
        [0.25, 0.75].map(|share| quantile(&sorted, share))
    }
}

pub(super) fn sorted(numbers: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut numbers: Vec<f64> = numbers.into_iter().collect();
    numbers.sort_by(f64::total_cmp);
    numbers
}

/// The value below which a share of sorted ones lies, between neighbours in a straight line.
pub(super) fn quantile(sorted: &[f64], share: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return 0.0 };
    let at = share * last as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    low + (high - low) * at.fract()
}

#[derive(Clone, Debug)]
pub(super) struct Table {
    pub(super) parameters: Vec<Column>,
    pub(super) metrics: Vec<Measured>,
    pub(super) infeasible: usize,
    pub(super) random: bool,
    state_ids: Vec<i64>,
    /// A number for each trial, equal for runs of one configuration in one state.
    pub(super) configurations: Vec<usize>,
}

impl Table {
    /// The measured ones of these trials. Without names of measurements, all that are there, and build and
    /// render time together.
    pub(super) fn of(spec: &StudySpec, trials: &[TrialRecord], metrics: &[String]) -> Self {
        let ended = |trial: &TrialRecord, ok: bool| match &trial.outcome {
            Some(OpenEnum::Known(Outcome::Ok)) => ok,
            Some(OpenEnum::Known(Outcome::Infeasible { .. })) => !ok,
            _ => false,
        };
        let trials: Vec<&TrialRecord> = trials.iter().filter(|trial| trial.fidelity.is_none()).collect();
        let measured: Vec<&TrialRecord> = trials.iter().copied().filter(|trial| ended(trial, true)).collect();
        let names = if metrics.is_empty() { usual(&measured) } else { metrics.to_vec() };
        Self {
            parameters: spec.space.parameters().iter().map(|one| Column::of(one, &measured)).collect(),
            metrics: names.into_iter().map(|name| relative(name, spec, &measured)).collect(),
            infeasible: trials.iter().filter(|trial| ended(trial, false)).count(),
            random: measured.iter().all(|trial| trial.measurements.get("sample").is_some()),
            state_ids: measured.iter().map(|trial| trial.state_id).collect(),
            configurations: numbered(&measured),
        }
    }

    /// Parameters that took more than one value.
    pub(super) fn varied(&self) -> impl Iterator<Item = &Column> {
        self.parameters.iter().filter(|parameter| parameter.varies())
    }

    /// Different configurations, those of each state counted.
    pub(super) fn distinct(&self) -> usize {
        self.configurations.iter().max().map_or(0, |last| last + 1)
    }

    pub(super) fn trials(&self) -> usize {
        self.state_ids.len()
    }

    pub(super) fn states(&self) -> usize {
        let distinct: std::collections::BTreeSet<i64> = self.state_ids.iter().copied().collect();
        distinct.len()
    }

    pub(super) fn parameter(&self, name: &str) -> Option<&Column> {
        self.parameters.iter().find(|parameter| parameter.name == name)
    }
}

/// Numbers each pair of a configuration and a state from 0.
fn numbered(trials: &[&TrialRecord]) -> Vec<usize> {
    let mut known: BTreeMap<(i64, String), usize> = BTreeMap::new();
    let number = |trial: &&TrialRecord| {
        let next = known.len();
        *known.entry((trial.state_id, trial.configuration.to_string())).or_insert(next)
    };
    trials.iter().map(number).collect()
}

/// The measurements there are. Where a build and a render time are among them, these two and their sum come
/// first.
fn usual(trials: &[&TrialRecord]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for trial in trials {
        for (name, _) in trial.measurements.iter() {
            if !NO_RESULTS.contains(&name) && names.iter().all(|known| known != name) {
                names.push(name.to_owned());
            }
        }
    }
    let first = ["render_ms", "build_ms"];
    let both = first.iter().all(|name| names.iter().any(|known| known == name));
    names.sort_by_key(|name| (first.iter().position(|one| one == name).unwrap_or(first.len()), name.clone()));
    if both {
        names.insert(1, "build_ms+render_ms".to_owned());
    }
    names
}

/// A measurement, or a sum of some, by its name. `cost` stands for the study's objective.
fn relative(name: String, spec: &StudySpec, trials: &[&TrialRecord]) -> Measured {
    let view = spec.objective.view();
    let is_cost = name == "cost";
    let value = |trial: &&TrialRecord| match is_cost {
        true => trial.cost.map(|cost| view.value(cost)),
        false => name.split('+').map(|term| trial.measurements.get(term.trim())).sum(),
    };
    let raw: Vec<Option<f64>> = trials.iter().map(value).collect();
    let name = if is_cost { view.name().to_owned() } else { name };
    let mut by_state: BTreeMap<i64, Vec<f64>> = BTreeMap::new();
    for (trial, value) in trials.iter().zip(&raw) {
        by_state.entry(trial.state_id).or_default().extend(value);
    }
    let means: BTreeMap<i64, f64> = by_state
        .into_iter()
        .map(|(state, values)| {
            let logarithms: Vec<f64> =
                values.iter().filter(|value| **value > 0.0).map(|value| value.ln()).collect();
            (state, (logarithms.iter().sum::<f64>() / logarithms.len() as f64).exp())
        })
        .collect();
    let over = |(trial, value): (&&TrialRecord, &Option<f64>)| {
        let mean = means.get(&trial.state_id).copied().filter(|mean| *mean > 0.0)?;
        Some((*value)? / mean)
    };
    Measured {
        higher_is_better: spec.objective.maximised().contains(&name),
        name,
        relative: trials.iter().zip(&raw).map(over).collect(),
        median: quantile(&sorted(raw.iter().flatten().copied()), 0.5),
    }
}
