//! Figures for Prometheus. `watch` serves them.
//!
//! A process makes one set of figures in `main` and hands it down. Labels have few values for any input of
//! clients: RPCs come from the table of `access::rules`, codes are gRPC's seventeen, reasons stand in
//! `status`, and only some studies are shown (`studies`). The names and units follow OpenMetrics 1.0.

/// Declares figures as a table. A row has the type and its begin, where that is not the default, then the
/// name, the description, and the unit, if it has one.
macro_rules! figures {
    (@begin) => { Default::default() };
    (@begin $begin:expr) => { $begin };
    (@register $registry:ident, $figure:expr, $name:literal, $tells:literal) => {
        $registry.register($name, $tells, $figure)
    };
    (@register $registry:ident, $figure:expr, $name:literal, $tells:literal, $unit:ident) => {
        $registry.register_with_unit($name, $tells, Unit::$unit, $figure)
    };
    ($(#[$about:meta])* $visibility:vis struct $set:ident {
        $($figure:ident: $kind:ty $(= $begin:expr)?, $name:literal, $tells:literal $(, $unit:ident)?;)+
    }) => {
        $(#[$about])*
        #[derive(Debug)]
        $visibility struct $set {
            $($visibility $figure: $kind,)+
        }

        impl Default for $set {
            fn default() -> Self {
                Self { $($figure: figures!(@begin $($begin)?),)+ }
            }
        }

        impl $set {
            $visibility fn register(&self, registry: &mut Registry) {
                $(figures!(@register registry, self.$figure.clone(), $name, $tells $(, $unit)?);)+
            }
        }
    };
}

mod process;
mod studies;
mod study;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Registry, Unit};
use tonic::Code;
use treewright_core::trial::TrialState;
use treewright_core::tuner::Change;
use treewright_store::{Receipt, StoreError};

use crate::access::rules::{RULES, rule_for};
use crate::status;
use studies::StudyFamilies;
pub(crate) use study::{FrameCounts, StudyFigures};

/// Names and values of labels.
type Labels<const N: usize, T = &'static str> = [(&'static str, T); N];

/// The figures of one daemon.
#[derive(Debug)]
pub struct Metrics {
    registry: Mutex<Registry>,
    answers: AtomicU64,
    last_durable: Mutex<Instant>,
    events: EventFigures,
    now: MomentGauges,
    studies: StudyFamilies,
}

figures! {
    /// Figures that are counted as things happen.
    struct EventFigures {
        requests: Family<Labels<2>, Counter>,
            "requests", "Requests, and frames of Tune streams, by RPC and gRPC code";
        request_seconds: Family<Labels<1>, Histogram, fn() -> Histogram> =
            Family::new_with_constructor(seconds), "request",
            "From a request's head to the answer's, by RPC; of Tune.frame from the frame to its answer", Seconds;
        refusals: Family<Labels<1>, Counter>,
            "refusals", "Refused requests, frames and parts of frames, by reason";
        connections_lost: Family<Labels<1>, Counter>,
            "connections_lost", "Connections refused or closed, by reason";
        forwarded: Family<Labels<1>, Counter>, "forwarded",
            "Requests and frames passed on to the replica that holds their study, by what came of it";
        durable_seconds: Histogram = seconds(),
            "durable", "From a decision to its being on the disk", Seconds;
        thinking_seconds: Histogram = seconds(),
            "thinking", "Fits of models for one question, apart from the study", Seconds;
        unthought: Counter, "unthought",
            "Questions answered from the tables because no processor was free to compute a plan in time";
        store_queue: Gauge, "store_queue", "Decisions that wait for the disk";
        expired_leases: Counter, "expired_leases", "Leases that ran out";
        late_reports: Counter, "late_reports", "Reports that came after their lease";
        client_outbox: Histogram = Histogram::new(OUTBOX_STEPS), "client_outbox",
            "Reports that wait at a client, as it says with each question that is answered";
        removed_trials: Counter, "removed_trials", "Old trials that retention removed";
    }
}

