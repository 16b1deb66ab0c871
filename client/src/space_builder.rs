//! A typed builder of parameter spaces. What follows a parameter (`default`, `log`, `active_if`)
//! belongs to that parameter, and only what makes sense for its type compiles.

use std::marker::PhantomData;
use std::ops::RangeInclusive;

use crate::numbers::check_name;
use crate::{ClientError, Condition, Constraint, Domain, Parameter, Scale, Space, Value, limits};

/// The last thing named was an integer parameter.
#[derive(Debug)]
pub enum IntegerParameter {}
/// The last thing named was a float parameter.
#[derive(Debug)]
pub enum FloatParameter {}
/// The last thing named was a boolean parameter.
#[derive(Debug)]
pub enum BooleanParameter {}
/// The last thing named was a categorical parameter.
#[derive(Debug)]
pub enum CategoricalParameter {}

/// Builds a [`Space`].
///
/// ```
/// let space = treewright_client::Space::builder()
///     .integer("max_depth", 9..=64).default(32).log()
///     .integer("min_leaf_size", 1..=32).default(1)
///     .integer("max_leaf_size", 1..=32).default(8)
///     .boolean("compact").default(false)
///     .less_or_equal("min_leaf_size", "max_leaf_size")
///     .build()?;
/// assert_eq!(space.default_configuration().integer("max_depth")?, 32);
/// # Ok::<(), treewright_client::ClientError>(())
/// ```
#[derive(Debug)]
pub struct SpaceBuilder<Last = ()> {
    parameters: Vec<Draft>,
    constraints: Vec<Constraint>,
    last: PhantomData<Last>,
}

/// A parameter whose default may still be missing.
#[derive(Debug)]
struct Draft {
    name: String,
    domain: Domain,
    default: Option<Value>,
    active_if: Option<Condition>,
}

impl Default for SpaceBuilder {
    fn default() -> Self {
        Self::new()
    }
}

impl SpaceBuilder {
    /// A space without parameters.
    #[must_use]
    pub fn new() -> Self {
        Self { parameters: Vec::new(), constraints: Vec::new(), last: PhantomData }
    }
}

impl<Last> SpaceBuilder<Last> {
    /// A whole number in a range, both ends included.
    #[must_use]
    pub fn integer(self, name: &str, range: RangeInclusive<i64>) -> SpaceBuilder<IntegerParameter> {
        self.parameter(name, Domain::Integer { min: *range.start(), max: *range.end(), scale: Scale::Linear })
    }

    /// A number in a range, both ends included.
    #[must_use]
    pub fn float(self, name: &str, range: RangeInclusive<f64>) -> SpaceBuilder<FloatParameter> {
        self.parameter(name, Domain::Float { min: *range.start(), max: *range.end(), scale: Scale::Linear })
    }

    /// `false` or `true`.
    #[must_use]
    pub fn boolean(self, name: &str) -> SpaceBuilder<BooleanParameter> {
        self.parameter(name, Domain::Boolean)
    }

    /// One of a list of values, which are all integers, all floats or all words.
    #[must_use]
    pub fn categorical<V: Into<Value>>(
        self,
        name: &str,
        values: impl IntoIterator<Item = V>,
    ) -> SpaceBuilder<CategoricalParameter> {
        self.parameter(name, Domain::Categorical { values: values.into_iter().map(Into::into).collect() })
    }

    /// A parameter that is there as a value, e.g. one of a list. It is checked like those that are written out.
    #[must_use]
    pub fn with_parameter(mut self, parameter: Parameter) -> SpaceBuilder {
        let Parameter { name, domain, default, active_if } = parameter;
        self.parameters.push(Draft { name, domain, default: Some(default), active_if });
        self.turn()
    }

    /// Every configuration has `lesser <= greater`.
    #[must_use]
    pub fn less_or_equal(mut self, lesser: &str, greater: &str) -> SpaceBuilder {
        self.constraints.push(Constraint { lesser: lesser.to_owned(), greater: greater.to_owned() });
        self.turn()
    }

