//! The gRPC service: reads each request, calls its use case, writes the answer.
//!
//! `studies` and `trials` hold the handlers by topic, `tune` the stream. What they share is here: every
//! request passes the gate, and every refusal is logged once.

mod frames;
mod studies;
mod trials;
mod tune;

use std::sync::Arc;

use tonic::{Code, Request, Response, Status, Streaming};
use treewright_proto::v1::tuning_service_server::TuningService;
use treewright_proto::v1::{self as wire};

use crate::error::Error;
use crate::gate::Gate;
use crate::peers::Peers;
use crate::status;
use crate::tuning::Tuning;

/// `treewright.v1.TuningService`.
#[derive(Clone)]
pub struct Service {
    tuning: Arc<Tuning>,
    gate: Gate,
    peers: Option<Arc<Peers>>,
}

impl Service {
    /// The service on its use cases.
    #[must_use]
    pub fn new(tuning: Arc<Tuning>, gate: Gate) -> Self {
        Self { tuning, gate, peers: None }
    }

    /// Passes frames of Tune streams on to the replicas that hold their studies.
    #[must_use]
    pub fn with_peers(self, peers: Option<Arc<Peers>>) -> Self {
        Self { peers, ..self }
    }

    /// Lets a request in, does its work, and answers.
    async fn answer<T>(
        &self,
        rpc: &'static str,
        work: impl Future<Output = Result<T, Error>> + Send,
    ) -> Result<Response<T>, Status> {
        let answer = match self.gate.request() {
            Ok(_entered) => work.await,
            Err(error) => Err(error),
        };
        match answer {
            Ok(answer) => Ok(Response::new(answer)),
            Err(error) => {
                note_refusal(rpc, &error);
                Err(error.into())
            }
        }
    }
}

/// One line for a request that was refused.
fn note_refusal(rpc: &'static str, error: &Error) {
    let code = status::code(error);
    if code == Code::Internal {
        tracing::error!(rpc, ?code, %error, "request failed");
    } else {
        tracing::warn!(rpc, ?code, %error, "request refused");
    }
}

#[tonic::async_trait]
impl TuningService for Service {
    async fn create_study(
        &self,
        request: Request<wire::CreateStudyRequest>,
    ) -> Result<Response<wire::Study>, Status> {
        let work = studies::create(&self.tuning, request.into_inner());
        self.answer("CreateStudy", work).await
    }

    async fn get_study(
        &self,
        request: Request<wire::GetStudyRequest>,
    ) -> Result<Response<wire::Study>, Status> {
        let work = studies::get(&self.tuning, request.into_inner());
        self.answer("GetStudy", work).await
    }

    async fn list_studies(
        &self,
        request: Request<wire::ListStudiesRequest>,
    ) -> Result<Response<wire::ListStudiesResponse>, Status> {
        let work = studies::list(&self.tuning, request.into_inner());
        self.answer("ListStudies", work).await
    }

    async fn update_study(
        &self,
        request: Request<wire::UpdateStudyRequest>,
    ) -> Result<Response<wire::Study>, Status> {
        let work = studies::update(&self.tuning, request.into_inner());
        self.answer("UpdateStudy", work).await
    }

    async fn delete_study(&self, request: Request<wire::DeleteStudyRequest>) -> Result<Response<()>, Status> {
        let work = studies::delete(&self.tuning, request.into_inner());
        self.answer("DeleteStudy", work).await
    }

    async fn suggest(&self, request: Request<wire::SuggestRequest>) -> Result<Response<wire::Trial>, Status> {
        let work = trials::suggest(&self.tuning, request.into_inner());
        self.answer("Suggest", work).await
    }

    async fn report(
        &self,
        request: Request<wire::ReportRequest>,
    ) -> Result<Response<wire::ReportResponse>, Status> {
        let work = trials::report(&self.tuning, request.into_inner());
        self.answer("Report", work).await
    }

    type TuneStream = tune::Answers;

    async fn tune(
        &self,
        request: Request<Streaming<wire::TuneRequest>>,
    ) -> Result<Response<Self::TuneStream>, Status> {
        match self.gate.stream() {
            Ok(entered) => {
                let tuning = Arc::clone(&self.tuning);
                let way = frames::Frames::new(self.peers.clone(), request.metadata());
                let frames = request.into_inner();
                let answers = tune::serve(tuning, self.gate.clone(), entered, way, frames);
                Ok(Response::new(answers))
            }
            Err(error) => {
                note_refusal("Tune", &error);
                Err(error.into())
            }
        }
    }

    async fn predict(
        &self,
        request: Request<wire::PredictRequest>,
    ) -> Result<Response<wire::PredictResponse>, Status> {
        let work = trials::predict(&self.tuning, request.into_inner());
        self.answer("Predict", work).await
    }

    async fn abandon_trial(
        &self,
        request: Request<wire::AbandonTrialRequest>,
    ) -> Result<Response<wire::Trial>, Status> {
        let work = trials::abandon(&self.tuning, request.into_inner());
        self.answer("AbandonTrial", work).await
    }

    async fn extend_lease(
        &self,
        request: Request<wire::ExtendLeaseRequest>,
    ) -> Result<Response<wire::Trial>, Status> {
        let work = trials::extend_lease(&self.tuning, request.into_inner());
        self.answer("ExtendLease", work).await
    }

    async fn get_trial(
        &self,
        request: Request<wire::GetTrialRequest>,
    ) -> Result<Response<wire::Trial>, Status> {
        let work = trials::get(&self.tuning, request.into_inner());
        self.answer("GetTrial", work).await
    }

    async fn query_trials(
        &self,
        request: Request<wire::QueryTrialsRequest>,
    ) -> Result<Response<wire::QueryTrialsResponse>, Status> {
        let work = trials::query(&self.tuning, request.into_inner());
        self.answer("QueryTrials", work).await
    }

    async fn get_best(&self, request: Request<wire::GetBestRequest>) -> Result<Response<wire::Best>, Status> {
        let work = trials::best(&self.tuning, request.into_inner());
        self.answer("GetBest", work).await
    }
}
