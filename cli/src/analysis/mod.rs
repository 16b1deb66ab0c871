//! The influence of a study's parameters, from its trials (paper, sections 4 and 5): the correlation of each
//! parameter with each measurement, the share of the variance that it explains, and the part of its range
//! that a search may keep to.
//!
//! Everything is computed from completed trials, in the order of their numbers, and without chance: equal
//! trials give equal bytes. Trials that were drawn at random (`treewright-render sample`) say most. Trials of
//! a search crowd where it looked; the result says which kind it rests on.
//!
//! | module | holds |
//! |---|---|
//! | `table` | trials as columns of numbers, measurements relative to their state |
//! | `dependence` | correlation, rank correlation, mutual information |
//! | `variance` | variance-based sensitivity, alone and in pairs |
//! | `narrow` | ranges and fixed values that keep the good configurations |
//! | `map` | two parameters against a measurement, such as both leaf sizes |
//! | `page` | all of it for a browser |

mod dependence;
mod map;
mod narrow;
mod page;
mod table;
mod variance;

use serde::Serialize;
use treewright_client::{StudySpec, TrialRecord};

pub(crate) use page::html;
use table::Table;

/// Fewer trials than this say nothing.
pub(crate) const TRIALS_MIN: usize = 30;
/// Fewer different configurations for each parameter cannot tell the parameters apart (Loeppky, Sacks and
/// Welch, "Choosing the sample size of a computer experiment", 2009).
const CONFIGURATIONS_PER_PARAMETER: usize = 10;

#[derive(Clone, Debug)]
pub(crate) struct Request {
    pub(crate) study: String,
    /// Measurements, sums of them written `a+b`.
    pub(crate) metrics: Vec<String>,
    /// Pairs of parameters to be drawn as maps.
    pub(crate) maps: Vec<(String, String)>,
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct Analysis {
    pub(crate) study: String,
    /// Of all completed ones, those that were measured.
    pub(crate) trials: usize,
    /// Trials that cannot be run.
    pub(crate) infeasible: usize,
    /// States, within which measurements are compared.
    pub(crate) states: usize,
    /// Different configurations, those of each state counted.
    pub(crate) configurations: usize,
    /// Parameters that took more than one value.
    pub(crate) varied: usize,
    /// Whether configurations were drawn at random; else they crowd where a search looked.
    pub(crate) random: bool,
    /// All trials first, then those for which a condition holds.
    pub(crate) conditions: Vec<Condition>,
    /// Ranges and values to which a search may be held, for each objective.
    pub(crate) objectives: Vec<narrow::Narrowed>,
    pub(crate) maps: Vec<map::Map>,
}

/// The trials for which something holds.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Condition {
    /// As a filter; empty for all trials.
    pub(crate) filter: String,
    pub(crate) trials: usize,
    pub(crate) metrics: Vec<Metric>,
}

/// A measurement and the parameters that it depends on.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Metric {
    pub(crate) name: String,
    /// The study maximises it.
    pub(crate) higher_is_better: bool,
    /// Median in its own unit.
    pub(crate) median: f64,
    /// Of the values relative to their state's geometric mean.
    pub(crate) relative_quartiles: [f64; 2],
    /// The most influential first.
    pub(crate) parameters: Vec<Influence>,
    pub(crate) pairs: Vec<variance::Pair>,
}

/// The dependence between one parameter and one measurement.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Influence {
    pub(crate) parameter: String,
    /// Trials in which it is active.
    pub(crate) trials: usize,
    /// Pearson's, with its 95 % interval; absent for values without an order.
    pub(crate) correlation: Option<dependence::Correlation>,
    /// Spearman's.
    pub(crate) rank_correlation: Option<dependence::Correlation>,
    /// In bits, of at most three.
    pub(crate) mutual_information_bits: f64,
    /// Share of the variance that it explains alone, 0 to 1; absent with too few configurations to say.
    pub(crate) first_order: Option<f64>,
}

/// Analyses trials: all of them, and for each further condition those for which it holds.
pub(crate) fn analyse(
    spec: &StudySpec,
    request: &Request,
    all: &[TrialRecord],
    conditions: &[(String, Vec<TrialRecord>)],
) -> Analysis {
    let table = Table::of(spec, all, &request.metrics);
    let mut found = vec![condition(String::new(), &table)];
    for (filter, trials) in conditions {
        found.push(condition(filter.clone(), &Table::of(spec, trials, &request.metrics)));
    }
    Analysis {
        study: request.study.clone(),
        trials: table.trials(),
        infeasible: table.infeasible,
        states: table.states(),
        configurations: table.distinct(),
        varied: table.varied().count(),
        random: table.random,
        conditions: found,
        objectives: table.metrics.iter().map(|metric| narrow::narrow(&table, metric)).collect(),
        maps: request
            .maps
            .iter()
            .flat_map(|pair| table.metrics.iter().filter_map(|metric| map::of(&table, pair, metric)))
            .collect(),
    }
}

