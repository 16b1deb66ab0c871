//! The other replicas, and the way of a request to the one that holds its study.
//!
//! Where several daemons share a database, a study's tuner lives in one of them. A replica that is asked
//! about another's study forwards the request unchanged, and returns the answer. A request is forwarded once:
//! a replica that receives a marked request and does not hold the study refuses it, and the first looks for
//! the holder again. If the holder is gone, the database lets the first take the study itself.
//! [`find_answer`] is that search; single requests, frames of a stream and the fault simulator each define
//! their own attempts.
//!
//! `links` are the connections, `key` separates requests of replicas from those of clients.

pub(crate) mod key;
mod links;

use std::sync::Arc;
use std::time::Duration;

use http::HeaderMap;
use tokio::time::{Instant, sleep};
use tonic::metadata::MetadataMap;
use tonic::transport::Channel;
use tonic::{Code, Request, Status};
use treewright_proto::v1 as wire;
use treewright_proto::v1::tuning_service_client::TuningServiceClient;
use treewright_store::Store;

use crate::limits;
use crate::redirect::Redirect;
use crate::refusals::Refusals;
use crate::tls::Tls;
use links::Links;

pub use key::{FORWARDED, ReplicaKey};

/// The other replicas.
pub struct Peers {
    store: Arc<dyn Store>,
    key: ReplicaKey,
    links: Links,
    refusals: Refusals,
}

/// A request that may have to look for its replica.
pub trait Seeking: Sync {
    /// Its answer.
    type Answer: Send;

    /// Tries in this replica: the answer, and the place for another try of the rest.
    fn here(&self) -> impl Future<Output = Result<(Self::Answer, Option<Redirect>), Status>> + Send;

    /// Tries in another replica, marked as passed on; none where that leaves the question open.
    fn there(
        &self,
        study: &str,
        address: &str,
    ) -> impl Future<Output = Result<Option<Self::Answer>, Status>> + Send;

    /// The replica did not answer, or does not hold the study any more.
    fn doubt(&self, study: &str);

    /// No replica did the request in time.
    fn gave_up(&self, study: &str) {
        let _ = study;
    }
}

/// Looks for the replica that answers a request until [`limits::PEER_PATIENCE`] is over; then this replica's
/// last answer counts. A forwarded request is not forwarded again.
pub async fn find_answer<S: Seeking>(request: &S, was_forwarded: bool) -> Result<S::Answer, Status> {
    let mut patience = Patience::new();
    loop {
        let (answer, fate) = request.here().await?;
        let study = match fate {
            None => return Ok(answer),
            Some(Redirect::ToReplica { .. }) if was_forwarded => return Ok(answer),
            Some(Redirect::ToReplica { study, address }) => {
                if let Some(theirs) = request.there(&study, &address).await? {
                    return Ok(theirs);
                }
                request.doubt(&study);
                study
            }
            Some(Redirect::Retry { study }) => study,
        };
        if !patience.wait().await {
            request.gave_up(&study);
            return Ok(answer);
        }
    }
}

/// The time of a request's search for the replica that does it.
struct Patience {
    until: Instant,
    pause: Duration,
}

impl Patience {
    fn new() -> Self {
        Self { until: Instant::now() + limits::PEER_PATIENCE, pause: limits::PEER_PAUSE }
    }

    /// Waits a little, a little longer each time; false when the time is up.
    async fn wait(&mut self) -> bool {
        if Instant::now() + self.pause >= self.until {
            return false;
        }
        sleep(self.pause).await;
        self.pause = (self.pause * 2).min(limits::PEER_PAUSE_LONGEST);
        true
    }
}

impl Peers {
    /// The replicas that share `store`; none for a store of one process. `tls` is used for replicas that
    /// speak TLS.
    pub fn of(store: &Arc<dyn Store>, tls: Option<Arc<Tls>>, refusals: Refusals) -> Option<Arc<Self>> {
        let key = ReplicaKey::new(&store.replica_key()?);
        let links = Links::new(tls, Arc::clone(refusals.metrics()));
        Some(Arc::new(Self { store: Arc::clone(store), key, links, refusals }))
    }

    /// The key by which replicas recognise each other's requests.
    pub fn key(&self) -> &ReplicaKey {
        &self.key
    }

    /// Marks a request to forward, and finds its connection.
    pub(crate) fn pass_on(&self, address: &str, headers: &mut HeaderMap) -> Result<Channel, Status> {
        self.key.show(headers);
        self.links.channel(address)
    }

    pub(crate) fn doubt(&self, study: &str) {
        self.store.doubt(study);
    }

    /// Waits for a replica's answer as long as the replica counts as alive: a frozen one keeps its
    /// connections and stays silent. None when the replica did not answer, or was given up.
    pub(crate) async fn ask<T>(
        &self,
        study: &str,
        address: &str,
        answer: impl Future<Output = Result<T, Status>>,
    ) -> Option<T> {
        let given_up = async {
            loop {
                sleep(limits::PEER_LOOK).await;
                if !self.store.is_held_by(study, address).await {
                    return;
                }
            }
        };
        let answer = tokio::select! {
            answer = answer => answer,
            () = given_up => Err(Status::unavailable("it was given up while it had a request")),
        };
        match &answer {
            Ok(_) => self.links.answered(address),
            Err(error) => self.links.silent(address, error),
        }
        answer.ok()
    }

    pub(crate) fn gave_up(&self, study: &str) {
        self.refusals.note_unplaced(study);
    }

    /// Passes one frame of a Tune stream on. `metadata` is the stream's own. The inner error is the replica's
    /// answer to the whole stream, such as the end of the token. The outer one means that the replica did not
    /// answer.
    pub(crate) async fn frame(
        &self,
        address: &str,
        metadata: &MetadataMap,
        frame: wire::TuneRequest,
    ) -> Result<Result<wire::TuneResponse, Status>, Status> {
        let mut headers = metadata.clone().into_headers();
        let channel = self.pass_on(address, &mut headers)?;
        let mut client =
            TuningServiceClient::new(channel).max_decoding_message_size(limits::REQUEST_BYTES * 4);
        let mut request = Request::new(tokio_stream::once(frame));
        *request.metadata_mut() = MetadataMap::from_headers(headers);
        let answer = match client.tune(request).await {
            Ok(answers) => answers.into_inner().message().await,
            Err(status) => Err(status),
        };
        match answer {
            Ok(Some(answer)) => Ok(Ok(answer)),
            Ok(None) => Err(Status::unavailable("the replica ended the stream")),
            Err(status) if has_broken(&status) => Err(status),
            Err(status) => Ok(Err(status)),
        }
    }
}

/// Whether a status comes from a failed connection on this side, not from the replica.
fn has_broken(status: &Status) -> bool {
    std::error::Error::source(status).is_some() || status.code() == Code::Unknown
}

/// Whether an answer of a replica leaves the question open.
pub(crate) fn is_open(answer: &wire::TuneResponse) -> bool {
    let errors = [&answer.report_error, &answer.suggest_error];
    errors.into_iter().flatten().any(|error| error.code == Code::Unavailable as i32)
}
