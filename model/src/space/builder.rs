//! A typed builder of parameter spaces. Calls after a parameter (`default`, `log`, `active_if`) belong to
//! that parameter, and only those for its type compile.

use std::marker::PhantomData;
use std::ops::RangeInclusive;

use crate::space::{Condition, Constraint, ConstraintError, Domain, Parameter, Scale, Space, SpaceError};
use crate::value::Value;

/// The last call named an integer parameter.
#[derive(Debug)]
pub enum IntegerParameter {}
/// The last call named a float parameter.
#[derive(Debug)]
pub enum FloatParameter {}
/// The last call named a boolean parameter.
#[derive(Debug)]
pub enum BooleanParameter {}
/// The last call named a categorical parameter.
#[derive(Debug)]
pub enum CategoricalParameter {}

/// Builds a [`Space`].
///
/// ```
/// let space = treewright_model::space::Space::builder()
///     .integer("max_depth", 9..=64).default(32).log()
///     .integer("min_leaf_size", 1..=32).default(1)
///     .integer("max_leaf_size", 1..=32).default(8)
///     .boolean("compact").default(false)
///     .less_or_equal("min_leaf_size", "max_leaf_size")
///     .build()?;
/// assert_eq!(space.default_configuration().integer("max_depth")?, 32);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct SpaceBuilder<Last = ()> {
    parameters: Vec<Draft>,
    constraints: Vec<Result<Constraint, ConstraintError>>,
    last: PhantomData<Last>,
}

/// A parameter whose default may still be missing.
#[derive(Debug)]
struct Draft {
    name: String,
    domain: Domain,
    default: Option<Value>,
    active_if: Option<Condition>,
    setup: bool,
}

impl Default for SpaceBuilder {
    fn default() -> Self {
        Self::new()
    }
}

impl SpaceBuilder {
    /// A space without parameters.
    pub fn new() -> Self {
        Self { parameters: Vec::new(), constraints: Vec::new(), last: PhantomData }
    }
}

impl<Last> SpaceBuilder<Last> {
    /// A whole number in a range, both ends included.
    pub fn integer(self, name: &str, range: RangeInclusive<i64>) -> SpaceBuilder<IntegerParameter> {
        self.parameter(name, Domain::Integer { min: *range.start(), max: *range.end(), scale: Scale::Linear })
    }

    /// A number in a range, both ends included.
    pub fn float(self, name: &str, range: RangeInclusive<f64>) -> SpaceBuilder<FloatParameter> {
        self.parameter(name, Domain::Float { min: *range.start(), max: *range.end(), scale: Scale::Linear })
    }

    /// `false` or `true`.
    pub fn boolean(self, name: &str) -> SpaceBuilder<BooleanParameter> {
        self.parameter(name, Domain::Boolean)
    }

    /// One of a list of values, which are all integers, all floats or all words.
    pub fn categorical<V: Into<Value>>(
        self,
        name: &str,
        values: impl IntoIterator<Item = V>,
    ) -> SpaceBuilder<CategoricalParameter> {
        self.parameter(name, Domain::Categorical { values: values.into_iter().map(Into::into).collect() })
    }

    /// A parameter given as a value, e.g. from a list. It is checked like any other.
    pub fn with_parameter(mut self, parameter: Parameter) -> SpaceBuilder {
        let Parameter { name, domain, default, active_if, setup } = parameter;
        self.parameters.push(Draft { name, domain, default: Some(default), active_if, setup });
        self.turn()
    }

    /// Every configuration has `lesser <= greater`.
    pub fn less_or_equal(mut self, lesser: &str, greater: &str) -> SpaceBuilder {
        self.constraints.push(Ok(Constraint::order(lesser, greater)));
        self.turn()
    }

    /// Every configuration fulfils an expression, such as `block_x * block_y <= 1024`; [`Constraint`] has the
    /// language.
    pub fn constraint(mut self, expression: &str) -> SpaceBuilder {
        self.constraints.push(Constraint::parse(expression));
        self.turn()
    }

    /// A constraint given as a value, e.g. from another space.
    pub fn with_constraint(mut self, constraint: Constraint) -> SpaceBuilder {
        self.constraints.push(Ok(constraint));
        self.turn()
    }

    /// Checks the whole and finishes it.
    ///
    /// # Errors
    /// [`SpaceError`] with the first parameter or constraint that is not acceptable.
    pub fn build(self) -> Result<Space, SpaceError> {
        let finish = |draft: Draft| match draft.default {
            Some(default) => {
                let Draft { name, domain, active_if, setup, .. } = draft;
                Ok(Parameter { name, domain, default, active_if, setup })
            }
            None => Err(SpaceError::of_parameter(&draft.name, " has no default; give the recommended value")),
        };
        let parameters = self.parameters.into_iter().map(finish).collect::<Result<_, _>>()?;
        Space::new(parameters, self.constraints.into_iter().collect::<Result<_, _>>()?)
    }

    fn parameter<Next>(mut self, name: &str, domain: Domain) -> SpaceBuilder<Next> {
        let name = name.to_owned();
        self.parameters.push(Draft { name, domain, default: None, active_if: None, setup: false });
        self.turn()
    }

