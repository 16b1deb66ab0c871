//! The measurements near a state, and a Gaussian process fitted to them when a question is answered.
//!
//! Collecting them takes microseconds; they are shared with the study's tables, not copied. Fitting the
//! process and searching for its least value take milliseconds, so callers do both without the study's lock.
//!
//! There is room for some hundred measurements. How much those of other machines say is learnt with the
//! lengths: the machine is a feature of the process. So where they take the room of the machine's own, the
//! nearest by these lengths are chosen when the process is fitted. Machines that rank configurations alike
//! are near each other then, and those that do not are further away than any state of one's own.

use std::collections::BTreeSet;
use std::sync::Arc;

use rand_chacha::ChaCha8Rng;

use crate::configuration::Configuration;
use crate::gp::kernel::squared_distance;
use crate::gp::warping::RobustLog;
use crate::gp::{Hyperparameters, Process, Sample, acquisition};
use crate::matrix::dot;
use crate::predict::contextual::lowest::LowestBound;
use crate::predict::contextual::running::Running;
use crate::predict::contextual::{FeatureMap, FitRequest, PRIOR};
use crate::predict::state_index::IndexEntry;
use crate::predict::{Answer, Estimate, Query, RUNS_LEAST, WORTH};
use crate::results::{KnownState, Record, ResultTable};
use crate::space::Space;

/// Most measurements that a process is fitted to, and the most after which a state that was measured often is
/// left out. Where every input is met once, each state gives one measurement, and all lessons are taken.
const ROWS_MAX: usize = 160;
const ROWS_OFTEN_MAX: usize = 96;
/// The least number of measurements that a process is fitted to.
const ROWS_MIN: usize = 2;
/// Most measurements of the nearest state among them. Each further state gives half as many.
const QUOTA_FIRST: usize = 48;
/// Least number of measurements that every state may give.
const QUOTA_LEAST: usize = 8;
/// The weight of a measurement of the machine itself, of its group and of the fleet: machines differ.
const TRUST: [f64; 3] = [1.0, 0.5, 0.25];

/// Least number of measurements by which a single state may decide an answer elsewhere. Without any of these
/// the answer must be expected to be the better one, too.
const DECIDING_ROWS: usize = 8;

/// Most near states in which nothing could be run, for the model of feasibility.
const FAILED_STATES_MAX: usize = 16;
/// Most failures that the model of feasibility is fitted to.
const FAILURES_MAX: usize = 64;
/// Least probability that an explored configuration can be run.
const EXPLORED_RUNS_LEAST: f64 = 0.5;
/// Deviations that are subtracted where an answer has to be surely good.
const CAREFUL: f64 = -1.0;

#[derive(Clone, Debug, PartialEq)]
struct SourceState {
    /// Its features for the process.
    state: Vec<f64>,
    results: Arc<ResultTable>,
    /// The number of its measurements that count.
    quota: usize,
    trust: f64,
    /// The factor from a cost there to one here.
    factor: f64,
    explored: bool,
}

/// The measurements near a state. See the head of this module.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LocalData {
    features: Arc<FeatureMap>,
    sources: Vec<SourceState>,
    /// States of the asking machine that found no room among them, beside nearer ones of other machines.
    crowded_out: Vec<SourceState>,
    /// The features of the asked state.
    state: Vec<f64>,
    /// The table of the asked state.
    here: Option<Arc<ResultTable>>,
}

