//! Studies as data: reads a specification from a file in TOML or JSON, and writes one.
//!
//! The file is flat and made for people: a parameter has a `type` and its bounds beside its name, whole
//! numbers are taken for float parameters, and a missing entry takes the daemon's default. The output of
//! `study show --format toml` creates an equal study when it is read again. `schema` describes the file for
//! editors.

pub(crate) mod find;
mod inline;
mod policy;
mod schema;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use treewright_client::{
    Condition, Constraint, Domain, Parameter, Scale, Space, StudyRecord, StudySpec, Value,
};

use crate::failure::{Failure, Result};
use policy::policy_entries;

pub(crate) use inline::{FidelityEntry, LimitEntry};
pub(crate) use schema::schema;

/// A study: what can be tuned, what describes the input, what is minimised, and how the service decides.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct StudyFile {
    /// The name by which commands and programs call the study: 1 to 64 characters of `a-z`, `0-9`, `-` and
    /// `_`, beginning with a letter. Without it the file's name is taken.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) id: Option<String>,
    /// A line for people, at most 200 characters.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) display_name: Option<String>,
    /// A text for people of several lines, at most 4096 bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) note: Option<String>,
    /// Words by which people group studies, at most 16, each of 1 to 32 letters, digits, `_`, `-` and `.`.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub(crate) tags: BTreeSet<String>,
    /// Two inputs are one state when every normalised indicator differs by at most this much, 0 to 1. Default
    /// 0.01.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) state_tolerance: Option<f64>,
    /// Seed of every random decision. Default 0. From 2^63 on, which TOML does not reach, it is written as
    /// text.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) seed: Option<Seed>,
    /// Further metrics of reports that explain costs, such as the processor time beside the wall time; at
    /// most 8. They cost nothing themselves.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) auxiliary: Vec<String>,
    /// Limits of measurements, such as a memory of at most 2000 MB; at most 16. A run beyond one is
    /// infeasible.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) limits: Vec<LimitEntry>,
    /// Frames of a trial, 1 to 64, for costs that rise or fall while a configuration is in use. Default 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) episode_frames: Option<u32>,
    /// Cheaper levels at which a trial can run, such as fewer samples, the cheapest first; at most 4.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) fidelities: Vec<FidelityEntry>,
    /// The tuned parameters, 1 to 128. A condition may only name a parameter that stands earlier.
    pub(crate) parameters: Vec<ParameterEntry>,
    /// Conditions that every configuration fulfils, such as `block_x * block_y <= 1024`; at most 64.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) constraints: Vec<ConstraintEntry>,
    /// The numbers that describe an input. Without any the study has one state.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) indicators: Vec<IndicatorEntry>,
    /// The minimised cost: the sum of weight times metric.
    pub(crate) objective: Vec<TermEntry>,
    /// How the service decides. What is left out takes the daemon's default.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(schema_with = "schema::policy")]
    pub(crate) policy: BTreeMap<String, PolicyEntry>,
}

/// A seed: a number, or a number as text.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub(crate) enum Seed {
    /// As a number.
    Number(u64),
    /// In decimal digits.
    Text(String),
}

impl From<u64> for Seed {
    fn from(seed: u64) -> Self {
        if i64::try_from(seed).is_ok() { Self::Number(seed) } else { Self::Text(seed.to_string()) }
    }
}

impl Seed {
    fn number(&self) -> Result<u64> {
        match self {
            Self::Number(number) => Ok(*number),
            Self::Text(text) => text
                .parse()
                .map_err(|_| Failure::Usage(format!("seed: {text:?} is no whole number below 2^64"))),
        }
    }
}

/// A tunable.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ParameterEntry {
    /// 1 to 64 letters and digits of any script, `_`, `-` and `.`, beginning with a letter or `_`.
    pub(crate) name: String,
    /// The kind of its values.
    #[serde(rename = "type")]
    kind: Kind,
    /// The smallest value, of `integer` and `float`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    min: Option<Number>,
    /// The largest value, of `integer` and `float`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    max: Option<Number>,
    /// `log` makes equal ratios equal steps; `min` must then be above 0.
    #[serde(default, skip_serializing_if = "is_linear")]
    #[schemars(schema_with = "schema::scale")]
    scale: Scale,
    /// Only values that are so far apart, from `min` on, of `integer`. It becomes a constraint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    step: Option<i64>,
    /// The choices of `categorical`: 1 to 64, all numbers or all words.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    values: Vec<Plain>,
    /// The value of today: the baseline of all gains.
    default: Plain,
    /// The parameter exists only while this holds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    active_if: Option<ConditionEntry>,
    /// A change of it needs a set-up, such as a build; that of all others only a run.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) setup: bool,
}

