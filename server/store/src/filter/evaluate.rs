//! The meaning of a filter, in memory. Tests compare the translations to SQL with it.

use std::mem::discriminant;

use treewright_core::trial::RawTrial;
use treewright_core::value::Value;
use treewright_core::words::Word as _;

use super::{Field, FieldComparison, Filter, Literal, Operator};

impl Filter {
    /// Whether every comparison holds for `trial`.
    pub fn matches(&self, trial: &RawTrial) -> bool {
        self.comparisons.iter().all(|comparison| comparison.holds(trial))
    }
}

impl FieldComparison {
    fn holds(&self, trial: &RawTrial) -> bool {
        let text = |text: &str| Some(Literal::Text(text.to_owned()));
        let own = match &self.field {
            Field::State => text(trial.state.word()),
            Field::Mode => text(trial.mode().word()),
            Field::Outcome => trial.outcome.as_ref().and_then(|outcome| text(outcome.kind().word())),
            Field::Late => Some(Literal::Boolean(trial.late)),
            Field::Excluded => Some(Literal::Boolean(trial.exclusion.is_some())),
            Field::ClientId => text(&trial.client_id),
            Field::StateId => Some(Literal::Whole(signed(trial.state_id))),
            Field::Number => Some(Literal::Whole(signed(trial.number))),
            Field::Cost => trial.cost.map(Literal::Number),
            Field::Measurement(name) => trial.measurements.get(name).copied().map(Literal::Number),
            Field::Indicator(name) => trial.indicators.get(name).copied().map(Literal::Number),
            Field::Configuration(name) => trial.configuration.get(name).and_then(|own| match own {
                Value::Text(own) => text(own),
                Value::Boolean(own) => Some(Literal::Boolean(*own)),
                number => number.as_number().map(Literal::Number),
            }),
        };
        own.is_some_and(|own| {
            discriminant(&own) == discriminant(&self.literal) && self.operator.holds(&own, &self.literal)
        })
    }
}

impl Operator {
    /// Compares two values of one kind. Text is ordered by its bytes, as SQLite does.
    fn holds(self, left: &Literal, right: &Literal) -> bool {
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