impl LocalData {
    /// Collects the measurements for a query: most of them from the nearest states, and the best of each.
    pub(super) fn new(features: &Arc<FeatureMap>, query: &Query<'_>) -> Self {
        let found = query.nearest_tried(ROWS_MAX, FAILED_STATES_MAX);
        let (mut sources, mut quota, mut rows) = (Vec::new(), QUOTA_FIRST, 0);
        let mut held = BTreeSet::new();
        let known = |found: &IndexEntry| Some((found.name, query.known.get(found.name as usize)?));
        for (name, state) in found.iter().filter_map(known) {
            let is_seldom = (1..DECIDING_ROWS).contains(&state.results.ranked().len());
            let most = if is_seldom { ROWS_MAX } else { ROWS_OFTEN_MAX };
            if rows >= most {
                continue;
            }
            let taken = quota.min(most - rows);
            sources.push(SourceState::of(features, query, state, taken));
            held.insert(name);
            let given = state.results.ranked().len().min(taken);
            rows += given;
            quota = if given > 0 { (quota / 2).max(QUOTA_LEAST) } else { quota };
            if rows >= ROWS_MAX {
                break;
            }
        }
        let is_shared = rows >= ROWS_OFTEN_MAX && query.machines.len() > 1;
        let own = if is_shared { query.nearest_own(ROWS_MAX) } else { Vec::new() };
        let crowded_out = own.iter().filter(|own| !held.contains(&own.name)).filter_map(known);
        let crowded_out =
            crowded_out.map(|(_, state)| SourceState::of(features, query, state, QUOTA_LEAST)).collect();
        let is_there =
            |here: &KnownState| found.iter().any(|found| found.name as usize + 1 == here.id.0 as usize);
        if let Some(here) = query.here.filter(|here| !is_there(here)) {
            // Its table may hold failures.
            sources.insert(0, SourceState::of(features, query, here, QUOTA_LEAST));
        }
        LocalData {
            features: Arc::clone(features),
            sources,
            crowded_out,
            state: features.state(query.state, query.machines.number(query.machine)),
            here: query.here.map(|here| Arc::clone(&here.results)),
        }
    }

    /// The share of the measurements that come from states which were searched.
    pub(super) fn is_mostly_searched(&self) -> bool {
        let rows = SourceState::rows;
        let searched = self.sources.iter().filter(|source| source.explored).map(rows).sum::<usize>();
        2 * searched > self.sources.iter().map(rows).sum()
    }

