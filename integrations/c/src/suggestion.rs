//! Suggestions: the configuration to run next, and its report.

use std::ffi::{CString, c_char};

use treewright_client::{Measurements, Outcome, Source};

use crate::configuration::Configuration;
use crate::edge::{Array, Number, Text, measurements, need};
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

exports! {
    fn tw_suggestion_configuration(suggestion: Option<&Suggestion>) -> Option<&Configuration> {
        suggestion.map(|suggestion| &suggestion.configuration)
    }

    fn tw_suggestion_source(suggestion: Option<&Suggestion>) -> i32 {
        suggestion.map_or(2, |suggestion| match suggestion.inner.source() {
            Source::Daemon => 0,
            Source::LastGood => 1,
            Source::Default => 2,
        })
    }

    fn tw_suggestion_trial(suggestion: Option<&Suggestion>) -> *const c_char {
        suggestion.map_or(c"".as_ptr(), |suggestion| suggestion.trial.as_ptr())
    }

    fn tw_suggestion_reason(suggestion: Option<&Suggestion>) -> *const c_char {
        suggestion.map_or(c"".as_ptr(), |suggestion| suggestion.reason.as_ptr())
    }

    fn tw_suggestion_problem(suggestion: Option<&Suggestion>) -> *const c_char {
        let problem = suggestion.and_then(|suggestion| suggestion.problem.as_ref());
        problem.map_or(std::ptr::null(), |problem| problem.as_ptr())
    }

    fn tw_suggestion_fidelity(suggestion: Option<&Suggestion>) -> *const c_char {
        let fidelity = suggestion.and_then(|suggestion| suggestion.fidelity.as_ref());
        fidelity.map_or(std::ptr::null(), |fidelity| fidelity.as_ptr())
    }

    fn tw_suggestion_predicted_cost(suggestion: Option<&Suggestion>) -> f64 {
        suggestion.and_then(|suggestion| suggestion.inner.predicted_cost()).unwrap_or(f64::NAN)
    }

    fn tw_suggestion_abort_above(suggestion: Option<&Suggestion>) -> f64 {
        suggestion.and_then(|suggestion| suggestion.inner.abort_above()).unwrap_or(f64::INFINITY)
    }

    fn tw_suggestion_is_prepared(suggestion: Option<&Suggestion>) -> bool {
        suggestion.is_some_and(|suggestion| suggestion.inner.is_prepared())
    }
}

fn end(
    suggestion: Option<Box<Suggestion>>,
    numbers: (Array<Number>, usize),
    outcome: Result<Outcome, Failure>,
) -> Result<(), Failure> {
    let suggestion = need(suggestion, "suggestion")?;
    let measured = suggestion.measured(numbers.0, numbers.1)?;
    Ok(suggestion.inner.report(measured, outcome?)?)
}

exports! {
    fn tw_suggestion_standard_errors(
        suggestion: Option<&mut Suggestion>, errors: Array<Number>, count: usize; error
    ) -> bool {
        need(suggestion, "suggestion")?.errors = measurements(errors, count)?;
        Ok(())
    }

    fn tw_suggestion_report(
        suggestion: Option<Box<Suggestion>>, numbers: Array<Number>, count: usize; error
    ) -> bool {
        end(suggestion, (numbers, count), Ok(Outcome::Ok))
    }

    fn tw_suggestion_aborted(suggestion: Option<Box<Suggestion>>, lower_bound: f64; error) -> bool {
        end(suggestion, (Array::none(), 0), Ok(Outcome::aborted(lower_bound)))
    }

    fn tw_suggestion_infeasible(suggestion: Option<Box<Suggestion>>, reason: Text; error) -> bool {
        end(suggestion, (Array::none(), 0), reason.read("the reason").map(Outcome::infeasible))
    }

    fn tw_suggestion_failed(suggestion: Option<Box<Suggestion>>, reason: Text; error) -> bool {
        end(suggestion, (Array::none(), 0), reason.read("the reason").map(Outcome::failed))
    }

    fn tw_suggestion_free(suggestion: Suggestion);
}
