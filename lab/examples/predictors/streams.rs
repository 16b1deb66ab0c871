//! Streams of trials on which predictors are compared. They differ in the states, in the share of frames that
//! a search decides, in the costs of configurations, and in their noise.

use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_core::policy::{Policy, PredictorMethod, SearchMethod};
use treewright_core::space::Space;
use treewright_core::study::StudySpec;
use treewright_core::tuner::{Ask, Tuner};
use treewright_lab::simulated::{report, share, study};

/// The cost of a configuration in a state, in a frame.
type Cost = fn(&[f64], &[f64], usize) -> f64;

/// Frames of a stream, and of a long one.
const FRAMES: usize = 400;
const FRAMES_LONG: usize = 3000;
/// In streams with wild frames: their share, and the factor on their costs.
const WILD_SHARE: f64 = 0.03;
const WILD: f64 = 10.0;

/// A stream of trials.
#[derive(Clone, Debug)]
pub(crate) struct Stream {
    pub(crate) name: String,
    parameters: usize,
    indicators: usize,
    frames: usize,
    /// Number of states, of which five frames in a row share one; `None` where each frame brings a new one.
    states: Option<usize>,
    /// Share of the frames in which a search decides and not a predictor.
    epsilon: f64,
    search: SearchMethod,
    /// The furthest that noise goes, as a share of the cost.
    noise: f64,
    wild: bool,
    cost: Cost,
}

fn bowl(state: &[f64], point: &[f64], _: usize) -> f64 {
    1.0 + point.iter().zip(state.iter().cycle()).map(|(p, s)| 3.0 * (p - s) * (p - s)).sum::<f64>()
}

fn level(state: &[f64], point: &[f64], frame: usize) -> f64 {
    libm::exp(3.0 * state[0]) * bowl(&state[1..], point, frame)
}

fn cliff(state: &[f64], point: &[f64], frame: usize) -> f64 {
    bowl(state, point, frame) * if point[0] > state[0] { 5.0 } else { 1.0 }
}

fn drift(state: &[f64], point: &[f64], frame: usize) -> f64 {
    bowl(state, point, frame) * (1.0 + frame as f64 / 400.0)
}

fn flat(state: &[f64], _: &[f64], _: usize) -> f64 {
    1.0 + state[0]
}

/// The first half of the frames wants the opposite of the second.
fn turn(state: &[f64], point: &[f64], frame: usize) -> f64 {
    let turned: Vec<f64> = point.iter().map(|p| if frame < FRAMES / 2 { *p } else { 1.0 - p }).collect();
    bowl(state, &turned, frame)
}

/// Factors that multiply, each with a kink at its optimum.
fn kinks(state: &[f64], point: &[f64], _: usize) -> f64 {
    point.iter().zip(state.iter().cycle()).map(|(p, s)| 1.0 + 0.8 * (p - s).abs()).product()
}

/// Waves along the first parameter.
fn waves(state: &[f64], point: &[f64], frame: usize) -> f64 {
    bowl(state, point, frame) * (1.5 + libm::sin(12.0 * (point[0] + state[0])))
}

/// Steps: parameters act as if they had four values each.
fn steps(state: &[f64], point: &[f64], frame: usize) -> f64 {
    let coarse: Vec<f64> = point.iter().map(|p| (p * 4.0).floor() / 3.0).collect();
    bowl(state, &coarse, frame)
}

/// The five of old, in three ways to meet states.
pub(crate) fn known() -> Vec<Stream> {
    let kinds: [(&str, Cost); 5] =
        [("bowl", bowl), ("level", level), ("cliff", cliff), ("drift", drift), ("flat", flat)];
    let ways = [(None, 0.2, "fresh"), (Some(12), 1.0, "searched"), (Some(12), 0.2, "visited")];
    let stream = |(states, epsilon, way): (Option<usize>, f64, &str), (kind, cost): (&str, Cost)| Stream {
        name: format!("{kind}, {way}"),
        parameters: 4,
        indicators: 3,
        frames: FRAMES,
        states,
        epsilon,
        search: SearchMethod::Random,
        noise: 0.1,
        wild: false,
        cost,
    };
    ways.into_iter().flat_map(|way| kinds.map(|kind| stream(way, kind))).collect()
}

