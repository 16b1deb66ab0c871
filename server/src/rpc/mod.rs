//! The gRPC service: reads each request, calls its use case, writes the answer.
//!
//! `studies` and `trials` hold the handlers by topic, `tune` the stream. Their common part is here: every
//! request counts against its caller's quotas, is admitted, and is logged once when it is refused. Handlers
//! read names through `reach`, so that no caller reaches a hidden study.

mod frames;
mod reach;
pub(crate) mod studies;
pub(crate) mod trials;
mod tune;

use std::sync::Arc;

use prost::Message;
use tonic::{Request, Response, Status, Streaming};
use treewright_proto::v1::tuning_service_server::TuningService;
use treewright_proto::v1::{self as wire};

use crate::access::caller::Caller;
use crate::admission::Admission;
use crate::connections::UnderWay;
use crate::error::Error;
use crate::peers::Peers;
use crate::peers::key::Counted;
use crate::refusals::Refusals;
use crate::tuning::Tuning;

/// `treewright.v1.TuningService`.
#[derive(Clone)]
pub struct Service {
    tuning: Arc<Tuning>,
    admission: Admission,
    peers: Option<Arc<Peers>>,
    /// Whether the middleware has authenticated each request.
    behind_middleware: bool,
    refusals: Refusals,
}

impl Service {
    /// The service on its use cases, without access control.
    #[must_use]
    pub fn new(tuning: Arc<Tuning>, admission: Admission) -> Self {
        let refusals = Refusals::new(Arc::clone(tuning.metrics()));
        Self { tuning, admission, peers: None, behind_middleware: false, refusals }
    }

    /// The service behind the [middleware](crate::middleware): a request that did not pass it is refused.
    #[must_use]
    pub fn behind_middleware(tuning: Arc<Tuning>, admission: Admission, refusals: Refusals) -> Self {
        Self { behind_middleware: true, refusals, ..Self::new(tuning, admission) }
    }

    /// Passes frames of Tune streams on to the replicas that hold their studies.
    #[must_use]
    pub fn with_peers(self, peers: Option<Arc<Peers>>) -> Self {
        Self { peers, ..self }
    }

    /// The sender of a request, from the middleware.
    fn caller<Q>(&self, request: &Request<Q>) -> Result<Caller, Error> {
        match request.extensions().get::<Caller>() {
            Some(caller) => Ok(caller.clone()),
            None if self.behind_middleware => {
                Err(Error::Defect("a request came in without passing the middleware"))
            }
            None => Ok(Caller::Anyone),
        }
    }

    /// Admits a request, does its work, and answers.
    async fn answer<Q: Message, T>(
        &self,
        request: Request<Q>,
        work: impl AsyncFnOnce(&Tuning, &Caller, Q) -> Result<T, Error>,
    ) -> Result<Response<T>, Status> {
        let answer = async {
            let caller = self.caller(&request)?;
            let is_counted = request.extensions().get::<Counted>().is_some();
            assert!(!is_counted || self.peers.is_some(), "a replica that there is none of counted a request");
            let request = request.into_inner();
            if !is_counted {
                caller.spend_request(request.encoded_len())?;
            }
            let _entered = self.admission.request()?;
            work(&self.tuning, &caller, request).await
        };
        match answer.await {
            Ok(answer) => Ok(Response::new(answer)),
            Err(error) => {
                self.refusals.note_here(&error, self.peers.is_some());
                Err(error.into())
            }
        }
    }
}

#[tonic::async_trait]
impl TuningService for Service {
    async fn create_study(
        &self,
        request: Request<wire::CreateStudyRequest>,
    ) -> Result<Response<wire::Study>, Status> {
        self.answer(request, studies::create).await
    }

    async fn get_study(
        &self,
        request: Request<wire::GetStudyRequest>,
    ) -> Result<Response<wire::Study>, Status> {
        self.answer(request, studies::get).await
    }

    async fn list_studies(
        &self,
        request: Request<wire::ListStudiesRequest>,
    ) -> Result<Response<wire::ListStudiesResponse>, Status> {
        self.answer(request, studies::list).await
    }

    async fn update_study(
        &self,
        request: Request<wire::UpdateStudyRequest>,
    ) -> Result<Response<wire::Study>, Status> {
        self.answer(request, studies::update).await
    }

    async fn rename_study(
        &self,
        request: Request<wire::RenameStudyRequest>,
    ) -> Result<Response<wire::Study>, Status> {
        self.answer(request, studies::rename).await
    }

    async fn change_space(
        &self,
        request: Request<wire::ChangeSpaceRequest>,
    ) -> Result<Response<wire::ChangeSpaceResponse>, Status> {
        self.answer(request, studies::change_space).await
    }

    async fn delete_study(&self, request: Request<wire::DeleteStudyRequest>) -> Result<Response<()>, Status> {
        self.answer(request, studies::delete).await
    }

    async fn suggest(&self, request: Request<wire::SuggestRequest>) -> Result<Response<wire::Trial>, Status> {
        self.answer(request, trials::suggest).await
    }

    async fn report(
        &self,
        request: Request<wire::ReportRequest>,
    ) -> Result<Response<wire::ReportResponse>, Status> {
        self.answer(request, trials::report).await
    }

    type TuneStream = tune::TuneAnswers;

    async fn tune(
        &self,
        request: Request<Streaming<wire::TuneRequest>>,
    ) -> Result<Response<Self::TuneStream>, Status> {
        let entered = self.caller(&request).and_then(|caller| Ok((caller, self.admission.stream()?)));
        match entered {
            Ok((caller, entered)) => {
                let under_way = request.extensions().get::<Arc<UnderWay>>().cloned();
                let way = frames::FrameRouter::new(self.peers.clone(), request.metadata());
                let stream = tune::TuneStream {
                    tuning: Arc::clone(&self.tuning),
                    admission: self.admission.clone(),
                    caller,
                    is_counted: request.extensions().get::<Counted>().is_some(),
                    has_peers: way.has_peers(),
                    refusals: self.refusals.clone(),
                    _inside: (entered, under_way),
                };
                Ok(Response::new(stream.serve(way, request.into_inner())))
            }
            Err(error) => {
                self.refusals.note(&error);
                Err(error.into())
            }
        }
    }

    async fn predict(
        &self,
        request: Request<wire::PredictRequest>,
    ) -> Result<Response<wire::PredictResponse>, Status> {
        self.answer(request, trials::predict).await
    }

    async fn abandon_trial(
        &self,
        request: Request<wire::AbandonTrialRequest>,
    ) -> Result<Response<wire::Trial>, Status> {
        self.answer(request, trials::abandon).await
    }

    async fn extend_lease(
        &self,
        request: Request<wire::ExtendLeaseRequest>,
    ) -> Result<Response<wire::Trial>, Status> {
        self.answer(request, trials::extend_lease).await
    }

    async fn exclude_trial(
        &self,
        request: Request<wire::ExcludeTrialRequest>,
    ) -> Result<Response<wire::Trial>, Status> {
        self.answer(request, trials::exclude).await
    }

    async fn get_trial(
        &self,
        request: Request<wire::GetTrialRequest>,
    ) -> Result<Response<wire::Trial>, Status> {
        self.answer(request, trials::get).await
    }

    async fn query_trials(
        &self,
        request: Request<wire::QueryTrialsRequest>,
    ) -> Result<Response<wire::QueryTrialsResponse>, Status> {
        self.answer(request, trials::query).await
    }

    async fn get_best(&self, request: Request<wire::GetBestRequest>) -> Result<Response<wire::Best>, Status> {
        self.answer(request, trials::best).await
    }
}
