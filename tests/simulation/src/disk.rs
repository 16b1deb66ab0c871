//! The simulated disk: a store whose writes take time, fail, and are lost when the machine crashes before
//! they end.
//!
//! Behind it lies one [`MemoryStore`], which holds the durable data and outlives every machine. In front of
//! it each machine has a queue and a writer that puts waiting writes into one transaction, as the real stores
//! do. A crash at a random moment of a write loses the whole transaction or keeps it whole, as a checksummed
//! log does with a torn write. Each machine has fences of its own. Whether another machine has taken the
//! study shows when the transaction is applied, as with an epoch in a shared database.
//! [`claims`](crate::claims) decides which machine may take a study.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use async_trait::async_trait;
use tokio::sync::{mpsc, oneshot};
use tokio::time::sleep;
use treewright_core::ids::StudyUid;
use treewright_core::study::StudySpec;
use treewright_core::trial::RawTrial;
use treewright_core::tuner::Checkpoint;
use treewright_store::{
    ClosedTrial, Created, Fence, Loaded, MemoryStore, Receipt, Result, Store, StoreError, StudyRecord,
    StudyWrite, TrialPage, TrialQuery,
};

use crate::claims::{Known, lock};
use crate::durable::{Durable, now};
use crate::plan::Bug;
use crate::world::{Trouble, World};

/// Most writes of one transaction, and most that wait.
const GROUP: usize = 64;
const QUEUE: usize = 1024;
/// The planted lost wake-up strikes one write of this number.
const FORGOTTEN: u32 = 500;

type Answer = oneshot::Sender<Result<()>>;

/// A write under a fence of the durable store.
type Write = Box<dyn Fn(&MemoryStore, &Fence) -> Receipt + Send>;

/// Something that waits for the writer.
struct Job {
    /// The machine's fence and the write; none for a barrier, which ends once everything before it has.
    write: Option<(Fence, Write)>,
    /// Whether it holds the changes of a commit.
    is_commit: bool,
    answer: Answer,
}

/// The last fence of each study that a machine was given: its own, and the durable store's behind it.
type Fences = HashMap<String, (Fence, Fence)>;

/// One machine's view of the disk.
pub(crate) struct SimulatedDisk {
    world: Arc<World>,
    durable: Arc<Durable>,
    queue: mpsc::Sender<Job>,
    fences: Arc<Mutex<Fences>>,
    /// Which of the machines this is.
    replica: usize,
    /// The holders of studies that it remembers.
    known: Known,
    alive: Arc<AtomicBool>,
}

impl SimulatedDisk {
    /// A disk for a machine that starts. `alive` turns false when it crashes.
    pub(crate) fn new(
        world: Arc<World>,
        durable: Arc<Durable>,
        replica: usize,
        alive: Arc<AtomicBool>,
    ) -> Self {
        let (queue, waiting) = mpsc::channel(QUEUE);
        let fences = Arc::<Mutex<Fences>>::default();
        let writer = Writer {
            world: Arc::clone(&world),
            durable: Arc::clone(&durable),
            fences: Arc::clone(&fences),
            replica,
            alive: Arc::clone(&alive),
        };
        tokio::spawn(writer.run(waiting));
        Self { world, durable, queue, fences, replica, known: Known::default(), alive }
    }

    fn enqueue(&self, job: Job) {
        match self.queue.try_send(job) {
            Ok(()) => {}
            Err(mpsc::error::TrySendError::Full(job)) => refuse(job, &StoreError::QueueFull(QUEUE)),
            Err(mpsc::error::TrySendError::Closed(job)) => refuse(job, &StoreError::Closed),
        }
    }

    async fn barrier(&self) -> Result<()> {
        let (answer, answered) = oneshot::channel();
        self.enqueue(Job { write: None, is_commit: false, answer });
        answered.await.unwrap_or(Err(StoreError::Closed))
    }

