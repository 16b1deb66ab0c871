//! The machines of a study, and the weight of one machine's measurements for another.
//!
//! Costs of one frame differ between machines, mostly by a factor, but the best configuration may differ as
//! well. So a measurement belongs to its machine: processor, instruction set, threads and software together
//! (the client's [`Fingerprint`]). Machines of one processor and one software make a group, and all machines
//! of the study make the fleet ([`MachineLevel`]). The weights of the group and of the fleet for a machine
//! are learnt: each of its measurements is compared with the prediction from the others' measurements. The
//! paper leaves this to future work ("hierarchical optimization or per node optimization is promising", its
//! section 9). The method is partial pooling (Gelman et al., "Bayesian Data Analysis", chapter 5).
//!
//! Other software makes another machine and another group. Measurements from before a change of Embree or of
//! the build count as the fleet's from then on, and never again as the machine's own.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

pub use crate::decision::MachineLevel;
use crate::fnv;
use crate::ids::MachineId;
use crate::limits::MACHINES_MAX;
use crate::trial::Fingerprint;

/// The prior error of a group's and the fleet's estimate of a configuration, as a logarithm, and the prior's
/// weight in comparisons.
const MISS_PRIOR: [f64; 2] = [0.05, 0.15];
const MISS_PRIOR_WEIGHT: f64 = 4.0;
/// Gains and losses against the default elsewhere are expected here as well. This is the square of the
/// difference, in logarithms, that outweighs that expectation.
const CARRIED_PRIOR: f64 = 0.25;
/// Factor by which an older comparison counts less: machines may change.
const MISS_FADE: f64 = 0.98;
/// The largest error that one comparison counts as: a factor of twenty.
const MISS_MAX: f64 = 3.0;
/// Number of latest comparisons that are averaged for the factor between a machine's costs and the others'.
const EFFECT_MEMORY: f64 = 64.0;
/// Distance that is added in quadrature to a state of the machine, the group and the fleet; indicators span 0
/// to 1.
const DISTANCE: [f64; 3] = [0.0, 0.05, 0.1];

/// The square of the distance that is added for a state of that level.
pub(crate) fn distance_2(level: MachineLevel) -> f64 {
    let distance = DISTANCE[level as usize];
    distance * distance
}

/// Statistics of a machine from comparisons with others. Costs are logarithms.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct PoolingStatistics {
    /// The logarithm of the factor of its costs over those of the others.
    effect: f64,
    compared: f64,
    /// The regression of its differences to the default on those of the group and of the fleet. It holds sums
    /// of products of theirs and its own, and of squares of theirs.
    carried: [(f64, f64); 2],
    /// Mean square errors of the group and of the fleet, and their weights.
    misses: [(f64, f64); 2],
}

impl Default for PoolingStatistics {
    fn default() -> Self {
        let miss = |prior: f64| (prior * prior * MISS_PRIOR_WEIGHT, MISS_PRIOR_WEIGHT);
        let carried = [(CARRIED_PRIOR, CARRIED_PRIOR); 2];
        PoolingStatistics { effect: 0.0, compared: 0.0, carried, misses: MISS_PRIOR.map(miss) }
    }
}

#[derive(Clone, Debug, PartialEq)]
struct Machine {
    exact: u64,
    group: u64,
    /// A number for processor, instruction set and threads, without the software.
    hardware: u64,
    fingerprint: Option<Fingerprint>,
    /// Rises with every state that any machine founds.
    latest: u64,
    pooling: PoolingStatistics,
}

/// The machines of a study in the order in which they came. A client that names no machine is one of its own.
///
/// At most [`MACHINES_MAX`] are distinguished at a time. One more displaces the machine whose last new state
/// is oldest. Its measurements stay as the others', and if it comes back it begins as a new machine.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Machines {
    machines: Vec<Machine>,
    /// The machines that are distinguished, by their numbers. Only these are ever matched again.
    current: BTreeMap<u64, MachineId>,
    founded: u64,
}

/// The first machine of a study, to which all others are compared.
pub(crate) const FIRST: MachineId = MachineId(0);

fn index(machine: MachineId) -> usize {
    machine.0 as usize
}

impl Machines {
    /// The place of a machine, if it has a state.
    pub fn find(&self, fingerprint: Option<&Fingerprint>) -> Option<MachineId> {
        self.current.get(&number(fingerprint, EXACT)).copied()
    }

