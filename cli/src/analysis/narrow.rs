//! Narrower spaces (paper, section 5): to which values a parameter may be held without losing the good
//! configurations.
//!
//! The choice rests on the best tenth of one half of the trials. A parameter with an order is held to the
//! shortest run of values that holds nearly all of that tenth, where chance would hardly do this. A parameter
//! without an order is fixed where nearly all of that tenth agree. The gain is measured on the other half.

use std::cmp::Ordering;

use serde::Serialize;

use super::table::{Column, Measured, Table, quantile};

/// The best share of trials.
const BEST: f64 = 0.1;
/// The share of them that must be kept.
const KEPT: f64 = 0.9;
/// Greatest share of all trials that a run may have.
const WORTH: f64 = 0.75;

/// The ranges and values to which a search for one measurement may be held.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Narrowed {
    pub(crate) metric: String,
    /// The study maximises it.
    pub(crate) higher_is_better: bool,
    /// The parameters that are held, with the values that remain.
    pub(crate) narrowed: Vec<Held>,
    /// All of it for a command line: `--range …` and `--fix …`.
    pub(crate) arguments: String,
    /// The values of trials on which it was not chosen: of all, and of those that fit.
    pub(crate) whole: Spread,
    pub(crate) part: Spread,
}

/// Probability at which as many of the best in a run are not taken for chance: there are many runs and
/// parameters.
const CHANCE: f64 = 1e-4;

/// A parameter and the values that remain for it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Held {
    pub(crate) parameter: String,
    /// `NAME=VALUE` or `NAME=LOW..HIGH`.
    pub(crate) argument: String,
    /// Whether one value is left.
    pub(crate) fixed: bool,
    /// Share of the best trials that it keeps, and of all.
    pub(crate) keeps_best: f64,
    pub(crate) keeps_all: f64,
}

/// Values relative to the geometric mean of their state.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Spread {
    pub(crate) trials: usize,
    pub(crate) best: f64,
    pub(crate) median: f64,
    /// Than which one trial in ten is worse.
    pub(crate) dear: f64,
    pub(crate) worst: f64,
}

impl Spread {
    fn of(mut values: Vec<f64>, higher_is_better: bool) -> Self {
        values.sort_by(|a, b| from_best(*a, *b, higher_is_better));
        let [best, median, dear, worst] = [0.0, 0.5, 0.9, 1.0].map(|share| quantile(&values, share));
        Self { trials: values.len(), best, median, dear, worst }
    }
}

fn from_best(a: f64, b: f64, higher_is_better: bool) -> Ordering {
    let rising = a.total_cmp(&b);
    if higher_is_better { rising.reverse() } else { rising }
}

/// A parameter's run of bins.
struct Run<'a> {
    column: &'a Column,
    low: f64,
    high: f64,
}

impl Run<'_> {
    /// Trials in which the parameter means nothing are in every run.
    fn has(&self, trial: usize) -> bool {
        self.column.values[trial].is_none_or(|value| (self.low..=self.high).contains(&value))
    }
}

/// Chooses on every second trial and measures the gain on the others.
pub(super) fn narrow(table: &Table, metric: &Measured) -> Narrowed {
    let measured = |parity: usize| {
        let own = move |trial: &usize| trial % 2 == parity;
        (0..metric.relative.len()).filter(own).filter_map(|trial| Some((trial, metric.relative[trial]?)))
    };
    let mut chosen_on: Vec<(usize, f64)> = measured(0).collect();
    let higher_is_better = metric.higher_is_better;
    chosen_on.sort_by(|a, b| from_best(a.1, b.1, higher_is_better).then(a.0.cmp(&b.0)));
    let best = ((chosen_on.len() as f64 * BEST).ceil() as usize).max(1).min(chosen_on.len());
    let all: Vec<usize> = chosen_on.iter().map(|(trial, _)| *trial).collect();
    let (mut narrowed, mut runs) = (Vec::new(), Vec::new());
    for column in table.parameters.iter().filter(|column| column.varies()) {
        if let Some((held, run)) = hold(column, &all[..best], &all) {
            narrowed.push(held);
            runs.push(run);
        }
    }
    let judged_on: Vec<(usize, f64)> = measured(1).collect();
    let inside = judged_on.iter().filter(|(trial, _)| runs.iter().all(|run| run.has(*trial)));
    let words = narrowed
        .iter()
        .map(|held: &Held| format!("{} {}", if held.fixed { "--fix" } else { "--range" }, held.argument));
    Narrowed {
        metric: metric.name.clone(),
        higher_is_better,
        arguments: words.collect::<Vec<_>>().join(" "),
        whole: Spread::of(judged_on.iter().map(|(_, value)| *value).collect(), higher_is_better),
        part: Spread::of(inside.map(|(_, value)| *value).collect(), higher_is_better),
        narrowed,
    }
}

fn hold<'a>(column: &'a Column, best: &[usize], all: &[usize]) -> Option<(Held, Run<'a>)> {
    let (bins, count) = column.bins();
    let shares = |trials: &[usize]| -> Option<Vec<f64>> {
        let active: Vec<usize> = trials.iter().filter_map(|trial| bins[*trial]).collect();
        let share =
            |bin: usize| active.iter().filter(|one| **one == bin).count() as f64 / active.len() as f64;
        (!active.is_empty()).then(|| (0..count).map(share).collect())
    };
    let (of_best, of_all) = (shares(best)?, shares(all)?);
    let runs = (0..count).flat_map(|from| (from..count).map(move |to| (from, to)));
    let sum = |shares: &[f64], (from, to): (usize, usize)| shares[from..=to].iter().sum::<f64>();
    let fits = runs.filter(|run| sum(&of_best, *run) >= KEPT && (column.ordered || run.0 == run.1));
    let run = fits.min_by(|a, b| sum(&of_all, *a).total_cmp(&sum(&of_all, *b)).then(a.cmp(b)))?;
    let (keeps_best, keeps_all) = (sum(&of_best, run), sum(&of_all, run));
    let active = best.iter().filter(|trial| bins[**trial].is_some()).count();
    if keeps_all > WORTH
        || at_least(active, (keeps_best * active as f64).round() as usize, keeps_all) > CHANCE
    {
        return None;
    }
    let inside = column
        .values
        .iter()
        .zip(&bins)
        .filter(|(_, bin)| bin.is_some_and(|bin| (run.0..=run.1).contains(&bin)));
    let values = || inside.clone().filter_map(|(value, _)| *value);
    let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
    let fixed = low == high;
    let name = &column.name;
    let argument = match fixed {
        true => format!("{name}={}", column.written(low)),
        false => format!("{name}={}..{}", column.written(low), column.written(high)),
    };
    Some((
        Held { parameter: name.clone(), argument, fixed, keeps_best, keeps_all },
        Run { column, low, high },
    ))
}

/// Probability of at least `least` hits in `count` draws of which each hits with `probability`.
fn at_least(count: usize, least: usize, probability: f64) -> f64 {
    let mut sum = 0.0;
    // The logarithm of the binomial coefficient, from `count` hits downwards.
    let mut coefficient = 0.0;
    for hits in (least..=count).rev() {
        let (hit, missed) = (hits as f64, (count - hits) as f64);
        sum += (coefficient + hit * probability.ln() + missed * (1.0 - probability).ln()).exp();
        coefficient += (hit / (missed + 1.0)).ln();
    }
    sum
}
