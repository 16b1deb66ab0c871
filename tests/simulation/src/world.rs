//! A world: its time, its chance, its troubles, its machines and its books, shared by all its parts.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use tokio::sync::{Notify, oneshot};
use tokio::time::{Instant, sleep, sleep_until};
use treewright_core::fnv;
use treewright_store::StoreError;
use treewright_store::limits::REPLICA_LAPSE;

use crate::claims::lock;
use crate::durable::Durable;
use crate::ledger::{Counts, Ledger, Violation};
use crate::machine::Machine;
use crate::plan::Plan;

/// Where simulated time begins, in milliseconds since 1970.
pub(crate) const START_MS: i64 = 1_750_000_000_000;
/// A call that a living machine has not answered after this time never will be.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);
/// No wait is longer.
const WAIT_MS_MAX: f64 = 1e7;

/// The result of a world.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Its plan.
    pub plan: Plan,
    /// Counts of events.
    pub counts: Counts,
    /// Events.
    pub steps: u64,
    /// Simulated time, in milliseconds.
    pub simulated_ms: u64,
    /// Equal for equal worlds: a hash over all events and their times.
    pub fingerprint: u64,
    /// Violations of the promises; empty if all is well.
    pub violations: Vec<Violation>,
}

/// A trouble that lasts for a time.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Trouble {
    /// The disk is full, for all machines.
    Full,
    /// A client is cut off from everything.
    Cut,
    /// A machine is cut off from the database.
    Away,
    /// A machine has stopped in its tracks.
    Asleep,
}

/// The state that all parts of a world share.
pub(crate) struct World {
    pub(crate) plan: Plan,
    pub(crate) durable: Arc<Durable>,
    begin: Instant,
    chance: Mutex<ChaCha8Rng>,
    inner: Mutex<Inner>,
    /// Notified when the world is over.
    over: Notify,
}

#[derive(Default)]
struct Inner {
    ledger: Ledger,
    steps: u64,
    fingerprint: u64,
    is_over: bool,
    /// Nothing goes wrong any more.
    is_calm: bool,
    machines: Vec<Option<Machine>>,
    /// When the last trouble of a kind of each client or machine began, and until when it lasts.
    troubles: BTreeMap<(Trouble, usize), (Instant, Instant)>,
    /// Answers that the planted defect keeps for ever.
    forgotten: Vec<oneshot::Sender<Result<(), StoreError>>>,
}

impl World {
    pub(crate) fn new(plan: Plan) -> Self {
        let machines = (0..plan.replicas).map(|_| None).collect();
        let inner = Inner { machines, fingerprint: fnv::EMPTY, ..Inner::default() };
        World {
            durable: Arc::default(),
            begin: Instant::now(),
            chance: Mutex::new(ChaCha8Rng::seed_from_u64(plan.seed)),
            inner: Mutex::new(inner),
            over: Notify::new(),
            plan,
        }
    }

    /// Waits until the last event, or something that should not be.
    pub(crate) async fn over(&self) {
        self.over.notified().await;
    }

    /// From here on nothing goes wrong any more.
    pub(crate) fn calm_down(&self) {
        self.lock().is_calm = true;
    }

    /// The last check, and what came of the world; it ends with this.
    pub(crate) fn end(&self) -> Outcome {
        let mut inner = self.lock();
        inner.ledger.check_all(&self.durable);
        // They know the world, and the world knows them.
        inner.machines.clear();
        inner.forgotten.clear();
        Outcome {
            plan: self.plan.clone(),
            counts: inner.ledger.counts.clone(),
            steps: inner.steps,
            simulated_ms: u64::try_from(self.begin.elapsed().as_millis()).unwrap_or(u64::MAX),
            fingerprint: inner.fingerprint,
            violations: std::mem::take(&mut inner.ledger.violations),
        }
    }

    /// Brings a trouble upon a client or machine.
    pub(crate) fn bring(&self, trouble: Trouble, whose: usize, time: Duration) {
        let now = Instant::now();
        self.lock().troubles.insert((trouble, whose), (now, now + time));
    }

    /// The machine that holds a study, where it is another one and lives.
    pub(crate) fn other_holder(&self, study: &str, me: usize) -> Option<usize> {
        self.durable.claims.other_holder(study, me, |replica| self.has_lapsed(replica))
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        lock(&self.inner)
    }

    fn random(&self) -> f64 {
        lock(&self.chance).random()
    }

    /// True with a probability.
    pub(crate) fn chance(&self, share: f64) -> bool {
        share > 0.0 && self.random() < share
    }

    pub(crate) fn one_in(&self, times: u32) -> bool {
        self.random() * f64::from(times) < 1.0
    }

    pub(crate) fn below(&self, bound: u64) -> u64 {
        (self.random() * bound as f64) as u64
    }

    /// A number between two.
    pub(crate) fn between(&self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.random()
    }

