//! The way from a client to a machine and back: messages come late, twice, in another order, or never.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use tokio::sync::oneshot;
use tokio::time::{sleep, timeout};
use tonic::Code;

use crate::claims::lock;
use crate::forward;
use crate::requests::{Answer, Request};
use crate::world::{Trouble, World};

/// Why a call gave nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Failure {
    Refused(Code),
    /// No answer came in time.
    Silence,
}

type Waiting = Arc<Mutex<Option<oneshot::Sender<Result<Answer, Code>>>>>;

/// Sends a request to a machine and waits for the answer until a deadline.
pub(crate) async fn call(
    world: &Arc<World>,
    client: u32,
    replica: usize,
    request: Request,
    deadline: Duration,
) -> Result<Answer, Failure> {
    let (sender, receiver) = oneshot::channel();
    let waiting = Arc::new(Mutex::new(Some(sender)));
    let copies = if !world.is_calm() && world.chance(world.plan.duplication) { 2 } else { 1 };
    if copies > 1 {
        world.count(|counts| counts.duplicated_messages += 1);
    }
    for _ in 0..copies {
        let (world, waiting) = (Arc::clone(world), Arc::clone(&waiting));
        tokio::spawn(carry(world, client, replica, request.clone(), waiting));
    }
    drop(waiting);
    match timeout(deadline, receiver).await {
        Ok(Ok(Ok(answer))) => Ok(answer),
        Ok(Ok(Err(code))) => Err(Failure::Refused(code)),
        Ok(Err(_)) => {
            // Lost on the way; a client only notices by waiting.
            sleep(deadline).await;
            Err(Failure::Silence)
        }
        Err(_) => Err(Failure::Silence),
    }
}

/// Whether a message gets through.
fn arrives(world: &World, client: u32) -> bool {
    if world.is_calm() {
        return true;
    }
    if world.is_in(Trouble::Cut, client as usize) || world.chance(world.plan.loss) {
        world.count(|counts| counts.lost_messages += 1);
        return false;
    }
    true
}

async fn carry(world: Arc<World>, client: u32, replica: usize, request: Request, waiting: Waiting) {
    world.step("sent");
    if !arrives(&world, client) {
        return;
    }
    sleep(world.time_ms(world.plan.delay_ms)).await;
    let Some(machine) = world.machine(replica) else {
        // No machine listens there: the connection is refused.
        give(&waiting, Err(Code::Unavailable));
        return;
    };
    world.step("received");
    let Some((answer, known)) = forward::answer(&world, &machine, &request).await else {
        return;
    };
    world.step("answered");
    let at_ms = world.elapsed_ms();
    world.enter(|ledger, durable| ledger.answered((at_ms, known), client, &request, &answer, durable));
    if !arrives(&world, client) {
        return;
    }
    sleep(world.time_ms(world.plan.delay_ms)).await;
    world.step("told");
    give(&waiting, answer.map_err(|status| status.code()));
}

fn give(waiting: &Waiting, answer: Result<Answer, Code>) {
    let sender = lock(waiting).take();
    if let Some(sender) = sender {
        // A client that gave up does not listen.
        let _ = sender.send(answer);
    }
}
