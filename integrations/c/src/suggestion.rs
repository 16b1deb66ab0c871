//! Suggestions: the configuration to run next, and its report.

use std::ffi::{CString, c_char};

use treewright_client::{Measurements, Outcome, Source};

use crate::configuration::Configuration;
use crate::edge::{Array, ErrorOut, Number, Text, free, guard, measurements, need};
use crate::error::{Failure, c_text};

/// A suggestion. Used by one thread at a time.
#[derive(Debug)]
pub(crate) struct Suggestion {
    pub(crate) inner: treewright_client::Suggestion,
    configuration: Configuration,
    trial: CString,
    reason: CString,
    problem: Option<CString>,
    fidelity: Option<CString>,
    /// The standard errors of measurements to come.
    errors: Measurements,
}

impl Suggestion {
    pub(crate) fn new(inner: treewright_client::Suggestion) -> Self {
        Self {
            configuration: Configuration::new(inner.configuration().clone()),
            trial: c_text(inner.trial().unwrap_or_default()),
            reason: c_text(&inner.reason().summary),
            problem: inner.problem().map(|problem| c_text(&problem.to_string())),
            fidelity: inner.fidelity().map(c_text),
            errors: Measurements::new(),
            inner,
        }
    }

    /// Numbers with the standard errors that were named before.
    pub(crate) fn measured(&self, numbers: Array<Number>, count: usize) -> Result<Measurements, Failure> {
        let measured = measurements(numbers, count)?;
        // Without measurements it ends otherwise.
        let errors = self.errors.iter().filter(|_| count > 0);
        Ok(errors.fold(measured, |all, (name, error)| all.with_standard_error(name, error)))
    }
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_suggestion_configuration(
    suggestion: Option<&Suggestion>,
) -> Option<&Configuration> {
    suggestion.map(|suggestion| &suggestion.configuration)
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_suggestion_source(suggestion: Option<&Suggestion>) -> i32 {
    suggestion.map_or(2, |suggestion| match suggestion.inner.source() {
        Source::Daemon => 0,
        Source::LastGood => 1,
        Source::Default => 2,
    })
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_suggestion_trial(suggestion: Option<&Suggestion>) -> *const c_char {
    suggestion.map_or(c"".as_ptr(), |suggestion| suggestion.trial.as_ptr())
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_suggestion_reason(suggestion: Option<&Suggestion>) -> *const c_char {
    suggestion.map_or(c"".as_ptr(), |suggestion| suggestion.reason.as_ptr())
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_suggestion_problem(suggestion: Option<&Suggestion>) -> *const c_char {
    let problem = suggestion.and_then(|suggestion| suggestion.problem.as_ref());
    problem.map_or(std::ptr::null(), |problem| problem.as_ptr())
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_suggestion_fidelity(suggestion: Option<&Suggestion>) -> *const c_char {
    let fidelity = suggestion.and_then(|suggestion| suggestion.fidelity.as_ref());
    fidelity.map_or(std::ptr::null(), |fidelity| fidelity.as_ptr())
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_suggestion_predicted_cost(suggestion: Option<&Suggestion>) -> f64 {
    suggestion.and_then(|suggestion| suggestion.inner.predicted_cost()).unwrap_or(f64::NAN)
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_suggestion_abort_above(suggestion: Option<&Suggestion>) -> f64 {
    suggestion.and_then(|suggestion| suggestion.inner.abort_above()).unwrap_or(f64::INFINITY)
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_suggestion_is_prepared(suggestion: Option<&Suggestion>) -> bool {
    suggestion.is_some_and(|suggestion| suggestion.inner.is_prepared())
}

fn end(
    suggestion: Option<Box<Suggestion>>,
    error: ErrorOut,
    numbers: (Array<Number>, usize),
    outcome: impl FnOnce() -> Result<Outcome, Failure>,
) -> bool {
    let body = || {
        let suggestion = need(suggestion, "suggestion")?;
        let measured = suggestion.measured(numbers.0, numbers.1)?;
        Ok(suggestion.inner.report(measured, outcome()?)?)
    };
    guard(error, body).is_some()
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_suggestion_standard_errors(
    suggestion: Option<&mut Suggestion>,
    errors: Array<Number>,
    count: usize,
    error: ErrorOut,
) -> bool {
    let body = || {
        need(suggestion, "suggestion")?.errors = measurements(errors, count)?;
        Ok(())
    };
    guard(error, body).is_some()
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_suggestion_report(
    suggestion: Option<Box<Suggestion>>,
    numbers: Array<Number>,
    count: usize,
    error: ErrorOut,
) -> bool {
    end(suggestion, error, (numbers, count), || Ok(Outcome::Ok))
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_suggestion_aborted(
    suggestion: Option<Box<Suggestion>>,
    lower_bound: f64,
    error: ErrorOut,
) -> bool {
    end(suggestion, error, (Array::none(), 0), || Ok(Outcome::aborted(lower_bound)))
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_suggestion_infeasible(
    suggestion: Option<Box<Suggestion>>,
    reason: Text,
    error: ErrorOut,
) -> bool {
    end(suggestion, error, (Array::none(), 0), || Ok(Outcome::infeasible(reason.read("the reason")?)))
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_suggestion_failed(
    suggestion: Option<Box<Suggestion>>,
    reason: Text,
    error: ErrorOut,
) -> bool {
    end(suggestion, error, (Array::none(), 0), || Ok(Outcome::failed(reason.read("the reason")?)))
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_suggestion_free(suggestion: Option<Box<Suggestion>>) {
    free(suggestion);
}