    /// The states whose measurements a process is fitted to: where states of the asking machine were crowded
    /// out, those that are nearest by the process's own lengths, for as many measurements.
    fn chosen(&self, hyper: &Hyperparameters) -> Vec<&SourceState> {
        if self.crowded_out.is_empty() {
            return self.sources.iter().collect();
        }
        let weights = hyper.weights(self.features.kinds.len());
        let features = self.features.kinds.iter().zip(&weights);
        let distance_2 = |source: &SourceState| -> f64 {
            let pairs = features.clone().zip(self.state.iter().zip(&source.state));
            pairs.map(|((kind, weight), (here, there))| weight * squared_distance(*kind, *here, *there)).sum()
        };
        let all = self.sources.iter().chain(&self.crowded_out);
        let mut all: Vec<(f64, &SourceState)> = all.map(|source| (distance_2(source), source)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut room: usize = self.sources.iter().map(SourceState::rows).sum();
        let fits = |source: &&SourceState| {
            let is_left = source.rows() <= room;
            room -= if is_left { source.rows() } else { 0 };
            is_left
        };
        all.into_iter().map(|(_, source)| source).filter(fits).collect()
    }

    /// The process of the measurements in some states, the costs as it sees them, and the records that it was
    /// fitted to.
    fn fit<'a>(
        &self,
        hyper: &Hyperparameters,
        space: &Space,
        sources: &[&'a SourceState],
    ) -> Option<(Process, RobustLog, Vec<&'a Record>)> {
        let (mut points, mut counts): (Vec<Vec<f64>>, Vec<f64>) = Default::default();
        let (mut records, mut costs) = (Vec::new(), Vec::new());
        for &source in sources {
            for record in source.records() {
                let features = self.features.features(&space.encode(&record.configuration));
                points.push([&source.state[..], &features].concat());
                counts.push(source.trust * record.measurements as f64);
                costs.push(source.translate(record.mean_cost));
                records.push(record);
            }
        }
        let warping = RobustLog::of(&costs)?;
        let values = costs.iter().map(|&cost| warping.see(cost)).collect();
        let points: Vec<&[f64]> = points.iter().map(Vec::as_slice).collect();
        let sample = Sample::new(self.features.kinds.clone(), &points, counts);
        if sample.len() < ROWS_MIN {
            return None;
        }
        Some((Process::fit(sample, values, hyper, &PRIOR)?, warping, records))
    }

    /// Configurations that ran and that failed near by.
    fn running(&self, space: &Space) -> Running {
        let (mut runs, mut failures) = (Vec::new(), FAILURES_MAX);
        for source in &self.sources {
            let failing = source.results.records().iter().filter(|record| record.fails()).take(failures);
            let ran = source.records();
            for record in ran.into_iter().chain(failing) {
                let features = self.features.features(&space.encode(&record.configuration));
                assert!(failures > 0 || !record.fails(), "no more failures are taken");
                failures -= usize::from(record.fails());
                runs.push(([&source.state[..], &features].concat(), record.fails(), source.trust));
            }
        }
        Running::of(&self.features, &runs, &self.state)
    }

    /// Whether a configuration ran in the nearest state that tried it, and in two states between which the
    /// asked one lies: in the ball of which they are opposite points. Where a limit of feasibility moves with
    /// the state, one side says little of the other.
    fn ran_around(&self, configuration: &Configuration) -> bool {
        // What was stopped has a verdict and did not run to its end.
        let is_tried =
            |results: &ResultTable| results.is_tried(configuration) || results.fails(configuration);
        let nearest = self.sources.iter().find(|source| is_tried(&source.results));
        let ran = self.sources.iter().filter(|source| source.results.ran(configuration).is_some());
        // The machine is the last feature of a state.
        let width = self.state.len() - 1;
        let way = |source: &SourceState| -> Vec<f64> {
            source.state[..width].iter().zip(&self.state).map(|(there, here)| there - here).collect()
        };
        let ways: Vec<Vec<f64>> = ran.map(way).collect();
        let is_beyond = |way: &Vec<f64>| ways.iter().any(|other| dot(way, other) <= 0.0);
        nearest.is_some_and(|nearest| nearest.results.ran(configuration).is_some())
            && ways.iter().any(is_beyond)
    }

    /// Whether one configuration is expected to cost less than another without any single other state, too.
    /// A state unlike all others may be the nearest one, and what is best there costs much elsewhere.
    fn is_borne_out(
        &self,
        hyper: &Hyperparameters,
        space: &Space,
        sources: &[&SourceState],
        [own, other]: [&[f64]; 2],
    ) -> bool {
        let is_here =
            |source: &SourceState| self.here.as_ref().is_some_and(|here| Arc::ptr_eq(here, &source.results));
        let decides = |source: &SourceState| !is_here(source) && source.rows() >= DECIDING_ROWS;
        let mut deciding = (0..sources.len()).filter(|place| decides(sources[*place]));
        deciding.all(|place| {
            let mut others = sources.to_vec();
            others.remove(place);
            let fit = self.fit(hyper, space, &others);
            fit.is_some_and(|(process, ..)| {
                process.difference(&process.context(&self.state), own, other).mean < 0.0
            })
        })
    }

    /// The configuration of the least cost, less some deviations, that can probably be run. Beside a rival it
    /// must almost surely run, lie among those that ran, be worth its risk, and be borne out by more than one
    /// state. Else there is no answer.
    pub(super) fn answer(
        &self,
        FitRequest { hyper, optimism, neighbours, rival, .. }: &FitRequest,
        space: &Space,
        random: &mut ChaCha8Rng,
    ) -> Option<Answer> {
        let sources = self.chosen(hyper);
        let (process, warping, records) = self.fit(hyper, space, &sources)?;
        let context = process.context(&self.state);
        let running = self.running(space);
        let layout = &self.features.layout;
        let runs_least = if rival.is_some() { RUNS_LEAST } else { EXPLORED_RUNS_LEAST };
        let excludes = |x: &[f64]| {
            let configuration = space.decode(x);
            match &self.here {
                Some(here) if here.fails(&configuration) => return true,
                Some(here) if here.ran(&configuration).is_some() => return false,
                _ => {}
            }
            let features = layout.features(x, &layout.active(x));
            // Limits of feasibility are sharp, and their model is not. So beside a rival an answer lies among
            // what ran near by.
            let is_among = || match running.failed {
                true => self.ran_around(&configuration),
                false => running.encloses(&features),
            };
            running.probability(&features) < runs_least || rival.is_some() && !is_among()
        };
        let is_worth = |x: &[f64]| {
            rival.as_ref().is_none_or(|rival| {
                let [own, other] = [x, &space.encode(rival)].map(|x| self.features.features(x));
                own != other
                    && acquisition::is_worth(process.difference(&context, &own, &other), WORTH)
                    && self.is_borne_out(hyper, space, &sources, [&own, &other])
            })
        };
        // A surely good point takes the place of one that may be best but is not worth its risk.
        let ways = [*optimism, CAREFUL];
        let (x, belief) = ways.into_iter().take(1 + usize::from(rival.is_some())).find_map(|optimism| {
            let lowest = LowestBound { process: &process, layout, context: &context, optimism };
            let known = records.iter().map(|record| space.encode(&record.configuration));
            lowest.search(known, random, excludes).filter(|(x, _)| is_worth(x))
        })?;
        let variance = belief.deviation * belief.deviation + process.noise;
        let expected = estimate(&warping, belief.mean, variance);
        Some(Answer { configuration: space.decode(&x), expected, neighbours: neighbours.clone() })
    }

    pub(crate) fn estimate(
        &self,
        hyper: &Hyperparameters,
        space: &Space,
        configuration: &Configuration,
    ) -> Option<Estimate> {
        let (process, warping, _) = self.fit(hyper, space, &self.chosen(hyper))?;
        let context = process.context(&self.state);
        let belief = process.at(&context, &self.features.features(&space.encode(configuration)));
        let variance = belief.deviation * belief.deviation + process.noise;
        Some(estimate(&warping, belief.mean, variance))
    }
}

impl SourceState {
    fn of(features: &FeatureMap, query: &Query<'_>, state: &KnownState, quota: usize) -> Self {
        SourceState {
            state: features.state(&state.anchor, query.machines.number(state.machine)),
            results: Arc::clone(&state.results),
            quota,
            trust: TRUST[query.machines.level(query.machine, state.machine) as usize],
            factor: query.machines.factor(state.machine, query.machine),
            explored: state.explored,
        }
    }

