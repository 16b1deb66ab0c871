//! Results of other machines for a state: its input, measured elsewhere.
//!
//! Machines differ by a factor above all, so costs are compared as logarithms, less that factor. It comes
//! from the configurations that both machines measured in this state (the default is the first of them), else
//! from other states. The rest is that one configuration is better on one machine than on another. The share
//! of the difference to the default that carries over, and its error, are learnt of each machine and level
//! ([`Machines`](crate::machines::Machines)).
//!
//! The estimate of a configuration's cost pools four sources by their precision: that it does as well as the
//! default, the fleet's measurements, the group's, and the machine's own. A new machine has none, so it runs
//! the fleet's best configuration. Its own measurements soon count for more, and where they disagree, the
//! others count less. A single measurement far below all others of its machine counts for nothing, as one
//! wrong report would decide for the whole fleet. One far above is drawn in, and compares no machines.

use crate::configuration::Configuration;
use crate::decision::{ByMachines, ExploitSource, ExploredPoint, MachineLevel};
use crate::ids::StateId;
use crate::limits::{NEIGHBOURS_MAX, REWARD_COST_MIN};
use crate::results::Record;
use crate::trial::Neighbour;
use crate::tuner::exploring::transfer::Transfer;
use crate::tuner::knowledge::States;
use crate::tuner::proposal::{Exploitation, ProposedTrial};

/// The assumed difference of an unmeasured configuration's cost from the default's, as a logarithm.
const SPREAD: f64 = 0.3;
/// Number of a machine's best configurations by which two machines are compared, beside the default.
const SHARED: usize = 16;
/// Number of its own best configurations among which a machine chooses.
const OWN_CANDIDATES: usize = 8;
/// Number of each other machine's best configurations among which it chooses.
const CANDIDATES: usize = 4;
/// Number of configurations after which the others are asked each time, while its own search goes on.
const ASK_EVERY: usize = 8;

/// The state of another machine with this input.
#[derive(Clone, Copy, Debug)]
struct OtherMachine {
    state: StateId,
    level: MachineLevel,
    /// The term to add to the logarithm of a cost there.
    shift: f64,
    /// Both have measured something, so that the shift rests on this very state.
    shared: bool,
    /// The range in which a single measurement there is believed.
    reach: Option<(f64, f64)>,
}

/// The logarithm of a configuration's cost by the measurements of one level.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LevelEstimate {
    mean: f64,
    variance: f64,
    machines: usize,
    measurements: u64,
}

/// The logarithm of a configuration's cost by all levels together, and the level that counts most in it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PooledEstimate {
    mean: f64,
    level: MachineLevel,
    machines: usize,
    measurements: u64,
}

impl PooledEstimate {
    /// The cost, in the objective's units.
    fn cost(&self) -> f64 {
        libm::exp(self.mean).min(f64::MAX)
    }
}

/// The other machines that measured something in a state.
struct OtherMachines<'a> {
    states: &'a States,
    state: StateId,
    default: &'a Configuration,
    peers: Vec<OtherMachine>,
    /// The range in which a single measurement of the asking machine is believed.
    reach: Option<(f64, f64)>,
}

fn log(cost: f64) -> f64 {
    libm::log(cost.max(REWARD_COST_MIN))
}

/// The variance of a measurement in a state, relative to its cost.
fn noise_2(states: &States, state: StateId) -> f64 {
    let noise = states.results(state).frame_noise();
    assert!(noise > 0.0, "a noise of {noise}");
    noise * noise
}

impl OtherMachine {
    fn of(
        states: &States,
        default: &Configuration,
        (state, own_reach): (StateId, Option<(f64, f64)>),
        other: StateId,
    ) -> Self {
        let own = &states[state];
        let reach = states.results(other).reach();
        let best = own.results.ranked().take(SHARED).filter(|record| record.configuration != *default);
        let (mut sum, mut weight) = (0.0, 0.0);
        let known = best.chain(states.results(state).ran(default));
        for record in known.filter(|record| !record.is_doubtful(own_reach)) {
            let there = states.results(other).ran(&record.configuration);
            if let Some(there) = there.filter(|there| !there.is_doubtful(reach)) {
                let (here, elsewhere) = (record.measurements as f64, there.measurements as f64);
                let share = here * elsewhere / (here + elsewhere);
                sum += share * (log(record.mean_cost) - log(there.mean_cost));
                weight += share;
            }
        }
        let (machines, machine) = (&states.machines, states[other].machine);
        assert!(machine != own.machine, "siblings are of different machines");
        let far = machines.effect(own.machine) - machines.effect(machine);
        OtherMachine {
            state: other,
            level: machines.level(own.machine, machine),
            shift: if weight > 0.0 { sum / weight } else { far },
            shared: weight > 0.0,
            reach,
        }
    }
}

impl<'a> OtherMachines<'a> {
    fn of(states: &'a States, default: &'a Configuration, state: StateId) -> Self {
        let others = states.siblings(state).iter().copied();
        let others = others.filter(|&other| states.results(other).best().is_some());
        let reach = states.results(state).reach();
        let peers = others.map(|other| OtherMachine::of(states, default, (state, reach), other)).collect();
        OtherMachines { states, state, default, peers, reach }
    }