/// The kinds of parameters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Kind {
    /// Whole numbers.
    Integer,
    /// Numbers.
    Float,
    /// One of a list.
    Categorical,
    /// `false` or `true`.
    Boolean,
}

fn is_linear(scale: &Scale) -> bool {
    *scale == Scale::Linear
}

/// A number as people write it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
enum Number {
    Integer(i64),
    Float(f64),
}

impl Number {
    fn float(self) -> f64 {
        match self {
            Self::Integer(integer) => integer as f64,
            Self::Float(float) => float,
        }
    }
}

/// A value as people write it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub(crate) enum Plain {
    Boolean(bool),
    Integer(i64),
    Float(f64),
    Text(String),
}

impl From<&Value> for Plain {
    fn from(value: &Value) -> Self {
        match value {
            Value::Integer(integer) => Self::Integer(*integer),
            Value::Float(float) => Self::Float(*float),
            Value::Text(text) => Self::Text(text.clone()),
            Value::Boolean(boolean) => Self::Boolean(*boolean),
        }
    }
}

impl Plain {
    /// As a value; whole numbers as floats where those are meant.
    pub(crate) fn value(&self, floats: bool) -> Value {
        match self {
            Self::Integer(integer) if floats => Value::Float(*integer as f64),
            Self::Integer(integer) => Value::Integer(*integer),
            Self::Float(float) => Value::Float(*float),
            Self::Text(text) => Value::Text(text.clone()),
            Self::Boolean(boolean) => Value::Boolean(*boolean),
        }
    }
}

/// Holds while the named parameter is active and has one of the values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct ConditionEntry {
    /// A parameter that stands earlier.
    parameter: String,
    /// Values of it.
    any_of: Vec<Plain>,
}

/// A condition that every configuration fulfils while all parameters that it names are active.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, deny_unknown_fields)]
pub(crate) enum ConstraintEntry {
    /// An expression: `+ - * / %`, comparisons, `and`, `or`, `not`, `min`, `max`, `abs`.
    Expression(String),
    /// `lesser <= greater`, between two numeric parameters.
    Order {
        /// The parameter that must not be greater.
        lesser: String,
        /// The parameter that must not be less.
        greater: String,
    },
}

/// One number that describes the input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct IndicatorEntry {
    /// 1 to 64 characters of `a-z`, `0-9` and `_`, beginning with a letter.
    name: String,
    /// Mapped to 0. Values outside are accepted.
    min: Number,
    /// Mapped to 1.
    max: Number,
    /// `log` maps log(1 + value - min).
    #[serde(default, skip_serializing_if = "is_linear")]
    #[schemars(schema_with = "schema::scale")]
    scale: Scale,
}

/// A weighted metric.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct TermEntry {
    /// Name of a measurement.
    pub(crate) metric: String,
    /// Above 0. Default 1.
    #[serde(default = "one")]
    pub(crate) weight: f64,
    /// Whether it is to be large, such as a rate: it then counts by its reciprocal.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) maximise: bool,
}

fn one() -> f64 {
    1.0
}

/// The key in a policy that names a preset.
const PRESET: &str = "preset";

/// The value of a policy's field.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub(crate) enum PolicyEntry {
    /// A number, switch or word.
    Value(Plain),
    /// A configuration, of `pinned`.
    Configuration(BTreeMap<String, Plain>),
}

/// The two languages of study files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Language {
    /// For people.
    Toml,
    /// For programs.
    Json,
}

