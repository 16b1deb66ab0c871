//! Passes single requests on to the replica that holds their study, below the level at which they are read:
//! the request goes on as it came, with its credentials, and the answer comes back as it was given.
//!
//! Frames of a Tune stream are passed on one by one by [`rpc`](crate::rpc), since each may concern another study.

use std::convert::Infallible;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use bytes::Bytes;
use http::{HeaderValue, Request, Response};
use http_body_util::{BodyExt as _, Full, Limited};
use tonic::body::Body;
use tonic::{Code, Status};
use tower::{Layer, Service, ServiceExt as _};

use crate::limits;
use crate::peers::{FORWARDED, Fate, Patience, Peers};

/// Bytes before a message: whether it is compressed, and its length.
const MESSAGE_HEAD: usize = 5;

/// Puts forwarding before a service.
#[derive(Clone)]
pub struct ForwardLayer {
    peers: Option<Arc<Peers>>,
}

impl ForwardLayer {
    /// Forwards to these replicas; to nobody where there are none.
    #[must_use]
    pub fn new(peers: Option<Arc<Peers>>) -> Self {
        Self { peers }
    }
}

impl<S> Layer<S> for ForwardLayer {
    type Service = Forward<S>;

    fn layer(&self, inner: S) -> Forward<S> {
        Forward { inner, peers: self.peers.clone() }
    }
}

/// A service with forwarding before it.
#[derive(Clone)]
pub struct Forward<S> {
    inner: S,
    peers: Option<Arc<Peers>>,
}

impl<S> Service<Request<Body>> for Forward<S>
where
    S: Service<Request<Body>, Response = Response<Body>, Error = Infallible> + Clone + Send + 'static,
    S::Future: Send,
{
    type Response = Response<Body>;
    type Error = Infallible;
    type Future = Pin<Box<dyn Future<Output = Result<Response<Body>, Infallible>> + Send>>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        self.inner.poll_ready(context)
    }

    fn call(&mut self, request: Request<Body>) -> Self::Future {
        // The service that was asked whether it is ready is the one to call.
        let next = self.inner.clone();
        let mut inner = std::mem::replace(&mut self.inner, next);
        match &self.peers {
            Some(peers) if is_single(request.uri().path()) => {
                let peers = Arc::clone(peers);
                Box::pin(async move { Ok(serve(&peers, inner, request).await) })
            }
            _ => Box::pin(inner.call(request)),
        }
    }
}

/// Whether a call has one request and one answer.
fn is_single(path: &str) -> bool {
    path.starts_with("/treewright.") && !path.ends_with("/Tune")
}

async fn serve<S>(peers: &Peers, inner: S, request: Request<Body>) -> Response<Body>
where
    S: Service<Request<Body>, Response = Response<Body>, Error = Infallible> + Clone,
{
    let (parts, body) = request.into_parts();
    // Beyond the limit the service itself refuses; here only memory is guarded.
    let bytes = match Limited::new(body, limits::REQUEST_BYTES + MESSAGE_HEAD).collect().await {
        Ok(collected) => collected.to_bytes(),
        Err(_) => return Status::out_of_range("the request is too large, or broke off").into_http(),
    };
    let request = |bytes: &Bytes| {
        let mut request = Request::from_parts(parts.clone(), Body::new(Full::new(bytes.clone())));
        request.headers_mut().remove(http::header::CONTENT_LENGTH);
        request
    };
    let was_forwarded = parts.headers.contains_key(FORWARDED);
    let mut patience = Patience::new();
    loop {
        let Ok(answer) = inner.clone().oneshot(request(&bytes)).await;
        let answer = match Fate::read(answer.headers()) {
            None => return answer,
            Some(Fate::Elsewhere { .. }) if was_forwarded => return answer,
            Some(Fate::Again { .. }) => answer,
            Some(Fate::Elsewhere { study, address }) => {
                let mut passed_on = request(&bytes);
                passed_on.headers_mut().insert(FORWARDED, HeaderValue::from_static("1"));
                match peers.channel(&address) {
                    Err(status) => return status.into_http(),
                    Ok(channel) => match channel.oneshot(passed_on).await {
                        Ok(theirs) if !is_unavailable(&theirs) => return theirs,
                        Ok(theirs) => {
                            peers.doubt(&study);
                            theirs
                        }
                        Err(error) => {
                            tracing::debug!(study, address, %error, "the replica does not answer");
                            peers.doubt(&study);
                            answer
                        }
                    },
                }
            }
        };
        if !patience.wait().await {
            return answer;
        }
    }
}

/// An error without a message stands in the headers.
fn is_unavailable(answer: &Response<Body>) -> bool {
    Status::from_header_map(answer.headers()).is_some_and(|status| status.code() == Code::Unavailable)
}
