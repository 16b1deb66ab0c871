//! The stand-in's network side.

use std::sync::{Arc, Mutex, MutexGuard};

use tokio::sync::{mpsc, watch};
use tokio_stream::wrappers::{ReceiverStream, TcpListenerStream};
use tonic::{Code, Request, Response, Status, Streaming};
use treewright_proto::v1::tuning_service_server::{TuningService, TuningServiceServer};
use treewright_proto::v1::{self, TuneError};

use super::{Book, Hold};

pub struct Service {
    pub book: Arc<Mutex<Book>>,
    pub hold: watch::Sender<Hold>,
}

/// A `google.rpc.Status` with a `RetryInfo` of one millisecond in its details, as bytes.
fn again_in_a_millisecond() -> Vec<u8> {
    const URL: &[u8] = b"type.googleapis.com/google.rpc.RetryInfo";
    const RETRY_INFO: [u8; 6] = [0x0a, 4, 0x10, 0xc0, 0x84, 0x3d];
    let length = |bytes: &[u8]| u8::try_from(bytes.len()).expect("a short text");
    let any = [&[0x0a, length(URL)][..], URL, &[0x12, length(&RETRY_INFO)], &RETRY_INFO].concat();
    [&[0x1a, length(&any)][..], &any].concat()
}

/// Refuses as long as the study counts as being loaded.
fn loaded(book: &mut Book) -> Result<(), Status> {
    let Some(left) = book.loading.checked_sub(1) else { return Ok(()) };
    book.loading = left;
    let words = "study \"scene\" is being loaded; try again";
    Err(Status::with_details(Code::Unavailable, words, again_in_a_millisecond().into()))
}

type Answer<T> = Result<Response<T>, Status>;

impl Service {
    pub async fn serve(self, listener: tokio::net::TcpListener) {
        let (health, health_service) = tonic_health::server::health_reporter();
        health.set_service_status("", tonic_health::ServingStatus::Serving).await;
        let served = tonic::transport::Server::builder()
            .add_service(health_service)
            .add_service(TuningServiceServer::new(self))
            .serve_with_incoming(TcpListenerStream::new(listener))
            .await;
        served.expect("the stand-in serves until it is dropped");
    }

    fn book(&self) -> MutexGuard<'_, Book> {
        self.book.lock().expect("no test panics inside the book")
    }

    /// Waits as long as calls of this kind are held back.
    async fn wait(&self, kind: Hold) {
        wait(&self.hold, kind).await;
    }
}

async fn wait(hold: &watch::Sender<Hold>, kind: Hold) {
    let free = |hold: &Hold| *hold == Hold::Nothing || (*hold != Hold::Everything && *hold != kind);
    let _ = hold.subscribe().wait_for(free).await;
}

#[tonic::async_trait]
impl TuningService for Service {
    async fn create_study(&self, request: Request<v1::CreateStudyRequest>) -> Answer<v1::Study> {
        self.wait(Hold::Everything).await;
        let mut book = self.book();
        book.enter("CreateStudy")?;
        book.create(request.into_inner()).map(Response::new)
    }

    async fn get_study(&self, request: Request<v1::GetStudyRequest>) -> Answer<v1::Study> {
        self.wait(Hold::Everything).await;
        let mut book = self.book();
        book.enter("GetStudy")?;
        loaded(&mut book)?;
        book.study(&request.into_inner().name).cloned().map(Response::new)
    }

    async fn list_studies(&self, _: Request<v1::ListStudiesRequest>) -> Answer<v1::ListStudiesResponse> {
        self.wait(Hold::Everything).await;
        let studies = self.book().studies.values().cloned().collect();
        Ok(Response::new(v1::ListStudiesResponse { studies, next_page_token: String::new() }))
    }

