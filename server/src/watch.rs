//! The second listener, for monitoring: `/metrics` for Prometheus, `/livez` and `/readyz` for an
//! orchestrator.
//!
//! A process that answers is alive. It is ready if it would serve requests: it is not draining, and the
//! database answers. The two differ because a restart only mends the first. The protocol is plain HTTP/1.1,
//! as monitors speak it. By default only this machine can reach it.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use http::{HeaderValue, Method, Request, Response, StatusCode, header};
use hyper::body::Incoming;
use treewright_store::{Store, StoreError};

use crate::admission::Admission;
use crate::connections::pages::Pages;
use crate::connections::{ConnectionSlot, ConnectionSlots, Unfinished};
use crate::metrics::{self, Metrics};
use crate::tls::Tls;
use crate::tuning::Tuning;
use crate::{limits, maintenance};

/// The media type of OpenMetrics' text form.
const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";
const PLAIN: &str = "text/plain; charset=utf-8";

/// The parts of the daemon that a request reads.
pub(crate) struct Watched {
    pub(crate) tuning: Arc<Tuning>,
    pub(crate) store: Arc<dyn Store>,
    pub(crate) admission: Admission,
    pub(crate) connection_slots: ConnectionSlots,
    pub(crate) unfinished: Unfinished,
    pub(crate) tls: Option<Arc<Tls>>,
    /// The file whose date is that of the last backup.
    pub(crate) backup_mark: Option<PathBuf>,
    pub(crate) metrics: Arc<Metrics>,
    /// The number of studies that are shown with their names.
    pub(crate) studies_shown: usize,
}

impl Watched {
    /// Whether requests would be served, or why not.
    async fn ready(&self) -> Result<(), String> {
        if self.admission.is_draining() {
            return Err("draining".to_owned());
        }
        // No study can have this name: a database that answers so is alive.
        match tokio::time::timeout(limits::READY, self.store.get_study("*")).await {
            Ok(Ok(_) | Err(StoreError::StudyNotFound { .. })) => Ok(()),
            Ok(Err(error)) => Err(error.to_string()),
            Err(_) => Err("the database does not answer".to_owned()),
        }
    }

    async fn figures(&self) -> Result<String, std::fmt::Error> {
        // A silent database must not hide the other figures.
        let size = tokio::time::timeout(limits::READY, self.store.size()).await.ok().flatten();
        let size = size.unwrap_or_default();
        let (in_flight, streams) = self.admission.in_progress();
        let (studies_in_memory, open_leases) = self.tuning.in_use();
        let (connections, newcomers) = self.connection_slots.counts();
        let most = self.admission.limits();
        self.metrics.text(&self.tuning.figures(self.studies_shown), |now| {
            for (gauge, count) in [
                (&now.connections, connections),
                (&now.newcomers, newcomers),
                (&now.in_flight, in_flight),
                (&now.streams, streams),
                (&now.studies_in_memory, studies_in_memory),
                (&now.draining, usize::from(self.admission.is_draining())),
                (&now.unfinished, self.unfinished.bytes()),
                (&now.connections_limit, self.connection_slots.limit()),
                (&now.in_flight_limit, most.requests),
                (&now.streams_limit, most.streams),
            ] {
                metrics::set(gauge, count as u64);
            }
            metrics::set(&now.open_leases, open_leases);
            metrics::set(&now.database, size.database_bytes);
            metrics::set(&now.database_log, size.log_bytes);
            now.certificate_expiry.set(self.tls.as_ref().map_or(0, |tls| tls.expiry_s()));
            now.last_backup
                .set(self.backup_mark.as_deref().and_then(maintenance::last_backup_s).unwrap_or(0));
        })
    }

    async fn respond(&self, request: &Request<Incoming>) -> Response<String> {
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
            "/metrics" => match self.figures().await {
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

impl Pages for Watched {
    type Body = String;

    const KEEPS_ALIVE: bool = false;
    const STAY: Duration = Duration::from_secs(2 * limits::WATCH.as_secs());

    async fn answer(self: &Arc<Self>, request: Request<Incoming>, slot: &ConnectionSlot) -> Response<String> {
        slot.settle();
        self.respond(&request).await
    }
}
