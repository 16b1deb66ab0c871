//! Checks that find, before anything is sent, values that the service would refuse.

use treewright_model::objective::check_report;

use crate::{ClientError, Indicators, Measurements, Outcome, StudySpec};

/// The state that the numbers stand for: one normalised number for each indicator of the study.
///
/// Errors: [`ClientError::Invalid`] naming an indicator that is missing, unknown or not finite.
pub(crate) fn state(spec: &StudySpec, indicators: &Indicators) -> Result<Vec<f64>, ClientError> {
    spec.indicators
        .normalise(&indicators.0)
        .map_err(|error| ClientError::invalid("indicators", error.to_string()))
}

/// Whether the service takes both indicators for one state: every normalised value within the tolerance.
pub(crate) fn are_one_state(spec: &StudySpec, a: &Indicators, b: &Indicators) -> bool {
    let (Ok(a), Ok(b)) = (state(spec, a), state(spec, b)) else { return false };
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= spec.state_tolerance)
}

pub(crate) fn measurements(measurements: &Measurements) -> Result<(), ClientError> {
    let checked = check_report(&measurements.0, &measurements.1);
    checked.map_err(|problem| ClientError::invalid("measurements", problem.to_string()))
}

/// Checks a result: with [`Outcome::Ok`] it must have a cost, unless it is beyond a limit. Limits hold for
/// full trials alone. The daemon would refuse it later, when nobody looks.
pub(crate) fn result(
    spec: &StudySpec,
    is_full: bool,
    outcome: &Outcome,
    measured: &Measurements,
) -> Result<(), ClientError> {
    measurements(measured)?;
    match outcome {
        Outcome::Ok => {
            // A result beyond a limit is infeasible and needs no cost.
            match spec.objective.beyond(&measured.0) {
                Ok(Some(_)) if is_full => Ok(()),
                Err(problem) if is_full => Err(problem),
                _ => spec.objective.cost(&measured.0).map(drop),
            }
            .map_err(|problem| ClientError::invalid("result", problem.to_string()))
        }
        Outcome::Aborted { lower_bound } if !(lower_bound.is_finite() && *lower_bound >= 0.0) => {
            let problem = format!("{lower_bound} is not a finite number of at least 0");
            Err(ClientError::invalid("lower bound of an aborted trial", problem))
        }
        Outcome::Aborted { .. } | Outcome::Infeasible { .. } | Outcome::Failed { .. } => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Scale, Space};

    fn spec() -> StudySpec {
        StudySpec::builder(Space::builder().boolean("compact").default(false).build().unwrap())
            .indicator("distance", 0.0..=100.0, Scale::Linear)
            .indicator("triangles", 0.0..=1e6, Scale::Log)
            .minimise("render_ms", 1.0)
            .state_tolerance(0.02)
            .build()
            .unwrap()
    }

    fn at(distance: f64, triangles: f64) -> Indicators {
        Indicators::from([("distance", distance), ("triangles", triangles)])
    }

    #[test]
    fn states_are_the_same_within_the_tolerance_of_the_scale() {
        assert!(are_one_state(&spec(), &at(10.0, 1000.0), &at(11.5, 1100.0)));
        assert!(!are_one_state(&spec(), &at(10.0, 1000.0), &at(12.5, 1000.0)));
        assert!(!are_one_state(&spec(), &at(10.0, 1000.0), &at(10.0, 2000.0)));
    }

    #[test]
    fn measurements_are_checked_before_they_are_sent() {
        assert!(measurements(&Measurements::from([("build_ms", 0.0), ("render_ms", 12.5)])).is_ok());
        for bad in [f64::NAN, f64::INFINITY, -1.0] {
            let error = measurements(&Measurements::new().with("render_ms", bad)).unwrap_err().to_string();
            assert!(error.contains("render_ms") && error.contains("finite"), "{error}");
        }
        assert!(measurements(&Measurements::new().with("Render ms", 1.0)).is_err());
        let estimated = |error| Measurements::from([("ms", 3.0)]).with_standard_error("ms", error);
        assert!(measurements(&estimated(0.0)).is_ok() && measurements(&estimated(4.0)).is_ok());
        for bad in [estimated(f64::NAN), estimated(-0.1), estimated(0.1).with_standard_error("fps", 1.0)] {
            assert!(measurements(&bad).unwrap_err().to_string().contains("standard error"));
        }
        let many: Measurements = (0..65).map(|index| (format!("m{index}"), 1.0)).collect();
        assert!(measurements(&many).unwrap_err().to_string().contains("64"));
    }

    #[test]
    fn a_result_without_a_cost_is_refused_before_it_is_sent() {
        let space = Space::builder().boolean("compact").default(false).build().unwrap();
        let spec = StudySpec::builder(space).maximise("rate", 1.0).build().unwrap();
        let of = |rate: f64| result(&spec, true, &Outcome::Ok, &Measurements::from([("rate", rate)]));
        assert!(of(3.0).is_ok());
        let refused = of(0.0).unwrap_err().to_string();
        assert!(refused.contains("rate") && refused.contains("above 0"), "{refused}");
    }

    #[test]
    fn limits_hold_for_full_trials_alone() {
        let space = Space::builder().boolean("compact").default(false).build().unwrap();
        let limited = StudySpec::builder(space).maximise("rate", 1.0).limit("memory_mb", None, Some(9.0));
        let spec = limited.build().unwrap();
        let of = |is_full: bool, measured: &Measurements| result(&spec, is_full, &Outcome::Ok, measured);
        let rate = Measurements::from([("rate", 3.0)]);
        assert!(of(true, &rate).is_err() && of(false, &rate).is_ok());
        let beyond = Measurements::from([("rate", 0.0), ("memory_mb", 10.0)]);
        assert!(of(true, &beyond).is_ok() && of(false, &beyond).is_err(), "a level needs its cost");
    }

    #[test]
    fn an_outcome_needs_its_numbers() {
        let nothing = Measurements::new();
        let problem = result(&spec(), true, &Outcome::Ok, &nothing).unwrap_err().to_string();
        assert!(problem.contains("render_ms"), "{problem}");
        assert!(result(&spec(), true, &Outcome::Ok, &Measurements::from([("render_ms", 1.0)])).is_ok());
        assert!(result(&spec(), true, &Outcome::infeasible("depth limit reached"), &nothing).is_ok());
        assert!(result(&spec(), true, &Outcome::aborted(5.0), &nothing).is_ok());
        for bad in [f64::NAN, f64::INFINITY, -1.0] {
            assert!(result(&spec(), true, &Outcome::aborted(bad), &nothing).is_err(), "{bad}");
        }
    }
}
