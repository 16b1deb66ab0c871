//! The course of a world: its machines, clients and troubles, from the first event to the last check.

use std::sync::Arc;
use std::time::Duration;

use tokio::time::{Instant, sleep};
use treewright_server::convert::from_proto;
use treewright_store::Store as _;

use crate::plan::Plan;
use crate::world::{Outcome, PATIENCE, START_MS, World};
use crate::{client, machine_life, replay, requests};

/// Length of the quiet after the last event, in which all calls end.
const QUIET: Duration = Duration::from_secs(900);

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
    // Tasks that still wait do not matter.
    runtime.shutdown_background();
    outcome
}

async fn live(plan: Plan) -> Outcome {
    let world = Arc::new(World::new(plan));
    let spec = from_proto::study(requests::study(&world.plan)).expect("a valid study");
    world.durable.store.create_study("world", &spec, START_MS).await.expect("an empty store");
    for index in 0..world.plan.replicas {
        tokio::spawn(machine_life::live(Arc::clone(&world), index));
    }
    tokio::spawn(fill_the_disk(Arc::clone(&world)));
    tokio::spawn(cut_clients_off(Arc::clone(&world)));
    tokio::spawn(cut_machines_off(Arc::clone(&world)));
    tokio::spawn(put_machines_to_sleep(Arc::clone(&world)));
    tokio::spawn(watch(Arc::clone(&world)));
    let clients: Vec<_> = (0..world.plan.clients)
        .map(|number| tokio::spawn(client::live(Arc::clone(&world), number)))
        .collect();
    world.over().await;

    // From here on all goes well, so that every call must end.
    world.calm_down();
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
    world.end()
}

/// Fills the disk now and then; a while later there is room again.
async fn fill_the_disk(world: Arc<World>) {
    while world.wait_for_trouble(world.plan.full_every_ms).await {
        world.fill_disk(world.time_ms(3_000.0));
        world.count(|counts| counts.full_disks += 1);
        world.step("disk full");
    }
}

/// Cuts a client off now and then.
async fn cut_clients_off(world: Arc<World>) {
    while world.wait_for_trouble(world.plan.partition_every_ms).await {
        let time = world.time_ms(world.plan.partition_ms);
        let client = world.below(u64::from(world.plan.clients)) as usize;
        world.cut_off(client, time);
        world.count(|counts| counts.partitions += 1);
        world.step("partition");
    }
}

/// Cuts a machine off from a shared database now and then.
async fn cut_machines_off(world: Arc<World>) {
    while world.plan.replicas > 1 && world.wait_for_trouble(world.plan.away_every_ms).await {
        let time = world.time_ms(world.plan.away_ms);
        let replica = world.below(world.plan.replicas as u64) as usize;
        world.take_database_away(replica, time);
        world.count(|counts| counts.absences += 1);
        world.step("database away");
    }
}

/// Stops a machine in its tracks now and then, as a hypervisor does; it goes on as if no time had passed.
async fn put_machines_to_sleep(world: Arc<World>) {
    while world.wait_for_trouble(world.plan.sleep_every_ms).await {
        let time = world.time_ms(world.plan.sleep_ms).min(PATIENCE / 3);
        let replica = world.below(world.plan.replicas as u64) as usize;
        world.put_to_sleep(replica, time);
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