    fn is_empty(&self) -> bool {
        self.peers.is_empty()
    }

    /// The peers' estimate of a configuration at a level, converted to this machine.
    fn by_level(&self, level: MachineLevel, configuration: &Configuration) -> Option<LevelEstimate> {
        let (mut sum, mut precision, mut machines, mut measurements) = (0.0, 0.0, 0, 0);
        for peer in self.peers.iter().filter(|peer| peer.level == level) {
            if let Some((record, cost)) = self.told((peer.state, peer.reach), configuration) {
                let own = record.measurements as f64 / noise_2(self.states, peer.state);
                sum += own * (log(cost) + peer.shift);
                precision += own;
                machines += 1;
                measurements += record.measurements;
            }
        }
        assert!(machines == 0 || precision > 0.0, "a precision of {precision} by {machines}");
        let (mean, variance) = (sum / precision, 1.0 / precision);
        (machines > 0).then_some(LevelEstimate { mean, variance, machines, measurements })
    }

    fn by_levels(&self, configuration: &Configuration) -> [(MachineLevel, Option<LevelEstimate>); 2] {
        [MachineLevel::Group, MachineLevel::Fleet].map(|level| (level, self.by_level(level, configuration)))
    }

    /// A machine's result of a configuration, and the cost that counts of it.
    fn told(
        &self,
        (state, reach): (StateId, Option<(f64, f64)>),
        configuration: &Configuration,
    ) -> Option<(&'a Record, f64)> {
        let record = self.states.results(state).ran(configuration)?;
        Some((record, record.told_cost(reach)?))
    }

    /// The estimate of a configuration's cost here from all its measurements; `None` where it has none.
    fn pooled(&self, baseline: Option<f64>, configuration: &Configuration) -> Option<PooledEstimate> {
        let (machines, machine) = (&self.states.machines, self.states[self.state].machine);
        let mut sources = Vec::with_capacity(3);
        if let Some((own, cost)) = self.told((self.state, self.reach), configuration) {
            let (mean, measurements) = (log(cost), own.measurements);
            let variance = noise_2(self.states, self.state) / measurements as f64;
            sources
                .push((MachineLevel::Machine, LevelEstimate { mean, variance, machines: 1, measurements }));
        }
        for (level, estimate) in self.by_levels(configuration) {
            if let Some(estimate) = estimate {
                let variance = estimate.variance + machines.miss_2(machine, level);
                let share = machines.share(machine, level);
                let mean = baseline.map_or(estimate.mean, |base| base + share * (estimate.mean - base));
                sources.push((level, LevelEstimate { mean, variance, ..estimate }));
            }
        }
        let most_precise = sources.iter().min_by(|a, b| a.1.variance.total_cmp(&b.1.variance))?;
        let (level, LevelEstimate { machines, measurements, .. }) = *most_precise;
        let prior = baseline.map(|mean| (mean, SPREAD * SPREAD));
        let all = sources.iter().map(|(_, estimate)| (estimate.mean, estimate.variance)).chain(prior);
        let (sum, precision) = all.fold((0.0, 0.0), |(sum, precision), (mean, variance)| {
            let own = 1.0 / variance.max(f64::MIN_POSITIVE);
            (sum + own * mean, precision + own)
        });
        assert!(precision > 0.0, "a precision of {precision}");
        Some(PooledEstimate { mean: sum / precision, level, machines, measurements })
    }

    /// The configuration with the least estimate among those that `filter` passes and that can be run here,
    /// as far as is known.
    fn best(&self, filter: impl Fn(&Configuration) -> bool) -> Option<(&'a Configuration, PooledEstimate)> {
        let (states, state) = (self.states, self.state);
        let own = states.results(state).ran(self.default).filter(|own| !own.is_doubtful(self.reach));
        let baseline = own.map(|record| log(record.mean_cost));
        let baseline = baseline.or_else(|| {
            let estimates = self.by_levels(self.default).into_iter();
            estimates.filter_map(|(_, estimate)| estimate).map(|estimate| estimate.mean).next()
        });
        let own = states.results(state).ranked().take(OWN_CANDIDATES);
        let others = self.peers.iter().flat_map(|peer| states.results(peer.state).ranked().take(CANDIDATES));
        let candidates = own.chain(others).map(|record| &record.configuration);
        // The nearest relation that tried a configuration says whether it runs.
        let runs = |candidate: &Configuration| {
            let mut near = std::iter::once(state).chain(self.peers.iter().map(|peer| peer.state));
            let tried = near.find_map(|near| states.results(near).record(candidate));
            tried.is_none_or(|record| !record.fails()) && !states.results(state).fails(candidate)
        };
        let candidates = candidates.filter(|candidate| runs(candidate) && filter(candidate));
        let estimated =
            candidates.filter_map(|candidate| Some((candidate, self.pooled(baseline, candidate)?)));
        estimated.min_by(|(_, a), (_, b)| a.mean.total_cmp(&b.mean))
    }
}

