//! Requests that concern a study.

use prost::Message as _;
use treewright_proto::convert::{signed, space_to_wire};
use treewright_proto::v1 as wire;
use treewright_store::limits::PAGE_SIZE_DEFAULT;
use treewright_store::{StoreError, StudyRecord, cursor};

use super::{Call, reach};
use crate::convert::from_proto::{self, required};
use crate::convert::policy_differences::policy_differences;
use crate::convert::study_update::StudyUpdate;
use crate::convert::{names, to_proto};
use crate::error::{Error, Result};
use crate::limits::PAGE_BYTES;

/// The question that a page token of ListStudies belongs to.
const LIST_QUESTION: [&str; 1] = ["studies"];

pub(super) async fn create(call: Call<'_>, request: wire::CreateStudyRequest) -> Result<wire::Study> {
    let id = names::study_id("study_id", &request.study_id)?;
    call.caller.reach(&id)?;
    let study = request.study.ok_or_else(|| required("study"))?;
    let given = study.policy.clone().unwrap_or_default();
    let spec = from_proto::study(study)?;
    // A client whose space is an earlier one of the study works with that.
    let answer = |stored: &StudyRecord, space_revision| wire::Study {
        policy_differs: policy_differences(&given, &spec.policy, &stored.spec.policy),
        space: Some(space_to_wire(&spec.space)),
        space_revision,
        ..to_proto::study(stored)
    };
    let spent = match call.caller.spend_study() {
        Ok(spent) => spent,
        // A caller that may create no more may still find an existing study. Nothing is created here, not
        // even where the study vanishes meanwhile.
        Err(over) => {
            let Ok(stored) = call.tuning.get_study(&id).await else { return Err(over) };
            return match stored.revision_of(&spec) {
                Ok(revision) => Ok(answer(&stored, revision)),
                Err(difference) => Err(StoreError::StudyExists { study: id, difference }.into()),
            };
        }
    };
    let created = call.tuning.create_study(&id, &spec).await?;
    if created.is_new {
        spent.keep();
    }
    let revision = created.study.revision_of(&spec);
    Ok(answer(&created.study, revision.unwrap_or_else(|_| created.study.earlier.revision())))
}

pub(crate) async fn get(call: Call<'_>, request: wire::GetStudyRequest) -> Result<wire::Study> {
    let name = reach::study(call, "name", &request.name).await?;
    let found = call.tuning.get_study(&name.id).await?;
    call.tuning.is_still(&name).await?;
    Ok(to_proto::study(&found))
}

pub(crate) async fn list(
    call: Call<'_>,
    request: wire::ListStudiesRequest,
) -> Result<wire::ListStudiesResponse> {
    let size = from_proto::page_size(request.page_size)?;
    let after = match request.page_token.as_str() {
        "" => None,
        token => {
            Some(cursor::open(token, &LIST_QUESTION).map_err(|error| Error::invalid("page_token", error))?)
        }
    };
    // One study more than fits shows whether another page follows.
    let records = visible(call, after, size + 1).await?;
    let mut studies = Vec::new();
    let mut bytes = 0;
    for record in records.iter().take(size as usize) {
        let study = to_proto::study(record);
        bytes += study.encoded_len();
        if bytes > PAGE_BYTES && !studies.is_empty() {
            break;
        }
        studies.push(study);
    }
    let more = studies.len() < records.len();
    let last = studies.len().checked_sub(1).map(|last| &records[last].id);
    let next_page_token = match last.filter(|_| more) {
        Some(last) => cursor::seal(last, &LIST_QUESTION),
        None => String::new(),
    };
    Ok(wire::ListStudiesResponse { studies, next_page_token })
}

/// The next studies that the caller may know of.
async fn visible(call: Call<'_>, mut after: Option<String>, size: u32) -> Result<Vec<StudyRecord>> {
    let mut found = Vec::new();
    // Where most are hidden, small pages would mean many.
    let page = if call.caller.is_limited() { size.max(PAGE_SIZE_DEFAULT) } else { size };
    loop {
        let records = call.tuning.list_studies(after.as_deref(), page).await?;
        let last_page = records.len() < page as usize;
        let before = std::mem::replace(&mut after, records.last().map(|record| record.id.clone()));
        assert!(after.is_none() || after > before, "these studies come again and again");
        found.extend(records.into_iter().filter(|record| call.caller.sees(&record.id)));
        if last_page || found.len() >= size as usize {
            found.truncate(size as usize);
            return Ok(found);
        }
    }
}

pub(crate) async fn update(call: Call<'_>, request: wire::UpdateStudyRequest) -> Result<wire::Study> {
    let study = request.study.ok_or_else(|| required("study"))?;
    let name = reach::study(call, "study.name", &study.name).await?;
    let update = StudyUpdate::read(study, request.update_mask)?;
    let record = call.tuning.update_study(&name, &update).await?;
    Ok(to_proto::study(&record))
}

pub(super) async fn rename(call: Call<'_>, request: wire::RenameStudyRequest) -> Result<wire::Study> {
    let name = reach::study(call, "name", &request.name).await?;
    let to = names::study_id("study_id", &request.study_id)?;
    call.caller.reach(&to)?;
    Ok(to_proto::study(&call.tuning.rename_study(&name, &to).await?))
}

pub(super) async fn change_space(
    call: Call<'_>,
    request: wire::ChangeSpaceRequest,
) -> Result<wire::ChangeSpaceResponse> {
    let name = reach::study(call, "name", &request.name).await?;
    let (record, effect) = call.tuning.change_space(&name, &from_proto::space_change(request)?).await?;
    Ok(wire::ChangeSpaceResponse {
        study: Some(to_proto::study(&record)),
        kept_trials: signed(effect.kept),
        outside_trials: signed(effect.outside),
        given_back_trials: signed(effect.given_back),
    })
}

pub(super) async fn delete(call: Call<'_>, request: wire::DeleteStudyRequest) -> Result<()> {
    let name = reach::study(call, "name", &request.name).await?;
    call.tuning.delete_study(&name).await
}
