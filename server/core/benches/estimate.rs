//! The time of a state's assessment: the posterior of its configurations, by their number and that of
//! measurements.
//!
//! `cargo bench -p treewright-core --bench estimate`. Medians of eleven, in milliseconds: without times,
//! where no model asks how the speed of the machine wanders, and with them.
// A benchmark reads the clock.
#![allow(clippy::disallowed_methods)]

use std::time::Instant;

use treewright_core::robust::Moment;
use treewright_core::statistics::estimate::{ConfigurationSample, CostPosterior, Measurement};

const ROUNDS: usize = 11;

/// Configurations that ran in turn, the first of them between all others.
fn samples(configurations: usize, measurements: usize, has_times: bool) -> Vec<ConfigurationSample> {
    let mut all: Vec<ConfigurationSample> = (0..configurations)
        .map(|place| ConfigurationSample {
            features: (0..28).map(|axis| ((place * 7 + axis * 13) % 17) as f64 / 17.0).collect(),
            measurements: Vec::new(),
            weight: 1.0,
        })
        .collect();
    for time in 0..measurements {
        let place = if time < configurations { time } else { (time * 5) % configurations };
        let moment = Some(Moment { client: 1, time: 2 * time as u64 }).filter(|_| has_times);
        let log_cost = 0.1 * ((time * 31) % 23) as f64 / 23.0 + 0.2 * (place as f64 / configurations as f64);
        all[place].measurements.push(Measurement { log_cost, moment });
    }
    all
}

fn main() {
    println!("configurations  measurements  without times  with times, ms");
    for (configurations, measurements) in [(12, 16), (40, 60), (60, 100), (96, 160)] {
        let median = |has_times| {
            let samples = samples(configurations, measurements, has_times);
            let distance_2 =
                |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
            let mut took: Vec<f64> = (0..ROUNDS)
                .map(|_| {
                    let begin = Instant::now();
                    std::hint::black_box(CostPosterior::of(&samples, distance_2));
                    1e3 * begin.elapsed().as_secs_f64()
                })
                .collect();
            took.sort_by(f64::total_cmp);
            took[ROUNDS / 2]
        };
        println!("{configurations:14}  {measurements:12}  {:13.2}  {:10.2}", median(false), median(true));
    }
}
