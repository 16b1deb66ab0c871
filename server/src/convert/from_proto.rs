//! Requests in the daemon's types. `treewright_proto::convert` converts messages to types of the model. What
//! is wrong is [`Error::Invalid`] with its field, here and in [`names`].

use std::collections::BTreeMap;

use treewright_core::configuration::RawConfiguration;
use treewright_core::limits::EXCLUSION_CHARACTERS_MAX;
use treewright_core::session::SessionPolicy;
use treewright_core::space::{Domain, Space};
use treewright_core::study::StudySpec;
use treewright_core::trial::Outcome;
use treewright_core::tuner::Ask;
use treewright_core::value::Value;
use treewright_proto::convert::{
    configuration_from_wire, fingerprint_from_wire, outcome_from_wire, session_policy_from_wire,
    space_from_wire, spec_from_wire,
};
use treewright_proto::v1;

use super::names::{self, StudyName, TrialName};
use crate::error::{Error, Result};

/// A client's report.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// The trial.
    pub trial: TrialName,
    /// The raw measurements.
    pub measurements: BTreeMap<String, f64>,
    /// The standard errors of some of them.
    pub standard_errors: BTreeMap<String, f64>,
    /// The outcome.
    pub outcome: Outcome,
}

/// A question for the next trial.
#[derive(Clone, Debug, PartialEq)]
pub struct Suggest {
    /// The study.
    pub study: StudyName,
    /// The client's question.
    pub ask: Ask,
    /// The configuration that the client wants to measure, unless the service chooses.
    pub wanted: Option<RawConfiguration>,
    /// The revision of the space that the client works with; 0 for the present one.
    pub space_revision: u32,
}

/// A change of a study's space, as it is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct SpaceChange {
    /// The revision that is changed.
    pub revision: u32,
    /// The new space.
    pub space: Space,
    /// Values of added and removed parameters, other than their defaults.
    pub fixed: RawConfiguration,
    /// Only the effect is asked for.
    pub validate_only: bool,
}

/// Reads a specification.
pub fn study(study: v1::Study) -> Result<StudySpec> {
    let said = spec_from_wire(study)?;
    let invalid = |error| Error::invalid("study", error);
    let policy =
        said.policy.clone().decide().and_then(|policy| policy.check(&said.space)).map_err(invalid)?;
    let spec = said.with_policy(policy);
    spec.validate().map_err(|error| Error::invalid("study", error))?;
    printable("study.space", &spec.space)?;
    Ok(spec)
}

/// Reads a change of a study's space.
pub fn space_change(request: v1::ChangeSpaceRequest) -> Result<SpaceChange> {
    let space = request.space.ok_or_else(|| required("space"))?;
    let space = space_from_wire("space", space)?;
    printable("space", &space)?;
    let fixed = configuration_from_wire("fixed", v1::Configuration { values: request.fixed })?;
    Ok(SpaceChange { revision: request.revision, space, fixed, validate_only: request.validate_only })
}

/// Refuses text values that a database, a table or a terminal cannot hold. Names have no such characters.
/// A stored study may have some, from before this rule.
fn printable(field: &str, space: &Space) -> Result<()> {
    for parameter in space.parameters() {
        let Domain::Categorical { values } = &parameter.domain else { continue };
        for value in values {
            if let Value::Text(text) = value
                && text.chars().any(char::is_control)
            {
                let name = &parameter.name;
                let problem = format!("parameter {name:?}: the value {text:?} has a control character");
                return Err(Error::invalid(field, problem));
            }
        }
    }
    Ok(())
}

/// Reads a question for the next trial.
pub fn suggest(request: v1::SuggestRequest) -> Result<Suggest> {
    Ok(Suggest {
        study: names::study("study", &request.study)?,
        ask: Ask {
            client_id: request.client_id,
            indicators: request.indicators,
            fingerprint: request.fingerprint.map(fingerprint_from_wire).transpose()?,
            session: request.session,
            can_abort: request.can_abort,
            session_policy: session_policy(request.session_policy)?,
            origin: origin(request.origin, request.wanted.is_some())?,
            fidelities: request.fidelities,
            start: start(request.start)?,
        },
        wanted: request.wanted.map(|wanted| configuration_from_wire("wanted", wanted)).transpose()?,
        space_revision: request.space_revision,
    })
}

/// Reads the configuration that a client runs by default.
pub fn start(wire: Option<v1::Configuration>) -> Result<Option<RawConfiguration>> {
    wire.map(|start| configuration_from_wire("start", start)).transpose().map_err(Error::from)
}

/// The place where a wanted configuration was measured before.
fn origin(text: String, has_wanted: bool) -> Result<Option<String>> {
    match text.as_str() {
        "" => Ok(None),
        _ if has_wanted => Ok(Some(text)),
        _ => {
            Err(Error::invalid("origin", "goes together with `wanted`, the configuration that was measured"))
        }
    }
}

fn session_policy(wire: Option<v1::SessionPolicy>) -> Result<SessionPolicy> {
    let policy = session_policy_from_wire(wire.unwrap_or_default());
    policy.validate().map_err(|error| Error::invalid("session_policy", error))?;
    Ok(policy)
}

/// Reads a result.
pub fn report(request: v1::ReportRequest) -> Result<Report> {
    Ok(Report {
        trial: names::trial("trial", &request.trial)?,
        measurements: request.measurements,
        standard_errors: request.standard_errors,
        outcome: request.outcome.and_then(outcome_from_wire).ok_or_else(|| required("outcome"))?,
    })
}

/// Reads why a trial is excluded; none where it counts again.
pub fn exclusion(request: &v1::ExcludeTrialRequest) -> Result<Option<&str>> {
    let reason = request.reason.as_str();
    let is_long = || reason.chars().nth(EXCLUSION_CHARACTERS_MAX).is_some();
    match (request.include, reason.trim().is_empty()) {
        (true, true) => Ok(None),
        (true, false) => Err(Error::invalid("reason", "a trial counts again without one; leave it out")),
        (false, true) => Err(required("reason")),
        (false, false) if is_long() || reason.chars().any(char::is_control) => {
            let problem = format!("must be 1 to {EXCLUSION_CHARACTERS_MAX} printable characters");
            Err(Error::invalid("reason", problem))
        }
        (false, false) => Ok(Some(reason)),
    }
}

pub(crate) fn required(field: &str) -> Error {
    Error::invalid(field, "is required")
}

/// Reads a page size.
///
/// # Errors
/// [`Error::Invalid`] when it is negative or over the limit.
pub fn page_size(size: i32) -> Result<u32> {
    use treewright_store::limits::{PAGE_SIZE, PAGE_SIZE_DEFAULT};
    match u32::try_from(size) {
        Ok(0) => Ok(PAGE_SIZE_DEFAULT),
        Ok(size) if size <= PAGE_SIZE => Ok(size),
        _ => Err(Error::invalid("page_size", format!("{size} must be 0 to {PAGE_SIZE}"))),
    }
}
