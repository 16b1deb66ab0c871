//! The troubles of a world, drawn from its seed.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

/// A defect that is planted to show that the simulator finds it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, clap::ValueEnum)]
pub enum Bug {
    /// The disk answers before it has written.
    AcknowledgeBeforeCommit,
    /// A replica that lost a study to another still stores what it decides.
    LeaseWithoutClaim,
    /// Now and then nobody learns that a write has ended.
    LostWakeUp,
    /// The study explores without the budget that clients were promised.
    Overspending,
}

/// The plan of a world. Probabilities are per event, times in milliseconds of simulated time.
#[derive(Clone, Debug, Serialize)]
pub struct Plan {
    /// The seed of everything.
    pub seed: u64,
    /// The number of events of the world.
    pub steps: u64,
    /// The number of clients.
    pub clients: u32,
    /// The number of replicas of the service that share the database.
    pub replicas: usize,
    /// The number of places for clients to be at: states of the study.
    pub places: u32,
    /// The mean delay of a message.
    pub delay_ms: f64,
    /// A message is lost.
    pub loss: f64,
    /// A message arrives twice.
    pub duplication: f64,
    /// The mean time until a client is cut off from everything; infinite for never.
    pub partition_every_ms: f64,
    /// For how long it is, on average.
    pub partition_ms: f64,
    /// The mean time until a machine crashes.
    pub crash_every_ms: f64,
    /// Time until it comes back.
    pub restart_ms: f64,
    /// The mean time of a write to the disk.
    pub write_ms: f64,
    /// A write fails.
    pub write_fails: f64,
    /// The mean time until the disk is full for a while.
    pub full_every_ms: f64,
    /// The mean time until a machine's clock jumps.
    pub clock_jump_every_ms: f64,
    /// Largest jump, either way.
    pub clock_jump_ms: i64,
    /// The mean time until a machine is cut off from the database.
    pub away_every_ms: f64,
    /// For how long it is, on average.
    pub away_ms: f64,
    /// The mean time until a machine stops in its tracks for a while.
    pub sleep_every_ms: f64,
    /// For how long it does, on average.
    pub sleep_ms: f64,
    /// Trials between two checkpoints, as long as those are small.
    pub checkpoint_after: u64,
    /// The number of trials that are kept of the study; `None` for all.
    pub keep_trials: Option<u64>,
    /// A client vanishes with an open trial, comes back, or says something twice.
    pub misbehaviour: f64,
    /// The share of frame time that exploring may cost; none for no budget.
    pub regret_budget: Option<f64>,
    /// Length of a lease.
    pub lease_s: i32,
    /// Configurations that a state's search may try.
    pub trials_per_state: i32,
    /// Whether the study is searched and predicted as it is by default, with models that are fitted apart.
    /// Otherwise points are drawn at random and nearest states answer, which is a hundred times quicker.
    pub default_policy: bool,
    /// The planted defect.
    pub bug: Option<Bug>,
}

impl Plan {
    /// The plan of a seed.
    pub fn of(seed: u64, steps: u64, bug: Option<Bug>) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x7ee5_7ee5);
        let mut chance = |share: f64| random.random::<f64>() < share;
        // Each kind of trouble is absent from some worlds, or faults would hide one another.
        let (network, partitions, crashes, disk, full, clocks, people) =
            (chance(0.7), chance(0.4), chance(0.7), chance(0.4), chance(0.3), chance(0.3), chance(0.7));
        let (many, budget) = (chance(0.5), chance(0.5));
        let claimless = bug == Some(Bug::LeaseWithoutClaim);
        let (away, asleep) = (chance(0.4), chance(0.4) || claimless);
        let mut between = |low: f64, high: f64| low * (high / low).powf(random.random::<f64>());
        let or_never = |is: bool, value: f64| if is { value } else { f64::INFINITY };
        let or_zero = |is: bool, value: f64| if is { value } else { 0.0 };
        Plan {
            seed,
            steps,
            clients: between(1.0, 32.0) as u32,
            replicas: if many || claimless { between(2.0, 3.9) as usize } else { 1 },
            places: between(1.0, 12.0) as u32,
            delay_ms: between(0.05, 50.0),
            loss: or_zero(network, between(0.001, 0.2)),
            duplication: or_zero(network, between(0.001, 0.2)),
            partition_every_ms: or_never(partitions, between(2e3, 1e5)),
            partition_ms: between(50.0, 2e4),
            crash_every_ms: or_never(crashes, between(500.0, 1e5)),
            restart_ms: between(10.0, 5e3),
            write_ms: between(0.05, 50.0),
            write_fails: or_zero(disk, between(0.001, 0.1)),
            full_every_ms: or_never(full, between(1e4, 1e5)),
            clock_jump_every_ms: or_never(clocks, between(5e3, 1e5)),
            clock_jump_ms: between(10.0, 1e7) as i64,
            away_every_ms: or_never(away, between(2e3, 1e5)),
            away_ms: between(50.0, 3e4),
            sleep_every_ms: or_never(asleep, between(2e3, 1e5)),
            sleep_ms: between(50.0, 3e4),
            checkpoint_after: between(20.0, 2e3) as u64,
            misbehaviour: or_zero(people, between(0.005, 0.1)),
            regret_budget: if budget || bug == Some(Bug::Overspending) {
                Some(between(0.02, 0.2))
            } else {
                None
            },
            lease_s: between(1.0, 60.0) as i32,
            trials_per_state: between(5.0, 100.0) as i32,
            keep_trials: Some(between(5.0, 500.0) as u64).filter(|keep| *keep < 50),
            default_policy: random.random::<f64>() < 0.15,
            bug,
        }
    }
}
