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
use crate::error::{Error, Result};
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
    pub fn new(tuning: Arc<Tuning>, admission: Admission) -> Self {
        let refusals = Refusals::new(Arc::clone(tuning.metrics()));
        Self { tuning, admission, peers: None, behind_middleware: false, refusals }
    }

    /// The service behind the [middleware](crate::middleware): a request that did not pass it is refused.
    pub fn behind_middleware(tuning: Arc<Tuning>, admission: Admission, refusals: Refusals) -> Self {
        Self { behind_middleware: true, refusals, ..Self::new(tuning, admission) }
    }

    /// Passes frames of Tune streams on to the replicas that hold their studies.
    #[must_use]
    pub fn with_peers(self, peers: Option<Arc<Peers>>) -> Self {
        Self { peers, ..self }
    }

    /// The sender of a request, from the middleware.
    fn caller<Q>(&self, request: &Request<Q>) -> Result<Caller> {
        match request.extensions().get::<Caller>() {
            Some(caller) => Ok(caller.clone()),
            None if self.behind_middleware => {
                Err(Error::Defect("a request came in without passing the middleware"))
            }
            None => Ok(Caller::Anyone),
        }
    }

    async fn answer<Q: Message, T>(
        &self,
        request: Request<Q>,
        work: impl AsyncFnOnce(Call<'_>, Q) -> Result<T>,
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
            work(Call { tuning: &self.tuning, caller: &caller }, request).await
        };
        match answer.await {
            Ok(answer) => Ok(Response::new(answer)),
            Err(error) => {
                self.refusals.note_here(&error, self.peers.is_some());
                Err(error.into())
            }
        }
    }

    fn open_stream(
        &self,
        request: Request<Streaming<wire::TuneRequest>>,
    ) -> Result<Response<tune::TuneAnswers>, Status> {
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
}

#[derive(Clone, Copy)]
pub(crate) struct Call<'a> {
    pub(crate) tuning: &'a Tuning,
    pub(crate) caller: &'a Caller,
}

/// Implements the service: which function does the work of which method.
macro_rules! methods {
    ($($method:ident($request:ident) -> $answer:ty: $work:path;)+) => {
        #[tonic::async_trait]
        impl TuningService for Service {
            type TuneStream = tune::TuneAnswers;

            async fn tune(
                &self,
                request: Request<Streaming<wire::TuneRequest>>,
            ) -> Result<Response<Self::TuneStream>, Status> {
                self.open_stream(request)
            }

            $(
                async fn $method(
                    &self,
                    request: Request<wire::$request>,
                ) -> Result<Response<$answer>, Status> {
                    self.answer(request, $work).await
                }
            )+
        }
    };
}

methods! {
    create_study(CreateStudyRequest) -> wire::Study: studies::create;
    get_study(GetStudyRequest) -> wire::Study: studies::get;
    list_studies(ListStudiesRequest) -> wire::ListStudiesResponse: studies::list;
    update_study(UpdateStudyRequest) -> wire::Study: studies::update;
    rename_study(RenameStudyRequest) -> wire::Study: studies::rename;
    change_space(ChangeSpaceRequest) -> wire::ChangeSpaceResponse: studies::change_space;
    delete_study(DeleteStudyRequest) -> (): studies::delete;
    suggest(SuggestRequest) -> wire::Trial: trials::suggest;
    report(ReportRequest) -> wire::ReportResponse: trials::report;
    predict(PredictRequest) -> wire::PredictResponse: trials::predict;
    abandon_trial(AbandonTrialRequest) -> wire::Trial: trials::abandon;
    extend_lease(ExtendLeaseRequest) -> wire::Trial: trials::extend_lease;
    exclude_trial(ExcludeTrialRequest) -> wire::Trial: trials::exclude;
    get_trial(GetTrialRequest) -> wire::Trial: trials::get;
    query_trials(QueryTrialsRequest) -> wire::QueryTrialsResponse: trials::query;
    get_best(GetBestRequest) -> wire::Best: trials::best;
}