impl StudyFile {
    /// Reads a file; `-` is standard input.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let text = crate::files::read_text(path)?;
        let is_json = path.extension().is_some_and(|extension| extension == "json")
            || text.trim_start().starts_with('{');
        Self::parse(&text, if is_json { Language::Json } else { Language::Toml })
            .map_err(|problem| Failure::file(path, problem))
    }

    /// Reads a text. The error names line and column.
    pub(crate) fn parse(text: &str, language: Language) -> Result<Self, String> {
        match language {
            Language::Toml => toml::from_str(text).map_err(|error| error.to_string().trim_end().to_owned()),
            Language::Json => serde_json::from_str(text).map_err(|error| error.to_string()),
        }
    }

    /// As text that [`StudyFile::parse`] reads.
    pub(crate) fn write(&self, language: Language) -> Result<String> {
        match language {
            Language::Toml => {
                toml::to_string(self).map_err(|error| Failure::Data(format!("as TOML: {error}")))
            }
            Language::Json => Ok(serde_json::to_string_pretty(self)? + "\n"),
        }
    }

    /// The specification that the file describes.
    pub(crate) fn spec(&self) -> Result<StudySpec> {
        let parameters = self.parameters.iter().map(|entry| entry.parameter(&self.parameters));
        let mut space = Space::builder();
        for parameter in parameters {
            space = space.with_parameter(parameter.map_err(Failure::Usage)?);
        }
        for entry in &self.constraints {
            space = match entry {
                ConstraintEntry::Expression(text) => space.constraint(text),
                ConstraintEntry::Order { lesser, greater } => space.less_or_equal(lesser, greater),
            };
        }
        for entry in &self.parameters {
            space = match (entry.step, entry.min) {
                (Some(step), Some(Number::Integer(min))) => {
                    space.with_constraint(Constraint::step(&entry.name, min, step))
                }
                _ => space,
            };
        }
        let mut builder = StudySpec::builder(space.build()?)
            .display_name(self.display_name.clone().unwrap_or_default())
            .note(self.note.clone().unwrap_or_default())
            .tags(&self.tags)
            .seed(self.seed.as_ref().map_or(Ok(0), Seed::number)?)
            .episode_frames(self.episode_frames.unwrap_or(1))
            .policy(self.policy_settings()?);
        if let Some(tolerance) = self.state_tolerance {
            builder = builder.state_tolerance(tolerance);
        }
        for entry in &self.indicators {
            builder = builder.indicator(&entry.name, entry.min.float()..=entry.max.float(), entry.scale);
        }
        for term in &self.objective {
            builder = match term.maximise {
                true => builder.maximise(&term.metric, term.weight),
                false => builder.minimise(&term.metric, term.weight),
            };
        }
        for metric in &self.auxiliary {
            builder = builder.auxiliary(metric);
        }
        for limit in &self.limits {
            builder = builder.limit(&limit.metric, limit.at_least, limit.at_most);
        }
        for level in &self.fidelities {
            builder = builder.fidelity(&level.name, level.cost);
        }
        builder.build().map_err(|error| Failure::Usage(error.to_string()))
    }

    /// The file that describes a stored study.
    pub(crate) fn of(study: &StudyRecord) -> Result<Self> {
        let spec = study.spec()?;
        let mut file = Self::of_spec(spec);
        file.id = Some(study.id().to_owned());
        file.policy = policy_entries(&study.policy)?;
        Ok(file)
    }

    fn of_spec(spec: &StudySpec) -> Self {
        let indicators = spec.indicators.indicators().iter().map(|indicator| IndicatorEntry {
            name: indicator.name.clone(),
            min: Number::Float(indicator.min),
            max: Number::Float(indicator.max),
            scale: indicator.scale,
        });
        let terms = spec.objective.terms().iter();
        Self {
            id: None,
            display_name: Some(spec.display_name.clone()).filter(|name| !name.is_empty()),
            note: Some(spec.note.clone()).filter(|note| !note.is_empty()),
            tags: spec.tags.clone(),
            state_tolerance: Some(spec.state_tolerance),
            seed: Some(spec.seed.into()),
            auxiliary: spec.objective.auxiliary().to_vec(),
            limits: spec.objective.limits().iter().map(LimitEntry::of).collect(),
            episode_frames: Some(spec.objective.episode_frames()).filter(|frames| *frames > 1),
            fidelities: spec.objective.fidelities().iter().map(FidelityEntry::of).collect(),
            parameters: spec.space.parameters().iter().map(ParameterEntry::of).collect(),
            constraints: spec
                .space
                .constraints()
                .iter()
                .map(|one| ConstraintEntry::Expression(one.to_string()))
                .collect(),
            indicators: indicators.collect(),
            objective: terms
                .map(|term| TermEntry {
                    metric: term.metric.clone(),
                    weight: term.weight,
                    maximise: spec.objective.maximised().contains(&term.metric),
                })
                .collect(),
            policy: BTreeMap::new(),
        }
    }
}

