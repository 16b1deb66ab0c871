//! A client: renders frame after frame, and is as unreliable as programs are.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use tokio::time::sleep;
use treewright_proto::v1::{self as wire, value};

use crate::network::{Failure, call};
use crate::plan::Plan;
use crate::requests::{self, Answer, Request, STUDY, client_name};
use crate::world::World;

/// Cost of the default at every place, in milliseconds.
const DEFAULT_MS: f64 = 10.0;
/// Attempts before a report is given up.
const TRIES: u32 = 6;
/// Variation of frames, as a share.
const NOISE: f64 = 0.05;
/// Where studies are frozen now and then, they are below this epsilon.
const FROZEN_BELOW: f64 = 0.5;
/// The most leaves with which a configuration can be run, in worlds where not all can.
const LEAVES_MAX: f64 = 40.0;

struct Client {
    world: Arc<World>,
    number: u32,
    replica: usize,
    session: u64,
    place: f64,
    /// A trial that it knows of, for questions.
    known: Option<String>,
}

/// Renders until the world ends.
pub(crate) async fn live(world: Arc<World>, number: u32) {
    let replica = number as usize % world.plan.replicas;
    let mut client = Client { world, number, replica, session: 1, place: 0.0, known: None };
    let mut next = None;
    while !client.world.is_over() {
        client.world.step("frame");
        let trial = match next.take() {
            Some(trial) => Some(trial),
            None => client.suggest().await,
        };
        match trial {
            Some(trial) => next = client.run(trial).await,
            None => client.without_a_trial().await,
        }
    }
}

impl Client {
    fn misbehaves(&self) -> bool {
        self.world.chance(self.world.plan.misbehaviour)
    }

    fn deadline(&self) -> Duration {
        // Long enough for most, so that time-outs are a fault among others.
        let plan = &self.world.plan;
        Duration::from_secs_f64((6.0 * (plan.delay_ms + plan.write_ms) + 20.0) / 1e3)
    }

    async fn ask(&mut self, request: Request) -> Result<Answer, Failure> {
        let deadline = self.deadline();
        let answer = call(&self.world, self.number, self.replica, request, deadline).await;
        if answer.is_err() {
            // Perhaps another replica answers.
            self.replica = (self.replica + 1) % self.world.plan.replicas;
        }
        answer
    }

    fn question(&self) -> wire::SuggestRequest {
        wire::SuggestRequest {
            study: STUDY.into(),
            client_id: client_name(self.number),
            indicators: BTreeMap::from([("place".to_owned(), self.place)]),
            session: self.session,
            can_abort: true,
            session_policy: self.never_explores().then(never),
            ..wire::SuggestRequest::default()
        }
    }

    /// Whether it only wants what is known to work, as in production. In some worlds a quarter of the clients
    /// do.
    fn never_explores(&self) -> bool {
        self.world.plan.seed % 5 == 1 && self.number % 4 == 3
    }

    fn move_on(&mut self) {
        if self.world.chance(0.05) {
            let places = u64::from(self.world.plan.places);
            self.place = self.world.below(places) as f64 / places as f64;
        }
    }

    async fn suggest(&mut self) -> Option<wire::Trial> {
        self.move_on();
        for _ in 0..2 {
            if let Ok(Answer::Trial(trial)) = self.ask(Request::Suggest(self.question())).await {
                return Some(*trial);
            }
        }
        None
    }

    /// Renders with the default because no answer came.
    async fn without_a_trial(&mut self) {
        sleep(Duration::from_secs_f64(DEFAULT_MS / 1e3)).await;
        self.note(false, DEFAULT_MS);
    }

    fn note(&self, explored: bool, spent_ms: f64) {
        let budget = self.world.plan.regret_budget;
        let at_ms = self.world.elapsed_ms();
        let frame = (spent_ms, DEFAULT_MS);
        self.world.enter(|ledger, _| ledger.frame(at_ms, self.number, self.session, explored, frame, budget));
    }

    /// Renders with a trial's configuration and reports the result. Returns the next trial, if the answer
    /// held one.
    async fn run(&mut self, trial: wire::Trial) -> Option<wire::Trial> {
        let true_ms = true_ms(&trial, self.place);
        let measured_ms = true_ms * (1.0 + NOISE * self.world.between(-1.0, 1.0));
        let cap_ms = trial.abort_above.unwrap_or(f64::INFINITY);
        let aborted = measured_ms > cap_ms;
        let spent_ms = if aborted { cap_ms } else { measured_ms };
        sleep(Duration::from_secs_f64(spent_ms / 1e3)).await;
        self.note(trial.mode == wire::Mode::Explore as i32, if aborted { cap_ms } else { true_ms });
        self.known = Some(trial.name.clone());
        if self.misbehaves() && self.is_done_otherwise(&trial).await {
            return None;
        }
        let report = match cannot_run(&self.world.plan, &trial) {
            true => requests::infeasible(&trial.name),
            false => requests::report(&trial.name, spent_ms, aborted),
        };
        if self.world.chance(0.5) {
            self.move_on();
            let frame = Request::Frame(report.clone(), self.question());
            if let Ok(Answer::Frame(reported, suggested)) = self.ask(frame).await
                && reported.is_ok()
            {
                return suggested.ok().map(|trial| *trial);
            }
        }
        self.tell(report).await;
        None
    }

