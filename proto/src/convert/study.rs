//! Specifications of studies.

use treewright_model::indicator::{Indicator, IndicatorSchema};
use treewright_model::objective::{MeasurementLimit, Objective, ObjectiveTerm};
use treewright_model::policy::PolicySettings;
use treewright_model::study::{STATE_TOLERANCE_DEFAULT, StudySpec};

use super::policy::{policy_from_wire, policy_to_wire};
use super::space::{scale_from_wire, space_from_wire, space_to_wire};
use super::{Malformed, WireEnum};
use crate::v1;

/// A specification, without the daemon's own fields (name, identity, time and statistics).
#[must_use]
pub fn spec_to_wire<P: Clone + Into<PolicySettings>>(spec: &StudySpec<P>) -> v1::Study {
    let indicator = |indicator: &Indicator| v1::Indicator {
        name: indicator.name.clone(),
        min: indicator.min,
        max: indicator.max,
        scale: indicator.scale.number(),
    };
    let limit = |limit: &MeasurementLimit| v1::MeasurementLimit {
        metric: limit.metric.clone(),
        at_least: limit.at_least,
        at_most: limit.at_most,
    };
    let term = |term: &ObjectiveTerm| v1::ObjectiveTerm { metric: term.metric.clone(), weight: term.weight };
    v1::Study {
        name: String::new(),
        display_name: spec.display_name.clone(),
        space: Some(space_to_wire(&spec.space)),
        indicators: spec.indicators.indicators().iter().map(indicator).collect(),
        objective: Some(v1::Objective {
            terms: spec.objective.terms().iter().map(term).collect(),
            auxiliary: spec.objective.auxiliary().to_vec(),
            limits: spec.objective.limits().iter().map(limit).collect(),
            maximised: spec.objective.maximised().to_vec(),
        }),
        state_tolerance: Some(spec.state_tolerance),
        policy: Some(policy_to_wire(spec.policy.clone().into())),
        seed: spec.seed,
        create_time: None,
        statistics: None,
        policy_differs: Vec::new(),
        uid: String::new(),
    }
}