    /// Checks the whole and finishes it.
    ///
    /// Errors: [`ClientError::Invalid`] names the first parameter or constraint that the service would refuse.
    pub fn build(self) -> Result<Space, ClientError> {
        if self.parameters.is_empty() || self.parameters.len() > limits::PARAMETERS {
            let problem =
                format!("{} parameters; there must be 1 to {}", self.parameters.len(), limits::PARAMETERS);
            return Err(ClientError::invalid("space", problem));
        }
        if self.constraints.len() > limits::CONSTRAINTS {
            let problem =
                format!("{} constraints; the limit is {}", self.constraints.len(), limits::CONSTRAINTS);
            return Err(ClientError::invalid("space", problem));
        }
        let mut parameters: Vec<Parameter> = Vec::with_capacity(self.parameters.len());
        for draft in self.parameters {
            let parameter = draft.finish(&parameters)?;
            parameters.push(parameter);
        }
        let space = Space { parameters, constraints: self.constraints };
        check_constraints(&space)?;
        Ok(space)
    }

    fn parameter<Next>(mut self, name: &str, domain: Domain) -> SpaceBuilder<Next> {
        self.parameters.push(Draft { name: name.to_owned(), domain, default: None, active_if: None });
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
        }
    };
}

of_a_parameter!(IntegerParameter, i64);
of_a_parameter!(FloatParameter, f64);
of_a_parameter!(BooleanParameter, bool);
of_a_parameter!(CategoricalParameter, impl Into<Value>);

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

impl Draft {
    fn finish(self, earlier: &[Parameter]) -> Result<Parameter, ClientError> {
        let what = format!("parameter `{}`", self.name);
        let invalid = |problem: String| Err(ClientError::invalid(what.clone(), problem));
        check_name(&what, &self.name)?;
        if earlier.iter().any(|other| other.name == self.name) {
            return invalid("the name is taken by an earlier parameter".into());
        }
        if let Some(problem) = self.domain.problem() {
            return invalid(problem);
        }
        let Some(default) = self.default else {
            return invalid("no default; give the recommended value with `.default(…)`".into());
        };
        if !self.domain.contains(&default) {
            return invalid(format!("the default {default} lies outside its domain"));
        }
        if let Some(condition) = &self.active_if {
            let Some(other) = earlier.iter().find(|other| other.name == condition.parameter) else {
                return invalid(format!(
                    "it depends on `{}`, which is not an earlier parameter",
                    condition.parameter
                ));
            };
            if condition.any_of.is_empty() {
                return invalid(format!(
                    "it depends on `{}` having one of no values; name at least one",
                    other.name
                ));
            }
            if let Some(value) = condition.any_of.iter().find(|value| !other.domain.contains(value)) {
                return invalid(format!("it depends on `{}` being {value}, which that never is", other.name));
            }
        }
        Ok(Parameter { name: self.name, domain: self.domain, default, active_if: self.active_if })
    }
}

impl Domain {
    /// Whether a value lies in the domain.
    #[must_use]
    pub fn contains(&self, value: &Value) -> bool {
        match (self, value) {
            (Self::Integer { min, max, .. }, Value::Integer(value)) => (min..=max).contains(&value),
            (Self::Float { min, max, .. }, Value::Float(value)) => (min..=max).contains(&value),
            (Self::Categorical { values }, value) => values.contains(value),
            (Self::Boolean, Value::Boolean(_)) => true,
            _ => false,
        }
    }

    fn problem(&self) -> Option<String> {
        match self {
            Self::Integer { min, max, scale } => {
                let bound = limits::INTEGER_MAGNITUDE;
                if min > max {
                    Some(format!("the range {min}..={max} is empty"))
                } else if *min < -bound || *max > bound {
                    Some(format!("the range {min}..={max} goes beyond -2^53..=2^53"))
                } else {
                    (*scale == Scale::Log && *min <= 0)
                        .then(|| format!("a log scale cannot begin at {min}; begin above 0"))
                }
            }
            Self::Float { min, max, scale } => {
                if !(min.is_finite() && max.is_finite()) {
                    Some(format!("the range {min}..={max} is not finite"))
                } else if min > max {
                    Some(format!("the range {min}..={max} is empty"))
                } else {
                    (*scale == Scale::Log && *min <= 0.0)
                        .then(|| format!("a log scale cannot begin at {min}; begin above 0"))
                }
            }
            Self::Categorical { values } => categorical_problem(values),
            Self::Boolean => None,
        }
    }
}

