//! Wire to domain. What the types of the domain check themselves is left to them.

use std::collections::BTreeMap;

use treewright_core::configuration::RawConfiguration;
use treewright_core::indicator::{Indicator, IndicatorSchema};
use treewright_core::objective::{Objective, ObjectiveTerm};
use treewright_core::session::SessionPolicy;
use treewright_core::space::{Condition, Constraint, Domain, Parameter, Scale, Space};
use treewright_core::study::{STATE_TOLERANCE_DEFAULT, StudySpec};
use treewright_core::trial::{Fingerprint, Outcome};
use treewright_core::tuner::Ask;
use treewright_core::value::Value;
use treewright_proto::v1;

use super::names::{self, TrialName};
use super::policy::policy;
use crate::error::Error;

/// A result as a client tells it.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Of which trial.
    pub trial: TrialName,
    /// The raw measurements.
    pub measurements: BTreeMap<String, f64>,
    /// How it ended.
    pub outcome: Outcome,
}

/// A question for the next trial.
#[derive(Clone, Debug, PartialEq)]
pub struct Suggest {
    /// The study's id.
    pub study: String,
    /// Who asks, and where.
    pub ask: Ask,
    /// What the client wants to measure, if it does not leave that to the service.
    pub wanted: Option<RawConfiguration>,
}

/// Reads a specification.
///
/// # Errors
/// [`Error::Invalid`] with the field.
pub fn study(study: v1::Study) -> Result<StudySpec, Error> {
    let space = space(study.space.ok_or_else(|| required("study.space"))?)?;
    let objective = study
        .objective
        .ok_or_else(|| required("study.objective"))?
        .terms
        .into_iter()
        .map(|term| ObjectiveTerm { metric: term.metric, weight: term.weight })
        .collect();
    let indicators = study.indicators.into_iter().map(indicator).collect::<Result<Vec<_>, _>>()?;
    let policy = policy("study.policy", study.policy.unwrap_or_default())?
        .check(&space)
        .map_err(|error| Error::invalid("study", error))?;
    let spec = StudySpec {
        display_name: study.display_name,
        space,
        indicators: IndicatorSchema::new(indicators)
            .map_err(|error| Error::invalid("study.indicators", error))?,
        objective: Objective::new(objective).map_err(|error| Error::invalid("study.objective", error))?,
        state_tolerance: study.state_tolerance.unwrap_or(STATE_TOLERANCE_DEFAULT),
        policy,
        seed: study.seed,
    };
    spec.validate().map_err(|error| Error::invalid("study", error))?;
    Ok(spec)
}

fn space(space: v1::Space) -> Result<Space, Error> {
    let parameters = space
        .parameters
        .into_iter()
        .enumerate()
        .map(|(index, wire)| parameter(&format!("study.space.parameters[{index}]"), wire))
        .collect::<Result<_, _>>()?;
    let constraints = space
        .constraints
        .into_iter()
        .map(|constraint| Constraint { lesser: constraint.lesser, greater: constraint.greater })
        .collect();
    Space::new(parameters, constraints).map_err(|error| Error::invalid("study.space", error))
}

fn parameter(field: &str, wire: v1::Parameter) -> Result<Parameter, Error> {
    use v1::parameter::Domain as Wire;
    let domain = match wire.domain {
        None => return Err(required(&format!("{field}.domain"))),
        Some(Wire::Integer(domain)) => {
            Domain::Integer { min: domain.min, max: domain.max, scale: scale(field, domain.scale)? }
        }
        Some(Wire::Float(domain)) => {
            Domain::Float { min: domain.min, max: domain.max, scale: scale(field, domain.scale)? }
        }
        Some(Wire::Categorical(domain)) => Domain::Categorical { values: values(field, domain.values)? },
        Some(Wire::Boolean(v1::BooleanDomain {})) => Domain::Boolean,
    };
    let default_field = format!("{field}.default_value");
    let default = wire.default_value.ok_or_else(|| required(&default_field))?;
    let active_if = wire.active_if.map(|condition| {
        Ok::<_, Error>(Condition {
            parameter: condition.parameter,
            any_of: values(&format!("{field}.active_if"), condition.any_of)?,
        })
    });
    Ok(Parameter {
        name: wire.name,
        domain,
        default: value(&default_field, default)?,
        active_if: active_if.transpose()?,
    })
}

fn indicator(wire: v1::Indicator) -> Result<Indicator, Error> {
    Ok(Indicator {
        min: wire.min,
        max: wire.max,
        scale: scale("study.indicators", wire.scale)?,
        name: wire.name,
    })
}