    fn turn<Next>(self) -> SpaceBuilder<Next> {
        SpaceBuilder { parameters: self.parameters, constraints: self.constraints, last: PhantomData }
    }

    fn change_last(mut self, change: impl FnOnce(&mut Draft)) -> Self {
        if let Some(last) = self.parameters.last_mut() {
            change(last);
        }
        self
    }
}

macro_rules! of_a_parameter {
    ($marker:ty, $value:ty) => {
        impl SpaceBuilder<$marker> {
            /// The recommended value. Every parameter needs one.
            #[must_use]
            pub fn default(self, value: $value) -> Self {
                self.change_last(|last| last.default = Some(value.into()))
            }

            /// The parameter exists only while an earlier one has one of these values.
            #[must_use]
            pub fn active_if<V: Into<Value>>(
                self,
                parameter: &str,
                any_of: impl IntoIterator<Item = V>,
            ) -> Self {
                let any_of = any_of.into_iter().map(Into::into).collect();
                let condition = Condition { parameter: parameter.to_owned(), any_of };
                self.change_last(|last| last.active_if = Some(condition))
            }

            /// A change of it needs a set-up, such as a build; that of all others only a run. The search
            /// keeps what is set up for a few trials.
            #[must_use]
            pub fn setup(self) -> Self {
                self.change_last(|last| last.setup = true)
            }
        }
    };
}

of_a_parameter!(IntegerParameter, i64);
of_a_parameter!(FloatParameter, f64);
of_a_parameter!(BooleanParameter, bool);
of_a_parameter!(CategoricalParameter, impl Into<Value>);

impl SpaceBuilder<IntegerParameter> {
    /// Only values in steps of this size, from the smallest on: a [`Constraint`]. The values of `16..=256`
    /// with a step of 16 are 16, 32, 48 and so on.
    #[must_use]
    pub fn step(mut self, step: i64) -> Self {
        if let Some(Draft { name, domain: Domain::Integer { min, .. }, .. }) = self.parameters.last() {
            self.constraints.push(Ok(Constraint::step(name, *min, step)));
        }
        self
    }
}

macro_rules! scaled {
    ($marker:ty) => {
        impl SpaceBuilder<$marker> {
            /// Equal ratios are equal steps; the lower bound must be positive.
            #[must_use]
            pub fn log(self) -> Self {
                self.change_last(|last| match &mut last.domain {
                    Domain::Integer { scale, .. } | Domain::Float { scale, .. } => *scale = Scale::Log,
                    Domain::Categorical { .. } | Domain::Boolean => {}
                })
            }
        }
    };
}

scaled!(IntegerParameter);
scaled!(FloatParameter);

#[cfg(test)]
mod tests {
    use super::*;

    fn problem<L: std::fmt::Debug>(builder: SpaceBuilder<L>) -> String {
        builder.build().expect_err("not a space").to_string()
    }

    #[test]
    fn a_list_of_parameters_makes_the_same_space() {
        let written = SpaceBuilder::new().boolean("deep").default(true).integer("depth", 1..=9).default(3);
        let written = written.active_if("deep", [true]).setup().build().expect("a space");
        let part = |given: &[(&str, Value)]| {
            let given = given.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
            written.setup_part(&given).into_keys().collect::<Vec<_>>()
        };
        assert_eq!(part(&[("deep", Value::from(true)), ("depth", Value::from(3i64))]), ["depth"]);
        assert!(part(&[("deep", Value::from(false))]).is_empty(), "it is not active");
        let listed = written
            .parameters()
            .iter()
            .cloned()
            .fold(SpaceBuilder::new(), |builder, one| builder.with_parameter(one));
        assert_eq!(listed.build().expect("a space"), written);
        let alone = SpaceBuilder::new().with_parameter(written.parameters()[1].clone());
        assert!(problem(alone).contains("not listed earlier"));
    }

    #[test]
    fn whole_numbers_have_steps() {
        let space =
            SpaceBuilder::new().integer("block", 8..=72).step(16).default(24).build().expect("a space");
        let all = space.enumerate().expect("they are few");
        let keys = all.iter().map(|one| one.key()).collect::<Vec<_>>();
        assert_eq!(keys, [8, 24, 40, 56, 72].map(|block| format!("block={block}")));
        assert_eq!(space.decode(&[0.3]).key(), "block=24");
        let problem = |step| problem(SpaceBuilder::new().integer("block", 8..=72).step(step).default(20));
        assert!(problem(16).contains("with block = 20; change a default"));
        assert!(problem(0).contains("`(block - 8) % 0 == 0`"));
    }

    #[test]
    fn mistakes_are_named() {
        let new = SpaceBuilder::new;
        assert!(problem(new()).contains("1 to 128"));
        assert!(problem(new().integer("depth", 1..=2)).contains("\"depth\" has no default"));
        assert!(problem(new().integer("depth", 0..=2).default(1).log()).contains("log scale"));
        assert!(problem(new().boolean("x").default(true).active_if("y", [true])).contains("\"y\""));
        let twice = new().integer("low", 1..=9).default(5).integer("high", 1..=9).default(4);
        assert!(problem(twice.less_or_equal("low", "high")).contains("`low <= high`: the defaults"));
    }
}
