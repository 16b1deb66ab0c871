//! Specifications of studies.

use treewright_model::fidelity::Fidelity;
use treewright_model::indicator::{Indicator, IndicatorSchema};
use treewright_model::objective::{MeasurementLimit, Objective, ObjectiveTerm};
use treewright_model::policy::PolicySettings;
use treewright_model::study::{STATE_TOLERANCE_DEFAULT, StudySpec};

use super::policy::{policy_from_wire, policy_to_wire};
use super::space::{scale_from_wire, space_from_wire, space_to_wire};
use super::{Malformed, WireEnum};
use crate::v1;

#[cfg(test)]
#[path = "../../../model/src/testing.rs"]
mod testing;

/// A specification, without the daemon's own fields (name, identity, revision, time and statistics).
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
    let fidelity = |level: &Fidelity| v1::Fidelity { name: level.name.clone(), cost: level.cost };
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
            episode_frames: match spec.objective.episode_frames() {
                1 => 0, // as before there were several
                frames => frames,
            },
            fidelities: spec.objective.fidelities().iter().map(fidelity).collect(),
        }),
        state_tolerance: Some(spec.state_tolerance),
        policy: Some(policy_to_wire(spec.policy.clone().into())),
        seed: spec.seed,
        create_time: None,
        statistics: None,
        policy_differs: Vec::new(),
        uid: String::new(),
        space_revision: 0,
        note: spec.note.clone(),
        tags: spec.tags.iter().cloned().collect(),
    }
}

/// Reads a specification, checked but for its texts for people and its policy.
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
    let fidelities = objective.fidelities.into_iter();
    let fidelities = fidelities.map(|level| Fidelity { name: level.name, cost: level.cost }).collect();
    let indicator = |wire: v1::Indicator| {
        let scale = scale_from_wire("study.indicators", wire.scale)?;
        Ok(Indicator { name: wire.name, min: wire.min, max: wire.max, scale })
    };
    let indicators = study.indicators.into_iter().map(indicator).collect::<Result<_, _>>()?;
    Ok(StudySpec {
        display_name: study.display_name,
        note: study.note,
        tags: study.tags.into_iter().collect(),
        space: space_from_wire("study.space", space)?,
        indicators: IndicatorSchema::new(indicators)
            .map_err(|error| Malformed::new("study.indicators", error))?,
        objective: Objective::new(terms.collect())
            .and_then(|terms| terms.with_auxiliary(objective.auxiliary))
            .and_then(|terms| terms.with_limits(limits.collect()))
            .and_then(|terms| terms.with_maximised(objective.maximised))
            .and_then(|terms| terms.with_episode_frames(objective.episode_frames.max(1)))
            .and_then(|terms| terms.with_fidelities(fidelities))
            .map_err(|error| Malformed::new("study.objective", error))?,
        state_tolerance: study.state_tolerance.unwrap_or(STATE_TOLERANCE_DEFAULT),
        policy: policy_from_wire("study.policy", study.policy.unwrap_or_default())?,
        seed: study.seed,
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use prost::Message as _;

    use super::testing::{cases, decided, studies};
    use super::*;
    use treewright_model::space::Space;
    use treewright_model::words::OpenEnum;

    proptest! {
        #![proptest_config(cases(128))]

        #[test]
        fn every_specification_survives_the_wire(spec in studies()) {
            let bytes = spec_to_wire(&spec).encode_to_vec();
            let again = spec_from_wire(v1::Study::decode(bytes.as_slice()).expect("own output"));
            prop_assert_eq!(again.map(decided), Ok(decided(spec)));
        }
    }

    fn spec() -> StudySpec<PolicySettings> {
        let space = Space::builder().integer("low", 1..=8).default(1).integer("high", 1..=8).default(8);
        let space =
            space.less_or_equal("low", "high").constraint("low * high <= 64").build().expect("a space");
        StudySpec::builder(space).minimise("render_ms", 1.0).build().expect("a study")
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
        assert!(problem(wrong.clone()).starts_with("study.space.constraints[1]: constraint `low * high"));
        wrong.space.as_mut().expect("a space").constraints[1].lesser = "low".to_owned();
        assert!(problem(wrong).contains("it has an expression and an order"));
        let mut long = spec_to_wire(&spec());
        let objective = long.objective.as_mut().expect("an objective");
        assert_eq!(objective.episode_frames, 0, "one frame is sent as ever");
        objective.episode_frames = 65;
        assert_eq!(problem(long), "study.objective: episode_frames is 65; give 1 to 64");
        let negative = v1::Policy { lease_s: -1, ..v1::Policy::default() };
        let error = policy_from_wire("study.policy", negative).expect_err("negative").to_string();
        assert_eq!(error, "study.policy.lease_s: -1 must not be negative");
    }
}
