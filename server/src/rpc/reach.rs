//! The study of a request, and the check that its caller may know of it.

use super::Call;
use crate::convert::names::{self, StudyName, TrialName};
use crate::error::Result;

pub(super) async fn study(call: Call<'_>, field: &str, name: &str) -> Result<StudyName> {
    find(call, names::study(field, name)?).await
}

pub(super) async fn trial(call: Call<'_>, field: &str, name: &str) -> Result<TrialName> {
    let TrialName { study, number } = names::trial(field, name)?;
    Ok(TrialName { study: find(call, study).await?, number })
}

/// The study that a request names, under its present id, for which tokens are valid. A hidden study is denied
/// with equal words whether it exists or not.
pub(super) async fn find(call: Call<'_>, name: StudyName) -> Result<StudyName> {
    let (asked, uid) = (name.id.clone(), name.uid);
    match call.tuning.find(name).await {
        Ok(found) => {
            debug_assert_eq!(found.uid, uid, "study {} is not the one that was asked for", found.id);
            call.caller.reach(&found.id).map(|()| found)
        }
        Err(error) => call.caller.reach(&asked).and(Err(error)),
    }
}
