//! The searches: simple regret on a smooth valley, on waves, on a model of the renderer's space and on a grid
//! where much cannot be run.

use std::sync::{Arc, Mutex};

use treewright_core::policy::SearchMethod;

use crate::curve::{Curve, Kind, Sample, marks};
use crate::problem::{self, Problem};
use crate::{FRAME_S, bbob, kernels, trees};

/// All that can be chosen.
pub(crate) const METHODS: [SearchMethod; 4] =
    [SearchMethod::Model, SearchMethod::NelderMead, SearchMethod::LatinHypercube, SearchMethod::Random];
/// What a curve shows as long as nothing that was tried can be run.
const REGRET_MAX: f64 = 10.0;
/// Noise of the functions, as the deviation of a logarithm.
const NOISE: f64 = 0.1;

/// What makes a problem from a seed.
type Make = fn(u64) -> Problem;

const PROBLEMS: [(&str, Make); 4] = [
    ("Rosenbrock's valley in 5 dimensions", |seed| bbob::problem(8, 5, seed, NOISE, 0.0)),
    ("Rastrigin's waves in 10 dimensions", |seed| bbob::problem(15, 10, seed, NOISE, 0.0)),
    ("the renderer's space", trees::problem),
    ("a kernel's grid", |seed| kernels::problem("hotspot", seed)),
];

/// The curves of all searches on all problems.
pub(crate) fn curves(seeds: u64, trials: usize) -> Vec<Curve> {
    let of = |&(name, make): &(&str, Make)| {
        METHODS.map(|method| {
            let runs: Vec<Vec<Sample>> =
                (0..seeds).map(|seed| run(make(seed), method, seed, trials)).collect();
            Curve::of(Kind::Search, name, method.name(), &runs)
        })
    };
    PROBLEMS.iter().flat_map(of).collect()
}

fn run(mut problem: Problem, method: SearchMethod, seed: u64, trials: usize) -> Vec<Sample> {
    let (optimum, kind) = (problem.optimum, problem.kind);
    let default = (problem.truth)(&problem.space.default_configuration()).unwrap_or(f64::INFINITY);
    // The regret of a cost. A gap is measured by that of the default.
    let regret = move |cost: f64| match kind {
        problem::Kind::Gap => cost / default,
        problem::Kind::Ratio => cost / optimum - 1.0,
    };
    // What trials cost, in the order in which they are run; one that cannot be run takes a frame to find out.
    let costs = Arc::new(Mutex::new(Vec::with_capacity(trials)));
    let (noted, truth) = (Arc::clone(&costs), problem.truth);
    problem.truth = Box::new(move |configuration| {
        let cost = truth(configuration);
        noted.lock().expect("nobody panics with it").push(cost.map_or(0.0, regret));
        cost
    });
    let every: Vec<usize> = (1..=trials).collect();
    let run = problem.run(method, 1, seed, &every);
    let costs = costs.lock().expect("nobody panics with it");
    let sample = |&trials: &usize| {
        let score = run.scores[trials - 1];
        let error = match kind {
            problem::Kind::Gap => regret(10f64.powf(score)),
            problem::Kind::Ratio => 1.0 / score - 1.0,
        };
        let compute_us: f64 = run.micros[..trials].iter().sum();
        let frames: f64 = costs[..trials].iter().map(|regret| 1.0 + regret).sum();
        let wall_s = FRAME_S * frames + compute_us / 1e6;
        Sample { trials, wall_s, compute_us, error: error.min(REGRET_MAX) }
    };
    marks(1, trials).iter().map(sample).collect()
}
