//! Several addresses of one service: the replicas of a daemon, any of which can answer.
//!
//! Requests go to one of them. When it does not answer, or says that it is not serving, the next request asks
//! the health service of each in turn and stays with the first that serves. The failed request is the
//! caller's affair: frames get their fallback, and reports wait in the outbox.

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::time::timeout;
use tonic::body::Body;
use tonic::codegen::Service;
use tonic::codegen::http::{Request, Response};
use tonic::transport::Channel;
use tonic::{Code, Status};
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

use crate::limits;

/// The connections to all addresses, used as if they were one.
#[derive(Debug, Clone)]
pub(crate) struct Failover {
    shared: Arc<FailoverState>,
}

#[derive(Debug)]
struct FailoverState {
    /// At least one.
    channels: Vec<Channel>,
    current: AtomicUsize,
    /// Whether the current one is worth a question. With one address it always is.
    trusted: AtomicBool,
}

impl Failover {
    /// Connections in the order in which they are tried.
    pub(crate) fn new(channels: Vec<Channel>) -> Self {
        let trusted = AtomicBool::new(channels.len() < 2);
        // The first look begins with the one after it, which is the first.
        let current = AtomicUsize::new(channels.len().saturating_sub(1));
        Self { shared: Arc::new(FailoverState { channels, current, trusted }) }
    }

    /// The number of addresses.
    pub(crate) fn count(&self) -> usize {
        self.shared.channels.len()
    }

    /// The current one did not answer in time: the next request looks at the others first.
    pub(crate) fn distrust(&self) {
        if self.count() > 1 {
            self.shared.trusted.store(false, Ordering::Release);
        }
    }

    /// The connection to use. It is the current one while it is trusted, else the first that serves,
    /// beginning with the one after it. It is the current one where none serves.
    async fn pick(&self) -> (usize, Channel) {
        let shared = &*self.shared;
        let current = shared.current.load(Ordering::Acquire);
        if shared.trusted.load(Ordering::Acquire) {
            return (current, shared.channels[current].clone());
        }
        let count = shared.channels.len();
        for step in 1..=count {
            let index = (current + step) % count;
            if serves(shared.channels[index].clone(), limits::PROBE).await {
                shared.current.store(index, Ordering::Release);
                shared.trusted.store(true, Ordering::Release);
                return (index, shared.channels[index].clone());
            }
        }
        (current, shared.channels[current].clone())
    }

    /// A failure of one that others may have left already is no news.
    fn failed(&self, index: usize) {
        if self.shared.current.load(Ordering::Acquire) == index {
            self.distrust();
        }
    }
}

/// Whether a daemon answers there and serves.
async fn serves(channel: Channel, limit: Duration) -> bool {
    let request = HealthCheckRequest { service: String::new() };
    match timeout(limit, HealthClient::new(channel).check(request)).await {
        Ok(Ok(answer)) => answer.get_ref().status() == ServingStatus::Serving,
        // A server answers, but no health service for this client: that is good enough to send requests.
        Ok(Err(status)) => {
            matches!(status.code(), Code::Unimplemented | Code::Unauthenticated | Code::PermissionDenied)
        }
        Err(_) => false,
    }
}

impl Service<Request<Body>> for Failover {
    type Response = Response<Body>;
    type Error = tonic::transport::Error;
    type Future = Pin<Box<dyn Future<Output = Result<Response<Body>, Self::Error>> + Send>>;

    fn poll_ready(&mut self, _: &mut Context<'_>) -> Poll<Result<(), Self::Error>> {
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, request: Request<Body>) -> Self::Future {
        let this = self.clone();
        Box::pin(async move {
            let (index, mut channel) = this.pick().await;
            let result = match std::future::poll_fn(|context| channel.poll_ready(context)).await {
                Ok(()) => channel.call(request).await,
                Err(error) => Err(error),
            };
            match &result {
                Err(_) => this.failed(index),
                Ok(answer) => {
                    let status = Status::from_header_map(answer.headers());
                    if status.is_some_and(|status| status.code() == Code::Unavailable) {
                        this.failed(index);
                    }
                }
            }
            result
        })
    }
}
