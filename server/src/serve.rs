//! The life of the server: serve until a signal to stop, drain, close.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, interval, sleep, timeout};
use tonic::codec::CompressionEncoding;
use tonic::transport::Server;
use tonic_health::ServingStatus;
use tonic_health::server::{HealthReporter, HealthService};
use treewright_proto::v1::tuning_service_server::{SERVICE_NAME, TuningServiceServer};
use treewright_store::{Store, StoreError};

use crate::access::Access;
use crate::admission::{Admission, AdmissionLimits};
use crate::clock::Clock;
use crate::config::DashboardPeer;
use crate::connections::{self, ConnectionLimits, ConnectionSlots, Unfinished};
use crate::dashboard::Dashboard;
use crate::error::Error;
use crate::forward::ForwardLayer;
use crate::limits;
use crate::listeners::Listeners;
use crate::metrics::Metrics;
use crate::middleware::MiddlewareLayer;
use crate::peers::Peers;
use crate::refusals::Refusals;
use crate::rpc::Service;
use crate::tls::Tls;
use crate::trouble::Trouble;
use crate::tuning::Tuning;
use crate::watch::Watched;

/// Time for the last answers to be sent, once no request is in progress.
const FLUSH: Duration = Duration::from_millis(200);

/// Why serving failed.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The server could not be put together, or the listener failed.
    #[error("the server failed: {0}")]
    Server(String),
    /// A task that accepts connections, writes, sweeps or saves met a defect.
    #[error("a task of the daemon met a defect, which the log tells; start it again and report this")]
    Task,
}

/// The options of serving. From a [`Duration`] alone it is a server without access control and encryption, as
/// most tests want.
#[derive(Default)]
pub struct Options {
    /// How long requests may take to finish at the end.
    pub drain: Duration,
    /// Access control; without it, every caller is admitted.
    pub access: Option<Arc<Access>>,
    /// The certificates; without them, plain text.
    pub tls: Option<Arc<Tls>>,
    /// The listener for monitoring, if any.
    pub watch: Option<TcpListener>,
    /// The listener for the dashboard, if any.
    pub dashboard: Option<TcpListener>,
    /// The other dashboards in its list of studies.
    pub dashboard_peers: Vec<DashboardPeer>,
    /// The number of studies that metrics show by name: those used last.
    pub studies_shown: u16,
    /// The least number of trials of a study to keep, where not all are kept.
    pub keep_trials: Option<u64>,
    /// The limits of connections.
    pub connections: ConnectionLimits,
    /// The number of connections that monitoring and the dashboard may each have;
    /// [`limits::PAGES_CONNECTIONS`] by default.
    pub pages: Option<usize>,
    /// The file whose date is that of the last backup.
    pub backup_mark: Option<PathBuf>,
    /// The most work at once.
    pub admission: AdmissionLimits,
    /// The metrics.
    pub metrics: Arc<Metrics>,
}

impl From<Duration> for Options {
    fn from(drain: Duration) -> Self {
        Self { drain, ..Self::default() }
    }
}