    /// Notes that a machine founds a state. Returns its place, and that of the machine that it displaced, if
    /// any.
    pub fn note_founder(&mut self, fingerprint: Option<&Fingerprint>) -> (MachineId, Option<MachineId>) {
        self.founded += 1;
        if let Some(place) = self.find(fingerprint) {
            let known = &mut self.machines[index(place)];
            assert_eq!(known.exact, number(fingerprint, EXACT), "machine {place:?} is another one");
            assert!(known.latest < self.founded, "{} comes after {}", self.founded, known.latest);
            known.latest = self.founded;
            return (place, None);
        }
        let full = self.current.len() >= MACHINES_MAX;
        let oldest = self.current.values().min_by_key(|&&place| self.machines[index(place)].latest);
        let displaced = oldest.copied().filter(|_| full);
        if let Some(place) = displaced {
            self.current.remove(&self.machines[index(place)].exact);
        }
        let place = MachineId(self.machines.len() as u64);
        let [exact, group, hardware] = [EXACT, GROUP, HARDWARE].map(|parts| number(fingerprint, parts));
        self.current.insert(exact, place);
        let (fingerprint, latest, pooling) =
            (fingerprint.cloned(), self.founded, PoolingStatistics::default());
        self.machines.push(Machine { exact, group, hardware, fingerprint, latest, pooling });
        assert!(self.current.len() <= MACHINES_MAX, "{} machines at a time", self.current.len());
        (place, displaced)
    }

    pub(crate) fn fingerprint(&self, machine: MachineId) -> Option<&Fingerprint> {
        self.machines.get(index(machine))?.fingerprint.as_ref()
    }

    /// The number of machines that ever founded a state.
    pub(crate) fn len(&self) -> usize {
        self.machines.len()
    }

    /// The level of `other` for `machine`: the machine itself, its group, or the fleet.
    pub fn level(&self, machine: MachineId, other: MachineId) -> MachineLevel {
        let group = |place: MachineId| self.machines.get(index(place)).map(|machine| machine.group);
        match machine == other {
            true => MachineLevel::Machine,
            false if group(machine) == group(other) => MachineLevel::Group,
            false => MachineLevel::Fleet,
        }
    }

    /// A number that stands for a machine's name; 0 for an unknown one.
    pub(crate) fn number(&self, machine: MachineId) -> u64 {
        self.machines.get(index(machine)).map_or(0, |machine| machine.exact)
    }

    /// The factor that converts a cost on `from` to the expected cost on `to`; exactly 1 for one machine.
    pub(crate) fn factor(&self, from: MachineId, to: MachineId) -> f64 {
        if from == to { 1.0 } else { libm::exp(self.effect(to) - self.effect(from)) }
    }

    /// A cost on `from` as it is expected on `to`, finite.
    pub(crate) fn translate(&self, from: MachineId, to: MachineId, cost: f64) -> f64 {
        (self.factor(from, to) * cost).min(f64::MAX)
    }

    /// The logarithm of the factor between a machine's costs and those of the first.
    pub(crate) fn effect(&self, machine: MachineId) -> f64 {
        self.machines.get(index(machine)).map_or(0.0, |machine| machine.pooling.effect)
    }

    /// The variance of a level's estimates of a machine's configurations.
    pub(crate) fn miss_2(&self, machine: MachineId, level: MachineLevel) -> f64 {
        if level == MachineLevel::Machine {
            return 0.0;
        }
        let (sum, weight) = self.machines[index(machine)].pooling.misses[level as usize - 1];
        assert!(weight > 0.0, "a mean over a weight of {weight}");
        sum / weight
    }

    /// Notes the error of the prediction of a machine's measurement from the others' costs and the factors so
    /// far.
    pub(crate) fn compare(&mut self, machine: MachineId, off: f64) {
        // All others are compared to the first machine.
        if let Some(Machine { pooling, .. }) =
            self.machines.get_mut(index(machine)).filter(|_| machine > FIRST)
        {
            pooling.compared = (pooling.compared + 1.0).min(EFFECT_MEMORY);
            pooling.effect += off.clamp(-700.0, 700.0) / pooling.compared;
        }
    }

