//! Studies: specification, space, policy.

use treewright_proto::v1;

use super::{
    Problem, configuration_from_wire, configuration_to_wire, time_from_wire, value_from_wire, value_to_wire,
};
use crate::{
    Condition, Constraint, Domain, Indicator, ObjectiveTerm, Operation, Parameter, Policy, PredictorMethod,
    Scale, SearchMethod, SessionPolicy, Space, StudyRecord, StudySpec, StudyStatistics, Value,
};

pub(crate) fn spec_to_wire(name: String, spec: &StudySpec) -> v1::Study {
    v1::Study {
        name,
        display_name: spec.display_name.clone(),
        space: Some(space_to_wire(&spec.space)),
        indicators: spec.indicators.iter().map(indicator_to_wire).collect(),
        objective: Some(v1::Objective {
            terms: spec
                .objective
                .iter()
                .map(|term| v1::ObjectiveTerm { metric: term.metric.clone(), weight: term.weight })
                .collect(),
        }),
        state_tolerance: spec.state_tolerance,
        policy: Some(policy_to_wire(&spec.policy)),
        seed: spec.seed,
        create_time: None,
        statistics: None,
        policy_differs: Vec::new(),
    }
}

pub(crate) fn session_policy_to_wire(policy: SessionPolicy) -> Option<v1::SessionPolicy> {
    let SessionPolicy { epsilon, trials_per_state, abort_above } = policy;
    // It was checked against a limit far below.
    let trials_per_state = trials_per_state.map(|trials| i32::try_from(trials).unwrap_or(i32::MAX));
    (!policy.is_empty()).then_some(v1::SessionPolicy { epsilon, trials_per_state, abort_above })
}

pub(crate) fn study_from_wire(study: v1::Study) -> Result<StudyRecord, Problem> {
    let statistics = study.statistics.unwrap_or_default();
    let terms = study.objective.ok_or("a study without an objective")?.terms;
    Ok(StudyRecord {
        name: study.name,
        spec: StudySpec {
            display_name: study.display_name,
            space: space_from_wire(study.space.ok_or("a study without a space")?)?,
            indicators: study.indicators.into_iter().map(indicator_from_wire).collect(),
            objective: terms
                .into_iter()
                .map(|term| ObjectiveTerm { metric: term.metric, weight: term.weight })
                .collect(),
            state_tolerance: study.state_tolerance,
            policy: policy_from_wire(study.policy.unwrap_or_default())?,
            seed: study.seed,
        },
        create_time: time_from_wire(study.create_time),
        statistics: StudyStatistics {
            states: statistics.states,
            trials: statistics.trials,
            completed_trials: statistics.completed_trials,
            open_trials: statistics.open_trials,
        },
        policy_differs: study.policy_differs,
    })
}

pub(crate) fn policy_to_wire(policy: &Policy) -> v1::Policy {
    let count = |value: Option<u32>| value.map_or(0, |value| i32::try_from(value).unwrap_or(i32::MAX));
    let search = policy.search.map_or(v1::SearchMethod::Unspecified, |search| match search {
        SearchMethod::NelderMead => v1::SearchMethod::NelderMead,
        SearchMethod::LatinHypercube => v1::SearchMethod::LatinHypercube,
        SearchMethod::Random => v1::SearchMethod::Random,
        SearchMethod::Model => v1::SearchMethod::Model,
        SearchMethod::Auto => v1::SearchMethod::Auto,
    });
    let predictor = policy.predictor.map_or(v1::PredictorMethod::Unspecified, |predictor| match predictor {
        PredictorMethod::NearestNeighbour => v1::PredictorMethod::NearestNeighbour,
        PredictorMethod::RbfGreedyGq => v1::PredictorMethod::RbfGreedyGq,
        PredictorMethod::Auto => v1::PredictorMethod::Auto,
        PredictorMethod::WeightedNeighbours => v1::PredictorMethod::WeightedNeighbours,
        PredictorMethod::GaussianGreedyGq => v1::PredictorMethod::GaussianGreedyGq,
        PredictorMethod::LeastSquares => v1::PredictorMethod::LeastSquares,
        PredictorMethod::Contextual => v1::PredictorMethod::Contextual,
    });
    v1::Policy {
        epsilon: policy.epsilon,
        search: search.into(),
        predictor: predictor.into(),
        trials_per_state: count(policy.trials_per_state),
        replicates: count(policy.replicates),
        lease_s: count(policy.lease_s),
        pinned: policy.pinned.as_ref().map(configuration_to_wire),
        epsilon_halves_after: count(policy.epsilon_halves_after),
        regret_budget: policy.regret_budget,
        abort_above: policy.abort_above,
        worst_factor: policy.worst_factor,
        operation: policy
            .operation
            .map_or(v1::Operation::Unspecified, |operation| match operation {
                Operation::Tune => v1::Operation::Tune,
                Operation::Freeze => v1::Operation::Freeze,
                Operation::Shadow => v1::Operation::Shadow,
            })
            .into(),
        weigh_gain: policy.weigh_gain.unwrap_or_default(),
        freeze_risk: policy.freeze_risk,
        warm_up: count(policy.warm_up),
        roll_back: policy.roll_back,
    }
}

