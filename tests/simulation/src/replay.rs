//! The knowledge of a machine follows from the stored trials: at the end of a world a fresh service replays
//! them, and has to answer as the machine that held the study. By then that machine has ended every expired
//! lease.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use tokio::time::sleep;
use treewright_core::tuner::Prediction;
use treewright_server::clock::ManualClock;
use treewright_server::tuning::Tuning;
use treewright_store::Store as _;

use crate::world::World;

/// Requests to a machine to end leases.
const TRIES: usize = 10;

/// The configuration that a service would exploit at each place, with its predicted cost.
async fn answers(tuning: &Tuning, places: u32) -> Vec<Option<Prediction>> {
    let mut answers = Vec::new();
    for place in 0..places {
        let indicators = BTreeMap::from([("place".to_owned(), f64::from(place) / f64::from(places))]);
        answers.push(tuning.predict(&"world".into(), &indicators, None, None, 0).await.ok());
    }
    answers
}

/// A service that is asked ends the leases that have run out. A write may fail, so it is asked again.
async fn end_leases(world: &World, tuning: &Tuning) {
    let mut due = Vec::new();
    for _ in 0..TRIES {
        let asked_ms = tuning.now_ms();
        if answers(tuning, 1).await.iter().all(Option::is_none) {
            // It cannot be asked.
            return;
        }
        sleep(Duration::from_secs(10)).await;
        due = world.durable.store.studies_with_due_leases(asked_ms).await.unwrap_or_default();
        if due.is_empty() {
            return;
        }
    }
    world.violation(format!("leases have run out, and their trials are open still: {due:?}"));
}

/// Compares the machine that holds the study, if one does, with what the durable store teaches.
pub(crate) async fn check(world: &World) {
    let durable = &world.durable;
    // No machine has this number.
    let holder = world.other_holder("world", usize::MAX);
    let Some(machine) = holder.and_then(|holder| world.machine(holder)) else {
        return;
    };
    end_leases(world, &machine.tuning).await;
    let learnt = answers(&machine.tuning, world.plan.places).await;
    // Meanwhile its waiting writes end.
    sleep(Duration::from_secs(10)).await;
    // In its time no lease runs out.
    let fresh = Tuning::new(Arc::clone(&durable.store) as _, Arc::new(ManualClock::at(0)));
    let replayed = answers(&fresh, world.plan.places).await;
    world.count(|counts| counts.replays += 1);
    for (place, (learnt, replayed)) in learnt.iter().zip(&replayed).enumerate() {
        let known = |answer: &Option<Prediction>| {
            answer.as_ref().map(|answer| (answer.configuration.clone(), answer.predicted_cost))
        };
        if learnt.is_some() && known(learnt) != known(replayed) {
            let what = format!(
                "at place {place} the service answers {:?}, and what is stored teaches {:?}",
                known(learnt),
                known(replayed)
            );
            world.violation(what);
        }
    }
}
