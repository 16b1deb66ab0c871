//! A running process of the service, and the calls it is working on.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use tokio::time::Instant;
use treewright_server::admission::Admission;
use treewright_server::rpc::Service;
use treewright_server::tuning::Tuning;
use treewright_store::Store;

use crate::claims::lock;

/// A running service. Cheap to clone.
#[derive(Clone)]
pub(crate) struct Machine {
    pub(crate) index: usize,
    pub(crate) service: Service,
    pub(crate) tuning: Arc<Tuning>,
    disk: Arc<dyn Store>,
    alive: Arc<AtomicBool>,
    calls: Arc<Calls>,
}

/// The calls that are being worked on, by number, and since when.
#[derive(Default)]
struct Calls {
    last: AtomicU64,
    since: Mutex<BTreeMap<u64, Instant>>,
}

impl Machine {
    /// A machine that has just started. `alive` turns false when it crashes.
    pub(crate) fn new(
        index: usize,
        tuning: Arc<Tuning>,
        disk: Arc<dyn Store>,
        alive: Arc<AtomicBool>,
    ) -> Self {
        let service = Service::new(Arc::clone(&tuning), Admission::default());
        Self { index, service, tuning, disk, alive, calls: Arc::default() }
    }

    pub(crate) fn is_alive(&self) -> bool {
        self.alive.load(Ordering::SeqCst)
    }

    pub(crate) fn doubt(&self, study: &str) {
        self.disk.doubt(study);
    }

    pub(crate) fn begin(&self) -> u64 {
        let number = self.calls.last.fetch_add(1, Ordering::SeqCst);
        lock(&self.calls.since).insert(number, Instant::now());
        number
    }

    pub(crate) fn end(&self, number: u64) {
        lock(&self.calls.since).remove(&number);
    }

    /// Whether a call has waited longer than a time.
    pub(crate) fn is_stuck(&self, patience: Duration) -> bool {
        let since = lock(&self.calls.since);
        since.first_key_value().is_some_and(|(_, since)| since.elapsed() > patience)
    }
}
