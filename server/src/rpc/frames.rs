//! Frames of a Tune stream where several replicas share the studies: each goes to the replica that holds its
//! study, and a frame about two studies is split.

use std::sync::Arc;

use tonic::metadata::MetadataMap;
use tonic::{Code, Status};
use treewright_proto::v1 as wire;

use crate::peers::{FORWARDED, Peers, Seeking, find_answer, is_open};
use crate::redirect::Redirect;

/// Answers frames in this replica.
pub(super) trait Attempt: Sync {
    /// Counts a frame against its caller's quotas. A refusal is its answer; an error ends the stream.
    fn count(&self, frame: &wire::TuneRequest) -> Result<Option<wire::TuneResponse>, Status>;

    /// The answer, and the place for another try of the rest. An error ends the stream.
    fn attempt(
        &self,
        frame: wire::TuneRequest,
    ) -> impl Future<Output = Result<(wire::TuneResponse, Option<Redirect>), Status>> + Send;
}

pub(super) struct FrameRouter {
    peers: Option<Arc<Peers>>,
    /// The metadata that the client sent with the stream, its credentials among them.
    metadata: MetadataMap,
}

impl FrameRouter {
    /// Whether another replica may do the rest of a frame.
    pub(super) fn has_peers(&self) -> bool {
        self.peers.is_some()
    }

    pub(super) fn new(peers: Option<Arc<Peers>>, metadata: &MetadataMap) -> Self {
        let metadata = if peers.is_some() { metadata.clone() } else { MetadataMap::new() };
        Self { peers, metadata }
    }

    /// Answers a frame: here, or at the replica that holds its study.
    pub(super) async fn answer(
        &self,
        frame: wire::TuneRequest,
        here: &impl Attempt,
    ) -> Result<wire::TuneResponse, Status> {
        // All tries of a frame, here and elsewhere, count once.
        if let Some(refused) = here.count(&frame)? {
            return Ok(refused);
        }
        let Some(peers) = &self.peers else {
            return Ok(here.attempt(frame).await?.0);
        };
        match frame {
            wire::TuneRequest { report: Some(report), suggest: Some(suggest) }
                if !concern_one_study(&report, &suggest) =>
            {
                let report = wire::TuneRequest { report: Some(report), suggest: None };
                let suggest = wire::TuneRequest { report: None, suggest: Some(suggest) };
                let reported = self.find_answer(peers, report, here).await?;
                let suggested = self.find_answer(peers, suggest, here).await?;
                Ok(wire::TuneResponse {
                    reported: reported.reported,
                    report_error: reported.report_error,
                    trial: suggested.trial,
                    suggest_error: suggested.suggest_error,
                })
            }
            frame => self.find_answer(peers, frame, here).await,
        }
    }

    async fn find_answer(
        &self,
        peers: &Peers,
        frame: wire::TuneRequest,
        here: &impl Attempt,
    ) -> Result<wire::TuneResponse, Status> {
        let was_forwarded = self.metadata.contains_key(FORWARDED);
        find_answer(&SeekingFrame { peers, metadata: &self.metadata, frame, here }, was_forwarded).await
    }
}

/// One frame, kept so that it can be tried again.
struct SeekingFrame<'a, A> {
    peers: &'a Peers,
    metadata: &'a MetadataMap,
    frame: wire::TuneRequest,
    here: &'a A,
}

impl<A: Attempt> Seeking for SeekingFrame<'_, A> {
    type Answer = wire::TuneResponse;

    async fn here(&self) -> Result<(wire::TuneResponse, Option<Redirect>), Status> {
        self.here.attempt(self.frame.clone()).await
    }

    async fn there(&self, study: &str, address: &str) -> Result<Option<wire::TuneResponse>, Status> {
        let frame = self.peers.frame(address, self.metadata, self.frame.clone());
        match self.peers.ask(study, address, frame).await.transpose() {
            Ok(theirs) => Ok(theirs.filter(|theirs| !is_open(theirs))),
            Err(status) if status.code() == Code::Unavailable => Ok(None),
            Err(status) => Err(status),
        }
    }

    fn doubt(&self, study: &str) {
        self.peers.doubt(study);
    }

    fn gave_up(&self, study: &str) {
        self.peers.gave_up(study);
    }
}

/// Whether the reported trial belongs to the study of the question. Malformed names count as one study; they
/// are refused later.
fn concern_one_study(report: &wire::ReportRequest, suggest: &wire::SuggestRequest) -> bool {
    match report.trial.split_once("/trials/") {
        Some((study, _)) => study == suggest.study,
        None => true,
    }
}