figures! {
    /// Figures that are set at every request for metrics.
    pub(crate) struct MomentGauges {
        connections: Gauge, "connections", "Open connections";
        newcomers: Gauge,
            "connections_unauthorised", "Open connections on which no request was authorised yet";
        in_flight: Gauge, "requests_in_flight", "Requests being worked on";
        streams: Gauge, "tune_streams", "Open Tune streams";
        studies_in_memory: Gauge, "studies_in_memory", "Studies whose tuner is in memory";
        open_leases: Gauge, "open_leases", "Trials under a lease, of studies in memory";
        draining: Gauge, "draining", "1 while the daemon is ending";
        unfinished: Gauge, "unfinished",
            "Requests that have not come as a whole, and answers that were not read", Bytes;
        connections_limit: Gauge, "connections_limit", "Most connections";
        in_flight_limit: Gauge, "requests_in_flight_limit", "Most requests being worked on";
        streams_limit: Gauge, "tune_streams_limit", "Most Tune streams";
        descriptors: Gauge, "descriptors", "Open files and sockets";
        descriptors_limit: Gauge, "descriptors_limit", "Most files and sockets";
        certificate_expiry: Gauge, "certificate_expiry",
            "When the certificate ends, in Unix time; 0 without one", Seconds;
        last_backup: Gauge, "last_backup",
            "When `treewrightd backup` last copied the database, in Unix time; 0 if it never did", Seconds;
        memory: Gauge, "resident_memory", "Memory of the process", Bytes;
        processor_seconds: Gauge<f64, AtomicU64>, "processor",
            "Processor time of the process, user and system, since it started", Seconds;
        database: Gauge, "database", "What the database takes up", Bytes;
        database_log: Gauge,
            "database_log", "What the write-ahead log of a database file takes up", Bytes;
        since_durable: Gauge<f64, AtomicU64>, "since_durable",
            "Time since a decision was last found to be on the disk, or since the start", Seconds;
    }
}

const LOSSES: [&str; 5] = ["limit", "address", "made_room", "tls", "overdue"];

const FORWARDED: [&str; 2] = ["answered", "silent"];

/// Reports that wait at a client.
const OUTBOX_STEPS: [f64; 9] = [0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 10_000.0];

/// From 50 µs to 13 s, each twice the one before.
fn seconds() -> Histogram {
    Histogram::new((0..19).map(|step| 50e-6 * f64::from(1_u32 << step)))
}

impl Default for Metrics {
    fn default() -> Self {
        Self::new()
    }
}

impl Metrics {
    /// Figures that all stand at 0.
    pub fn new() -> Self {
        let metrics = Self {
            registry: Mutex::new(Registry::with_prefix("treewright")),
            answers: AtomicU64::new(0),
            last_durable: Mutex::new(Instant::now()),
            events: EventFigures::default(),
            now: MomentGauges::default(),
            studies: StudyFamilies::default(),
        };
        metrics.register();
        metrics
    }

    fn register(&self) {
        let mut guard = self.registry.lock().unwrap_or_else(PoisonError::into_inner);
        let registry = &mut *guard;
        let build = Family::<Labels<1>, Gauge>::default();
        build.get_or_create(&[("version", env!("CARGO_PKG_VERSION"))]).set(1);
        registry.register("build_info", "Always 1; which version runs", build);
        self.events.register(registry);
        self.now.register(registry);
        self.studies.register(registry);
        drop(guard);
        self.begin_at_zero();
    }

    /// Makes every counter with every label, so that the first event shows as an increase.
    fn begin_at_zero(&self) {
        for reason in LOSSES {
            drop(self.events.connections_lost.get_or_create(&[("reason", reason)]));
        }
        for reason in status::REASONS {
            drop(self.events.refusals.get_or_create(&[("reason", reason)]));
        }
        for outcome in FORWARDED {
            drop(self.events.forwarded.get_or_create(&[("outcome", outcome)]));
        }
        let rpcs = RULES.iter().map(|rule| rule.rpc).chain(["Tune.frame", rule_for("").rpc]);
        for rpc in rpcs {
            drop(self.events.request_seconds.get_or_create(&[("rpc", rpc)]));
            for code in (0..=16).map(Code::from_i32) {
                drop(self.events.requests.get_or_create(&[("rpc", rpc), ("code", code_name(code))]));
            }
        }
    }

    /// A request, or a frame of a stream, has been answered.
    pub(crate) fn answered(&self, rpc: &'static str, code: Code, took: Duration) {
        self.answers.fetch_add(1, Ordering::Relaxed);
        self.events.requests.get_or_create(&[("rpc", rpc), ("code", code_name(code))]).inc();
        self.events.request_seconds.get_or_create(&[("rpc", rpc)]).observe(took.as_secs_f64());
    }

    pub(crate) fn answers(&self) -> u64 {
        self.answers.load(Ordering::Relaxed)
    }

    pub(crate) fn refused(&self, reason: &'static str) {
        assert!(status::REASONS.contains(&reason), "{reason} is not counted from the start");
        self.events.refusals.get_or_create(&[("reason", reason)]).inc();
    }

    /// A connection was refused or closed, for one of [`LOSSES`].
    pub(crate) fn connection_lost(&self, reason: &'static str) {
        assert!(LOSSES.contains(&reason), "{reason} is not counted from the start");
        self.events.connections_lost.get_or_create(&[("reason", reason)]).inc();
    }

    /// A request was passed on to another replica, with one of the outcomes of [`FORWARDED`].
    pub(crate) fn forwarded(&self, outcome: &'static str) {
        assert!(FORWARDED.contains(&outcome), "{outcome} is not counted from the start");
        self.events.forwarded.get_or_create(&[("outcome", outcome)]).inc();
    }