    /// The durable store's fence behind one that this machine was given, as long as it was given no later
    /// one.
    fn behind(&self, fence: &Fence) -> Result<Fence> {
        let fences = lock(&self.fences);
        let found = fences.get(fence.study()).filter(|(own, _)| own.is_same(fence));
        let found = found.map(|(_, durable)| durable.clone());
        found.ok_or_else(|| StoreError::Fenced(fence.study().to_owned()))
    }

    async fn read(&self) -> Result<()> {
        sleep(self.world.time_ms(self.world.plan.write_ms * 0.2)).await;
        self.world.awake(self.replica).await;
        if !self.alive.load(Ordering::SeqCst) {
            Err(StoreError::Closed)
        } else if self.world.is_in(Trouble::Away, self.replica) {
            Err(StoreError::Unavailable("the simulated database is away".to_owned()))
        } else {
            Ok(())
        }
    }
}

/// The address that a machine advertises.
fn address(replica: usize) -> String {
    format!("replica-{replica}")
}

/// The write with a copy of what it stores.
fn kept(write: StudyWrite<'_>) -> Write {
    match write {
        StudyWrite::Commit(changes) => {
            let changes = changes.to_vec();
            Box::new(move |store: &MemoryStore, fence: &Fence| store.commit(fence, &changes))
        }
        StudyWrite::Study(spec, earlier, since) => {
            let (spec, earlier) = (spec.clone(), earlier.clone());
            Box::new(move |store: &MemoryStore, fence: &Fence| {
                store.update_study(fence, &spec, &earlier, since)
            })
        }
        StudyWrite::Space(spec, earlier) => {
            let (spec, earlier) = (spec.clone(), earlier.clone());
            Box::new(move |store: &MemoryStore, fence: &Fence| store.change_space(fence, &spec, &earlier))
        }
        StudyWrite::Exclude(number, reason) => {
            let reason = reason.map(str::to_owned);
            Box::new(move |store: &MemoryStore, fence: &Fence| {
                store.exclude_trial(fence, number, reason.as_deref())
            })
        }
    }
}

fn refuse(job: Job, error: &StoreError) {
    if let Some((fence, _)) = &job.write {
        fence.break_up();
    }
    // The caller may have left.
    let _ = job.answer.send(Err(error.clone()));
}

struct Writer {
    world: Arc<World>,
    durable: Arc<Durable>,
    fences: Arc<Mutex<Fences>>,
    replica: usize,
    alive: Arc<AtomicBool>,
}

impl Writer {
    async fn run(self, mut queue: mpsc::Receiver<Job>) {
        while let Some(first) = queue.recv().await {
            let mut group = vec![first];
            while group.len() < GROUP
                && let Ok(job) = queue.try_recv()
            {
                group.push(job);
            }
            if self.world.plan.bug == Some(Bug::AcknowledgeBeforeCommit) {
                acknowledge_early(&mut group);
            }
            sleep(self.world.time_ms(self.world.plan.write_ms)).await;
            self.world.awake(self.replica).await;
            self.world.step("write");
            if !self.alive.load(Ordering::SeqCst) {
                // The crash came in the middle: the log holds all of the transaction or none.
                if self.world.chance(0.5) {
                    self.world.count(|counts| counts.torn_writes += 1);
                } else {
                    self.apply(group).into_iter().for_each(drop);
                }
                return;
            }
            if self.world.is_in(Trouble::Full, 0) || self.world.chance(self.world.plan.write_fails) {
                self.world.count(|counts| counts.failed_writes += 1);
                let error = StoreError::Unavailable("the simulated disk failed".to_owned());
                group.into_iter().for_each(|job| refuse(job, &error));
                continue;
            }
            if self.world.is_in(Trouble::Away, self.replica) {
                self.lose_touch(group);
                continue;
            }
            let answers = self.apply(group);
            if self.world.chance(0.3) {
                // A crash may come between the commit and the answer.
                sleep(self.world.time_ms(self.world.plan.write_ms * 0.1)).await;
                if !self.alive.load(Ordering::SeqCst) {
                    return;
                }
            }
            for (answer, result) in answers {
                if self.world.plan.bug == Some(Bug::LostWakeUp) && self.world.one_in(FORGOTTEN) {
                    // Kept for ever, so that the caller does not even learn that no answer will come.
                    self.world.forget(answer);
                    continue;
                }
                let _ = answer.send(result);
            }
        }
    }