fn policy_from_wire(policy: v1::Policy) -> Result<Policy, Problem> {
    let count = |value: i32| u32::try_from(value).ok().filter(|value| *value > 0);
    let search = match v1::SearchMethod::try_from(policy.search) {
        Ok(v1::SearchMethod::Unspecified) => None,
        Ok(v1::SearchMethod::NelderMead) => Some(SearchMethod::NelderMead),
        Ok(v1::SearchMethod::LatinHypercube) => Some(SearchMethod::LatinHypercube),
        Ok(v1::SearchMethod::Random) => Some(SearchMethod::Random),
        Ok(v1::SearchMethod::Model) => Some(SearchMethod::Model),
        Ok(v1::SearchMethod::Auto) => Some(SearchMethod::Auto),
        Err(_) => return Err(format!("an unknown search method ({})", policy.search)),
    };
    let predictor = match v1::PredictorMethod::try_from(policy.predictor) {
        Ok(v1::PredictorMethod::Unspecified) => None,
        Ok(v1::PredictorMethod::NearestNeighbour) => Some(PredictorMethod::NearestNeighbour),
        Ok(v1::PredictorMethod::RbfGreedyGq) => Some(PredictorMethod::RbfGreedyGq),
        Ok(v1::PredictorMethod::Auto) => Some(PredictorMethod::Auto),
        Ok(v1::PredictorMethod::WeightedNeighbours) => Some(PredictorMethod::WeightedNeighbours),
        Ok(v1::PredictorMethod::GaussianGreedyGq) => Some(PredictorMethod::GaussianGreedyGq),
        Ok(v1::PredictorMethod::LeastSquares) => Some(PredictorMethod::LeastSquares),
        Ok(v1::PredictorMethod::Contextual) => Some(PredictorMethod::Contextual),
        Err(_) => return Err(format!("an unknown predictor ({})", policy.predictor)),
    };
    Ok(Policy {
        epsilon: policy.epsilon,
        search,
        predictor,
        trials_per_state: count(policy.trials_per_state),
        replicates: count(policy.replicates),
        lease_s: count(policy.lease_s),
        pinned: policy.pinned.map(|pinned| configuration_from_wire(Some(pinned))).transpose()?,
        epsilon_halves_after: count(policy.epsilon_halves_after),
        regret_budget: policy.regret_budget,
        abort_above: policy.abort_above,
        worst_factor: policy.worst_factor,
        operation: match v1::Operation::try_from(policy.operation) {
            Ok(v1::Operation::Unspecified) => None,
            Ok(v1::Operation::Tune) => Some(Operation::Tune),
            Ok(v1::Operation::Freeze) => Some(Operation::Freeze),
            Ok(v1::Operation::Shadow) => Some(Operation::Shadow),
            Err(_) => return Err(format!("an unknown operation ({})", policy.operation)),
        },
        weigh_gain: policy.weigh_gain.then_some(true),
        freeze_risk: policy.freeze_risk,
        warm_up: count(policy.warm_up),
        roll_back: policy.roll_back,
    })
}

fn space_to_wire(space: &Space) -> v1::Space {
    let constraint = |constraint: &Constraint| v1::Constraint {
        lesser: constraint.lesser.clone(),
        greater: constraint.greater.clone(),
    };
    v1::Space {
        parameters: space.parameters.iter().map(parameter_to_wire).collect(),
        constraints: space.constraints.iter().map(constraint).collect(),
    }
}

fn parameter_to_wire(parameter: &Parameter) -> v1::Parameter {
    use v1::parameter::Domain as Wire;
    let domain = match &parameter.domain {
        Domain::Integer { min, max, scale } => {
            Wire::Integer(v1::IntegerDomain { min: *min, max: *max, scale: scale_to_wire(*scale) })
        }
        Domain::Float { min, max, scale } => {
            Wire::Float(v1::FloatDomain { min: *min, max: *max, scale: scale_to_wire(*scale) })
        }
        Domain::Categorical { values } => {
            Wire::Categorical(v1::CategoricalDomain { values: values.iter().map(value_to_wire).collect() })
        }
        Domain::Boolean => Wire::Boolean(v1::BooleanDomain {}),
    };
    v1::Parameter {
        name: parameter.name.clone(),
        domain: Some(domain),
        default_value: Some(value_to_wire(&parameter.default)),
        active_if: parameter.active_if.as_ref().map(|condition| v1::Condition {
            parameter: condition.parameter.clone(),
            any_of: condition.any_of.iter().map(value_to_wire).collect(),
        }),
    }
}