fn categorical_problem(values: &[Value]) -> Option<String> {
    if values.is_empty() || values.len() > limits::CATEGORICAL_VALUES {
        return Some(format!("{} values; there must be 1 to {}", values.len(), limits::CATEGORICAL_VALUES));
    }
    for (index, value) in values.iter().enumerate() {
        if matches!(value, Value::Boolean(_)) {
            return Some("a choice between true and false is `.boolean(…)`".into());
        }
        if value.kind() != values[0].kind() {
            return Some(format!(
                "its values are of different kinds: {} and {}",
                values[0].kind(),
                value.kind()
            ));
        }
        if values[..index].contains(value) {
            return Some(format!("the value {value} is listed twice"));
        }
    }
    None
}

fn check_constraints(space: &Space) -> Result<(), ClientError> {
    for constraint @ Constraint { lesser, greater } in &space.constraints {
        let what = format!("constraint {constraint}");
        for name in [lesser, greater] {
            let numeric = space.parameters.iter().any(|parameter| {
                parameter.name == *name
                    && matches!(parameter.domain, Domain::Integer { .. } | Domain::Float { .. })
            });
            if !numeric {
                return Err(ClientError::invalid(
                    what,
                    format!("`{name}` is not a numeric parameter of this space"),
                ));
            }
        }
        if lesser == greater {
            return Err(ClientError::invalid(what, "it compares a parameter with itself"));
        }
    }
    match space.broken_constraint(&space.default_configuration()) {
        Some((broken, problem)) => {
            Err(ClientError::invalid(format!("constraint {broken}"), format!("with the defaults {problem}")))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem<L>(builder: SpaceBuilder<L>) -> String {
        builder.build().unwrap_err().to_string()
    }

    #[test]
    fn a_list_of_parameters_makes_the_same_space() {
        let written = SpaceBuilder::new()
            .boolean("deep")
            .default(true)
            .integer("depth", 1..=9)
            .default(3)
            .active_if("deep", [true])
            .build()
            .unwrap();
        let listed = written
            .parameters()
            .iter()
            .cloned()
            .fold(SpaceBuilder::new(), |builder, one| builder.with_parameter(one));
        assert_eq!(listed.build().unwrap(), written);
        let alone = SpaceBuilder::new().with_parameter(written.parameters()[1].clone());
        assert!(problem(alone).contains("not an earlier parameter"));
    }

    #[test]
    fn mistakes_are_named() {
        let new = SpaceBuilder::new;
        assert!(problem(new()).contains("1 to 128"));
        assert!(problem(new().integer("Depth", 1..=2).default(1)).contains("Depth"));
        assert!(problem(new().integer("depth", 1..=2)).contains("no default"));
        assert!(problem(new().integer("depth", 1..=2).default(3)).contains("default 3"));
        assert!(problem(new().integer("depth", 0..=2).default(1).log()).contains("log scale"));
        assert!(problem(new().float("cost", 0.0..=f64::NAN).default(0.0)).contains("finite"));
        assert!(problem(new().categorical("split", ["a", "a"]).default("a")).contains("twice"));
        assert!(problem(new().boolean("x").default(true).boolean("x").default(true)).contains("taken"));
        assert!(problem(new().boolean("x").default(true).active_if("y", [true])).contains("`y`"));
        let twice = new().integer("low", 1..=9).default(5).integer("high", 1..=9).default(4);
        assert!(problem(twice.less_or_equal("low", "high")).contains("5 > 4"));
        assert!(problem(new().boolean("x").default(true).less_or_equal("x", "y")).contains("numeric"));
    }
}
