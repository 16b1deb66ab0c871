//! Request middleware: gives each request an id, authenticates it, limits its time, and counts its status.
//!
//! The request id comes from the client's `x-request-id` or is made here. It is in the span of all log lines
//! about the request, and goes back with the answer. So a line in a renderer's log leads to the lines in the
//! daemon's.

use std::convert::Infallible;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll};
use std::time::Instant;

use http::{HeaderMap, HeaderName, HeaderValue, Request, Response};
use tonic::body::Body;
use tonic::{Code, Status};
use tower::{Layer, Service};
use tracing::Instrument as _;

use crate::access::caller::Caller;
use crate::access::rules::{AccessRule, Need, rule_for};
use crate::access::{Access, Authorization};
use crate::connections::{Activity, answer_body, request_body};
use crate::error::{Error, Result};
use crate::peers::key::{self, ReplicaKey};
use crate::refusals::Refusals;
use crate::telemetry::traces;
use crate::{limits, status};

const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Wraps a service in the middleware.
#[derive(Clone)]
pub struct MiddlewareLayer {
    shared: Arc<MiddlewareState>,
}

struct MiddlewareState {
    /// None where no tokens are required.
    access: Option<Arc<Access>>,
    /// None where there are no other replicas.
    replica_key: Option<ReplicaKey>,
    refusals: Refusals,
    /// Separates the ids of this process from another's.
    process: u32,
    requests: AtomicU64,
}

impl MiddlewareLayer {
    /// Middleware that requires tokens where `access` is given, and recognises requests of replicas by their
    /// key.
    pub fn new(
        access: Option<Arc<Access>>,
        replica_key: Option<ReplicaKey>,
        refusals: Refusals,
    ) -> Result<Self, getrandom::Error> {
        let (process, requests) = (getrandom::u32()?, AtomicU64::new(0));
        let shared = MiddlewareState { access, replica_key, refusals, process, requests };
        Ok(Self { shared: Arc::new(shared) })
    }
}

impl<S> Layer<S> for MiddlewareLayer {
    type Service = Middleware<S>;

    fn layer(&self, inner: S) -> Middleware<S> {
        Middleware { inner, shared: Arc::clone(&self.shared) }
    }
}

/// A service wrapped in the middleware.
#[derive(Clone)]
pub struct Middleware<S> {
    inner: S,
    shared: Arc<MiddlewareState>,
}

impl<S> Service<Request<Body>> for Middleware<S>
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

    fn call(&mut self, mut request: Request<Body>) -> Self::Future {
        // The service that reported to be ready must be the one that is called.
        let next = self.inner.clone();
        let inner = std::mem::replace(&mut self.inner, next);
        let shared = Arc::clone(&self.shared);
        let rule = rule_for(request.uri().path());
        let id = shared.request_id(request.headers());
        // A forwarded request keeps its id.
        request.headers_mut().insert(REQUEST_ID, id.clone());
        key::check(shared.replica_key.as_ref(), &mut request);
        let activity = request.extensions().get::<Arc<Activity>>().cloned();
        if let Some(activity) = &activity {
            request = request_body(activity, request);
        }
        let under_way = activity.as_ref().map(Activity::begin).map(Arc::new);
        if let Some(under_way) = &under_way {
            request.extensions_mut().insert(Arc::clone(under_way));
        }
        let span = tracing::info_span!(
            "request",
            id = id.to_str().unwrap_or_default(),
            rpc = rule.rpc,
            token = tracing::field::Empty
        );
        traces::adopt(&span, request.headers());
        let work = async move {
            let since = Instant::now();
            let mut response = shared.serve(rule, activity.as_deref(), request, inner).await;
            // Only an answer without a message has its status in the head; others succeeded so far.
            let code = Status::from_header_map(response.headers()).map_or(Code::Ok, |status| status.code());
            shared.refusals.metrics().answered(rule.rpc, code, since.elapsed());
            response.headers_mut().insert(REQUEST_ID, id);
            // A client that watches the health on a connection of its own sends nothing more. The connection
            // lasts as long as the stream, and still makes room like every newcomer.
            let watching = under_way.filter(|_| rule.need == Need::Nothing);
            Ok(match &activity {
                Some(activity) => response.map(|body| answer_body(activity, body, watching)),
                None => response,
            })
        };
        Box::pin(work.instrument(span))
    }
}

/// The answer, with another code where the gRPC library should not have given its own.
fn corrected(response: Response<Body>) -> Response<Body> {
    match Status::from_header_map(response.headers()) {
        Some(status) if status.code() == Code::Internal => {
            let corrected = status::corrected(status);
            if corrected.code() == Code::Internal { response } else { corrected.into_http() }
        }
        _ => response,
    }
}

impl MiddlewareState {
    /// The client's id, if it is one, or a new one.
    fn request_id(&self, headers: &HeaderMap) -> HeaderValue {
        let allowed = |b: &u8| b.is_ascii_alphanumeric() || matches!(b, b'.' | b'_' | b'-');
        let given = headers.get(REQUEST_ID).filter(|id| {
            (1..=limits::REQUEST_ID_CHARACTERS).contains(&id.len()) && id.as_bytes().iter().all(allowed)
        });
        given.cloned().unwrap_or_else(|| {
            let number = self.requests.fetch_add(1, Ordering::Relaxed);
            let id = format!("{:08x}-{number:x}", self.process);
            HeaderValue::from_str(&id).unwrap_or(HeaderValue::from_static("none"))
        })
    }

    async fn serve<S>(
        &self,
        rule: AccessRule,
        activity: Option<&Activity>,
        mut request: Request<Body>,
        mut inner: S,
    ) -> Response<Body>
    where
        S: Service<Request<Body>, Response = Response<Body>, Error = Infallible>,
    {
        let caller = match self.authorize(rule, request.headers()).await {
            Ok(caller) => caller,
            Err(error) => {
                self.refusals.note(&error);
                return Status::from(error).into_http();
            }
        };
        if !caller.id().is_empty() {
            tracing::Span::current().record("token", caller.id());
        }
        if let Some(activity) = activity.filter(|_| rule.need != Need::Nothing) {
            activity.settle();
        }
        let earlier = request.extensions_mut().insert(caller);
        assert!(earlier.is_none(), "a request passes the middleware twice");
        match tokio::time::timeout(limits::REQUEST, inner.call(request)).await {
            Ok(Ok(response)) => corrected(response),
            Ok(Err(never)) => match never {},
            Err(_) => {
                let error = Error::Deadline(limits::REQUEST);
                self.refusals.note(&error);
                Status::from(error).into_http()
            }
        }
    }

    async fn authorize(&self, rule: AccessRule, headers: &HeaderMap) -> Result<Caller> {
        if headers.len() > limits::HEADERS {
            let problem = format!("{} of them, at most {} are taken", headers.len(), limits::HEADERS);
            return Err(Error::invalid("metadata", problem));
        }
        match &self.access {
            None => Ok(Caller::Anyone),
            Some(access) => access.authorize(rule.need, Authorization::of(headers)).await,
        }
    }
}
