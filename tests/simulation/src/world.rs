//! A world: its time, its chance, its machines and clients, from the first event to the last check.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use tokio::sync::{Notify, oneshot};
use tokio::time::{Instant, sleep, sleep_until};
use treewright_core::fnv;
use treewright_server::convert::from_proto;
use treewright_store::limits::REPLICA_LAPSE;
use treewright_store::{Store as _, StoreError};

use crate::disk::Durable;
use crate::ledger::{Counts, Ledger, Violation};
use crate::machine::{self, Machine};
use crate::plan::Plan;
use crate::{client, replay, requests};

/// Where simulated time begins, in milliseconds since 1970.
pub(crate) const START_MS: i64 = 1_750_000_000_000;
/// A call that a living machine has not answered after this time never will be.
const PATIENCE: Duration = Duration::from_secs(60);
/// How long the quiet after the last event lasts, in which everybody finishes what they are at.
const QUIET: Duration = Duration::from_secs(900);
/// No wait is longer.
const WAIT_MS_MAX: f64 = 1e7;

/// What came of a world.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// How it was made.
    pub plan: Plan,
    /// How much happened.
    pub counts: Counts,
    /// Events.
    pub steps: u64,
    /// Simulated time, in milliseconds.
    pub simulated_ms: u64,
    /// Equal for equal worlds: a hash over all events and their times.
    pub fingerprint: u64,
    /// What should not have been; empty if all is well.
    pub violations: Vec<Violation>,
}

/// What everything in a world shares.
pub(crate) struct World {
    pub(crate) plan: Plan,
    pub(crate) durable: Arc<Durable>,
    begin: Instant,
    chance: Mutex<ChaCha8Rng>,
    inner: Mutex<Inner>,
    /// Told when the world is over.
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
    full_until: Option<Instant>,
    cut_until: Vec<Option<Instant>>,
    /// When each machine lost the database, and until when.
    away: Vec<Option<(Instant, Instant)>>,
    /// When each machine stopped in its tracks, and until when.
    asleep: Vec<Option<(Instant, Instant)>>,
    /// Answers that the planted defect keeps for ever.
    forgotten: Vec<oneshot::Sender<Result<(), StoreError>>>,
}

/// Runs a world to its end.
///
/// # Panics
/// When the runtime cannot be built, or the simulator itself has a defect.
#[must_use]
pub fn run(plan: Plan) -> Outcome {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_time()
        .start_paused(true)
        .build()
        .expect("a runtime without input and output");
    let outcome = runtime.block_on(live(plan));
    // Whatever still waits is of no interest.
    runtime.shutdown_background();
    outcome
}

async fn live(plan: Plan) -> Outcome {
    let world = Arc::new(World::new(plan));
    let spec = from_proto::study(requests::study(&world.plan)).expect("a valid study");
    world.durable.store.create_study("world", &spec, START_MS).await.expect("an empty store");
    for index in 0..world.plan.replicas {
        tokio::spawn(machine::live(Arc::clone(&world), index));
    }
    tokio::spawn(fill_the_disk(Arc::clone(&world)));
    tokio::spawn(cut_clients_off(Arc::clone(&world)));
    tokio::spawn(cut_machines_off(Arc::clone(&world)));
    tokio::spawn(put_machines_to_sleep(Arc::clone(&world)));
    tokio::spawn(watch(Arc::clone(&world)));
    let clients: Vec<_> = (0..world.plan.clients)
        .map(|number| tokio::spawn(client::live(Arc::clone(&world), number)))
        .collect();
    world.over.notified().await;

    // From here on all goes well, so that everybody must come to an end.
    world.lock().is_calm = true;
    let begin = Instant::now();
    for client in clients {
        let left = QUIET.saturating_sub(begin.elapsed());
        if tokio::time::timeout(left, client).await.is_err() {
            world.violation(
                "a client does not come to an end although nothing goes wrong any more".to_owned(),
            );
        }
    }
    sleep(PATIENCE + Duration::from_secs(1)).await;
    world.look_for_stuck_calls();
    replay::check(&world).await;
    let durable = Arc::clone(&world.durable);
    world.lock().ledger.check_all(&durable);
    let mut inner = world.lock();
    // They know the world, and the world knows them.
    inner.machines.clear();
    inner.forgotten.clear();
    Outcome {
        plan: world.plan.clone(),
        counts: inner.ledger.counts.clone(),
        steps: inner.steps,
        simulated_ms: u64::try_from(world.begin.elapsed().as_millis()).unwrap_or(u64::MAX),
        fingerprint: inner.fingerprint,
        violations: std::mem::take(&mut inner.ledger.violations),
    }
}

/// Fills the disk now and then; a while later there is room again.
async fn fill_the_disk(world: Arc<World>) {
    while world.wait_for_trouble(world.plan.full_every_ms).await {
        let until = Instant::now() + world.time_ms(3_000.0);
        world.lock().full_until = Some(until);
        world.count(|counts| counts.full_disks += 1);
        world.step("disk full");
    }
}

/// Cuts a client off now and then.
async fn cut_clients_off(world: Arc<World>) {
    while world.wait_for_trouble(world.plan.partition_every_ms).await {
        let until = Instant::now() + world.time_ms(world.plan.partition_ms);
        let client = world.below(u64::from(world.plan.clients)) as usize;
        world.lock().cut_until[client] = Some(until);
        world.count(|counts| counts.partitions += 1);
        world.step("partition");
    }
}

