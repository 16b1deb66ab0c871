//! The query language for trials: `state = COMPLETED AND cost < 12.5`.
//!
//! The contract stands in the comments of `QueryTrialsRequest`. A filter is parsed and checked once into the
//! [`Filter`] below. [`Filter::matches`] evaluates it in memory, and the stores on databases compile it to
//! bound SQL. A property test compares the two.
//!
//! One rule covers all doubtful cases: a comparison with a value that the trial lacks, or of another kind, is
//! false for every operator, as with NULL in SQL.

mod evaluate;
mod names;
mod order;
mod parse;
mod token;

pub use order::{Order, OrderKey};

/// A parsed filter: comparisons that must all hold. The empty filter matches every trial.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filter {
    /// At most [`FILTER_COMPARISONS`](crate::limits::FILTER_COMPARISONS).
    pub(crate) comparisons: Vec<FieldComparison>,
}

impl Filter {
    /// Reads a filter. Blank text matches every trial.
    pub fn parse(text: &str) -> Result<Self, FilterError> {
        parse::filter(text)
    }
}

/// Why a filter or an order cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("at character {position}: {problem}")]
pub struct FilterError {
    /// The place, counted in characters from 1.
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

/// The comparison of two values.
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
    pub fn is_equality(self) -> bool {
        matches!(self, Self::Equal | Self::NotEqual)
    }
}

#[derive(Clone, Debug, PartialEq, PartialOrd)]
pub(crate) enum Literal {
    /// Finite. Compares with integers and floats.
    Number(f64),
    /// Compares with columns of integers.
    Whole(i64),
    Text(String),
    Boolean(bool),
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Field {
    State,
    Mode,
    Outcome,
    Late,
    Excluded,
    ClientId,
    StateId,
    Number,
    Cost,
    Measurement(String),
    Indicator(String),
    Configuration(String),
}

/// One comparison. The parser gives each field a literal of its kind (enums have their words), and kinds
/// without an order only the operators `=` and `!=`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FieldComparison {
    pub(crate) field: Field,
    pub(crate) operator: Operator,
    pub(crate) literal: Literal,
}