    async fn update_study(&self, request: Request<v1::UpdateStudyRequest>) -> Answer<v1::Study> {
        let v1::UpdateStudyRequest { study, update_mask } = request.into_inner();
        let (change, mask) = (study.unwrap_or_default(), update_mask.unwrap_or_default());
        let mut book = self.book();
        let name = book.study(&change.name)?.name.clone();
        let wanted = change.policy.unwrap_or_default();
        let study = book.studies.get_mut(&name).expect("it was just there");
        let policy = study.policy.get_or_insert_default();
        for path in mask.paths {
            match path.as_str() {
                "policy.epsilon" => policy.epsilon = wanted.epsilon,
                "policy.pinned" => policy.pinned.clone_from(&wanted.pinned),
                "policy.lease_s" => policy.lease_s = wanted.lease_s,
                "policy.search" => policy.search = wanted.search,
                "display_name" => study.display_name.clone_from(&change.display_name),
                "note" => study.note.clone_from(&change.note),
                "tags" => study.tags.clone_from(&change.tags),
                other => {
                    let wrong = || Status::invalid_argument(format!("update_mask: {other}"));
                    let tag = other.strip_prefix("tags.").ok_or_else(wrong)?;
                    study.tags.retain(|known| known != tag);
                    study.tags.extend(change.tags.iter().find(|given| *given == tag).cloned());
                }
            }
        }
        Ok(Response::new(study.clone()))
    }

    async fn rename_study(&self, request: Request<v1::RenameStudyRequest>) -> Answer<v1::Study> {
        let v1::RenameStudyRequest { name, study_id } = request.into_inner();
        let mut book = self.book();
        book.study(&name)?;
        let mut study = book.studies.remove(&name).expect("it was just there");
        study.name = format!("studies/{study_id}");
        book.studies.insert(study.name.clone(), study.clone());
        Ok(Response::new(study))
    }

    async fn change_space(
        &self,
        request: Request<v1::ChangeSpaceRequest>,
    ) -> Answer<v1::ChangeSpaceResponse> {
        let v1::ChangeSpaceRequest { name, revision, space, validate_only, .. } = request.into_inner();
        let mut book = self.book();
        let mut study = book.study(&name)?.clone();
        if study.space_revision != revision {
            return Err(Status::failed_precondition(format!("not revision {revision}")));
        }
        if !validate_only {
            (study.space, study.space_revision) = (space, revision + 1);
            book.studies.insert(study.name.clone(), study.clone());
        }
        Ok(Response::new(v1::ChangeSpaceResponse { study: Some(study), ..Default::default() }))
    }

    async fn exclude_trial(&self, request: Request<v1::ExcludeTrialRequest>) -> Answer<v1::Trial> {
        let v1::ExcludeTrialRequest { trial, reason, .. } = request.into_inner();
        let mut book = self.book();
        let trial = super::book::find(&mut book.trials, &trial)?;
        trial.exclusion = reason;
        Ok(Response::new(trial.clone()))
    }

    async fn delete_study(&self, request: Request<v1::DeleteStudyRequest>) -> Answer<()> {
        let name = request.into_inner().name;
        let mut book = self.book();
        book.study(&name)?;
        book.studies.remove(&name);
        Ok(Response::new(()))
    }

    async fn suggest(&self, request: Request<v1::SuggestRequest>) -> Answer<v1::Trial> {
        self.wait(Hold::Suggestions).await;
        let mut book = self.book();
        book.enter("Suggest")?;
        loaded(&mut book)?;
        book.suggest(request.into_inner()).map(Response::new)
    }

    async fn report(&self, request: Request<v1::ReportRequest>) -> Answer<v1::ReportResponse> {
        self.wait(Hold::Reports).await;
        let mut book = self.book();
        book.enter("Report")?;
        let answer = book.report(request.into_inner())?;
        if book.lose_answers > 0 {
            book.lose_answers -= 1;
            return Err(Status::unavailable("the answer is lost"));
        }
        Ok(Response::new(answer))
    }

    type TuneStream = ReceiverStream<Result<v1::TuneResponse, Status>>;

    async fn tune(&self, request: Request<Streaming<v1::TuneRequest>>) -> Answer<Self::TuneStream> {
        self.wait(Hold::Everything).await;
        self.book().enter("Tune")?;
        let (answers, outgoing) = mpsc::channel(4);
        let (book, hold) = (Arc::clone(&self.book), self.hold.clone());
        tokio::spawn(async move {
            let mut requests = request.into_inner();
            while let Ok(Some(request)) = requests.message().await {
                wait(&hold, Hold::Suggestions).await;
                let answer = tune(&mut book.lock().expect("no test panics inside the book"), request);
                let Some(answer) = answer else { break };
                if answers.send(Ok(answer)).await.is_err() {
                    break;
                }
            }
        });
        Ok(Response::new(ReceiverStream::new(outgoing)))
    }