/// Serves `store` on `listeners` until `shutdown`, then drains and closes the store.
///
/// Draining: health turns NOT_SERVING, new requests are answered UNAVAILABLE, requests and stream frames in
/// progress are finished, streams end with UNAVAILABLE.
pub async fn run(
    listeners: impl Into<Listeners>,
    store: Arc<dyn Store>,
    clock: Arc<dyn Clock>,
    options: impl Into<Options>,
    shutdown: impl Future<Output = ()> + Send,
) -> Result<(), ServeError> {
    let Options {
        drain,
        access,
        tls,
        watch: watch_listener,
        dashboard: dashboard_listener,
        dashboard_peers,
        studies_shown,
        keep_trials,
        connections,
        pages,
        backup_mark,
        admission,
        metrics,
    } = options.into();
    let mut listeners = listeners.into();
    let socket_files = listeners.take_files();
    let tuning = Arc::new(Tuning::new(Arc::clone(&store), clock).with_metrics(Arc::clone(&metrics)));
    let refusals = Refusals::new(Arc::clone(&metrics));
    let peers = Peers::of(&store, tls.clone(), refusals.clone());
    let admission = Admission::new(admission);
    let connection_slots = ConnectionSlots::new(connections);
    let unfinished = Unfinished::new(limits::UNFINISHED_BYTES);
    let pages = pages.unwrap_or(limits::PAGES_CONNECTIONS);
    let mut health = HealthReporter::new();
    set_health(&health, ServingStatus::Serving).await;

    let service = Service::behind_middleware(Arc::clone(&tuning), admission.clone(), refusals.clone())
        .with_peers(peers.clone());
    let service = TuningServiceServer::new(service)
        .max_decoding_message_size(limits::REQUEST_BYTES)
        .accept_compressed(CompressionEncoding::Gzip);
    let health_service = tonic_health::pb::health_server::HealthServer::new(
        HealthService::from_health_reporter(health.clone()),
    );
    let reflection = || {
        tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(treewright_proto::FILE_DESCRIPTOR_SET)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
    };
    let defect = |error: tonic_reflection::server::Error| ServeError::Server(error.to_string());
    let replica_key = peers.as_ref().map(|peers| peers.key().clone());
    let middleware = MiddlewareLayer::new(access.clone(), replica_key, refusals.clone())
        .map_err(|error| ServeError::Server(error.to_string()))?;
    let stop = Admission::draining(&admission);
    // None of them ends by itself: one that does has met a defect, and the daemon ends with it.
    let mut steady = JoinSet::new();
    let server = Server::builder()
        .layer(middleware)
        .max_concurrent_streams(limits::CALLS_PER_CONNECTION)
        .initial_stream_window_size(limits::WINDOW_BYTES)
        .initial_connection_window_size(limits::WINDOW_BYTES)
        .http2_max_pending_accept_reset_streams(Some(limits::RESETS_PER_CONNECTION))
        .http2_max_header_list_size(limits::HEADER_BYTES)
        .http2_keepalive_interval(Some(limits::KEEPALIVE))
        .http2_keepalive_timeout(Some(limits::KEEPALIVE))
        .layer(ForwardLayer::new(peers.clone()))
        .add_service(health_service)
        .add_service(reflection().build_v1().map_err(defect)?)
        .add_service(reflection().build_v1alpha().map_err(defect)?)
        .add_service(service)
        .serve_with_incoming_shutdown(
            connections::accept(
                &mut steady,
                listeners,
                tls.clone(),
                connection_slots.clone(),
                unfinished.clone(),
                Arc::clone(&metrics),
            ),
            stop,
        );
    tokio::pin!(server);

    if let Some(listener) = watch_listener {
        let watched = Watched {
            tuning: Arc::clone(&tuning),
            store: Arc::clone(&store),
            admission: admission.clone(),
            connection_slots,
            unfinished,
            tls,
            backup_mark,
            metrics,
            studies_shown: studies_shown.into(),
        };
        steady.spawn(connections::pages::serve(listener, watched, pages));
    }
    if let Some(listener) = dashboard_listener {
        let dashboard = Dashboard::new(Arc::clone(&tuning), access.clone(), refusals, dashboard_peers);
        steady.spawn(connections::pages::serve(listener, dashboard, pages));
    }
    steady.spawn(sweep(Arc::clone(&tuning), Arc::clone(&store)));
    steady.spawn(save_checkpoints(Arc::clone(&tuning)));
    if let Some(keep) = keep_trials {
        steady.spawn(thin_trials(Arc::clone(&tuning), keep));
    }
    // It is not cut off, since it may be storing what tokens used.
    let mut following = JoinSet::new();
    let (end_following, ends) = oneshot::channel::<()>();
    if let Some(access) = access.clone() {
        let ends = async move {
            let _ = ends.await;
        };
        following.spawn(async move { access.follow(ends).await });
    }
    let mut has_failed = false;
    let served = tokio::select! {
        served = &mut server => Some(served),
        () = shutdown => None,
        Some(_) = steady.join_next() => {
            has_failed = true;
            None
        }
        Some(_) = following.join_next() => {
            has_failed = true;
            None
        }
    };
    let served = match served {
        Some(served) => {
            // It takes connections until it has to end, unless the tasks that accept them met a defect.
            has_failed = served.is_ok();
            served
        }
        None => {
            tracing::info!(drain_s = drain.as_secs(), "draining");
            set_health(&health, ServingStatus::NotServing).await;
            // The files are removed while the socket still listens. The next daemon makes a new file where it
            // is gone, and waits while this one listens. Later the file could be that daemon's.
            drop(socket_files);
            admission.drain();
            // The server must go on while those inside finish.
            let finish = async {
                admission.empty().await;
                // The last checkpoints only save the next start from learning again.
                if timeout(limits::LAST_CHECKPOINTS, tuning.save_last_checkpoints()).await.is_err() {
                    tracing::info!("the last checkpoints took too long; the next start reads more trials");
                }
                // Before the answers have left, so that other replicas take over at once.
                store.close().await;
                sleep(FLUSH).await;
                // Ends the streams of health watchers.
                for service in ["", SERVICE_NAME] {
                    health.clear_service_status(service).await;
                }
                // All requests are answered. A frozen or lost client that does not read must not delay the
                // end.
                sleep(limits::DRAIN_UNREAD).await;
                tracing::info!("not every client reads its last answer; connections are cut");
            };
            let drained = timeout(drain, async {
                tokio::select! {
                    served = &mut server => served,
                    () = finish => Ok(()),
                }
            });
            drained.await.unwrap_or_else(|_| {
                tracing::warn!("not everything was finished in time; connections are cut");
                Ok(())
            })
        }
    };
    steady.shutdown().await;
    drop(end_following);
    while following.join_next().await.is_some() {}
    if let Some(access) = access {
        access.close().await;
    }
    store.close().await;
    if has_failed {
        tracing::error!("stopped, since a task that never ends has ended; what was acknowledged is stored");
        return Err(ServeError::Task);
    }
    tracing::info!("stopped");
    served.map_err(|error| ServeError::Server(error.to_string()))
}

