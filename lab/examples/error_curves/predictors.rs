//! The predictors: prequential error on streams of trials, each with a clock of its own.
//!
//! A tuner with `auto` decides what is run; then every predictor goes through the same trials by itself, is
//! asked about each and learns it. The clock runs while it is asked and while it learns, not while the tables
//! of states are kept, which every study does.

use std::sync::Arc;
use std::time::Instant;

use treewright_core::ids::{MachineId, StateId};
use treewright_core::machines::{Machines, Origin};
use treewright_core::policy::{Policy, PredictorMethod};
use treewright_core::predict::{Lesson, Predictors, Query, StateIndex, prequential};
use treewright_core::results::KnownState;
use treewright_core::search::Verdict;
use treewright_core::study::StudySpec;
use treewright_core::trial::Trial;

use crate::FRAME_S;
use crate::curve::{Curve, Kind, Sample, marks};
use crate::streams::{self, Stream};

/// All that can be chosen.
pub(crate) const METHODS: [PredictorMethod; 7] = [
    PredictorMethod::Auto,
    PredictorMethod::Contextual,
    PredictorMethod::NearestNeighbour,
    PredictorMethod::WeightedNeighbours,
    PredictorMethod::RbfGreedyGq,
    PredictorMethod::GaussianGreedyGq,
    PredictorMethod::LeastSquares,
];
/// The streams, and what they are called here.
const STREAMS: [(&str, &str); 4] = [
    ("level, fresh", "every state new, levels differ"),
    ("cliff, visited", "twelve states, a cliff"),
    ("drift, searched", "twelve states, costs drift"),
    ("turn, fresh", "every state new, a change half-way"),
];
/// The first point of a curve covers so many trials, but for the very first, of which nothing can be said.
const FIRST: usize = 8;

/// The curves of all predictors on all streams.
pub(crate) fn curves(seeds: u64, frames: usize) -> Vec<Curve> {
    let all: Vec<Stream> = [streams::known(), streams::unseen()].concat();
    let chosen = STREAMS.map(|(name, title)| {
        let stream = all.iter().find(|stream| stream.name == name).expect("one of the streams");
        (stream.clone().of_length(frames), title)
    });
    let of = |(stream, title): &(Stream, &str)| {
        let mut trials: Vec<Vec<(Vec<f64>, Trial)>> = Vec::new();
        for seed in 0..seeds {
            let mut run = Vec::with_capacity(frames);
            stream.run(seed, |state, trial| run.push((state.to_vec(), trial.clone())));
            trials.push(run);
        }
        METHODS.map(|method| {
            let spec = |seed| stream.study(Policy::default(), seed);
            let runs: Vec<Vec<Sample>> =
                (0..).zip(&trials).map(|(seed, trials)| replay(&spec(seed), method, trials)).collect();
            Curve::of(Kind::Predictor, title, method.name(), &runs)
        })
    };
    chosen.iter().flat_map(of).collect()
}

/// What one predictor makes of a run.
fn replay(spec: &StudySpec, method: PredictorMethod, trials: &[(Vec<f64>, Trial)]) -> Vec<Sample> {
    let (space, indicators) = (&spec.space, spec.indicators.indicators().len());
    let mut predictors = Predictors::new(method, space, indicators, spec.seed, &[]);
    let (mut machines, mut state_index, mut known) =
        (Machines::default(), StateIndex::new(indicators), Vec::new());
    machines.note_founder(None);
    let marks = marks(FIRST.min(trials.len()), trials.len());
    let (mut samples, mut errors, mut wall_s, mut compute_us) = (Vec::new(), Vec::new(), 0.0, 0.0);
    for (number, (state, trial)) in (1..).zip(trials) {
        let cost = trial.cost.expect("every trial of a stream gives one");
        let place = trial.state_id as usize - 1;
        if place == known.len() {
            let (anchor, results) = (state.clone(), Arc::default());
            known.push(KnownState {
                id: StateId(trial.state_id),
                anchor,
                machine: MachineId(0),
                explored: true,
                results,
            });
        }
        let (state_index_now, machines) = (&state_index, &machines);
        let here = Some(&known[place]);
        let query = Query {
            state,
            here,
            known: &known,
            state_index: state_index_now,
            space,
            machines,
            machine: MachineId(0),
            rival: None,
        };
        // `auto` asks all when it tests them.
        let clock = Instant::now();
        let expected = predictors.estimate(method, &query, &trial.configuration);
        let asked = if method == PredictorMethod::Auto {
            let clock = Instant::now();
            predictors.test(&query, &trial.configuration, cost);
            clock.elapsed()
        } else {
            clock.elapsed()
        };
        if number > 1 {
            errors.push(prequential::error(expected, cost));
        }
        Arc::make_mut(&mut known[place].results).learn(trial, &space.default_configuration());
        state_index.note(&known[place]);
        let default = known[place].results.record(&space.default_configuration());
        let default_cost = default.filter(|record| record.measurements > 0).map(|record| record.mean_cost);
        let point = space.encode(&trial.configuration);
        let lesson = Lesson {
            state,
            configuration: &trial.configuration,
            point: &point,
            verdict: Verdict::Cost(cost),
            default_cost,
            origin: Origin { group: 0, node: 0 },
        };
        let clock = Instant::now();
        predictors.learn(&lesson);
        compute_us += (asked + clock.elapsed()).as_secs_f64() * 1e6;
        wall_s += FRAME_S * cost;
        if marks.contains(&number) {
            let error = errors.iter().sum::<f64>() / errors.len() as f64;
            errors.clear();
            samples.push(Sample { trials: number, wall_s: wall_s + compute_us / 1e6, compute_us, error });
        }
    }
    samples
}