impl ParameterEntry {
    fn of(parameter: &Parameter) -> Self {
        let linear = Scale::Linear;
        let (kind, min, max, scale, values) = match &parameter.domain {
            Domain::Integer { min, max, scale } => {
                (Kind::Integer, Some(Number::Integer(*min)), Some(Number::Integer(*max)), *scale, Vec::new())
            }
            Domain::Float { min, max, scale } => {
                (Kind::Float, Some(Number::Float(*min)), Some(Number::Float(*max)), *scale, Vec::new())
            }
            Domain::Categorical { values } => {
                (Kind::Categorical, None, None, linear, values.iter().map(Plain::from).collect())
            }
            Domain::Boolean => (Kind::Boolean, None, None, linear, Vec::new()),
        };
        let active_if = parameter.active_if.as_ref().map(|condition| ConditionEntry {
            parameter: condition.parameter.clone(),
            any_of: condition.any_of.iter().map(Plain::from).collect(),
        });
        let (name, default) = (parameter.name.clone(), Plain::from(&parameter.default));
        let (step, setup) = (None, parameter.setup);
        Self { name, kind, min, max, step, scale, values, default, active_if, setup }
    }

    /// Whether its values are floats, so that whole numbers stand for floats.
    fn is_float(&self) -> bool {
        let some_float = || self.values.iter().any(|value| matches!(value, Plain::Float(_)));
        self.kind == Kind::Float || (self.kind == Kind::Categorical && some_float())
    }

    fn parameter(&self, all: &[Self]) -> Result<Parameter, String> {
        let floats = self.is_float();
        let condition = |condition: &ConditionEntry| {
            let other = all.iter().find(|other| other.name == condition.parameter);
            let floats = other.is_some_and(Self::is_float);
            Condition {
                parameter: condition.parameter.clone(),
                any_of: condition.any_of.iter().map(|value| value.value(floats)).collect(),
            }
        };
        Ok(Parameter {
            name: self.name.clone(),
            domain: self.domain(floats)?,
            default: self.default.value(floats),
            active_if: self.active_if.as_ref().map(condition),
            setup: self.setup,
        })
    }

    fn domain(&self, floats: bool) -> Result<Domain, String> {
        let name = &self.name;
        let bounds = || match (self.min, self.max) {
            (Some(min), Some(max)) => Ok((min, max)),
            _ => Err(format!("parameter {name}: a number needs `min` and `max`")),
        };
        let whole = |number: Number| match number {
            Number::Integer(integer) => Ok(integer),
            Number::Float(float) => {
                Err(format!("parameter {name}: {float} is no whole number; write type = \"float\""))
            }
        };
        let is_numeric = matches!(self.kind, Kind::Integer | Kind::Float);
        if !is_numeric && (self.min.is_some() || self.max.is_some() || !is_linear(&self.scale)) {
            return Err(format!("parameter {name}: only numbers have `min`, `max` and `scale`"));
        }
        if self.kind != Kind::Integer && self.step.is_some() {
            return Err(format!("parameter {name}: only a whole number has a `step`"));
        }
        if self.kind != Kind::Categorical && !self.values.is_empty() {
            return Err(format!("parameter {name}: only a categorical one has `values`"));
        }
        let scale = self.scale;
        Ok(match self.kind {
            Kind::Integer => {
                let (min, max) = bounds()?;
                Domain::Integer { min: whole(min)?, max: whole(max)?, scale }
            }
            Kind::Float => {
                let (min, max) = bounds()?;
                Domain::Float { min: min.float(), max: max.float(), scale }
            }
            Kind::Categorical => {
                Domain::Categorical { values: self.values.iter().map(|value| value.value(floats)).collect() }
            }
            Kind::Boolean => Domain::Boolean,
        })
    }
}

#[cfg(test)]
mod tests;
