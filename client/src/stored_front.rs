//! The Pareto front of the trials that a study has stored, whatever the study minimises.

use std::collections::BTreeSet;
use std::sync::Arc;

use treewright_model::front::{Front, ParetoFront};

use crate::client::study_name;
use crate::core::Core;
use crate::front::is_measured;
use crate::pages::TrialPages;
use crate::{Client, ClientError, Configuration, Study, StudyRecord, StudySpec, TrialQuery, TrialRecord};

/// Which front of a study's trials. The default is the one that the study was made for.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FrontQuery {
    /// The metrics, of which the study need not minimise any; `None` for those that it was made for.
    pub front: Option<Front>,
    /// The number of a state. Needed where trials are of several inputs or machines: these do not compare.
    pub state: Option<i64>,
    /// A value of each metric, above 0, to which the hypervolume refers; `None` for those of the default.
    pub reference: Option<Vec<f64>>,
}

impl Client {
    /// The Pareto front of a study's stored trials. Those do not count that are excluded, ran at a cheaper
    /// level, or are outside the study's present space.
    ///
    /// Errors: [`ClientError::Invalid`] where no metrics are named and the study was made for none, for
    /// trials that do not compare, for a state without trials, and for a reference that is none. Also
    /// [`ClientError::Refused`], [`ClientError::Away`], [`ClientError::Late`].
    pub async fn front(&self, study: &str, query: &FrontQuery) -> Result<ParetoFront, ClientError> {
        read(&self.core, &study_name(study), query).await
    }
}

impl Study {
    /// See [`Client::front`]. Errors: as there.
    pub async fn front(&self, query: &FrontQuery) -> Result<ParetoFront, ClientError> {
        let context = &self.shared.context;
        read(&context.core, &context.asked_name(), query).await
    }
}

async fn read(core: &Arc<Core>, name: &str, query: &FrontQuery) -> Result<ParetoFront, ClientError> {
    let study = core.study_record(name).await?;
    let spec = study.spec()?;
    let Some(front) = query.front.clone().or_else(|| Front::of_study(&study.display_name)) else {
        let problem = format!("{} was made for none; name two or three of its measurements", study.name);
        return Err(ClientError::invalid("metrics of a front", problem));
    };
    let reference = query.reference.as_deref();
    let is_value = |value: &f64| Front::is_usable(*value);
    if reference.is_some_and(|all| all.len() != front.metrics().count() || !all.iter().all(is_value)) {
        return Err(ClientError::invalid("reference of a front", "give one number above 0 for each metric"));
    }
    let completed = TrialQuery::all().filter("state = COMPLETED").in_present_space();
    let trials =
        TrialPages::new(Arc::clone(core), study.identified_name(), completed).take(usize::MAX).await?;
    let trials = comparable(&study, spec, trials, query.state)?;
    let default = Configuration::from(spec.space.default_configuration());
    Ok(front.of(trials.iter().filter_map(TrialRecord::measured_run), &default, reference))
}

/// The trials of one input and one machine that may be on a front. Its directions are states of one input.
fn comparable(
    study: &StudyRecord,
    spec: &StudySpec,
    mut trials: Vec<TrialRecord>,
    state: Option<i64>,
) -> Result<Vec<TrialRecord>, ClientError> {
    if let Some(state) = state.filter(|state| trials.iter().all(|trial| trial.state_id != *state)) {
        let problem =
            format!("{} has no completed trial in state {state}; each trial has its number", study.name);
        return Err(ClientError::invalid("state", problem));
    }
    trials.retain(is_measured);
    let has_inputs = spec.indicators.indicators().iter().any(|indicator| indicator.name != Front::DIRECTION);
    let machine = |trial: &TrialRecord| trial.fingerprint.as_ref().map(|machine| format!("{machine:?}"));
    if let Some(state) = state {
        let of_state = trials.iter().find(|trial| trial.state_id == state).map(machine);
        let is_meant =
            |trial: &TrialRecord| trial.state_id == state || !has_inputs && Some(machine(trial)) == of_state;
        trials.retain(is_meant);
        return Ok(trials);
    }
    let machines: BTreeSet<_> = trials.iter().map(machine).collect();
    let states: BTreeSet<_> = trials.iter().map(|trial| trial.state_id).collect();
    if machines.len() > 1 || has_inputs && states.len() > 1 {
        let (states, machines) = (states.len(), machines.len());
        let problem = format!(
            "{} has runs in {states} states, on {machines} machine(s), which do not compare: name one state \
             by its number",
            study.name
        );
        return Err(ClientError::invalid("state", problem));
    }
    Ok(trials)
}