impl Influence {
    /// Its measures as text: both correlations, the mutual information and the share.
    fn shown(&self) -> [String; 4] {
        let r = |of: Option<dependence::Correlation>| of.map(|of| format!("{:.2}", of.r));
        let share = self.first_order.map(|share| format!("{:.1} %", share * 100.0));
        let bits = Some(format!("{:.3}", self.mutual_information_bits));
        [r(self.correlation), r(self.rank_correlation), bits, share]
            .map(|text| text.unwrap_or_else(|| "–".to_owned()))
    }
}

impl Analysis {
    /// The most important influences, in words.
    fn headline(&self) -> String {
        let (configurations, varied) = (self.configurations, self.varied);
        if configurations < CONFIGURATIONS_PER_PARAMETER * varied {
            return format!(
                "Too few trials: {configurations} different configurations do not tell {varied} parameters apart, so shares are \
                 uncertain. Record {} or more, best at random.",
                CONFIGURATIONS_PER_PARAMETER * varied
            );
        }
        let all = self.conditions.first().map(|all| all.metrics.as_slice()).unwrap_or_default();
        let strongest = all.iter().take(3).filter_map(|metric| {
            let first = metric.parameters.first()?;
            let share = first.first_order.filter(|share| *share >= 0.01)?;
            let name = &metric.name;
            Some(format!("{} explains {:.0} % of {name}'s variance", first.parameter, share * 100.0))
        });
        let statements: Vec<String> = strongest.collect();
        if statements.is_empty() {
            "No single parameter explains 1 % or more of any measurement.".into()
        } else {
            statements.join("; ") + "."
        }
    }

    /// For a terminal.
    pub(crate) fn words(&self) -> String {
        let Self { study, trials, states, .. } = self;
        let mut text = format!("{study}: {trials} trials in {states} states. {}\n", self.headline());
        for metric in self.conditions.first().iter().flat_map(|all| &all.metrics) {
            let title = titled(&metric.name, metric.higher_is_better);
            text += &format!("\n{title:24} {:>6} {:>6} {:>6} {:>7}\n", "r", "rank", "bits", "share");
            for one in &metric.parameters {
                let [r, rank, bits, share] = one.shown();
                text += &format!("  {:22} {r:>6} {rank:>6} {bits:>6} {share:>7}\n", one.parameter);
            }
        }
        for narrowed in self.objectives.iter().filter(|one| !one.narrowed.is_empty()) {
            let narrow::Narrowed { metric, arguments, whole, part, higher_is_better, .. } = narrowed;
            let (wish, worse) = if *higher_is_better { ("more", "below") } else { ("less", "above") };
            text += &format!(
                "\nfor {wish} {metric}: {arguments}\n  one in ten trials {worse} {:.2} instead of {:.2} times the mean, the \
                 worst {:.2} instead of {:.2}\n",
                part.dear, whole.dear, part.worst, whole.worst
            );
        }
        text
    }
}

/// A measurement's name, with its direction where that is not the usual one.
fn titled(name: &str, higher_is_better: bool) -> String {
    format!("{name}{}", if higher_is_better { " (higher is better)" } else { "" })
}

fn condition(filter: String, table: &Table) -> Condition {
    let metrics = table.metrics.iter().map(|metric| {
        let mut parameters: Vec<Influence> = table
            .varied()
            .map(|parameter| Influence {
                parameter: parameter.name.clone(),
                trials: parameter.values.iter().flatten().count(),
                correlation: dependence::correlation(parameter, &metric.relative),
                rank_correlation: dependence::rank_correlation(parameter, &metric.relative),
                mutual_information_bits: dependence::mutual_information(parameter, &metric.relative),
                first_order: variance::first_order(table, parameter, &metric.relative),
            })
            .collect();
        parameters.sort_by(|a, b| {
            let share = |of: &Influence| of.first_order.unwrap_or(0.0);
            share(b).total_cmp(&share(a)).then_with(|| a.parameter.cmp(&b.parameter))
        });
        Metric {
            name: metric.name.clone(),
            higher_is_better: metric.higher_is_better,
            median: metric.median,
            relative_quartiles: metric.quartiles(),
            pairs: variance::pairs(table, metric, &parameters),
            parameters,
        }
    });
    Condition { filter, trials: table.trials(), metrics: metrics.collect() }
}

#[cfg(test)]
pub(crate) mod tests;
