//! The second listener, for those who watch: `/metrics` for Prometheus, `/livez` and `/readyz` for an orchestrator.
//!
//! Alive is a process that answers at all; ready is one whose requests would be served: it is not draining, and the
//! database answers. The two are apart because a restart mends the one and not the other. Plain HTTP/1.1, which is
//! what the askers speak; nobody outside the machine sees it unless told so.

use std::convert::Infallible;
use std::sync::Arc;

use http::{HeaderValue, Method, Request, Response, StatusCode, header};
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use treewright_store::{Store, StoreError};

use crate::admission::Admission;
use crate::connections::ConnectionSlots;
use crate::limits;
use crate::metrics::{Metrics, Moment};
use crate::tuning::Tuning;

/// The media type of OpenMetrics' text form.
const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";
const PLAIN: &str = "text/plain; charset=utf-8";

/// What is looked at when somebody asks.
pub(crate) struct Watched {
    pub(crate) tuning: Arc<Tuning>,
    pub(crate) store: Arc<dyn Store>,
    pub(crate) admission: Admission,
    pub(crate) connection_slots: ConnectionSlots,
    pub(crate) metrics: Arc<Metrics>,
    /// How many studies are shown with their names.
    pub(crate) studies_shown: usize,
}

impl Watched {
    /// Whether requests would be served, or why not.
    async fn ready(&self) -> Result<(), String> {
        if self.admission.is_draining() {
            return Err("draining".to_owned());
        }
        // No study can have this name: whoever says so has looked.
        match tokio::time::timeout(limits::READY, self.store.get_study("*")).await {
            Ok(Ok(_) | Err(StoreError::StudyNotFound { .. })) => Ok(()),
            Ok(Err(error)) => Err(error.to_string()),
            Err(_) => Err("the database does not answer".to_owned()),
        }
    }

    async fn moment(&self) -> Moment {
        let (in_flight, streams) = self.admission.in_progress();
        let (studies_in_memory, open_leases) = self.tuning.in_use();
        let (connections, newcomers) = self.connection_slots.counts();
        Moment {
            connections,
            newcomers,
            in_flight,
            streams,
            studies_in_memory,
            open_leases,
            // A database that does not answer must not hide the rest.
            size: tokio::time::timeout(limits::READY, self.store.size())
                .await
                .ok()
                .flatten()
                .unwrap_or_default(),
            draining: self.admission.is_draining(),
            studies: self.tuning.figures(self.studies_shown),
        }
    }

    async fn answer(&self, request: &Request<Incoming>) -> Response<String> {
        let of = |status, kind, text| {
            let mut response = Response::new(text);
            *response.status_mut() = status;
            response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
            response
        };
        if !matches!(*request.method(), Method::GET | Method::HEAD) {
            return of(StatusCode::METHOD_NOT_ALLOWED, PLAIN, "only GET\n".to_owned());
        }
        match request.uri().path() {
            "/metrics" => match self.metrics.text(&self.moment().await) {
                Ok(text) => of(StatusCode::OK, OPEN_METRICS, text),
                Err(error) => of(StatusCode::INTERNAL_SERVER_ERROR, PLAIN, format!("{error}\n")),
            },
            "/livez" => of(StatusCode::OK, PLAIN, "alive\n".to_owned()),
            "/readyz" => match self.ready().await {
                Ok(()) => of(StatusCode::OK, PLAIN, "ready\n".to_owned()),
                Err(why) => of(StatusCode::SERVICE_UNAVAILABLE, PLAIN, format!("{why}\n")),
            },
            _ => of(StatusCode::NOT_FOUND, PLAIN, "there are /metrics, /livez and /readyz\n".to_owned()),
        }
    }
}

/// Serves those who watch until it is dropped.
pub(crate) async fn serve(listener: TcpListener, watched: Watched) {
    let watched = Arc::new(watched);
    let connection_slots = Arc::new(Semaphore::new(limits::WATCHERS));
    loop {
        let stream = match listener.accept().await {
            Ok((stream, _)) => stream,
            Err(error) => {
                tracing::warn!(%error, "a connection for metrics could not be accepted");
                tokio::time::sleep(std::time::Duration::from_millis(50)).await;
                continue;
            }
        };
        // One too many is closed at once.
        let Ok(place) = Arc::clone(&connection_slots).try_acquire_owned() else {
            continue;
        };
        let watched = Arc::clone(&watched);
        tokio::spawn(async move {
            let service = service_fn(async |request| Ok::<_, Infallible>(watched.answer(&request).await));
            let served = http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(limits::WATCH)
                .keep_alive(false)
                .serve_connection(TokioIo::new(stream), service);
            // Whatever went wrong is the asker's affair.
            let _ = tokio::time::timeout(2 * limits::WATCH, served).await;
            drop(place);
        });
    }
}
