//! The words by which enums stand in filters and tables: one list each, so that they cannot drift apart.

use treewright_core::trial::{Mode, TrialState};

use crate::filter::OutcomeKind;

pub(crate) const STATES: &[(&str, TrialState)] = &[
    ("OPEN", TrialState::Open),
    ("COMPLETED", TrialState::Completed),
    ("ABANDONED", TrialState::Abandoned),
    ("EXPIRED", TrialState::Expired),
];
pub(crate) const MODES: &[(&str, Mode)] = &[
    ("DEFAULT", Mode::Default),
    ("EXPLORE", Mode::Explore),
    ("EXPLOIT", Mode::Exploit),
    ("PINNED", Mode::Pinned),
];
pub(crate) const OUTCOMES: &[(&str, OutcomeKind)] = &[
    ("OK", OutcomeKind::Ok),
    ("INFEASIBLE", OutcomeKind::Infeasible),
    ("ABORTED", OutcomeKind::Aborted),
    ("FAILED", OutcomeKind::Failed),
];

/// The word for a value. The lists above are complete; the contract suite stores every value once.
pub(crate) fn word<T: Copy + PartialEq>(words: &[(&'static str, T)], value: T) -> &'static str {
    let found = words.iter().find(|(_, known)| *known == value);
    found.expect("every value has a word").0
}

/// The value that a word stands for.
pub(crate) fn value<T: Copy>(words: &[(&str, T)], word: &str) -> Option<T> {
    let found = words.iter().find(|(known, _)| *known == word);
    found.map(|(_, value)| *value)
}