    /// The connection breaks during a transaction: it was committed or not, and the caller does not learn
    /// which.
    fn lose_touch(&self, group: Vec<Job>) {
        self.world.count(|counts| counts.unsure_writes += 1);
        let error = StoreError::Unavailable("the simulated database is away".to_owned());
        // In the first second its last messages may have arrived.
        let away = self.world.troubled(Trouble::Away, self.replica);
        if away.is_some_and(|time| time < Duration::from_secs(1)) && self.world.chance(0.5) {
            for job in group {
                let fence = job.write.as_ref().map(|(fence, _)| fence.clone());
                let (answer, _) = self.apply_one(job);
                if let Some(fence) = fence {
                    fence.break_up();
                }
                let _ = answer.send(Err(error.clone()));
            }
        } else {
            group.into_iter().for_each(|job| refuse(job, &error));
        }
    }

    /// Applies a transaction, job by job; each has its own result.
    fn apply(&self, group: Vec<Job>) -> Vec<(Answer, Result<()>)> {
        group.into_iter().map(|job| self.apply_one(job)).collect()
    }

    fn apply_one(&self, job: Job) -> (Answer, Result<()>) {
        let result = job.write.map_or(Ok(()), |(fence, write)| self.under(&fence, &write));
        (job.answer, result)
    }

    /// Writes under the durable fence that belongs to the machine's. Where it no longer holds, another
    /// machine has taken the study, and the machine's fence breaks too.
    fn under(&self, fence: &Fence, write: &Write) -> Result<()> {
        let store: &MemoryStore = &self.durable.store;
        let write = |durable: &Fence| now(write(store, durable).durable());
        let fences = lock(&self.fences);
        let fenced = || StoreError::Fenced(fence.study().to_owned());
        let found = fences.get(fence.study()).filter(|(ours, _)| ours.is_same(fence));
        let result = match found {
            Some((ours, durable)) if ours.holds() => {
                if self.world.plan.bug == Some(Bug::LeaseWithoutClaim) && !durable.holds() {
                    let claim = self.durable.claims.fence(fence.study());
                    claim.map_or_else(|| Err(fenced()), |claim| write(&claim))
                } else {
                    write(durable)
                }
            }
            _ => Err(fenced()),
        };
        if result.is_err() {
            fence.break_up();
        }
        result
    }
}

/// The planted defect: callers are answered, and their changes may never be written.
fn acknowledge_early(group: &mut [Job]) {
    for job in group.iter_mut().filter(|job| job.is_commit) {
        let (unheard, _) = oneshot::channel();
        let _ = std::mem::replace(&mut job.answer, unheard).send(Ok(()));
    }
}

#[async_trait]
impl Store for SimulatedDisk {
    async fn create_study(&self, id: &str, spec: &StudySpec, now_ms: i64) -> Result<Created> {
        self.barrier().await?;
        self.durable.store.create_study(id, spec, now_ms).await
    }

    async fn get_study(&self, study: &str) -> Result<StudyRecord> {
        self.read().await?;
        self.durable.store.get_study(study).await
    }

    async fn list_studies(&self, after: Option<&str>, size: u32) -> Result<Vec<StudyRecord>> {
        self.read().await?;
        self.durable.store.list_studies(after, size).await
    }

    async fn delete_study(&self, study: &str, uid: Option<StudyUid>) -> Result<()> {
        self.barrier().await?;
        self.durable.store.delete_study(study, uid).await
    }

