//! The way of a request to the machine that holds the study: the service's own search, over a simulated
//! network between the machines.

use std::sync::Arc;
use std::time::Duration;

use tokio::time::sleep;
use tonic::Status;
use treewright_server::peers::{Seeking, find_answer};
use treewright_server::redirect::Redirect;

use crate::machine::Machine;
use crate::requests::{self, Answer, Request};
use crate::world::World;

/// Time without an answer after which a machine gives another up.
const SILENCE: Duration = Duration::from_secs(2);

/// The result of a call, and the number of acknowledged reports when its machine began.
type Done = (Result<Answer, Status>, i64);

struct Call<'a> {
    world: &'a Arc<World>,
    machine: &'a Machine,
    request: &'a Request,
}

/// Answers a request that came to a machine. None when it crashed meanwhile.
pub(crate) async fn answer(world: &Arc<World>, machine: &Machine, request: &Request) -> Option<Done> {
    let number = machine.begin();
    let call = Call { world, machine, request };
    let done = find_answer(&call, false).await;
    machine.end(number);
    if !machine.is_alive() {
        return None;
    }
    Some(done.unwrap_or_else(|status| (Err(status), 0)))
}

/// Answers it here or not at all.
async fn here(world: &World, machine: &Machine, request: &Request) -> (Done, Option<Redirect>) {
    world.awake(machine.index).await;
    let known = world.known();
    let (answer, redirect) = requests::answer(&machine.service, &machine.tuning, request.clone()).await;
    world.awake(machine.index).await;
    ((answer, known), redirect)
}

impl Seeking for Call<'_> {
    type Answer = Done;

    async fn here(&self) -> Result<(Done, Option<Redirect>), Status> {
        Ok(here(self.world, self.machine, self.request).await)
    }

    async fn there(&self, _study: &str, address: &str) -> Result<Option<Done>, Status> {
        let world = self.world;
        let index: usize = address.trim_start_matches("replica-").parse().expect("an address of this world");
        world.count(|counts| counts.forwarded_messages += 1);
        world.step("forwarded");
        if !is_carried(world) {
            sleep(SILENCE).await;
            return Ok(None);
        }
        sleep(world.time_ms(world.plan.delay_ms)).await;
        let Some(other) = world.machine(index) else {
            return Ok(None);
        };
        let number = other.begin();
        // Marked as passed on, it is not passed on again.
        let (done, redirect) = here(world, &other, self.request).await;
        other.end(number);
        if !other.is_alive() || !is_carried(world) {
            sleep(SILENCE).await;
            return Ok(None);
        }
        sleep(world.time_ms(world.plan.delay_ms)).await;
        Ok(Some(done).filter(|_| redirect.is_none()))
    }

    fn doubt(&self, study: &str) {
        self.machine.doubt(study);
    }
}

/// Whether a message between machines arrives.
fn is_carried(world: &World) -> bool {
    let is_lost = !world.is_calm() && world.chance(world.plan.loss);
    if is_lost {
        world.count(|counts| counts.lost_messages += 1);
    }
    !is_lost
}
