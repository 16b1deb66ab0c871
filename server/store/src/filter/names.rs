//! The check that a study has the parameters and indicators of a filter.
//!
//! A comparison with an unknown name would match no trial, which looks like an answer. Names of measurements
//! are not checked: clients may report any beside the objective's metrics.

use treewright_core::space::{EarlierSpaces, Space};
use treewright_core::study::StudySpec;

use super::token::{FilterToken, tokens};
use super::{Field, Filter, FilterError};

impl Filter {
    /// Whether there are names to check with [`check_names`](Self::check_names).
    pub fn has_names(&self) -> bool {
        let mut comparisons = self.comparisons.iter();
        comparisons.any(|one| matches!(one.field, Field::Configuration(_) | Field::Indicator(_)))
    }

    /// Refuses parameters and indicators that the study does not have. Those of its earlier spaces find what
    /// ran there. `text` is the filter's source.
    ///
    /// # Errors
    /// [`FilterError`] with the place of the first such name, and the known names.
    pub fn check_names(
        &self,
        text: &str,
        spec: &StudySpec,
        earlier: &EarlierSpaces,
    ) -> Result<(), FilterError> {
        debug_assert_eq!(Self::parse(text).as_ref(), Ok(self), "the filter is of another text");
        let mut parameters: Vec<&str> = Vec::new();
        for parameter in std::iter::once(&spec.space).chain(earlier.spaces()).flat_map(Space::parameters) {
            if !parameters.contains(&parameter.name.as_str()) {
                parameters.push(&parameter.name);
            }
        }
        let indicators: Vec<&str> =
            spec.indicators.indicators().iter().map(|one| one.name.as_str()).collect();
        for comparison in &self.comparisons {
            let (prefix, name, kind, names) = match &comparison.field {
                Field::Configuration(name) => ("config", name, "parameter", &parameters),
                Field::Indicator(name) => ("indicator", name, "indicator", &indicators),
                _ => continue,
            };
            if !names.contains(&name.as_str()) {
                let position = position(text, &format!("{prefix}.{name}"));
                let problem = format!("the study has no {kind} {name:?}; it has {}", listed(names));
                return Err(FilterError::new(position, problem));
            }
        }
        Ok(())
    }
}

/// The place of a field in a filter that was parsed, counted in characters from 1. In a longer word and in
/// text it is no word of its own.
fn position(text: &str, field: &str) -> usize {
    let is_field = |token: &FilterToken| matches!(token, FilterToken::Word(word) if word == field);
    let all = tokens(text).unwrap_or_default();
    all.iter().find(|placed| is_field(&placed.token)).map_or(1, |placed| placed.position)
}

fn listed(names: &[&str]) -> String {
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

#[cfg(test)]
mod tests {
    use treewright_core::policy::Policy;
    use treewright_core::space::Scale;

    use super::*;

    fn spec() -> StudySpec {
        let space = Space::builder().integer("quality", 0..=9).default(4).build().expect("valid");
        let spec = StudySpec::builder(space).indicator("x", 0.0..=1.0, Scale::Linear);
        spec.minimise("render_ms", 1.0).build().expect("valid").with_policy(Policy::default())
    }

    fn check(text: &str) -> Result<(), FilterError> {
        let before = Space::builder().boolean("robust").default(true).build().expect("valid");
        let spec = spec();
        let earlier = EarlierSpaces::default().changed(&before, &spec.space, 9, Default::default());
        let earlier = earlier.expect("a change");
        Filter::parse(text).expect("a filter").check_names(text, &spec, &earlier)
    }

    #[test]
    fn names_that_a_study_does_not_have_are_pointed_at() {
        check("").expect("nothing is named");
        check("config.robust = true").expect("it had it");
        check("config.quality = 2 AND indicator.x < 0.5 AND measurement.anything > 1").expect("it has them");
        for (text, position, problem) in [
            ("config.qualty = 2", 1, "no parameter \"qualty\"; it has quality"),
            ("client_id = \"config.q\" AND config.q = 2", 28, "no parameter \"q\""),
            (r#"client_id = "a\" config.q" AND config.q = 2"#, 32, "no parameter \"q\""),
            ("indicator.x < 1 AND indicator.xx < 1", 21, "no indicator \"xx\"; it has x"),
        ] {
            let error = check(text).expect_err(text);
            assert!(error.problem.contains(problem), "{error}");
            assert_eq!(error.position, position, "{error}");
        }
        assert!(!Filter::parse("cost < 1").expect("a filter").has_names());
    }
}