    async fn find_study(&self, uid: StudyUid) -> Result<Option<String>> {
        self.read().await?;
        self.durable.store.find_study(uid).await
    }

    async fn rename_study(&self, study: &str, uid: Option<StudyUid>, to: &str) -> Result<StudyRecord> {
        self.barrier().await?;
        self.durable.store.rename_study(study, uid, to).await
    }

    async fn load(&self, study: &str) -> Result<Loaded> {
        let elsewhere =
            |replica| StoreError::Elsewhere { study: study.to_owned(), address: address(replica) };
        if let Some(holder) = self.known.holder(study) {
            return Err(elsewhere(holder));
        }
        self.barrier().await?;
        self.read().await?;
        if let Some(holder) = self.world.other_holder(study, self.replica) {
            self.known.remember(study, holder);
            return Err(elsewhere(holder));
        }
        let loaded = self.durable.store.load(study).await?;
        let fence = Fence::new(study, 0);
        self.durable.claims.take(study, loaded.fence.clone(), self.replica, &self.alive);
        if let Some((earlier, _)) = lock(&self.fences).insert(study.to_owned(), (fence.clone(), loaded.fence))
        {
            earlier.break_up();
        }
        Ok(Loaded { fence, ..loaded })
    }

    fn doubt(&self, study: &str) {
        self.known.forget(study);
    }

    fn queue(&self, fence: &Fence, write: StudyWrite<'_>) -> Receipt {
        let is_commit = matches!(write, StudyWrite::Commit(_));
        let (answer, receipt) = Receipt::pending();
        self.enqueue(Job { write: Some((fence.clone(), kept(write))), is_commit, answer });
        receipt
    }

    async fn completed_trials(&self, fence: &Fence, after: u64, size: u32) -> Result<Vec<RawTrial>> {
        self.read().await?;
        self.durable.store.completed_trials(&self.behind(fence)?, after, size).await
    }

    async fn save_checkpoint(&self, fence: &Fence, checkpoint: &Checkpoint) -> Result<()> {
        sleep(self.world.time_ms(self.world.plan.write_ms)).await;
        self.read().await?;
        self.world.count(|counts| counts.checkpoints += 1);
        self.durable.store.save_checkpoint(&self.behind(fence)?, checkpoint).await?;
        self.durable.covered.store(checkpoint.completion, Ordering::SeqCst);
        Ok(())
    }

    async fn closed_trials(&self, fence: &Fence, after: u64, to: u64, size: u32) -> Result<Vec<ClosedTrial>> {
        self.read().await?;
        self.durable.store.closed_trials(&self.behind(fence)?, after, to, size).await
    }

    async fn remove_trials(&self, fence: &Fence, numbers: &[u64], covered: u64) -> Result<u64> {
        sleep(self.world.time_ms(self.world.plan.write_ms)).await;
        self.read().await?;
        let behind = self.behind(fence)?;
        let trials: Vec<RawTrial> = numbers
            .iter()
            .filter_map(|number| now(self.durable.store.get_trial(fence.study(), *number)).ok())
            .collect();
        let removed = self.durable.store.remove_trials(&behind, numbers, covered).await?;
        let covered = self.durable.covered.load(Ordering::SeqCst);
        self.world.enter(|ledger, durable| ledger.removed(&trials, covered, durable));
        Ok(removed)
    }

    async fn get_trial(&self, study: &str, number: u64) -> Result<RawTrial> {
        self.read().await?;
        self.durable.store.get_trial(study, number).await
    }

    async fn query_trials(&self, study: &str, query: &TrialQuery) -> Result<TrialPage> {
        self.read().await?;
        self.durable.store.query_trials(study, query).await
    }

    async fn studies_with_due_leases(&self, now_ms: i64) -> Result<Vec<String>> {
        self.read().await?;
        self.durable.store.studies_with_due_leases(now_ms).await
    }

    async fn close(&self) {}
}
