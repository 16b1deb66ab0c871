//! Passes single requests on to the replica that holds their study, before they are decoded: the request and
//! its credentials go on unchanged, and so does the answer.
//!
//! Frames of a Tune stream are passed on one by one by [`rpc`](crate::rpc), because each may concern another
//! study.

use std::convert::Infallible;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll};

use bytes::Bytes;
use http::request::Parts;
use http::{Request, Response};
use http_body_util::{BodyExt as _, Full, Limited};
use tonic::body::Body;
use tonic::transport::Channel;
use tonic::{Code, Status};
use tower::{Layer, Service, ServiceExt as _};

use crate::limits;
use crate::peers::key::Counted;
use crate::peers::{FORWARDED, Peers, Seeking, find_answer};
use crate::redirect::Redirect;

/// Bytes before a message: whether it is compressed, and its length.
const MESSAGE_HEAD: usize = 5;

/// Puts forwarding before a service.
#[derive(Clone)]
pub struct ForwardLayer {
    peers: Option<Arc<Peers>>,
}

impl ForwardLayer {
    /// Forwards to these replicas, if there are any.
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
    S: Service<Request<Body>, Response = Response<Body>, Error = Infallible> + Clone + Send + Sync + 'static,
    S::Future: Send,
{
    type Response = Response<Body>;
    type Error = Infallible;
    type Future = Pin<Box<dyn Future<Output = Result<Response<Body>, Infallible>> + Send>>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        self.inner.poll_ready(context)
    }

    fn call(&mut self, request: Request<Body>) -> Self::Future {
        // The service that reported to be ready must be the one that is called.
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
    S: Service<Request<Body>, Response = Response<Body>, Error = Infallible> + Clone + Send + Sync,
    S::Future: Send,
{
    let (mut parts, body) = request.into_parts();
    // The service itself refuses larger messages; this limit only guards memory.
    let bytes = match Limited::new(body, limits::REQUEST_BYTES + MESSAGE_HEAD).collect().await {
        Ok(collected) => collected.to_bytes(),
        Err(_) => return Status::out_of_range("the request is too large, or broke off").into_http(),
    };
    parts.headers.remove(http::header::CONTENT_LENGTH);
    let was_forwarded = parts.headers.contains_key(FORWARDED);
    let single = Single { peers, inner, parts, bytes, was_tried: AtomicBool::new(false) };
    find_answer(&single, was_forwarded).await.unwrap_or_else(Status::into_http)
}

/// A single request, kept so that it can be tried again.
struct Single<'a, S> {
    peers: &'a Peers,
    inner: S,
    parts: Parts,
    bytes: Bytes,
    was_tried: AtomicBool,
}

impl<S> Single<'_, S> {
    fn request(&self) -> Request<Body> {
        Request::from_parts(self.parts.clone(), Body::new(Full::new(self.bytes.clone())))
    }
}

impl<S> Seeking for Single<'_, S>
where
    S: Service<Request<Body>, Response = Response<Body>, Error = Infallible> + Clone + Send + Sync,
    S::Future: Send,
{
    type Answer = Response<Body>;

    async fn here(&self) -> Result<(Response<Body>, Option<Redirect>), Status> {
        let mut request = self.request();
        // All tries of a request count once against its caller's quotas.
        if self.was_tried.swap(true, Ordering::Relaxed) {
            request.extensions_mut().insert(Counted);
        }
        let Ok(answer) = self.inner.clone().oneshot(request).await;
        let redirect = Redirect::read(answer.headers());
        Ok((answer, redirect))
    }

    async fn there(&self, study: &str, address: &str) -> Result<Option<Response<Body>>, Status> {
        let mut request = self.request();
        let channel = self.peers.pass_on(address, request.headers_mut())?;
        let theirs = self.peers.ask(study, address, whole(channel, request)).await;
        Ok(theirs.filter(|theirs| !is_unavailable(theirs)))
    }

    fn doubt(&self, study: &str) {
        self.peers.doubt(study);
    }

    fn gave_up(&self, study: &str) {
        self.peers.gave_up(study);
    }
}

/// A replica's answer with its message and its trailers. A replica that is killed in between has not
/// answered. If the answer were passed on in pieces, the client would see an INTERNAL error of a healthy
/// replica.
async fn whole(channel: Channel, request: Request<Body>) -> Result<Response<Body>, Status> {
    let answer = channel.oneshot(request).await.map_err(|error| Status::from_error(error.into()))?;
    let (parts, body) = answer.into_parts();
    Ok(Response::from_parts(parts, Body::new(body.collect().await?)))
}

/// An error without a message stands in the headers.
fn is_unavailable(answer: &Response<Body>) -> bool {
    Status::from_header_map(answer.headers()).is_some_and(|status| status.code() == Code::Unavailable)
}