    /// The share of a configuration's difference to the default that carries over to a machine, 0 to 1: least
    /// squares through the origin, with a prior of 1. It is 0 where others' best configurations do worse than
    /// the default here.
    pub(crate) fn share(&self, machine: MachineId, level: MachineLevel) -> f64 {
        if level == MachineLevel::Machine {
            return 1.0;
        }
        let (product, square) = self.machines[index(machine)].pooling.carried[level as usize - 1];
        (product / square).clamp(0.0, 1.0)
    }

    /// Notes a configuration's difference to the default: `theirs` on a level, and `own` on the machine.
    pub(crate) fn carry(&mut self, machine: MachineId, level: MachineLevel, theirs: f64, own: f64) {
        if level == MachineLevel::Machine {
            return;
        }
        let [theirs, own] = [theirs, own].map(|difference| difference.clamp(-MISS_MAX, MISS_MAX));
        let off = own - self.share(machine, level) * theirs;
        let PoolingStatistics { carried, misses, .. } = &mut self.machines[index(machine)].pooling;
        let (product, square) = &mut carried[level as usize - 1];
        (*product, *square) = (MISS_FADE * *product + own * theirs, MISS_FADE * *square + theirs * theirs);
        // As comparisons fade, the prior gains weight again.
        *product += (1.0 - MISS_FADE) * CARRIED_PRIOR;
        *square += (1.0 - MISS_FADE) * CARRIED_PRIOR;
        assert!(*square > 0.0, "squares of {square}");
        let (sum, weight) = &mut misses[level as usize - 1];
        (*sum, *weight) = (MISS_FADE * *sum + off * off, MISS_FADE * *weight + 1.0);
        assert!(*sum >= 0.0 && *weight >= 1.0, "squares of {sum} over {weight}");
    }

    /// The change of a machine's software since the latest earlier machine of its hardware: "embree 4.3.0 ->
    /// 4.4.0". `None` where there was no such machine.
    pub(crate) fn change_of_software(&self, machine: MachineId) -> Option<String> {
        let own = &self.machines[index(machine)];
        let now = &own.fingerprint.as_ref()?.software;
        let before = self.machines[..index(machine)].iter().rev();
        let before = before.filter(|other| other.hardware == own.hardware && other.group != own.group);
        let before = &before.filter_map(|other| other.fingerprint.as_ref()).next()?.software;
        let names = before.keys().chain(now.keys().filter(|name| !before.contains_key(*name)));
        let version = |of: &BTreeMap<String, String>, name: &String| {
            of.get(name).cloned().unwrap_or_else(|| "none".into())
        };
        let changes: Vec<String> = names
            .filter(|name| before.get(*name) != now.get(*name))
            .map(|name| format!("{name} {} -> {}", version(before, name), version(now, name)))
            .collect();
        (!changes.is_empty()).then(|| changes.join(", "))
    }

    pub(crate) fn pooling(&self) -> Vec<PoolingStatistics> {
        self.machines.iter().map(|machine| machine.pooling).collect()
    }

    /// Takes over statistics from [`pooling`](Machines::pooling) for the first machines.
    pub(crate) fn take_over(&mut self, pooling: &[PoolingStatistics]) {
        let pairs = self.machines.iter_mut().zip(pooling);
        pairs.for_each(|(machine, pooling)| machine.pooling = *pooling);
    }
}

/// The parts of a fingerprint that count beside the processor: instruction set and threads, and the software.
const EXACT: [bool; 2] = [true, true];
const GROUP: [bool; 2] = [false, true];
const HARDWARE: [bool; 2] = [true, false];