impl Transfer<'_> {
    /// The best configuration of other machines in this state, as long as that counts for more than the
    /// machine's own measurements.
    pub(crate) fn best_by_machines(&self, state: StateId) -> Option<Exploitation> {
        let peers = OtherMachines::of(self.states, self.spec.space.default_ref(), state);
        if peers.is_empty() {
            return None;
        }
        let (configuration, estimate) = peers.best(|_| true)?;
        (estimate.level != MachineLevel::Machine).then(|| Exploitation {
            configuration: configuration.clone(),
            predicted_cost: Some(estimate.cost()),
            source: ExploitSource::Machines(by_machines(&peers, &estimate)),
            rolled_back: false,
        })
    }

    /// The best configuration of other machines that this one has not measured yet, where its estimate beats
    /// this one's best. The default comes first, because machines are compared by it.
    pub(crate) fn untried_by_machines(&self, state: StateId) -> Option<ProposedTrial> {
        let results = self.states.results(state);
        let policy = &self.spec.policy;
        let is_finished = self.searches.are_spent(state, results, policy, policy.trials_per_state as usize);
        if self.states.siblings(state).is_empty() || is_finished {
            return None;
        }
        let searches = self.searches.of(state).is_some();
        if searches && !results.tried().is_multiple_of(ASK_EVERY) {
            return None;
        }
        let default = self.spec.space.default_ref();
        let peers = OtherMachines::of(self.states, default, state);
        if peers.is_empty() {
            return None;
        }
        if !results.is_tried(default) && !self.trials.runs(state, default) && !searches {
            let (configuration, point) = (default.clone(), ExploredPoint::BaselineOfMachine);
            return Some(ProposedTrial { configuration, predicted_cost: None, point });
        }
        let is_new =
            |candidate: &Configuration| !results.is_tried(candidate) && !self.trials.runs(state, candidate);
        let (configuration, estimate) = peers.best(is_new)?;
        let promising = results.best().is_none_or(|best| estimate.mean < log(best.mean_cost));
        promising.then(|| ProposedTrial {
            configuration: configuration.clone(),
            predicted_cost: Some(estimate.cost()),
            point: ExploredPoint::ByMachines(by_machines(&peers, &estimate)),
        })
    }
}

/// The machines whose measurements an estimate rests on, for the decision.
fn by_machines(peers: &OtherMachines<'_>, estimate: &PooledEstimate) -> ByMachines {
    assert!(estimate.machines > 0 && estimate.measurements > 0, "{estimate:?} rests on something");
    let states = peers.states;
    let of_level = peers.peers.iter().filter(|peer| peer.level == estimate.level);
    let neighbours = of_level.filter_map(|peer| {
        let best = states.results(peer.state).best()?;
        let best_cost = libm::exp(log(best.mean_cost) + peer.shift).min(f64::MAX);
        Some(Neighbour { state_id: peer.state.get(), distance: 0.0, best_cost })
    });
    ByMachines {
        level: estimate.level,
        machines: estimate.machines as u64,
        measurements: estimate.measurements,
        software_change: states.machines.change_of_software(states[peers.state].machine),
        neighbours: neighbours.take(NEIGHBOURS_MAX).collect(),
    }
}

/// Compares a measured cost with the prediction of other machines' measurements, before it is learnt.
pub(crate) fn compare(
    states: &mut States,
    default: &Configuration,
    state: StateId,
    configuration: &Configuration,
    cost: f64,
) {
    let siblings = states.siblings(state);
    if !siblings.iter().any(|&other| states.results(other).ran(configuration).is_some()) {
        return;
    }
    let machine = states[state].machine;
    let peers = OtherMachines::of(states, default, state);
    // By the factors between machines alone.
    let (mut sum, mut count) = (0.0, 0.0);
    for peer in &peers.peers {
        if let Some(record) = states.results(peer.state).ran(configuration) {
            sum += log(record.mean_cost) - states.machines.effect(states[peer.state].machine);
            count += 1.0;
        }
    }
    assert!(count > 0.0, "another machine measured it");
    // The first time only: afterwards machines are compared by this configuration.
    let baseline = states.results(state).ran(default).map(|record| log(record.mean_cost));
    let baseline = baseline.filter(|_| states.results(state).ran(configuration).is_none());
    let carried = baseline.map(|baseline| {
        let shared = peers.peers.iter().copied().filter(|peer| peer.shared).collect();
        (baseline, OtherMachines { peers: shared, ..peers }.by_levels(configuration))
    });
    let machines = &mut states.machines;
    if let Some((baseline, estimates)) = carried {
        for (level, estimate) in estimates {
            if let Some(estimate) = estimate {
                machines.carry(machine, level, estimate.mean - baseline, log(cost) - baseline);
            }
        }
    }
    let effect = machines.effect(machine);
    machines.compare(machine, log(cost) - sum / count - effect);
}
