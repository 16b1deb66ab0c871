//! The course of a world: its machines, clients and troubles, from the first event to the last check.

use std::sync::Arc;
use std::time::Duration;

use tokio::time::{Instant, sleep};
use treewright_server::convert::from_proto;
use treewright_store::Store as _;

use crate::plan::Plan;
use crate::world::{Outcome, PATIENCE, START_MS, Trouble, World};
use crate::{client, frozen, machine_life, replay, requests};

/// Length of the quiet after the last event, in which all calls end.
const QUIET: Duration = Duration::from_secs(900);

/// Runs a world to its end.
pub fn run(plan: Plan) -> Outcome {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build();
    let runtime = runtime.expect("a runtime without input and output");
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
    for trouble in [Trouble::Full, Trouble::Cut, Trouble::Away, Trouble::Asleep] {
        tokio::spawn(make(Arc::clone(&world), trouble));
    }
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
    frozen::check(&world).await;
    world.end()
}

/// Makes a trouble now and then.
async fn make(world: Arc<World>, trouble: Trouble) {
    let plan = &world.plan;
    let (what, every_ms, ms) = match trouble {
        Trouble::Full => ("disk full", plan.full_every_ms, 3_000.0),
        Trouble::Cut => ("partition", plan.partition_every_ms, plan.partition_ms),
        // A single machine has its database at hand.
        Trouble::Away if plan.replicas == 1 => return,
        Trouble::Away => ("database away", plan.away_every_ms, plan.away_ms),
        Trouble::Asleep => ("asleep", plan.sleep_every_ms, plan.sleep_ms),
    };
    while world.wait_for_trouble(every_ms).await {
        let time = world.time_ms(ms);
        let replica = || world.below(plan.replicas as u64) as usize;
        match trouble {
            Trouble::Full => world.bring(trouble, 0, time),
            Trouble::Cut => world.bring(trouble, world.below(u64::from(plan.clients)) as usize, time),
            Trouble::Away => world.bring(trouble, replica(), time),
            // It goes on as if no time had passed, as under a hypervisor.
            Trouble::Asleep => world.bring(trouble, replica(), time.min(PATIENCE / 3)),
        }
        world.count(|counts| match trouble {
            Trouble::Full => counts.full_disks += 1,
            Trouble::Cut => counts.partitions += 1,
            Trouble::Away => counts.absences += 1,
            Trouble::Asleep => counts.sleeps += 1,
        });
        world.step(what);
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