/// A number for parts of a fingerprint, which their lengths separate. 0 where there is none, or one that says
/// nothing: an import sends such a one.
fn number(fingerprint: Option<&Fingerprint>, [hardware, software]: [bool; 2]) -> u64 {
    let Some(said) = fingerprint.filter(|said| **said != Fingerprint::default()) else { return 0 };
    let threads = said.threads.to_string();
    let mut texts = vec![said.cpu_model.as_str()];
    if hardware {
        texts.extend([said.isa.as_str(), threads.as_str()]);
    }
    if software {
        texts.extend(said.software.iter().flat_map(|(name, version)| [name.as_str(), version.as_str()]));
    }
    let joined: String = texts.into_iter().map(|text| format!("{}:{text}", text.len())).collect();
    fnv::hash(joined.bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn machine(cpu: &str, threads: u32, embree: &str) -> Fingerprint {
        let software = BTreeMap::from([("embree".to_owned(), embree.to_owned())]);
        Fingerprint { cpu_model: cpu.into(), isa: "avx2".into(), threads, software }
    }

    #[test]
    fn the_same_processor_and_software_make_a_group_and_other_software_does_not() {
        let mut machines = Machines::default();
        let all =
            [machine("a", 8, "4.3"), machine("a", 4, "4.3"), machine("a", 8, "4.4"), machine("b", 8, "4.4")];
        let places: Vec<MachineId> =
            all.iter().map(|machine| machines.note_founder(Some(machine)).0).collect();
        assert_eq!(places, [0, 1, 2, 3].map(MachineId));
        assert_eq!(machines.note_founder(Some(&all[1])), (MachineId(1), None));
        assert_eq!(machines.find(None), None);
        let mut unnamed = Machines::default();
        let (place, _) = unnamed.note_founder(None);
        assert_eq!(unnamed.find(Some(&Fingerprint::default())), Some(place), "it says nothing");
        let levels =
            |from: usize| places.iter().map(|&to| machines.level(places[from], to)).collect::<Vec<_>>();
        let [own, group, fleet] = [MachineLevel::Machine, MachineLevel::Group, MachineLevel::Fleet];
        assert_eq!(levels(0), [own, group, fleet, fleet]);
        assert_eq!(levels(2), [fleet, fleet, own, fleet]);
        let changes = [0, 2, 3].map(|place| machines.change_of_software(MachineId(place)));
        assert_eq!(changes, [None, Some("embree 4.3 -> 4.4".to_owned()), None]);
    }

    #[test]
    fn trust_follows_comparisons() {
        let mut machines = Machines::default();
        for threads in 0..2 {
            machines.note_founder(Some(&machine("a", threads, "4")));
        }
        let (one, group, fleet) = (MachineId(1), MachineLevel::Group, MachineLevel::Fleet);
        let close = |a: f64, b: f64| (a - b).abs() < 1e-12;
        assert!(close(machines.miss_2(one, group), 0.0025) && close(machines.miss_2(one, fleet), 0.0225));
        (0..50).for_each(|_| machines.carry(one, group, -0.3, -0.3));
        assert!(machines.miss_2(one, group) < 0.0025 / 5.0);
        assert!((machines.share(one, group) - 1.0).abs() < 1e-9);
        // A configuration that halves the fleet's cost doubles it here.
        (0..3).for_each(|_| machines.carry(one, fleet, -0.7, 0.7));
        assert_eq!(machines.share(one, fleet), 0.0);
        (0..3).for_each(|_| machines.carry(one, group, 1.0, f64::INFINITY));
        assert!(machines.miss_2(one, group) > 0.1 && machines.miss_2(one, group) <= 9.0);
        (0..500).for_each(|_| machines.carry(one, fleet, 0.0, 0.0));
        assert!(machines.share(one, fleet) > 0.9, "it is asked again in time");
        assert_eq!(machines.factor(FIRST, one), 1.0);
        (0..9).for_each(|_| machines.compare(one, libm::log(2.0) - machines.effect(one)));
        assert!(close(machines.factor(FIRST, one), 2.0) && close(machines.factor(one, FIRST), 0.5));
        // All others are compared to the first machine.
        machines.compare(FIRST, 1.0);
        assert_eq!((machines.effect(FIRST), machines.factor(one, one)), (0.0, 1.0));
    }

    #[test]
    fn one_machine_too_many_displaces_the_one_that_met_nothing_new_for_longest() {
        let mut machines = Machines::default();
        let of = |threads: usize| machine("a", threads as u32, "4");
        for threads in 0..MACHINES_MAX {
            machines.note_founder(Some(&of(threads)));
        }
        machines.note_founder(Some(&of(0)));
        let next = MachineId(MACHINES_MAX as u64);
        assert_eq!(machines.note_founder(Some(&of(MACHINES_MAX))), (next, Some(MachineId(1))));
        assert_eq!(machines.find(Some(&of(1))), None);
        assert_eq!(machines.find(Some(&of(0))), Some(MachineId(0)));
        // It comes back as a new machine.
        let again = MachineId(next.0 + 1);
        assert_eq!(machines.note_founder(Some(&of(1))), (again, Some(MachineId(2))));
        assert_eq!(machines.level(again, MachineId(1)), MachineLevel::Group);
    }
}