fn scale(field: &str, scale: i32) -> Result<Scale, Error> {
    match v1::Scale::try_from(scale) {
        Ok(v1::Scale::Unspecified | v1::Scale::Linear) => Ok(Scale::Linear),
        Ok(v1::Scale::Log) => Ok(Scale::Log),
        Err(_) => Err(unknown(&format!("{field}.scale"), scale)),
    }
}

fn values(field: &str, values: Vec<v1::Value>) -> Result<Vec<Value>, Error> {
    values.into_iter().map(|v| value(field, v)).collect()
}

fn value(field: &str, value: v1::Value) -> Result<Value, Error> {
    use v1::value::Kind;
    Ok(match value.kind {
        Some(Kind::Integer(integer)) => Value::Integer(integer),
        Some(Kind::Float(float)) => Value::Float(float),
        Some(Kind::Text(text)) => Value::Text(text),
        Some(Kind::Boolean(boolean)) => Value::Boolean(boolean),
        None => {
            let problem = "a value is empty; set integer, float, text or boolean";
            return Err(Error::invalid(field, problem));
        }
    })
}

/// Reads a configuration that its space has yet to check.
///
/// # Errors
/// [`Error::Invalid`] with the field.
pub fn configuration(field: &str, configuration: v1::Configuration) -> Result<RawConfiguration, Error> {
    let values = configuration.values.into_iter();
    values.map(|(name, v)| value(&format!("{field}.values[{name:?}]"), v).map(|v| (name, v))).collect()
}

/// Reads a question for the next trial.
///
/// # Errors
/// [`Error::Invalid`] with the field.
pub fn suggest(request: v1::SuggestRequest) -> Result<Suggest, Error> {
    Ok(Suggest {
        study: names::study("study", &request.study)?,
        ask: Ask {
            client_id: request.client_id,
            indicators: request.indicators,
            fingerprint: request.fingerprint.map(fingerprint).transpose()?,
            session: request.session,
            can_abort: request.can_abort,
            session_policy: session_policy(request.session_policy)?,
        },
        wanted: request.wanted.map(|wanted| configuration("wanted", wanted)).transpose()?,
    })
}

/// What a session wants for itself.
fn session_policy(wire: Option<v1::SessionPolicy>) -> Result<SessionPolicy, Error> {
    let v1::SessionPolicy { epsilon, trials_per_state, abort_above } = wire.unwrap_or_default();
    // What is negative is as far out of its range as 0.
    let trials_per_state = trials_per_state.map(|trials| u32::try_from(trials).unwrap_or(0));
    let policy = SessionPolicy { epsilon, trials_per_state, abort_above };
    policy.validate().map_err(|error| Error::invalid("session_policy", error))?;
    Ok(policy)
}

/// Who asks.
///
/// # Errors
/// When the number of threads is negative.
pub fn fingerprint(wire: v1::Fingerprint) -> Result<Fingerprint, Error> {
    let threads = u32::try_from(wire.threads)
        .map_err(|_| Error::invalid("fingerprint.threads", "must not be negative"))?;
    Ok(Fingerprint { cpu_model: wire.cpu_model, isa: wire.isa, threads, software: wire.software })
}

/// Reads a result.
///
/// # Errors
/// [`Error::Invalid`] with the field.
pub fn report(request: v1::ReportRequest) -> Result<Report, Error> {
    use v1::outcome::Kind;
    let kind = request.outcome.and_then(|outcome| outcome.kind);
    Ok(Report {
        trial: names::trial("trial", &request.trial)?,
        measurements: request.measurements,
        outcome: match kind.ok_or_else(|| required("outcome"))? {
            Kind::Ok(v1::Ok {}) => Outcome::Ok,
            Kind::Infeasible(v1::Infeasible { reason }) => Outcome::Infeasible { reason },
            Kind::Aborted(v1::Aborted { lower_bound }) => Outcome::Aborted { lower_bound },
            Kind::Failed(v1::Failed { reason }) => Outcome::Failed { reason },
        },
    })
}

/// The error for a field that is missing.
pub(crate) fn required(field: &str) -> Error {
    Error::invalid(field, "is required")
}

/// The error for a number that no value of an enum has.
pub(crate) fn unknown(field: &str, number: i32) -> Error {
    Error::invalid(field, format!("{number} is not a known value"))
}

/// Reads a page size.
///
/// # Errors
/// [`Error::Invalid`] when it is negative or over the limit.
pub fn page_size(size: i32) -> Result<u32, Error> {
    use treewright_store::limits::{PAGE_SIZE, PAGE_SIZE_DEFAULT};
    match u32::try_from(size) {
        Ok(0) => Ok(PAGE_SIZE_DEFAULT),
        Ok(size) if size <= PAGE_SIZE => Ok(size),
        _ => Err(Error::invalid("page_size", format!("{size} must be 0 to {PAGE_SIZE}"))),
    }
}