    /// Reports a result until a machine acknowledges it.
    async fn tell(&mut self, report: wire::ReportRequest) {
        for attempt in 0..TRIES {
            match self.ask(Request::Report(report.clone())).await {
                Ok(_) => return,
                Err(Failure::Refused(tonic::Code::FailedPrecondition)) => return,
                Err(_) => sleep(self.world.time_ms(20.0 * f64::from(1 << attempt))).await,
            }
        }
    }

    /// Misbehaviour of programs. True when the trial is not to be reported any more.
    async fn is_done_otherwise(&mut self, trial: &wire::Trial) -> bool {
        let lease_ms = 1e3 * f64::from(self.world.plan.lease_s);
        match self.world.below(8) {
            0 => {
                // Gone, and back as a new session that knows nothing.
                self.world.count(|counts| counts.client_restarts += 1);
                self.world.step("client restart");
                self.session += 1;
                sleep(self.world.time_ms(100.0)).await;
                true
            }
            1 => {
                // Silent for longer than the lease; the report comes late.
                self.world.count(|counts| counts.vanished_clients += 1);
                sleep(Duration::from_secs_f64(lease_ms * self.world.between(0.5, 2.0) / 1e3)).await;
                false
            }
            2 => {
                let _ = self.ask(Request::Abandon(trial.name.clone())).await;
                true
            }
            3 => {
                let _ = self.ask(Request::Extend(trial.name.clone())).await;
                false
            }
            4 => {
                // Says it twice, and something else the second time.
                self.tell(requests::report(&trial.name, 1.0, false)).await;
                false
            }
            5 => {
                if let Some(known) = self.known.clone() {
                    let _ = self.ask(Request::GetTrial(known)).await;
                }
                false
            }
            6 => {
                let request = match self.world.below(4) {
                    0 => Request::Best,
                    1 => Request::Predict(self.question().indicators),
                    2 => Request::GetStudy,
                    _ => Request::Query(wire::QueryTrialsRequest {
                        study: STUDY.into(),
                        filter: "state = COMPLETED".into(),
                        order_by: "number desc".into(),
                        page_size: 20,
                        ..wire::QueryTrialsRequest::default()
                    }),
                };
                let _ = self.ask(request).await;
                false
            }
            _ => {
                self.change_the_policy().await;
                false
            }
        }
    }

    /// Changes what does not touch the promises: how much is explored, and in some worlds whether the study
    /// is frozen.
    async fn change_the_policy(&mut self) {
        let epsilon = self.world.between(0.2, 1.0);
        let is_frozen = freezes(&self.world.plan) && epsilon < FROZEN_BELOW;
        let request = requests::change(&self.world.plan, epsilon, is_frozen);
        let _ = self.ask(request).await;
    }
}

fn never() -> wire::SessionPolicy {
    wire::SessionPolicy { epsilon: Some(0.0), ..wire::SessionPolicy::default() }
}

/// Whether studies are frozen now and then. Where no budget has to be kept, configurations with many leaves
/// cannot be run there.
fn freezes(plan: &Plan) -> bool {
    plan.seed % 5 == 3
}

fn cannot_run(plan: &Plan, trial: &wire::Trial) -> bool {
    freezes(plan) && plan.regret_budget.is_none() && number(trial, "leaf") > LEAVES_MAX
}

fn number(trial: &wire::Trial, name: &str) -> f64 {
    let values = trial.configuration.as_ref().map(|configuration| &configuration.values);
    match values.and_then(|values| values.get(name)).and_then(|value| value.kind.as_ref()) {
        Some(value::Kind::Integer(integer)) => *integer as f64,
        Some(value::Kind::Float(float)) => *float,
        _ => 0.0,
    }
}

/// The true cost of a configuration at a place: a bowl whose middle moves, with dear corners.
fn true_ms(trial: &wire::Trial, place: f64) -> f64 {
    let (leaf, cost) = (number(trial, "leaf"), number(trial, "cost"));
    if (leaf, cost) == (8.0, 0.5) {
        return DEFAULT_MS;
    }
    6.0 + 20.0 * ((leaf / 64.0 - place).abs() + (cost - 0.7).abs())
}
