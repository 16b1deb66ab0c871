//! The meaning of a filter, in memory. Tests compare the translations to SQL with it.

use treewright_core::trial::RawTrial;
use treewright_core::value::Value;

use super::{FieldComparison, Filter, Literal, Operator};

impl Filter {
    /// Whether every comparison holds for `trial`.
    #[must_use]
    pub fn matches(&self, trial: &RawTrial) -> bool {
        self.comparisons.iter().all(|comparison| comparison.holds(trial))
    }
}

impl FieldComparison {
    fn holds(&self, trial: &RawTrial) -> bool {
        match self {
            Self::State(operator, state) => operator.equality(trial.state == *state),
            Self::Mode(operator, mode) => operator.equality(trial.mode() == *mode),
            Self::Outcome(operator, kind) => {
                trial.outcome.as_ref().is_some_and(|outcome| operator.equality(outcome.kind() == *kind))
            }
            Self::Late(operator, late) => operator.equality(trial.late == *late),
            Self::Excluded(operator, excluded) => operator.equality(trial.exclusion.is_some() == *excluded),
            Self::ClientId(operator, text) => operator.holds(trial.client_id.as_str(), text),
            Self::StateId(operator, id) => operator.holds(&signed(trial.state_id), id),
            Self::Number(operator, number) => operator.holds(&signed(trial.number), number),
            Self::Cost(operator, cost) => trial.cost.is_some_and(|own| operator.holds(&own, cost)),
            Self::Measurement(name, operator, value) => {
                trial.measurements.get(name).is_some_and(|own| operator.holds(own, value))
            }
            Self::Indicator(name, operator, value) => {
                trial.indicators.get(name).is_some_and(|own| operator.holds(own, value))
            }
            Self::Configuration(name, operator, literal) => {
                trial.configuration.get(name).is_some_and(|own| literal_holds(own, *operator, literal))
            }
        }
    }
}

fn literal_holds(own: &Value, operator: Operator, literal: &Literal) -> bool {
    match (own, literal) {
        (Value::Text(own), Literal::Text(text)) => operator.holds(own, text),
        (Value::Boolean(own), Literal::Boolean(boolean)) => operator.equality(own == boolean),
        (Value::Integer(_) | Value::Float(_), Literal::Number(number)) => {
            own.as_number().is_some_and(|own| operator.holds(&own, number))
        }
        _ => false,
    }
}

impl Operator {
    fn equality(self, equal: bool) -> bool {
        assert!(self.is_equality(), "{} needs an order", self.symbol());
        equal == (self == Self::Equal)
    }

    /// Compares two values of one ordered kind. Text is ordered by its bytes, as SQLite does.
    fn holds<T: PartialOrd + ?Sized>(self, left: &T, right: &T) -> bool {
        match self {
            Self::Equal => left == right,
            Self::NotEqual => left != right,
            Self::Less => left < right,
            Self::LessOrEqual => left <= right,
            Self::Greater => left > right,
            Self::GreaterOrEqual => left >= right,
        }
    }
}

/// Numbers rise by one from 1 and never come near the end of the signed range.
fn signed(number: u64) -> i64 {
    debug_assert!(i64::try_from(number).is_ok(), "{number} is compared as another number");
    i64::try_from(number).unwrap_or(i64::MAX)
}
