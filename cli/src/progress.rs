//! Progress while trials run: a line that is written over on a terminal, a line each elsewhere.

use std::io::{IsTerminal as _, Write as _};

use treewright_client::{CostView, TrialRecord};

use crate::show::figure;

/// Counts trials and keeps the best.
pub(crate) struct Progress {
    most: Option<u32>,
    objective: String,
    done: u32,
    first: Option<f64>,
    best: Option<f64>,
    view: CostView,
}

impl Progress {
    pub(crate) fn new(most: Option<u32>, objective: String, view: CostView) -> Self {
        Self { most, objective, done: 0, first: None, best: None, view }
    }

    /// Another trial is done, with a cost, or with the reason why it has none.
    pub(crate) fn trial(&mut self, trial: &TrialRecord, result: Result<f64, &str>) {
        self.done += 1;
        if let Ok(cost) = result {
            self.first.get_or_insert(cost);
            self.best = Some(self.best.map_or(cost, |best| best.min(cost)));
        }
        let of = self.most.map(|most| format!("/{most}")).unwrap_or_default();
        let value = |cost: f64| self.view.value(cost);
        let result = match result {
            Ok(cost) => format!("{} {}", self.objective, figure(value(cost))),
            Err(reason) => reason.to_owned(),
        };
        let best = self.best.map(|best| format!("  best {}", figure(value(best)))).unwrap_or_default();
        let gain = match (self.first, self.best) {
            (Some(first), Some(best)) if first > 0.0 && self.done > 1 => {
                format!(" ({:+.1} %)", 100.0 * (value(best) / value(first) - 1.0))
            }
            _ => String::new(),
        };
        status(&format!("{}{of}  {result}{best}{gain}  {}", self.done, trial.configuration));
    }
}

/// A line that the next one takes the place of, on a terminal.
pub(crate) fn status(text: &str) {
    let mut err = std::io::stderr().lock();
    // Nobody may be looking.
    let _ = if err.is_terminal() {
        let shown: String = text.chars().take(79).collect();
        write!(err, "\r\x1b[2K{shown}").and_then(|()| err.flush())
    } else {
        writeln!(err, "{text}")
    };
}

/// Ends such a line.
pub(crate) fn status_end() {
    let mut err = std::io::stderr().lock();
    if err.is_terminal() {
        let _ = write!(err, "\r\x1b[2K").and_then(|()| err.flush());
    }
}

/// Something worth knowing.
pub(crate) fn note(text: &str) {
    status_end();
    let _ = writeln!(std::io::stderr(), "treewright: {text}");
}
