//! Requests that concern trials.

use prost::Message as _;
use treewright_proto::convert::{configuration_to_wire, fingerprint_from_wire};
use treewright_proto::v1 as wire;
use treewright_store::cursor::Cursor;
use treewright_store::filter::{Filter, Order};
use treewright_store::{StudyRecord, TrialQuery};

use super::{Call, reach};
use crate::convert::names::StudyName;
use crate::convert::{from_proto, to_proto};
use crate::error::{Error, Result};
use crate::limits::PAGE_BYTES;
use crate::tuning::Reported;

pub(super) async fn suggest(call: Call<'_>, request: wire::SuggestRequest) -> Result<wire::Trial> {
    let reports_waiting = request.reports_waiting;
    let mut suggest = from_proto::suggest(request)?;
    suggest.study = reach::find(call, suggest.study).await?;
    let spent = call.caller.spend_trial()?;
    let study = suggest.study.clone();
    let trial = call.tuning.suggest(suggest).await?;
    call.tuning.metrics().outbox_reported(reports_waiting);
    spent.keep();
    Ok(to_proto::trial(&study, &trial))
}

pub(super) async fn report(call: Call<'_>, request: wire::ReportRequest) -> Result<wire::ReportResponse> {
    let mut report = from_proto::report(request)?;
    report.trial.study = reach::find(call, report.trial.study).await?;
    let study = report.trial.study.clone();
    Ok(reported(&study, &call.tuning.report(report).await?))
}

pub(super) fn reported(study: &StudyName, reported: &Reported) -> wire::ReportResponse {
    let (trial, duplicate) = match reported {
        Reported::Taken(trial) => (to_proto::trial(study, trial), false),
        Reported::Duplicate(trial) => (to_proto::trial(study, trial), true),
    };
    wire::ReportResponse { trial: Some(trial), duplicate }
}

pub(crate) async fn predict(call: Call<'_>, request: wire::PredictRequest) -> Result<wire::PredictResponse> {
    let study = reach::study(call, "study", &request.study).await?;
    let fingerprint = request.fingerprint.map(fingerprint_from_wire).transpose()?;
    let (indicators, revision) = (&request.indicators, request.space_revision);
    let (fingerprint, start) = (fingerprint.as_ref(), from_proto::start(request.start)?);
    let prediction = call.tuning.predict(&study, indicators, fingerprint, start.as_ref(), revision).await?;
    Ok(to_proto::prediction(&prediction))
}

pub(super) async fn abandon(call: Call<'_>, request: wire::AbandonTrialRequest) -> Result<wire::Trial> {
    let name = reach::trial(call, "trial", &request.trial).await?;
    Ok(to_proto::trial(&name.study, &call.tuning.abandon(&name).await?))
}

pub(super) async fn extend_lease(call: Call<'_>, request: wire::ExtendLeaseRequest) -> Result<wire::Trial> {
    let name = reach::trial(call, "trial", &request.trial).await?;
    let trial = call.tuning.extend_lease(&name).await?;
    Ok(to_proto::trial(&name.study, &trial))
}

pub(crate) async fn exclude(call: Call<'_>, request: wire::ExcludeTrialRequest) -> Result<wire::Trial> {
    let name = reach::trial(call, "trial", &request.trial).await?;
    let reason = from_proto::exclusion(&request)?;
    let trial = call.tuning.exclude_trial(&name, reason).await?;
    Ok(to_proto::trial(&name.study, &trial))
}

pub(crate) async fn get(call: Call<'_>, request: wire::GetTrialRequest) -> Result<wire::Trial> {
    let name = reach::trial(call, "name", &request.name).await?;
    let trial = call.tuning.get_trial(&name).await?;
    Ok(to_proto::trial(&name.study, &trial))
}

pub(crate) async fn query(
    call: Call<'_>,
    request: wire::QueryTrialsRequest,
) -> Result<wire::QueryTrialsResponse> {
    let study = reach::study(call, "study", &request.study).await?;
    let filter = Filter::parse(&request.filter).map_err(|error| Error::invalid("filter", error))?;
    let order = Order::parse(&request.order_by).map_err(|error| Error::invalid("order_by", error))?;
    let mut present = None;
    if filter.has_names() || request.in_present_space {
        let StudyRecord { spec, earlier, .. } = call.tuning.get_study(&study.id).await?;
        let named = filter.check_names(&request.filter, &spec, &earlier);
        named.map_err(|error| Error::invalid("filter", error))?;
        present = request.in_present_space.then_some((spec.space, earlier));
    }
    let question = [study.id.as_str(), &request.filter, &request.order_by];
    let after =
        Cursor::parse(&request.page_token, &question).map_err(|error| Error::invalid("page_token", error))?;
    let query = TrialQuery { filter, order, after, size: from_proto::page_size(request.page_size)? };
    let page = call.tuning.query_trials(&study, &query).await?;

    let mut next = page.next;
    let mut trials = Vec::with_capacity(page.trials.len());
    let (mut bytes, mut last) = (0, None);
    for trial in page.trials {
        let mut answer = to_proto::trial(&study, &trial);
        bytes += answer.encoded_len();
        if let Some(last) = last.as_ref().filter(|_| bytes > PAGE_BYTES) {
            next = Some(query.order.place(last));
            break;
        }
        let mut is_inside = true;
        if let Some((space, earlier)) = &present {
            let revision = earlier.revision_of(trial.number);
            let adopted = earlier.adopt(revision, trial.configuration.clone(), space);
            is_inside = adopted.is_some();
            answer.configuration = adopted.map(|configuration| configuration_to_wire(&configuration));
        }
        trials.extend(is_inside.then_some(answer));
        last = Some(trial);
    }
    let next_page_token = next.map_or_else(String::new, |next| next.token(&question));
    Ok(wire::QueryTrialsResponse { trials, next_page_token })
}

pub(crate) async fn best(call: Call<'_>, request: wire::GetBestRequest) -> Result<wire::Best> {
    let study = reach::study(call, "study", &request.study).await?;
    let indicators = Some(&request.indicators).filter(|given| !given.is_empty());
    let fingerprint = request.fingerprint.map(fingerprint_from_wire).transpose()?;
    let (fingerprint, revision) = (fingerprint.as_ref(), request.space_revision);
    let start = from_proto::start(request.start)?;
    let (best, is_best) = call.tuning.best(&study, indicators, fingerprint, start.as_ref(), revision).await?;
    Ok(to_proto::best(&study, &best, is_best))
}