    pub(crate) fn decided(&self, changes: &[Change]) {
        let trials = changes.iter().flat_map(|change| &change.trials);
        let late = trials.filter(|trial| trial.late && trial.state == TrialState::Completed).count();
        self.events.late_reports.inc_by(late as u64);
    }

    pub(crate) fn expired(&self, leases: usize) {
        self.events.expired_leases.inc_by(leases as u64);
    }

    /// A client with an answered question has given the number of its waiting reports.
    pub(crate) fn outbox_reported(&self, reports: u32) {
        self.events.client_outbox.observe(f64::from(reports));
    }

    pub(crate) fn removed(&self, trials: u64) {
        self.events.removed_trials.inc_by(trials);
    }

    /// Waits for the disk, and counts the wait.
    pub(crate) async fn durable(&self, receipt: Receipt) -> Result<(), StoreError> {
        let waiting = QueuePlace { queue: &self.events.store_queue, since: Instant::now() };
        self.events.store_queue.inc();
        let stored = receipt.durable().await;
        self.events.durable_seconds.observe(waiting.since.elapsed().as_secs_f64());
        if stored.is_ok() {
            *self.last_durable.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
        }
        stored
    }

    /// Waits for a plan to be computed, and counts the time.
    pub(crate) async fn planned<T>(&self, computing: impl Future<Output = T>) -> T {
        let since = Instant::now();
        let plan = computing.await;
        self.events.thinking_seconds.observe(since.elapsed().as_secs_f64());
        plan
    }

    /// A question was answered from the tables because no processor was free to compute a plan.
    pub(crate) fn not_planned(&self) {
        self.events.unthought.inc();
    }

    /// All figures in OpenMetrics' text form: those of these studies, and those that `look` sets.
    pub(crate) fn text(
        &self,
        studies: &[StudyFigures],
        look: impl FnOnce(&MomentGauges),
    ) -> Result<String, std::fmt::Error> {
        // Held to the end, so that two requests at once do not mix their moments.
        let registry = self.registry.lock().unwrap_or_else(PoisonError::into_inner);
        self.studies.show(studies);
        let now = &self.now;
        look(now);
        let (descriptors, descriptors_limit) = process::descriptors().unwrap_or((0, 0));
        set(&now.descriptors, descriptors);
        set(&now.descriptors_limit, descriptors_limit);
        set(&now.memory, process::resident_bytes().unwrap_or(0));
        now.processor_seconds.set(process::processor_seconds().unwrap_or(0.0));
        let last_durable = *self.last_durable.lock().unwrap_or_else(PoisonError::into_inner);
        now.since_durable.set(last_durable.elapsed().as_secs_f64());
        let mut text = String::new();
        prometheus_client::encoding::text::encode(&mut text, &registry)?;
        Ok(text)
    }
}

pub(crate) fn set(gauge: &Gauge, count: u64) {
    gauge.set(i64::try_from(count).unwrap_or(i64::MAX));
}

/// A place in the queue to the disk, even of a request that is cancelled while it waits.
struct QueuePlace<'a> {
    queue: &'a Gauge,
    since: Instant,
}

impl Drop for QueuePlace<'_> {
    fn drop(&mut self) {
        let before = self.queue.dec();
        debug_assert!(before > 0, "{before} decisions waited for the disk");
    }
}

/// The code as the gRPC specification writes it.
fn code_name(code: Code) -> &'static str {
    match code {
        Code::Ok => "OK",
        Code::Cancelled => "CANCELLED",
        Code::Unknown => "UNKNOWN",
        Code::InvalidArgument => "INVALID_ARGUMENT",
        Code::DeadlineExceeded => "DEADLINE_EXCEEDED",
        Code::NotFound => "NOT_FOUND",
        Code::AlreadyExists => "ALREADY_EXISTS",
        Code::PermissionDenied => "PERMISSION_DENIED",
        Code::ResourceExhausted => "RESOURCE_EXHAUSTED",
        Code::FailedPrecondition => "FAILED_PRECONDITION",
        Code::Aborted => "ABORTED",
        Code::OutOfRange => "OUT_OF_RANGE",
        Code::Unimplemented => "UNIMPLEMENTED",
        Code::Internal => "INTERNAL",
        Code::Unavailable => "UNAVAILABLE",
        Code::DataLoss => "DATA_LOSS",
        Code::Unauthenticated => "UNAUTHENTICATED",
    }
}

#[cfg(test)]
mod tests {
    use treewright_core::tuner::StudyCounts;

    use super::*;