fn space_from_wire(space: v1::Space) -> Result<Space, Problem> {
    let constraints = space.constraints.into_iter();
    Ok(Space {
        parameters: space.parameters.into_iter().map(parameter_from_wire).collect::<Result<_, _>>()?,
        constraints: constraints
            .map(|each| Constraint { lesser: each.lesser, greater: each.greater })
            .collect(),
    })
}

fn parameter_from_wire(parameter: v1::Parameter) -> Result<Parameter, Problem> {
    use v1::parameter::Domain as Wire;
    let values = |values: Vec<v1::Value>| {
        values.into_iter().map(value_from_wire).collect::<Result<Vec<Value>, Problem>>()
    };
    let domain = match parameter.domain {
        Some(Wire::Integer(domain)) => {
            Domain::Integer { min: domain.min, max: domain.max, scale: scale_from_wire(domain.scale) }
        }
        Some(Wire::Float(domain)) => {
            Domain::Float { min: domain.min, max: domain.max, scale: scale_from_wire(domain.scale) }
        }
        Some(Wire::Categorical(domain)) => Domain::Categorical { values: values(domain.values)? },
        Some(Wire::Boolean(_)) => Domain::Boolean,
        None => return Err(format!("parameter {} without a domain", parameter.name)),
    };
    let default =
        parameter.default_value.ok_or_else(|| format!("parameter {} without a default", parameter.name))?;
    let active_if = match parameter.active_if {
        Some(condition) => {
            Some(Condition { parameter: condition.parameter, any_of: values(condition.any_of)? })
        }
        None => None,
    };
    Ok(Parameter { name: parameter.name, domain, default: value_from_wire(default)?, active_if })
}

fn indicator_to_wire(indicator: &Indicator) -> v1::Indicator {
    v1::Indicator {
        name: indicator.name.clone(),
        min: indicator.min,
        max: indicator.max,
        scale: scale_to_wire(indicator.scale),
    }
}

fn indicator_from_wire(indicator: v1::Indicator) -> Indicator {
    let scale = scale_from_wire(indicator.scale);
    Indicator { name: indicator.name, min: indicator.min, max: indicator.max, scale }
}

fn scale_to_wire(scale: Scale) -> i32 {
    match scale {
        Scale::Linear => v1::Scale::Linear.into(),
        Scale::Log => v1::Scale::Log.into(),
    }
}

fn scale_from_wire(scale: i32) -> Scale {
    if scale == i32::from(v1::Scale::Log) { Scale::Log } else { Scale::Linear }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Configuration;

    #[test]
    fn a_specification_survives_the_wire() {
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
            .build()
            .unwrap();
        let policy = Policy::new()
            .epsilon(0.0)
            .search(SearchMethod::Random)
            .predictor(PredictorMethod::RbfGreedyGq)
            .trials_per_state(7)
            .replicates(2)
            .lease_s(9)
            .pinned(Configuration::new().with("compact", true))
            .epsilon_halves_after(3)
            .regret_budget(0.05)
            .abort_above(1.5)
            .worst_factor(20.0)
            .operation(crate::Operation::Shadow)
            .weigh_gain(true)
            .freeze_risk(0.1)
            .warm_up(2)
            .roll_back(false);
        let spec = StudySpec::builder(space)
            .display_name("sponza")
            .indicator("triangles", 0.0..=1e6, Scale::Log)
            .minimise("build_ms", 0.5)
            .minimise("render_ms", 1.0)
            .state_tolerance(0.0)
            .policy(policy)
            .seed(u64::MAX)
            .build()
            .unwrap();
        let back = study_from_wire(spec_to_wire("studies/s".into(), &spec)).unwrap();
        assert_eq!(back.spec, spec);
        assert_eq!(back.id(), "s");
    }

    #[test]
    fn what_the_contract_does_not_allow_is_named() {
        assert_eq!(study_from_wire(v1::Study::default()).unwrap_err(), "a study without an objective");
        let parameter = v1::Parameter { name: "x".into(), ..v1::Parameter::default() };
        assert!(parameter_from_wire(parameter).unwrap_err().contains("parameter x"));
    }
}