    /// The number of its measurements that count.
    fn rows(&self) -> usize {
        self.results.ranked().len().min(self.quota)
    }

    /// Its measurements that count: the better half of them the best, the others evenly from the rest.
    fn records(&self) -> Vec<&Record> {
        self.results.spread(self.quota.div_ceil(2), self.quota / 2, &[])
    }

    fn translate(&self, cost: f64) -> f64 {
        (cost * self.factor).min(f64::MAX)
    }
}

/// A belief in the objective's units. The deviation is that of a single measurement.
fn estimate(warping: &RobustLog, mean: f64, variance: f64) -> Estimate {
    assert!(variance >= 0.0, "a variance of {variance}");
    let cost = warping.cost(mean);
    let above = warping.cost(mean + variance.sqrt());
    Estimate::new(cost, above - cost)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;
    use crate::ids::MachineId;
    use crate::predict::tests::World;
    use crate::trial::Outcome;

    /// The place of the machine among the features of a state of two indicators.
    const MACHINE: usize = 2;

    /// A world in which every trial finds another state, on the machines in turn.
    fn fresh(machines: u64) -> World {
        let mut world = World::new(1, 2);
        let mut random = ChaCha8Rng::seed_from_u64(3);
        for round in 0..400 {
            let state: [f64; 2] = random.random();
            let cost = 1.0 + random.random::<f64>();
            world.take(&state, &[random.random()], Outcome::Ok, Some(cost), 10 * (1 + round % machines));
        }
        world
    }

    #[test]
    fn machines_take_the_room_of_ones_own_states_as_far_as_they_are_alike() {
        let world = fresh(2);
        let features = FeatureMap::of(&world.space, 2);
        let data = LocalData::new(&features, &world.query(&[0.5, 0.5]));
        let own = world.machines.number(MachineId(0)) as f64;
        let chosen = |machine_weight: f64| {
            let count = features.kinds.len() + 1;
            let mut log = vec![0.0; count];
            log[MACHINE] = libm::log(machine_weight);
            let plain = serde_json::json!({ "log": log, "steps": vec![0.3; count], "signs": vec![0; count] });
            let hyper: Hyperparameters = serde_json::from_value(plain).expect("plain data");
            let chosen = data.chosen(&hyper);
            let of_own = chosen.iter().filter(|source| source.state[MACHINE] == own).count();
            (chosen.len(), of_own)
        };
        let (all, of_own) = chosen(1e-6);
        assert!(all == ROWS_MAX && (50..=110).contains(&of_own), "{of_own} of {all} where they are alike");
        assert_eq!(chosen(100.0), (ROWS_MAX, ROWS_MAX), "others say nothing");
    }

    #[test]
    fn one_machine_crowds_nothing_out() {
        let world = fresh(1);
        let features = FeatureMap::of(&world.space, 2);
        let data = LocalData::new(&features, &world.query(&[0.5, 0.5]));
        assert!(data.crowded_out.is_empty() && data.sources.len() == ROWS_MAX, "{}", data.sources.len());
    }
}