    /// A time with a mean, exponentially distributed.
    pub(crate) fn time_ms(&self, mean_ms: f64) -> Duration {
        let ms = (-mean_ms * (1.0 - self.random()).ln()).min(WAIT_MS_MAX);
        Duration::from_micros((ms * 1e3) as u64)
    }

    pub(crate) fn elapsed_ms(&self) -> i64 {
        i64::try_from(self.begin.elapsed().as_millis()).unwrap_or(i64::MAX)
    }

    pub(crate) fn step(&self, what: &str) {
        let time = u64::try_from(self.begin.elapsed().as_micros()).unwrap_or(u64::MAX);
        let mut inner = self.lock();
        inner.steps += 1;
        // Fowler, Noll and Vo's hash, 1a.
        for byte in what.bytes().chain(time.to_le_bytes()) {
            inner.fingerprint = fnv::add(inner.fingerprint, u64::from(byte));
        }
        if inner.steps >= self.plan.steps && !inner.is_over {
            inner.is_over = true;
            self.over.notify_one();
        }
    }

    pub(crate) fn count(&self, count: impl FnOnce(&mut Counts)) {
        count(&mut self.lock().ledger.counts);
    }

    /// Enters an event into the books; a violation ends the world.
    pub(crate) fn enter(&self, enter: impl FnOnce(&mut Ledger, &Durable)) {
        let mut inner = self.lock();
        enter(&mut inner.ledger, &self.durable);
        if !inner.ledger.violations.is_empty() && !inner.is_over {
            inner.is_over = true;
            self.over.notify_one();
        }
    }

    /// The number of reports that were acknowledged so far.
    pub(crate) fn known(&self) -> i64 {
        self.lock().ledger.known()
    }

    /// Notes something that should not be.
    pub(crate) fn violation(&self, what: String) {
        let at_ms = self.elapsed_ms();
        self.enter(|ledger, _| ledger.violations.push(Violation { at_ms, what }));
    }

    /// A living machine answers every call.
    pub(crate) fn look_for_stuck_calls(&self) {
        let now = Instant::now();
        let slept = |inner: &Inner| {
            let mut all = inner.troubles.iter();
            all.any(|((trouble, _), (_, until))| *trouble == Trouble::Asleep && *until + PATIENCE > now)
        };
        // A machine that sleeps does not answer, and its callers wait; the last look comes when all machines
        // have long been awake.
        if !self.is_calm() && slept(&self.lock()) {
            return;
        }
        let is_stuck = self.lock().machines.iter().flatten().any(|machine| machine.is_stuck(PATIENCE));
        if is_stuck {
            self.violation("a living machine leaves a call unanswered".to_owned());
        }
    }

    /// Whether clients should come to an end.
    pub(crate) fn is_over(&self) -> bool {
        self.lock().is_over
    }

    pub(crate) fn is_calm(&self) -> bool {
        self.lock().is_calm
    }

    /// Waits for the next trouble of a kind; false when there will be none.
    pub(crate) async fn wait_for_trouble(&self, every_ms: f64) -> bool {
        if !every_ms.is_finite() {
            return false;
        }
        sleep(self.time_ms(every_ms)).await;
        !self.is_calm()
    }

    /// For how long a client or machine has been in a trouble.
    pub(crate) fn troubled(&self, trouble: Trouble, whose: usize) -> Option<Duration> {
        let inner = self.lock();
        let (since, until) = *inner.troubles.get(&(trouble, whose)).filter(|_| !inner.is_calm)?;
        let now = Instant::now();
        (now < until).then(|| now - since)
    }

    /// Whether a client or machine is in a trouble.
    pub(crate) fn is_in(&self, trouble: Trouble, whose: usize) -> bool {
        self.troubled(trouble, whose).is_some()
    }

    /// Whether the database takes it for dead.
    fn has_lapsed(&self, replica: usize) -> bool {
        let troubled = |trouble| self.troubled(trouble, replica);
        troubled(Trouble::Away).max(troubled(Trouble::Asleep)).is_some_and(|time| time > REPLICA_LAPSE)
    }

    /// Waits until a machine is awake.
    pub(crate) async fn awake(&self, replica: usize) {
        while self.is_in(Trouble::Asleep, replica) {
            let (_, until) = self.lock().troubles[&(Trouble::Asleep, replica)];
            sleep_until(until).await;
        }
    }

    pub(crate) fn machine(&self, index: usize) -> Option<Machine> {
        self.lock().machines[index].clone()
    }

    pub(crate) fn set_machine(&self, index: usize, machine: Option<Machine>) {
        self.lock().machines[index] = machine;
    }

    /// Keeps an answer for ever.
    pub(crate) fn forget(&self, answer: oneshot::Sender<Result<(), StoreError>>) {
        self.lock().forgotten.push(answer);
    }
}
