//! What a machine has learnt is what follows from the trials that are stored: at the end of a world a fresh service goes
//! through them, and has to answer as the machine does that has held the study.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use tokio::time::sleep;
use treewright_core::tuner::Prediction;
use treewright_server::clock::ManualClock;
use treewright_server::tuning::Tuning;

use crate::world::World;

/// What a service would exploit at each place, and what it says that costs.
async fn answers(tuning: &Tuning, places: u32) -> Vec<Option<Prediction>> {
    let mut answers = Vec::new();
    for place in 0..places {
        let indicators = BTreeMap::from([("place".to_owned(), f64::from(place) / f64::from(places))]);
        answers.push(tuning.predict("world", &indicators, None).await.ok());
    }
    answers
}

/// Compares the machine that holds the study, if one does, with what the durable store teaches.
pub(crate) async fn check(world: &World) {
    let durable = &world.durable;
    // Nobody's own number.
    let holder = world.other_holder("world", usize::MAX);
    let Some(machine) = holder.and_then(|holder| world.machine(holder)) else {
        return;
    };
    let learnt = answers(&machine.tuning, world.plan.places).await;
    // Whatever it still has to write is written.
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
