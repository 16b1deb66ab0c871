//! Several states at once: what is best in each, and what happens at the moment.

use std::time::SystemTime;

use treewright_client::Best;

use super::{figure, line, table};
use crate::commands::watch::Glance;

/// By how much the best of a state is below its default, with its 95 % interval; empty where the default was not
/// measured.
fn gain(best: &Best) -> String {
    match best.standing {
        Some(standing) => standing.gain.map(|gain| gain.to_string()).unwrap_or_default(),
        None => {
            let default = best.default_cost.filter(|default| *default > 0.0);
            default
                .map_or_else(String::new, |default| format!("{:.1} %", 100.0 * (1.0 - best.cost / default)))
        }
    }
}

/// The best configuration of each state, each beside its own default.
pub(crate) fn best_of_states(found: &[Best], states: i64) -> String {
    if found.is_empty() {
        return "nothing was measured yet\n".to_owned();
    }
    let mut text = rows(found);
    if (found.len() as i64) < states {
        line(&mut text, &format!("{} of {states} states; see another one with --state NUMBER", found.len()));
    }
    text
}

fn rows(found: &[Best]) -> String {
    let header = ["state", "cost", "below the default", "stands", "runs", "configuration"];
    let mut table = table(&header, &[0, 1, 2, 4]);
    let mut jumps = 0;
    for best in found {
        let cost = best.standing.map_or(best.cost, |standing| standing.cost);
        jumps += best.standing.map_or(0, |standing| standing.disturbances);
        table.add_row([
            best.state_id.to_string(),
            figure(cost),
            gain(best),
            best.standing.map(|standing| standing.in_short().to_owned()).unwrap_or_default(),
            best.measurements.to_string(),
            best.configuration.to_string(),
        ]);
    }
    let mut text = table.trim_fmt() + "\n";
    if jumps > 0 {
        line(&mut text, &format!("the speed of machines jumped {jumps} time(s) while this was measured"));
    }
    text
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
        text += &rows(&glance.best);
        if (glance.best.len() as i64) < counts.states {
            line(&mut text, &format!("the first {} of {} states", glance.best.len(), counts.states));
        }
    }
    if !glance.open.is_empty() {
        text.push('\n');
        let mut leases = table(&["client", "trial", "state", "lease, s", "configuration"], &[1, 2, 3]);
        for trial in &glance.open {
            let left =
                trial.lease_expire_time.and_then(|end| end.duration_since(now).ok()).unwrap_or_default();
            leases.add_row([
                trial.client_id.clone(),
                trial.number().map_or_else(|| trial.name.clone(), |number| number.to_string()),
                trial.state_id.to_string(),
                left.as_secs().to_string(),
                trial.configuration.to_string(),
            ]);
        }
        line(&mut text, &leases.trim_fmt());
    }
    text
}
