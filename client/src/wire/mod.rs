//! Messages as records of this crate. Shared conversions are in `treewright_proto::convert`.
//!
//! One entry of a newer daemon never makes a whole list unreadable: unknown words are carried along, and an
//! entry keeps the reason why it cannot be read. A caller that must act on the entry fails with that reason.

mod insight;
mod trial;

pub(crate) use trial::{best_from_wire, prediction_from_wire, trial_from_wire};

use treewright_model::words::OpenEnum;
use treewright_proto::convert::{WireEnum, configuration_from_wire, policy_from_wire, spec_from_wire};
use treewright_proto::v1;

use crate::{Configuration, StudyRecord, StudyStatistics};

/// Something the daemon sent that the contract does not allow; says what.
pub(crate) type Problem = String;

/// A study; what cannot be read of its specification stands in the record.
pub(crate) fn study_from_wire(study: v1::Study) -> Result<StudyRecord, Problem> {
    let statistics = study.statistics.unwrap_or_default();
    let policy = policy_from_wire("study.policy", study.policy.clone().unwrap_or_default());
    Ok(StudyRecord {
        name: study.name.clone(),
        uid: study.uid.clone(),
        display_name: study.display_name.clone(),
        note: study.note.clone(),
        tags: study.tags.iter().cloned().collect(),
        policy: policy.map_err(|problem| problem.to_string())?,
        create_time: time_from_wire(study.create_time),
        policy_differs: study.policy_differs.clone(),
        space_revision: study.space_revision,
        statistics: StudyStatistics {
            states: statistics.states,
            trials: statistics.trials,
            completed_trials: statistics.completed_trials,
            open_trials: statistics.open_trials,
        },
        spec: spec_from_wire(study).map_err(|problem| problem.to_string()),
    })
}

/// A configuration that is to be used, and so must be read as a whole.
fn usable_configuration(wire: Option<v1::Configuration>) -> Result<Configuration, Problem> {
    let read = configuration_from_wire("configuration", wire.ok_or("no configuration")?);
    read.map(Into::into).map_err(|problem| problem.to_string())
}

/// A word; `Unrecognised(0)` where none was said.
fn word<T: WireEnum>(number: i32) -> OpenEnum<T> {
    T::from_number(number).unwrap_or(OpenEnum::Unrecognised(0))
}

/// A time, where there is one that this machine can represent.
fn time_from_wire(time: Option<prost_types::Timestamp>) -> Option<std::time::SystemTime> {
    time.and_then(|time| time.try_into().ok())
}