/// Cuts a machine off from a shared database now and then.
async fn cut_machines_off(world: Arc<World>) {
    while world.plan.replicas > 1 && world.wait_for_trouble(world.plan.away_every_ms).await {
        let now = Instant::now();
        let until = now + world.time_ms(world.plan.away_ms);
        let replica = world.below(world.plan.replicas as u64) as usize;
        world.lock().away[replica] = Some((now, until));
        world.count(|counts| counts.absences += 1);
        world.step("database away");
    }
}

/// Stops a machine in its tracks now and then, as a hypervisor does; it goes on as if no time had passed.
async fn put_machines_to_sleep(world: Arc<World>) {
    while world.wait_for_trouble(world.plan.sleep_every_ms).await {
        let now = Instant::now();
        let until = now + world.time_ms(world.plan.sleep_ms).min(PATIENCE / 3);
        let replica = world.below(world.plan.replicas as u64) as usize;
        world.lock().asleep[replica] = Some((now, until));
        world.count(|counts| counts.sleeps += 1);
        world.step("asleep");
    }
}

/// Looks for calls that are never answered.
async fn watch(world: Arc<World>) {
    loop {
        sleep(Duration::from_secs(10)).await;
        if world.is_over() {
            return;
        }
        world.look_for_stuck_calls();
    }
}

impl World {
    fn new(plan: Plan) -> Self {
        let inner = Inner {
            machines: (0..plan.replicas).map(|_| None).collect(),
            cut_until: vec![None; plan.clients as usize],
            away: vec![None; plan.replicas],
            asleep: vec![None; plan.replicas],
            fingerprint: fnv::EMPTY,
            ..Inner::default()
        };
        World {
            durable: Arc::default(),
            begin: Instant::now(),
            chance: Mutex::new(ChaCha8Rng::seed_from_u64(plan.seed)),
            inner: Mutex::new(inner),
            over: Notify::new(),
            plan,
        }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn random(&self) -> f64 {
        self.chance.lock().unwrap_or_else(PoisonError::into_inner).random()
    }

    /// True with a probability.
    pub(crate) fn chance(&self, share: f64) -> bool {
        share > 0.0 && self.random() < share
    }

    /// True once in so many times.
    pub(crate) fn one_in(&self, times: u32) -> bool {
        self.random() * f64::from(times) < 1.0
    }

    /// A whole number below a bound.
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

    /// Milliseconds since the beginning.
    pub(crate) fn elapsed_ms(&self) -> i64 {
        i64::try_from(self.begin.elapsed().as_millis()).unwrap_or(i64::MAX)
    }

    /// Something happened.
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

    /// Enters something into the books; what is wrong ends the world.
    pub(crate) fn enter(&self, enter: impl FnOnce(&mut Ledger, &Durable)) {
        let mut inner = self.lock();
        enter(&mut inner.ledger, &self.durable);
        if !inner.ledger.violations.is_empty() && !inner.is_over {
            inner.is_over = true;
            self.over.notify_one();
        }
    }

    /// How many reports were acknowledged so far.
    pub(crate) fn known(&self) -> i64 {
        self.lock().ledger.known()
    }

    /// Notes something that should not be.
    pub(crate) fn violation(&self, what: String) {
        let at_ms = self.elapsed_ms();
        self.enter(|ledger, _| ledger.violations.push(Violation { at_ms, what }));
    }

    /// A living machine answers every call.
    fn look_for_stuck_calls(&self) {
        let now = Instant::now();
        let slept = |inner: &Inner| inner.asleep.iter().flatten().any(|(_, until)| *until + PATIENCE > now);
        // Who sleeps answers nobody, and who asked it waits; the last look comes when all have long been awake.
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

    /// Whether nothing goes wrong any more.
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

    pub(crate) fn disk_is_full(&self) -> bool {
        let inner = self.lock();
        !inner.is_calm && inner.full_until.is_some_and(|until| Instant::now() < until)
    }

    pub(crate) fn is_cut_off(&self, client: u32) -> bool {
        let inner = self.lock();
        !inner.is_calm && inner.cut_until[client as usize].is_some_and(|until| Instant::now() < until)
    }

    /// For how long a machine has been in a trouble.
    fn troubled(&self, of: impl Fn(&Inner) -> Option<(Instant, Instant)>) -> Option<Duration> {
        let inner = self.lock();
        let (since, until) = of(&inner).filter(|_| !inner.is_calm)?;
        let now = Instant::now();
        (now < until).then(|| now - since)
    }

    /// Whether a machine cannot reach the database.
    pub(crate) fn is_away(&self, replica: usize) -> bool {
        self.troubled(|inner| inner.away[replica]).is_some()
    }

    /// Whether it has only just lost it, so that what it sent last may have arrived.
    pub(crate) fn is_leaving(&self, replica: usize) -> bool {
        self.troubled(|inner| inner.away[replica]).is_some_and(|time| time < Duration::from_secs(1))
    }

    /// Whether the database takes it for dead.
    pub(crate) fn has_lapsed(&self, replica: usize) -> bool {
        let away = self.troubled(|inner| inner.away[replica]);
        let asleep = self.troubled(|inner| inner.asleep[replica]);
        away.max(asleep).is_some_and(|time| time > REPLICA_LAPSE)
    }

    /// Waits until a machine is awake.
    pub(crate) async fn awake(&self, replica: usize) {
        while self.troubled(|inner| inner.asleep[replica]).is_some() {
            let until = self.lock().asleep[replica].map_or_else(Instant::now, |(_, until)| until);
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
