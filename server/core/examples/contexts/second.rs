//! A client that joins a state which another has explored.

use std::collections::BTreeMap;
use std::sync::Arc;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use treewright_core::indicator::{Indicator, IndicatorSchema};
use treewright_core::objective::{Objective, ObjectiveTerm};
use treewright_core::policy::Policy;
use treewright_core::space::{Domain, Parameter, Scale, Space};
use treewright_core::study::StudySpec;
use treewright_core::trial::{Mode, Outcome, Trial};
use treewright_core::tuner::{Ask, Tuner};
use treewright_core::value::Value;

use super::world::normal;

const PARAMETERS: usize = 6;
const NOISE: f64 = 0.07;

fn study(seed: u64) -> Tuner {
    let parameter = |axis: usize| Parameter {
        name: format!("p{axis}"),
        domain: Domain::Integer { min: 0, max: 15, scale: Scale::Linear },
        default: Value::Integer(7),
        active_if: None,
    };
    let indicator = Indicator { name: "x".into(), min: 0.0, max: 1.0, scale: Scale::Linear };
    let term = ObjectiveTerm { metric: "ms".into(), weight: 1.0 };
    let spec = StudySpec {
        display_name: "second".into(),
        space: Space::new((0..PARAMETERS).map(parameter).collect(), vec![]).expect("a valid space"),
        indicators: IndicatorSchema::new(vec![indicator]).expect("valid"),
        objective: Objective::new(vec![term]).expect("valid"),
        state_tolerance: 0.05,
        policy: Policy::default(),
        seed,
    };
    Tuner::new(Arc::new(spec)).expect("a valid study")
}

/// How often the second client explored nothing in 80 frames, and what its last frame cost over the optimum.
pub(crate) fn run(seeds: u64) -> String {
    let (mut never, mut ends) = (0, Vec::new());
    for seed in 0..seeds {
        let (mut tuner, mut random) = (study(seed), ChaCha8Rng::seed_from_u64(seed));
        let centre: Vec<f64> =
            (0..PARAMETERS).map(|_| (7.0 + 3.4 * normal(&mut random)).clamp(0.0, 15.0)).collect();
        let way = |x: &[f64]| x.iter().zip(&centre).map(|(x, c)| (x - c) * (x - c)).sum::<f64>();
        let default = way(&[7.0; PARAMETERS]);
        // The optimum costs 4, the default 10.
        let truth = |trial: &Trial| {
            let number =
                |axis: usize| trial.configuration.get(&format!("p{axis}")).and_then(Value::as_number);
            let x: Vec<f64> = (0..PARAMETERS).map(|axis| number(axis).unwrap_or(0.0)).collect();
            4.0 + 6.0 * way(&x) / default
        };
        let mut frame = |client: &str| {
            let indicators = BTreeMap::from([("x".to_owned(), 0.5)]);
            let ask = Ask { client_id: client.into(), indicators, ..Ask::default() };
            let trial = tuner.suggest(&ask, 0).expect("a valid question").0;
            let cost = truth(&trial) * (NOISE * normal(&mut random)).exp();
            let measurements = BTreeMap::from([("ms".to_owned(), cost)]);
            let _change = tuner.report(&trial, measurements, Outcome::Ok, 1).expect("a valid report");
            (trial.mode() == Mode::Explore, truth(&trial) / 4.0)
        };
        for _ in 0..40 {
            frame("first");
        }
        let frames: Vec<(bool, f64)> = (0..80).map(|_| frame("second")).collect();
        never += usize::from(frames.iter().all(|(explored, _)| !explored));
        ends.push(frames[79].1);
    }
    ends.sort_by(f64::total_cmp);
    let mean = ends.iter().sum::<f64>() / ends.len() as f64;
    format!(
        "never explored in {never} of {seeds}; last frame over the optimum {mean:.3}, worst {:.3}",
        ends[ends.len() - 1]
    )
}
