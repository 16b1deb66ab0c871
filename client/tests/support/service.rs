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

    /// The answer to a call, once calls of its kind are not held back any more.
    async fn answer<Q, T>(
        &self,
        call: &'static str,
        kind: Option<Hold>,
        request: Q,
        work: impl FnOnce(&mut Book, Q) -> Result<T, Status>,
    ) -> Answer<T> {
        if let Some(kind) = kind {
            wait(&self.hold, kind).await;
        }
        let mut book = self.book();
        book.enter(call)?;
        work(&mut book, request).map(Response::new)
    }

    async fn stream(
        &self,
        mut requests: Streaming<v1::TuneRequest>,
    ) -> Answer<ReceiverStream<Result<v1::TuneResponse, Status>>> {
        wait(&self.hold, Hold::Everything).await;
        self.book().enter("Tune")?;
        let (answers, outgoing) = mpsc::channel(4);
        let (book, hold) = (Arc::clone(&self.book), self.hold.clone());
        tokio::spawn(async move {
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
}

/// Keeps a call waiting only while all are.
const EVERYTHING: Option<Hold> = Some(Hold::Everything);

async fn wait(hold: &watch::Sender<Hold>, kind: Hold) {
    let free = |hold: &Hold| *hold == Hold::Nothing || (*hold != Hold::Everything && *hold != kind);
    let _ = hold.subscribe().wait_for(free).await;
}

/// Implements the service: which work of the book each call is, and the kind of hold that keeps it waiting.
macro_rules! methods {
    ($($method:ident($request:ident) -> $answer:ty: $call:literal, $hold:expr, $work:expr;)+) => {
        #[tonic::async_trait]
        impl TuningService for Service {
            type TuneStream = ReceiverStream<Result<v1::TuneResponse, Status>>;

            async fn tune(&self, request: Request<Streaming<v1::TuneRequest>>) -> Answer<Self::TuneStream> {
                self.stream(request.into_inner()).await
            }

            $(
                async fn $method(&self, request: Request<v1::$request>) -> Answer<$answer> {
                    self.answer($call, $hold, request.into_inner(), $work).await
                }
            )+
        }
    };
}

methods! {
    create_study(CreateStudyRequest) -> v1::Study: "CreateStudy", EVERYTHING, Book::create;
    get_study(GetStudyRequest) -> v1::Study: "GetStudy", EVERYTHING, |book, request| {
        loaded(book)?;
        book.study(&request.name).cloned()
    };
    list_studies(ListStudiesRequest) -> v1::ListStudiesResponse: "ListStudies", EVERYTHING, |book, _| {
        let studies = book.studies.values().cloned().collect();
        Ok(v1::ListStudiesResponse { studies, next_page_token: String::new() })
    };
    update_study(UpdateStudyRequest) -> v1::Study: "UpdateStudy", None, update;
    rename_study(RenameStudyRequest) -> v1::Study: "RenameStudy", None, |book, request| {
        book.study(&request.name)?;
        let mut study = book.studies.remove(&request.name).expect("it was just there");
        study.name = format!("studies/{}", request.study_id);
        book.studies.insert(study.name.clone(), study.clone());
        Ok(study)
    };
    change_space(ChangeSpaceRequest) -> v1::ChangeSpaceResponse: "ChangeSpace", None, change_space;
    exclude_trial(ExcludeTrialRequest) -> v1::Trial: "ExcludeTrial", None, |book, request| {
        let trial = super::book::find(&mut book.trials, &request.trial)?;
        trial.exclusion = request.reason;
        Ok(trial.clone())
    };
    delete_study(DeleteStudyRequest) -> (): "DeleteStudy", None, |book, request| {
        book.study(&request.name)?;
        book.studies.remove(&request.name);
        Ok(())
    };
    suggest(SuggestRequest) -> v1::Trial: "Suggest", Some(Hold::Suggestions), |book, request| {
        loaded(book)?;
        book.suggest(request)
    };
    report(ReportRequest) -> v1::ReportResponse: "Report", Some(Hold::Reports), |book, request| {
        let answer = book.report(request)?;
        if book.lose_answers > 0 {
            book.lose_answers -= 1;
            return Err(Status::unavailable("the answer is lost"));
        }
        Ok(answer)
    };
    predict(PredictRequest) -> v1::PredictResponse: "Predict", None, predict;
    abandon_trial(AbandonTrialRequest) -> v1::Trial: "AbandonTrial", EVERYTHING, |book, request| {
        book.abandon(&request.trial)
    };
    extend_lease(ExtendLeaseRequest) -> v1::Trial: "ExtendLease", None, |book, request| {
        book.extend(&request.trial)
    };
    get_trial(GetTrialRequest) -> v1::Trial: "GetTrial", None, |book, request| {
        super::book::find(&mut book.trials, &request.name).cloned()
    };
    query_trials(QueryTrialsRequest) -> v1::QueryTrialsResponse: "QueryTrials", None, |book, request| {
        book.asked.push(request.study.clone());
        book.query(&request)
    };
    get_best(GetBestRequest) -> v1::Best: "GetBest", None, |book, request| {
        loaded(book)?;
        book.asked.push(request.study.clone());
        book.best(&request)
    };
}

fn update(book: &mut Book, request: v1::UpdateStudyRequest) -> Result<v1::Study, Status> {
    let (change, mask) = (request.study.unwrap_or_default(), request.update_mask.unwrap_or_default());
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
    Ok(study.clone())
}

fn change_space(book: &mut Book, request: v1::ChangeSpaceRequest) -> Result<v1::ChangeSpaceResponse, Status> {
    let v1::ChangeSpaceRequest { name, revision, space, validate_only, .. } = request;
    let mut study = book.study(&name)?.clone();
    if study.space_revision != revision {
        return Err(Status::failed_precondition(format!("not revision {revision}")));
    }
    if !validate_only {
        (study.space, study.space_revision) = (space, revision + 1);
        book.studies.insert(study.name.clone(), study.clone());
    }
    Ok(v1::ChangeSpaceResponse { study: Some(study), ..Default::default() })
}

fn predict(book: &mut Book, request: v1::PredictRequest) -> Result<v1::PredictResponse, Status> {
    if request.indicators.is_empty() {
        return Err(Status::invalid_argument("indicators: `triangles` is missing"));
    }
    book.asked.push(request.study.clone());
    loaded(book)?;
    if let Some(predicted) = book.predicted.clone() {
        return Ok(predicted);
    }
    let v1::PredictRequest { study, indicators, fingerprint, .. } = request;
    let best = book.best(&v1::GetBestRequest { study, indicators, fingerprint, ..Default::default() })?;
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
    Ok(v1::PredictResponse { configuration, mode, predicted_cost, reason, state })
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
