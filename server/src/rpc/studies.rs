//! Requests that concern a study.

use prost::Message as _;
use treewright_proto::v1 as wire;
use treewright_store::cursor;

use crate::convert::from_proto::{self, required};
use crate::convert::policy::PolicyUpdate;
use crate::convert::{names, to_proto};
use crate::error::Error;
use crate::limits::PAGE_BYTES;
use crate::tuning::Tuning;

/// What a page token of ListStudies belongs to.
const LIST_QUESTION: [&str; 1] = ["studies"];

pub(super) async fn create(tuning: &Tuning, request: wire::CreateStudyRequest) -> Result<wire::Study, Error> {
    let id = names::study_id("study_id", &request.study_id)?;
    let spec = from_proto::study(request.study.ok_or_else(|| required("study"))?)?;
    let record = tuning.create_study(&id, &spec).await?;
    Ok(to_proto::study(&record))
}

pub(super) async fn get(tuning: &Tuning, request: wire::GetStudyRequest) -> Result<wire::Study, Error> {
    let id = names::study("name", &request.name)?;
    Ok(to_proto::study(&tuning.get_study(&id).await?))
}

pub(super) async fn list(
    tuning: &Tuning,
    request: wire::ListStudiesRequest,
) -> Result<wire::ListStudiesResponse, Error> {
    let size = from_proto::page_size(request.page_size)?;
    let after = match request.page_token.as_str() {
        "" => None,
        token => {
            Some(cursor::open(token, &LIST_QUESTION).map_err(|error| Error::invalid("page_token", error))?)
        }
    };
    // One more than fits tells whether another page follows.
    let records = tuning.list_studies(after.as_deref(), size + 1).await?;
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

pub(super) async fn update(tuning: &Tuning, request: wire::UpdateStudyRequest) -> Result<wire::Study, Error> {
    let study = request.study.ok_or_else(|| required("study"))?;
    let id = names::study("study.name", &study.name)?;
    let update = PolicyUpdate::read(study.policy.unwrap_or_default(), request.update_mask)?;
    let record = tuning.update_policy(&id, &update).await?;
    Ok(to_proto::study(&record))
}

pub(super) async fn delete(tuning: &Tuning, request: wire::DeleteStudyRequest) -> Result<(), Error> {
    let id = names::study("name", &request.name)?;
    tuning.delete_study(&id).await
}
