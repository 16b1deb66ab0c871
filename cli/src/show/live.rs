//! Several states at once: the best configuration of each, and the trials under way.

use std::time::SystemTime;

use serde::Serialize;
use treewright_client::{Best, Configuration, CostView, StudyRecord, StudySpec, TrialRecord};

use super::{figure, line, table};

/// Width of lines of words.
const COLUMNS: u16 = 80;

/// The picture of one moment.
#[derive(Debug, Serialize)]
pub(crate) struct Glance {
    pub(crate) study: StudyRecord,
    /// The best of each of the first states.
    pub(crate) best: Vec<Best>,
    /// Trials under a lease.
    pub(crate) open: Vec<TrialRecord>,
    /// Completed since the last look.
    pub(crate) trials_per_s: Option<f64>,
}

/// By how much the best of a state is better than its default, with its 95 % interval; empty where the
/// default was not measured.
fn gain(best: &Best, view: &CostView) -> String {
    match best.standing {
        Some(standing) => standing.gain.map(|gain| gain.by(view).to_string()).unwrap_or_default(),
        None => {
            let default = best.default_cost.filter(|default| *default > 0.0);
            let gain = |default: f64| view.percent(1.0 - best.cost / default);
            default.map_or_else(String::new, |default| format!("{} %", gain(default)))
        }
    }
}

/// The best configuration of each state, each beside its own default.
pub(crate) fn best_of_states(found: &[Best], study: &StudyRecord) -> String {
    if found.is_empty() {
        return "nothing measured yet\n".to_owned();
    }
    let mut text = rows(found, study.spec().ok());
    let states = study.statistics.states;
    if (found.len() as i64) < states {
        line(&mut text, &format!("{} of {states} states; use --state NUMBER to see others", found.len()));
    }
    text
}

/// Longest configuration that stands in the table, in characters; longer ones follow it.
const SHORT: usize = 30;

pub(super) fn rows(found: &[Best], spec: Option<&StudySpec>) -> String {
    let others: Vec<String> = found.iter().map(|best| beside_default(&best.configuration, spec)).collect();
    let is_short = others.iter().all(|words| words.chars().count() <= SHORT);
    let view = spec.map(|spec| spec.objective.view()).unwrap_or_default();
    let (title, gains) = (view.title(), format!("{} the default", view.better_side()));
    let mut header = vec!["state", &title, &gains, "status", "runs"];
    header.extend(is_short.then_some("changed from the default"));
    let mut table = table(&header, &[0, 1, 2, 4]);
    let mut jumps = 0;
    for (best, other) in found.iter().zip(&others) {
        let cost = best.standing.map_or(best.cost, |standing| standing.cost);
        jumps += best.standing.map_or(0, |standing| standing.disturbances);
        let mut row = vec![
            best.state_id.to_string(),
            figure(view.value(cost)),
            gain(best, &view),
            best.standing.map(|standing| standing.in_short().to_owned()).unwrap_or_default(),
            best.measurements.to_string(),
        ];
        row.extend(is_short.then(|| other.clone()));
        table.add_row(row);
    }
    let mut text = table.trim_fmt() + "\n";
    if !is_short {
        line(&mut text, "Values of the best configurations that differ from the default:");
        for (best, other) in found.iter().zip(&others) {
            text += &wrapped(&format!("{:>4}  ", best.state_id), other);
        }
    }
    if jumps > 0 {
        line(&mut text, &format!("the machine's speed jumped {jumps} time(s) during these measurements"));
    }
    text
}

/// The values of a configuration that differ from the default; all where the study cannot be read.
fn beside_default(configuration: &Configuration, spec: Option<&StudySpec>) -> String {
    let Some(spec) = spec else { return configuration.to_string() };
    let parameters = spec.space.parameters().iter();
    let others = parameters.filter_map(|parameter| {
        let value = configuration.get(&parameter.name).filter(|value| **value != parameter.default)?;
        Some(format!("{}={value}", parameter.name))
    });
    let words = others.collect::<Vec<_>>().join(" ");
    if words.is_empty() { "the default".to_owned() } else { words }
}

fn wrapped(label: &str, words: &str) -> String {
    let mut text = label.to_owned();
    let mut column = label.len();
    for (index, word) in words.split(' ').enumerate() {
        if index > 0 && column + 1 + word.len() >= usize::from(COLUMNS) {
            text += &format!("\n{:width$}", "", width = label.len());
            column = label.len();
        } else if index > 0 {
            text.push(' ');
            column += 1;
        }
        text += word;
        column += word.len();
    }
    text + "\n"
}

/// A study at one moment.
pub(crate) fn glance(glance: &Glance, now: SystemTime) -> String {
    let (study, counts) = (&glance.study, glance.study.statistics);
    let mut text = String::new();
    line(&mut text, &format!("{}  {}", study.name, study.display_name));
    let speed = glance.trials_per_s.map(|speed| format!(", {speed:.1} trials/s")).unwrap_or_default();
    line(
        &mut text,
        &format!(
            "{} states, {} trials, {} completed, {} open{speed}",
            counts.states, counts.trials, counts.completed_trials, counts.open_trials
        ),
    );
    if !glance.best.is_empty() {
        text.push('\n');
        text += &rows(&glance.best, study.spec().ok());
        if (glance.best.len() as i64) < counts.states {
            line(&mut text, &format!("first {} of {} states", glance.best.len(), counts.states));
        }
    }
    if !glance.open.is_empty() {
        text.push('\n');
        let header = ["client", "trial", "state", "lease, s", "changed from the default"];
        let mut leases = table(&header, &[1, 2, 3]);
        for trial in &glance.open {
            let left =
                trial.lease_expire_time.and_then(|end| end.duration_since(now).ok()).unwrap_or_default();
            leases.add_row([
                trial.client_id.clone(),
                trial.number().map_or_else(|| trial.name.clone(), |number| number.to_string()),
                trial.state_id.to_string(),
                left.as_secs().to_string(),
                beside_default(&trial.configuration, study.spec().ok()),
            ]);
        }
        line(&mut text, &leases.trim_fmt());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_not_broken() {
        let words = ["first_shadow=sixteen_coherent"; 5].join(" ");
        let text = wrapped("   1  ", &words);
        assert!(text.lines().all(|line| line.len() <= usize::from(COLUMNS)), "{text}");
        assert_eq!(text.matches("first_shadow=sixteen_coherent").count(), 5);
        assert_eq!(text.lines().count(), 3);
    }
}
