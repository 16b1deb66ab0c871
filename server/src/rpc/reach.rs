//! The study of a request, and the check that its caller may know of it.

use crate::access::caller::Caller;
use crate::convert::names::{self, StudyName, TrialName};
use crate::error::Error;
use crate::tuning::Tuning;

pub(super) async fn study(
    tuning: &Tuning,
    caller: &Caller,
    field: &str,
    name: &str,
) -> Result<StudyName, Error> {
    find(tuning, caller, names::study(field, name)?).await
}

pub(super) async fn trial(
    tuning: &Tuning,
    caller: &Caller,
    field: &str,
    name: &str,
) -> Result<TrialName, Error> {
    let TrialName { study, number } = names::trial(field, name)?;
    Ok(TrialName { study: find(tuning, caller, study).await?, number })
}

/// The study that a request names, under its present id, for which tokens are valid. A hidden study is denied
/// with equal words whether it exists or not.
pub(super) async fn find(tuning: &Tuning, caller: &Caller, name: StudyName) -> Result<StudyName, Error> {
    let (asked, uid) = (name.id.clone(), name.uid);
    match tuning.find(name).await {
        Ok(found) => {
            debug_assert_eq!(found.uid, uid, "study {} is not the one that was asked for", found.id);
            caller.reach(&found.id).map(|()| found)
        }
        Err(error) => caller.reach(&asked).and(Err(error)),
    }
}