/// Reads a specification, checked but for its display name and its policy.
///
/// # Errors
/// [`Malformed`] with the field.
pub fn spec_from_wire(study: v1::Study) -> Result<StudySpec<PolicySettings>, Malformed> {
    let space = study.space.ok_or_else(|| Malformed::missing("study.space"))?;
    let objective = study.objective.ok_or_else(|| Malformed::missing("study.objective"))?;
    let terms =
        objective.terms.into_iter().map(|term| ObjectiveTerm { metric: term.metric, weight: term.weight });
    let limits = objective.limits.into_iter().map(|wire| {
        let v1::MeasurementLimit { metric, at_least, at_most } = wire;
        MeasurementLimit { metric, at_least, at_most }
    });
    let indicator = |wire: v1::Indicator| {
        let scale = scale_from_wire("study.indicators", wire.scale)?;
        Ok(Indicator { name: wire.name, min: wire.min, max: wire.max, scale })
    };
    let indicators = study.indicators.into_iter().map(indicator).collect::<Result<_, _>>()?;
    Ok(StudySpec {
        display_name: study.display_name,
        space: space_from_wire("study.space", space)?,
        indicators: IndicatorSchema::new(indicators)
            .map_err(|error| Malformed::new("study.indicators", error))?,
        objective: Objective::new(terms.collect())
            .and_then(|terms| terms.with_auxiliary(objective.auxiliary))
            .and_then(|terms| terms.with_limits(limits.collect()))
            .and_then(|terms| terms.with_maximised(objective.maximised))
            .map_err(|error| Malformed::new("study.objective", error))?,
        state_tolerance: study.state_tolerance.unwrap_or(STATE_TOLERANCE_DEFAULT),
        policy: policy_from_wire("study.policy", study.policy.unwrap_or_default())?,
        seed: study.seed,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use treewright_model::assignment::Assignment;
    use treewright_model::space::{Scale, Space};
    use treewright_model::words::OpenEnum;

    fn spec() -> StudySpec<PolicySettings> {
        let space = Space::builder()
            .categorical("split", ["sah", "median"])
            .default("sah")
            .integer("max_depth", 9..=64)
            .default(32)
            .log()
            .integer("low", 1..=8)
            .default(1)
            .integer("high", 1..=8)
            .default(8)
            .float("cost", 0.1..=4.0)
            .default(1.0)
            .active_if("split", ["sah"])
            .boolean("compact")
            .default(false)
            .less_or_equal("low", "high")
            .constraint("low * max_depth <= 64 or split == 'sah'")
            .build()
            .expect("a space");
        // Every field of the policy is set to something.
        let mut policy = PolicySettings::new().pinned(Assignment::new().with("compact", true));
        for field in PolicySettings::FIELDS {
            let text = match (field.words)().last() {
                Some(word) => (*word).to_owned(),
                None => "0.5".to_owned(),
            };
            if policy.set_text(field.name, &text).is_err() && policy.set_text(field.name, "7").is_err() {
                let text = (field.unset != "true").to_string();
                if field.name != "pinned" {
                    policy.set_text(field.name, &text).expect("a switch");
                }
            }
        }
        StudySpec::builder(space)
            .display_name("sponza")
            .indicator("triangles", 0.0..=1e6, Scale::Log)
            .minimise("build_ms", 0.5)
            .minimise("render_ms", 1.0)
            .auxiliary("render_cpu_ms")
            .limit("memory_mb", None, Some(2000.0))
            .limit("psnr_db", Some(-3.5), Some(90.0))
            .state_tolerance(0.0)
            .policy(policy.abort_above(1.5).worst_factor(20.0))
            .seed(u64::MAX)
            .build()
            .expect("a study")
    }

    #[test]
    fn a_specification_survives_the_wire() {
        assert_eq!(spec_from_wire(spec_to_wire(&spec())), Ok(spec()));
    }

    #[test]
    fn every_field_of_the_policy_survives_the_wire() {
        for field in PolicySettings::FIELDS {
            assert!(spec().policy.show(field.name).is_some(), "{}", field.name);
            let mut policy = PolicySettings::new();
            policy
                .set_text(field.name, &spec().policy.show(field.name).expect("set"))
                .expect("its own words");
            let back = policy_from_wire("policy", policy_to_wire(policy.clone())).expect("well formed");
            assert_eq!(back.show(field.name), policy.show(field.name));
        }
    }

    #[test]
    fn methods_of_newer_versions_are_carried_there_and_back() {
        let wire = v1::Policy { predictor: 8, operation: 77, ..v1::Policy::default() };
        let read = policy_from_wire("policy", wire.clone()).expect("well formed");
        assert_eq!(read.predictor, Some(OpenEnum::Unrecognised(8)));
        assert_eq!(read.show("operation").as_deref(), Some("unrecognised (77)"));
        assert_eq!(policy_to_wire(read), wire);
    }

    #[test]
    fn what_is_missing_is_named() {
        let problem = |study: v1::Study| spec_from_wire(study).expect_err("not a study").to_string();
        assert_eq!(problem(v1::Study::default()), "study.space: is required");
        let mut newer = spec_to_wire(&spec());
        newer.space.as_mut().expect("a space").parameters[1].domain = None;
        assert!(problem(newer).starts_with("study.space.parameters[1].domain: is required; known here are"));
        let mut wrong = spec_to_wire(&spec());
        let constraints = &mut wrong.space.as_mut().expect("a space").constraints;
        assert_eq!((constraints[0].lesser.as_str(), constraints[0].expression.as_str()), ("low", ""));
        constraints[1].expression.push('*');
        assert!(problem(wrong.clone()).starts_with("study.space.constraints[1]: constraint `low * max"));
        wrong.space.as_mut().expect("a space").constraints[1].lesser = "low".to_owned();
        assert!(problem(wrong).contains("it has an expression and an order"));
        let negative = v1::Policy { lease_s: -1, ..v1::Policy::default() };
        let error = policy_from_wire("study.policy", negative).expect_err("negative").to_string();
        assert_eq!(error, "study.policy.lease_s: -1 must not be negative");
    }
}
