//! The last questions of a world: its study is frozen, and a new client at each place gets a configuration
//! that ran, or the default.

use std::collections::BTreeMap;

use tokio::time::timeout;
use tonic::Status;
use treewright_proto::v1 as wire;

use crate::machine::Machine;
use crate::requests::{self, Answer, Request, STUDY, client_name, is_of_frozen};
use crate::world::{PATIENCE, World};

fn question(client: u32, place: f64) -> Request {
    Request::Suggest(wire::SuggestRequest {
        study: STUDY.into(),
        client_id: client_name(client),
        indicators: BTreeMap::from([("place".to_owned(), place)]),
        session: 1,
        ..wire::SuggestRequest::default()
    })
}

/// A machine's answer; none where a planted defect keeps it for ever.
async fn asked(machine: &Machine, request: Request) -> Option<Result<Answer, Status>> {
    let answer = requests::answer(&machine.service, &machine.tuning, request);
    timeout(PATIENCE, answer).await.ok().map(|(answer, _redirect)| answer)
}

/// Freezes the study on the machine that holds it, if one does, and asks at each place and between them. The
/// ledger looks at every answer of a frozen study.
pub(crate) async fn check(world: &World) {
    // No machine has this number.
    let holder = world.other_holder("world", usize::MAX);
    let Some(machine) = holder.and_then(|holder| world.machine(holder)) else {
        return;
    };
    let Some(Ok(_)) = asked(&machine, requests::change(&world.plan, 1.0, true)).await else {
        return;
    };
    let places = world.plan.places;
    for number in 0..2 * places {
        let client = world.plan.clients + number;
        let request = question(client, f64::from(number) / f64::from(2 * places));
        let known = world.known();
        let Some(answer) = asked(&machine, request.clone()).await else {
            return;
        };
        let now = (world.elapsed_ms(), known);
        world.enter(|ledger, durable| ledger.answered(now, client, &request, &answer, durable));
        if let Ok(Answer::Trial(trial)) = &answer
            && !is_of_frozen(trial)
        {
            world.violation(format!("the study is frozen, and {} is learnt from", trial.name));
        }
    }
}
