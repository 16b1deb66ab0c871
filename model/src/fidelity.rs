//! Fidelities: cheaper levels at which a configuration can be measured, such as fewer samples or a shorter
//! input. What is measured at one is evidence for what is worth a full measurement, and never a result.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use crate::limits::{FIDELITIES_MAX, NAME_CHARACTERS_MAX};

/// A level below the full one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fidelity {
    /// Its name, 1 to 64 of `A-Z`, `a-z`, `0-9`, `_`, `-` and `.`: a word, or a number for the program's use.
    pub name: String,
    /// The cost of a trial at this level, as a share of a full one; above 0, below 1.
    pub cost: f64,
}

impl Fidelity {
    /// The word for the full level, which no other level has for a name.
    pub const FULL: &str = "full";
}

/// The first problem of a list of levels, cheapest first, in words.
pub(crate) fn problem(fidelities: &[Fidelity]) -> Option<String> {
    if fidelities.len() > FIDELITIES_MAX {
        return Some(format!("there are {}; give at most {FIDELITIES_MAX}", fidelities.len()));
    }
    let (mut seen, mut before) = (BTreeSet::new(), 0.0);
    for Fidelity { name, cost } in fidelities {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
        if name.is_empty() || name.len() > NAME_CHARACTERS_MAX || !name.chars().all(is_plain) {
            return Some(format!("{name:?} is not a name; use 1 to 64 of A-Z, a-z, 0-9, _, - and ."));
        }
        if name == Fidelity::FULL || !seen.insert(name) {
            return Some(format!("{name:?} is taken; give each level, but for the full one, its own name"));
        }
        if !(*cost > before && *cost < 1.0) {
            return Some(format!(
                "{name:?} costs {cost}; give the cheapest first, each a share of a full trial above that before it and \
                 below 1"
            ));
        }
        before = *cost;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_few_named_and_rise() {
        let levels = |given: &[(&str, f64)]| -> Vec<Fidelity> {
            given.iter().map(|&(name, cost)| Fidelity { name: name.to_owned(), cost }).collect()
        };
        assert_eq!(problem(&[]), None);
        assert_eq!(problem(&levels(&[("16", 0.1), ("half-size", 0.5)])), None);
        let five = vec![("a", 0.1), ("b", 0.2), ("c", 0.3), ("d", 0.4), ("e", 0.5)];
        for (wrong, word) in [
            (vec![("", 0.1)], "not a name"),
            (vec![("a b", 0.1)], "not a name"),
            (vec![("full", 0.1)], "taken"),
            (vec![("a", 0.1), ("a", 0.2)], "taken"),
            (vec![("a", 0.2), ("b", 0.2)], "cheapest first"),
            (vec![("a", 0.0)], "above"),
            (vec![("a", 1.0)], "below 1"),
            (vec![("a", f64::NAN)], "share"),
            (five, "at most 4"),
        ] {
            let said = problem(&levels(&wrong)).unwrap_or_default();
            assert!(said.contains(word), "{wrong:?}: {said:?}");
        }
    }
}
