//! Checks of clients' input: nothing malformed and no infinite number gets into the tuner.

use crate::configuration::{Configuration, RawConfiguration};
use crate::limits::{
    CLIENT_ID_CHARACTERS_MAX, FINGERPRINT_SOFTWARE_MAX, FINGERPRINT_TEXT_CHARACTERS_MAX,
    ORIGIN_CHARACTERS_MAX, OUTCOME_REASON_CHARACTERS_MAX,
};
use crate::space::Space;
use crate::trial::{Fingerprint, Outcome};
use crate::tuner::{Ask, TunerError};

pub(super) fn client_id(client_id: &str) -> Result<(), TunerError> {
    let length = client_id.chars().count();
    let printable = !client_id.chars().any(char::is_control);
    if (1..=CLIENT_ID_CHARACTERS_MAX).contains(&length) && printable {
        Ok(())
    } else {
        Err(TunerError::ClientId)
    }
}

pub(super) fn origin(origin: Option<&str>) -> Result<(), TunerError> {
    let fits = |text: &str| {
        let length = text.chars().count();
        (1..=ORIGIN_CHARACTERS_MAX).contains(&length) && !text.chars().any(char::is_control)
    };
    if origin.is_none_or(fits) { Ok(()) } else { Err(TunerError::Origin) }
}

pub(super) fn fingerprint(fingerprint: Option<&Fingerprint>) -> Result<(), TunerError> {
    let Some(Fingerprint { cpu_model, isa, software, .. }) = fingerprint else { return Ok(()) };
    let mut texts = [cpu_model, isa].into_iter().chain(software.iter().flat_map(|(k, v)| [k, v]));
    let fits = texts.all(|text| text.chars().count() <= FINGERPRINT_TEXT_CHARACTERS_MAX);
    if fits && software.len() <= FINGERPRINT_SOFTWARE_MAX { Ok(()) } else { Err(TunerError::Fingerprint) }
}

/// Checks a start; `None` for the study's default.
pub(super) fn start(
    space: &Space,
    start: Option<&RawConfiguration>,
) -> Result<Option<Configuration>, TunerError> {
    let Some(start) = start else { return Ok(None) };
    let start = space.configuration(start.clone()).map_err(TunerError::Start)?;
    Ok((start != *space.default_ref()).then_some(start))
}

/// The start of a client whose question was checked.
pub(super) fn start_of(space: &Space, ask: &Ask) -> Option<Configuration> {
    start(space, ask.start.as_ref()).ok().flatten()
}

pub(super) fn outcome(outcome: &Outcome) -> Result<(), TunerError> {
    match outcome {
        Outcome::Aborted { lower_bound } if !lower_bound.is_finite() || *lower_bound < 0.0 => {
            Err(TunerError::LowerBound(*lower_bound))
        }
        Outcome::Infeasible { reason } | Outcome::Failed { reason }
            if reason.chars().count() > OUTCOME_REASON_CHARACTERS_MAX =>
        {
            Err(TunerError::OutcomeReason)
        }
        _ => Ok(()),
    }
}
