//! The life of a machine: it starts, does what the service does by itself, crashes, and starts again.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::time::Duration;

use tokio::time::sleep;
use treewright_server::clock::Clock;
use treewright_server::tuning::Tuning;
use treewright_store::Store;

use crate::disk::SimulatedDisk;
use crate::machine::Machine;
use crate::world::{START_MS, World};

/// A machine's clock: the world's time, and how far it is off.
struct MachineClock {
    world: Arc<World>,
    off_ms: Arc<AtomicI64>,
}

impl Clock for MachineClock {
    fn now_ms(&self) -> i64 {
        START_MS + self.world.elapsed_ms() + self.off_ms.load(Ordering::SeqCst)
    }
}

/// Starts a machine, crashes it, and starts it again, until the world ends.
pub(crate) async fn live(world: Arc<World>, index: usize) {
    let off_ms = Arc::new(AtomicI64::new(0));
    tokio::spawn(set_the_clock(Arc::clone(&world), Arc::clone(&off_ms)));
    loop {
        let alive = Arc::new(AtomicBool::new(true));
        let disk =
            SimulatedDisk::new(Arc::clone(&world), Arc::clone(&world.durable), index, Arc::clone(&alive));
        let disk: Arc<dyn Store> = Arc::new(disk);
        let clock = MachineClock { world: Arc::clone(&world), off_ms: Arc::clone(&off_ms) };
        let tuning = Tuning::new(Arc::clone(&disk), Arc::new(clock))
            .with_checkpoints_after(world.plan.checkpoint_after);
        let tuning = Arc::new(tuning);
        let machine = Machine::new(index, Arc::clone(&tuning), disk, Arc::clone(&alive));
        tokio::spawn(sweep(Arc::clone(&world), index, Arc::clone(&tuning), Arc::clone(&alive)));
        tokio::spawn(save_checkpoints(Arc::clone(&world), Arc::clone(&tuning), Arc::clone(&alive)));
        if let Some(keep) = world.plan.keep_trials {
            tokio::spawn(thin_trials(Arc::clone(&world), tuning, keep, Arc::clone(&alive)));
        }
        world.set_machine(index, Some(machine));
        world.step("start");
        if !world.wait_for_trouble(world.plan.crash_every_ms).await {
            return;
        }
        alive.store(false, Ordering::SeqCst);
        world.set_machine(index, None);
        world.count(|counts| counts.crashes += 1);
        world.step("crash");
        sleep(world.time_ms(world.plan.restart_ms)).await;
    }
}

/// Ends leases that have run out, as the service does once a second.
async fn sweep(world: Arc<World>, index: usize, tuning: Arc<Tuning>, alive: Arc<AtomicBool>) {
    while alive.load(Ordering::SeqCst) && !world.is_over() {
        sleep(Duration::from_secs(1)).await;
        world.awake(index).await;
        // A disk that fails is met by the next sweep again.
        let _ = tuning.sweep_leases().await;
    }
}

/// Saves checkpoints, as the service does.
async fn save_checkpoints(world: Arc<World>, tuning: Arc<Tuning>, alive: Arc<AtomicBool>) {
    while alive.load(Ordering::SeqCst) && !world.is_over() {
        sleep(Duration::from_secs(1)).await;
        tuning.save_checkpoints().await;
    }
}

/// Removes old trials, as the service does where it is asked to. The policy's predictor never changes, so
/// that no trial may still have to be taught.
async fn thin_trials(world: Arc<World>, tuning: Arc<Tuning>, keep: u64, alive: Arc<AtomicBool>) {
    while alive.load(Ordering::SeqCst) && !world.is_over() {
        sleep(Duration::from_secs(2)).await;
        tuning.thin_beyond(keep, 0).await;
    }
}

/// Sets the clock wrong now and then.
async fn set_the_clock(world: Arc<World>, off_ms: Arc<AtomicI64>) {
    while world.wait_for_trouble(world.plan.clock_jump_every_ms).await {
        let far = world.plan.clock_jump_ms as f64;
        off_ms.store(world.between(-far, far) as i64, Ordering::SeqCst);
        world.count(|counts| counts.clock_jumps += 1);
        world.step("clock jump");
    }
}