    #[test]
    fn figures_are_written_with_few_labels() {
        let metrics = Metrics::new();
        metrics.answered("Suggest", Code::Ok, Duration::from_micros(300));
        metrics.answered("Suggest", Code::PermissionDenied, Duration::from_micros(30));
        metrics.connection_lost("tls");
        metrics.refused("scope");
        metrics.expired(2);
        let text = metrics
            .text(&[], |now| {
                set(&now.open_leases, 3);
                set(&now.database, 4096);
            })
            .unwrap();
        for line in [
            "treewright_requests_total{rpc=\"Suggest\",code=\"OK\"} 1",
            "treewright_requests_total{rpc=\"Suggest\",code=\"PERMISSION_DENIED\"} 1",
            "treewright_request_seconds_bucket{le=\"0.0004\",rpc=\"Suggest\"} 2",
            "treewright_connections_lost_total{reason=\"tls\"} 1",
            "treewright_refusals_total{reason=\"scope\"} 1",
            "treewright_expired_leases_total 2",
            "treewright_open_leases 3",
            "treewright_database_bytes 4096",
            "# EOF",
        ] {
            assert!(text.contains(line), "{line} is not in\n{text}");
        }
    }

    #[test]
    fn whatever_can_happen_is_counted_from_zero() {
        let text = Metrics::new().text(&[], |_| {}).unwrap();
        for line in [
            "treewright_refusals_total{reason=\"defect\"} 0",
            "treewright_refusals_total{reason=\"store\"} 0",
            "treewright_refusals_total{reason=\"token\"} 0",
            "treewright_requests_total{rpc=\"Suggest\",code=\"INTERNAL\"} 0",
            "treewright_requests_total{rpc=\"Tune.frame\",code=\"OK\"} 0",
            "treewright_request_seconds_count{rpc=\"Health.Check\"} 0",
        ] {
            assert!(text.contains(line), "{line} is not in\n{text}");
        }
    }

    #[test]
    fn studies_come_and_go() {
        let metrics = Metrics::new();
        let shown = |studies: &[&str]| {
            let figures = |study: &&str| StudyFigures {
                study: (*study).to_owned(),
                statistics: StudyCounts { trials: 7, ..StudyCounts::default() },
                tally: FrameCounts {
                    cost: [1.0, 5.5, 2.0, 0.0],
                    reached: [0.0, 90.0, 60.0, 0.0],
                    ..FrameCounts::default()
                },
                maximised: (*study == "attic").then(|| "fps".to_owned()),
                errors: vec![("contextual", 0.25)],
                unsaved_trials: 2,
                model_age_ms: Some(1500),
            };
            metrics.text(&studies.iter().map(figures).collect::<Vec<_>>(), |_| {}).unwrap()
        };
        for _ in 0..2 {
            let text = shown(&["hall", "attic"]);
            for line in [
                "treewright_study_trials{study=\"hall\"} 7",
                "treewright_study_cost_total{study=\"attic\",mode=\"explore\"} 5.5",
                "treewright_study_maximised_total{study=\"attic\",mode=\"explore\",metric=\"fps\"} 90.0",
                "treewright_study_model_error{study=\"hall\",predictor=\"contextual\"} 0.25",
                "treewright_study_model_age_seconds{study=\"hall\"} 1.5",
            ] {
                assert!(text.contains(line), "{line} is not in\n{text}");
            }
        }
        assert!(!["attic", "metric="].iter().any(|word| shown(&["hall"]).contains(word)), "it minimises");
    }

    #[tokio::test(start_paused = true)]
    async fn silence_of_the_disk_shows() {
        let metrics = Metrics::new();
        let since = |metrics: &Metrics| {
            let text = metrics.text(&[], |_| {}).unwrap();
            let line =
                text.lines().find(|line| line.starts_with("treewright_since_durable_seconds ")).unwrap();
            line.rsplit(' ').next().unwrap().parse::<f64>().unwrap()
        };
        *metrics.last_durable.lock().unwrap() -= Duration::from_secs(100);
        let (_never, receipt) = Receipt::pending();
        let waited = tokio::time::timeout(Duration::from_millis(5), metrics.durable(receipt)).await;
        assert!(waited.is_err() && since(&metrics) > 99.0, "nothing is on the disk yet");
        let ended = async |result| {
            let (answer, receipt) = Receipt::pending();
            answer.send(result).expect("somebody waits");
            metrics.durable(receipt).await
        };
        ended(Err(StoreError::Closed)).await.unwrap_err();
        assert!(since(&metrics) > 99.0, "nor is this");
        ended(Ok(())).await.unwrap();
        assert!(since(&metrics) < 50.0);
    }

    #[tokio::test]
    async fn who_gives_up_waiting_leaves_the_queue() {
        let metrics = Metrics::new();
        let (_never, receipt) = Receipt::pending();
        let waited = tokio::time::timeout(Duration::from_millis(5), metrics.durable(receipt)).await;
        assert!(waited.is_err());
        assert_eq!(metrics.events.store_queue.get(), 0);
    }
}