async fn set_health(health: &HealthReporter, status: ServingStatus) {
    for service in ["", SERVICE_NAME] {
        health.set_service_status(service, status).await;
    }
}

/// Ends leases that have run out, also in studies without requests. It ends where the store can write no
/// more. What fails each time is logged rarely.
async fn sweep(tuning: Arc<Tuning>, store: Arc<dyn Store>) {
    let (mut trouble, mut of_studies) = (Trouble::default(), BTreeMap::<String, Trouble>::new());
    let mut ticks = interval(limits::SWEEP_PERIOD);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        if store.has_failed() {
            return;
        }
        // Where the store is closed, the daemon is ending.
        match tuning.sweep().await {
            Ok(failed) => {
                if trouble.is_over() {
                    tracing::info!("leases are swept again");
                }
                of_studies.retain(|study, _| failed.contains_key(study));
                for (study, error) in failed {
                    let is_end = error == Error::Store(StoreError::Closed);
                    if !is_end && of_studies.entry(study.clone()).or_default().is_worth_a_line() {
                        tracing::warn!(study, %error, "leases of the study could not be swept; trying again");
                    }
                }
            }
            Err(Error::Store(StoreError::Closed)) => {}
            Err(error) if trouble.is_worth_a_line() => {
                tracing::warn!(%error, "leases could not be swept; trying again");
            }
            Err(_) => {}
        }
    }
}

async fn save_checkpoints(tuning: Arc<Tuning>) {
    let mut ticks = interval(limits::CHECKPOINT_PERIOD);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        tuning.save_checkpoints().await;
    }
}

async fn thin_trials(tuning: Arc<Tuning>, keep: u64) {
    let mut ticks = interval(limits::THINNING_PERIOD);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        tuning.thin_trials(keep).await;
    }
}