/// Others, on which nothing was chosen: other shapes, sizes, noise and searches.
pub(crate) fn unseen() -> Vec<Stream> {
    let [fresh, searched, visited, ..] = [0, 5, 10].map(|at| known().swap_remove(at));
    let of = |stream: &Stream, name: &str, cost: Cost| Stream { name: name.into(), cost, ..stream.clone() };
    vec![
        of(&fresh, "turn, fresh", turn),
        of(&visited, "turn, visited", turn),
        of(&fresh, "kinks, fresh", kinks),
        of(&searched, "kinks, searched", kinks),
        of(&fresh, "waves, fresh", waves),
        of(&visited, "waves, visited", waves),
        of(&searched, "steps, searched", steps),
        of(&visited, "steps, visited", steps),
        Stream { wild: true, ..of(&fresh, "bowl, wild, fresh", bowl) },
        Stream { wild: true, ..of(&searched, "level, wild, searched", level) },
        Stream { noise: 0.6, ..of(&visited, "bowl, noisy, visited", bowl) },
        Stream { noise: 0.6, ..of(&fresh, "cliff, noisy, fresh", cliff) },
        Stream { parameters: 11, indicators: 17, ..of(&fresh, "bowl, large, fresh", bowl) },
        Stream { parameters: 11, indicators: 17, ..of(&visited, "kinks, large, visited", kinks) },
        Stream { parameters: 1, indicators: 2, ..of(&visited, "level, small, visited", level) },
        Stream {
            states: Some(1),
            search: SearchMethod::Model,
            ..of(&searched, "bowl, one state, model", bowl)
        },
        Stream {
            states: Some(40),
            search: SearchMethod::Model,
            ..of(&searched, "kinks, many states, model", kinks)
        },
        Stream {
            states: Some(5),
            search: SearchMethod::NelderMead,
            ..of(&searched, "level, simplex", level)
        },
        Stream { frames: FRAMES_LONG, ..of(&fresh, "level, long, fresh", level) },
        Stream { frames: FRAMES_LONG, states: Some(30), ..of(&visited, "cliff, long, visited", cliff) },
        Stream { frames: FRAMES_LONG, states: Some(100), ..of(&searched, "drift, long, searched", drift) },
    ]
}

impl Stream {
    /// The tuner that decides, with all predictors; parameters and indicators go from 0 to 1.
    fn tuner(&self, seed: u64) -> Tuner {
        let policy = Policy {
            predictor: PredictorMethod::Auto,
            search: self.search,
            epsilon: self.epsilon,
            trials_per_state: 60,
            ..Policy::default()
        };
        let parameters = (0..self.parameters).map(|axis| share(format!("p{axis}")));
        let space = Space::new(parameters.collect(), vec![]).expect("a valid space");
        let study = study(space, (0..self.indicators).map(|axis| format!("i{axis}")), policy, seed);
        Tuner::new(Arc::new(StudySpec { state_tolerance: 1e-3, ..study })).expect("a valid study")
    }

    /// Goes through the stream.
    pub(crate) fn run(&self, seed: u64) -> Tuner {
        let mut tuner = self.tuner(seed);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let places: Vec<Vec<f64>> = (0..self.states.unwrap_or(self.frames))
            .map(|_| (0..self.indicators).map(|_| random.random()).collect())
            .collect();
        for frame in 0..self.frames {
            let state = &places[self.states.map_or(frame, |states| (frame / 5) % states)];
            let indicators = (0..self.indicators).map(|axis| (format!("i{axis}"), state[axis])).collect();
            let ask = Ask { client_id: "a".into(), indicators, ..Ask::default() };
            let trial = tuner.suggest(&ask, 0).expect("a valid question").0;
            let value = |axis: usize| trial.configuration.get(&format!("p{axis}"))?.as_number();
            let point: Vec<f64> = (0..self.parameters).map(|axis| value(axis).unwrap_or(0.5)).collect();
            let noise = 1.0 + self.noise * (random.random::<f64>() - random.random::<f64>());
            let wild = if self.wild && random.random::<f64>() < WILD_SHARE { WILD } else { 1.0 };
            report(&mut tuner, &trial, Some(wild * noise * (self.cost)(state, &point, frame)));
        }
        tuner
    }
}