    async fn predict(&self, request: Request<v1::PredictRequest>) -> Answer<v1::PredictResponse> {
        let request = request.into_inner();
        if request.indicators.is_empty() {
            return Err(Status::invalid_argument("indicators: `triangles` is missing"));
        }
        let mut book = self.book();
        book.enter("Predict")?;
        book.asked.push(request.study.clone());
        loaded(&mut book)?;
        if let Some(predicted) = book.predicted.clone() {
            return Ok(Response::new(predicted));
        }
        let v1::PredictRequest { study, indicators, fingerprint, .. } = request;
        let best = book.best(&v1::GetBestRequest { study, indicators, fingerprint, space_revision: 0 })?;
        let reason = v1::Reason {
            summary: "The nearest known state is 0.25 away.".into(),
            source: "nearest_neighbour".into(),
            step: String::new(),
            neighbours: vec![v1::Neighbour { state_id: 1, distance: 0.25, best_cost: best.cost }],
            explanation: Some(v1::Explanation { rule: v1::Rule::Exploit.into(), ..Default::default() }),
        };
        let (configuration, mode) = (best.configuration, v1::Mode::Exploit.into());
        let predicted_cost = Some(best.cost);
        let state = Some(v1::StateInsight {
            state_id: 1,
            tried: 3,
            noise: Some(0.04),
            expected_gain: Some(0.11),
            expected_frames: Some(20.0),
            exploring_cost: Some(3.5),
            omissions: vec![v1::Omission {
                parameter: "compact".into(),
                reason: v1::OmissionReason::Inactive.into(),
                summary: "it means nothing beside the best known value of builder".into(),
                saved_trials: 7.5,
            }],
            ..Default::default()
        });
        let reason = Some(reason);
        Ok(Response::new(v1::PredictResponse { configuration, mode, predicted_cost, reason, state }))
    }

    async fn abandon_trial(&self, request: Request<v1::AbandonTrialRequest>) -> Answer<v1::Trial> {
        self.wait(Hold::Everything).await;
        let mut book = self.book();
        book.enter("AbandonTrial")?;
        book.abandon(&request.into_inner().trial).map(Response::new)
    }

    async fn extend_lease(&self, request: Request<v1::ExtendLeaseRequest>) -> Answer<v1::Trial> {
        let mut book = self.book();
        book.enter("ExtendLease")?;
        book.extend(&request.into_inner().trial).map(Response::new)
    }

    async fn get_trial(&self, request: Request<v1::GetTrialRequest>) -> Answer<v1::Trial> {
        let name = request.into_inner().name;
        let found = self.book().trials.iter().find(|trial| trial.name == name).cloned();
        found.map(Response::new).ok_or_else(|| Status::not_found(name))
    }

    async fn query_trials(
        &self,
        request: Request<v1::QueryTrialsRequest>,
    ) -> Answer<v1::QueryTrialsResponse> {
        let mut book = self.book();
        book.enter("QueryTrials")?;
        let request = request.into_inner();
        book.asked.push(request.study.clone());
        book.query(&request).map(Response::new)
    }

    async fn get_best(&self, request: Request<v1::GetBestRequest>) -> Answer<v1::Best> {
        let mut book = self.book();
        book.enter("GetBest")?;
        loaded(&mut book)?;
        let request = request.into_inner();
        book.asked.push(request.study.clone());
        book.best(&request).map(Response::new)
    }
}

/// One answer of a stream; `None` breaks it.
fn tune(book: &mut Book, request: v1::TuneRequest) -> Option<v1::TuneResponse> {
    let error = |status: Status| TuneError {
        code: status.code().into(),
        message: status.message().to_owned(),
        retry_after_ms: None,
    };
    let mut answer = v1::TuneResponse::default();
    if let Some(report) = request.report {
        match book.enter("streamed Report").and_then(|()| book.report(report)) {
            Ok(reported) => answer.reported = Some(reported),
            Err(status) => answer.report_error = Some(error(status)),
        }
    }
    if book.break_streams > 0 {
        book.break_streams -= 1;
        return None;
    }
    if let Some(suggest) = request.suggest {
        match book.enter("streamed Suggest").and_then(|()| book.suggest(suggest)) {
            Ok(trial) => answer.trial = Some(trial),
            Err(status) => answer.suggest_error = Some(error(status)),
        }
    }
    Some(answer)
}
