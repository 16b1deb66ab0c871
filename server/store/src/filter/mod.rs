//! The language in which trials are asked for: `state = COMPLETED AND cost < 12.5`.
//!
//! The contract stands in the comments of `QueryTrialsRequest`. A filter is parsed once into the
//! [`Filter`] below, which no longer contains anything unchecked. It then means the same thing in two
//! places: [`Filter::matches`] evaluates it in memory, and the stores on databases compile it to bound SQL. A
//! property test holds them against each other.
//!
//! One rule covers everything that could be doubtful: a comparison with a value that the trial does not
//! have, or that is of another kind, is false, whatever the operator. It is what SQL does with NULL.

mod evaluate;
mod names;
mod order;
mod parse;
mod token;

pub use order::{Order, OrderKey};

use treewright_core::trial::{Mode, OutcomeKind, TrialState};

/// A parsed filter: comparisons that must all hold. The empty filter matches every trial.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filter {
    /// At most [`FILTER_COMPARISONS`](crate::limits::FILTER_COMPARISONS).
    pub(crate) comparisons: Vec<FieldComparison>,
}

impl Filter {
    /// Reads a filter. Blank text is the filter that matches everything.
    ///
    /// # Errors
    /// [`FilterError`] with the place and what was expected there.
    pub fn parse(text: &str) -> Result<Self, FilterError> {
        parse::filter(text)
    }
}

/// Why a filter or an order cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("at character {position}: {problem}")]
pub struct FilterError {
    /// Where, counted in characters from 1.
    pub position: usize,
    /// The mistake there, and how to mend it.
    pub problem: String,
}

impl FilterError {
    pub(crate) fn new(position: usize, problem: impl Into<String>) -> Self {
        assert!(position > 0, "characters are counted from 1");
        Self { position, problem: problem.into() }
    }
}

/// How two values are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operator {
    /// `=`
    Equal,
    /// `!=`
    NotEqual,
    /// `<`
    Less,
    /// `<=`
    LessOrEqual,
    /// `>`
    Greater,
    /// `>=`
    GreaterOrEqual,
}

impl Operator {
    /// The operator as it is written, in the filter and in SQL alike (`!=` is common to both).
    #[must_use]
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Equal => "=",
            Self::NotEqual => "!=",
            Self::Less => "<",
            Self::LessOrEqual => "<=",
            Self::Greater => ">",
            Self::GreaterOrEqual => ">=",
        }
    }

    /// Whether the operator needs no order between the values.
    #[must_use]
    pub fn is_equality(self) -> bool {
        matches!(self, Self::Equal | Self::NotEqual)
    }
}

/// A value that a parameter is compared with.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Literal {
    /// Finite. Compares with integers and floats.
    Number(f64),
    Text(String),
    Boolean(bool),
}

/// One comparison. Equality-only kinds carry an operator that is `=` or `!=`; the parser sees to it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum FieldComparison {
    State(Operator, TrialState),
    Mode(Operator, Mode),
    Outcome(Operator, OutcomeKind),
    Late(Operator, bool),
    ClientId(Operator, String),
    StateId(Operator, i64),
    Number(Operator, i64),
    Cost(Operator, f64),
    Measurement(String, Operator, f64),
    Indicator(String, Operator, f64),
    Configuration(String, Operator, Literal),
}
