//! The time of one suggestion with its feedback, by the number of trials in the study.
//!
//! `cargo bench -p treewright-core --bench suggestion`. Each search works on a mixed, conditional space of 28
//! parameters, on one of choices in regions that cannot be run, and on a continuous one; a table of the
//! median and the 99th percentile comes out, in microseconds, over the last 40 trials before each mark.
// A benchmark reads the clock.
#![allow(clippy::disallowed_methods)]

use std::time::Instant;

use treewright_core::policy::SearchMethod;
use treewright_core::search::{AnySearch, Feedback, Layout, SearchSetup, Verdict, levels};
use treewright_core::space::{Condition, Domain, Parameter, Scale, Space};
use treewright_core::value::Value;
use treewright_core::words::Word as _;

const MARKS: [usize; 3] = [80, 200, 1000];

fn parameter(name: String, domain: Domain, default: Value, active_if: Option<Condition>) -> Parameter {
    Parameter { name, domain, default, active_if }
}

/// Eight switches, eight integers, four choices of numbers and eight floats, half of them behind a switch.
fn mixed() -> Space {
    let behind = |index: usize| {
        (index % 2 == 1)
            .then(|| Condition { parameter: "switch0".into(), any_of: vec![Value::Boolean(true)] })
    };
    let switches = (0..8).map(|i| {
        let condition = if i == 0 { None } else { behind(i) };
        parameter(format!("switch{i}"), Domain::Boolean, Value::Boolean(true), condition)
    });
    let integers = (0..8).map(|i| {
        let domain = Domain::Integer { min: 1, max: 32, scale: Scale::Log };
        parameter(format!("integer{i}"), domain, Value::Integer(8), behind(i))
    });
    let choices = (0..4).map(|i| {
        let values = [1, 2, 4, 8, 16, 32].map(Value::Integer).to_vec();
        parameter(format!("choice{i}"), Domain::Categorical { values }, Value::Integer(2), behind(i))
    });
    let floats = (0..8).map(|i| {
        let domain = Domain::Float { min: 0.1, max: 10.0, scale: Scale::Log };
        parameter(format!("float{i}"), domain, Value::Float(1.0), behind(i))
    });
    Space::new(switches.chain(integers).chain(choices).chain(floats).collect(), Vec::new()).expect("valid")
}

fn choices() -> Space {
    let values = || [1, 2, 4, 8, 16, 32, 64].map(Value::Integer).to_vec();
    let one =
        |i| parameter(format!("p{i}"), Domain::Categorical { values: values() }, Value::Integer(1), None);
    Space::new((0..7).map(one).collect(), Vec::new()).expect("valid")
}

fn continuous() -> Space {
    let domain = || Domain::Float { min: -5.0, max: 5.0, scale: Scale::Linear };
    let one = |i| parameter(format!("x{i}"), domain(), Value::Float(4.0), None);
    Space::new((0..10).map(one).collect(), Vec::new()).expect("valid")
}

/// Times of asking and telling, a trial, in microseconds.
fn times(space: &Space, method: SearchMethod) -> Vec<f64> {
    let setup = SearchSetup {
        seed: 1,
        state_id: 1,
        start: space.encode(&space.default_configuration()),
        budget: 80,
        levels: levels(space),
        layout: Layout::of(space),
    };
    let mut search = AnySearch::new(method, setup);
    let mut times = Vec::new();
    for trial in 0..MARKS[MARKS.len() - 1] {
        let begin = Instant::now();
        let point = search.ask().expect("nothing is out");
        let asking = begin.elapsed();
        // A bowl with a tenth of ripple; the far corner cannot be run.
        let bowl: f64 = point.x.iter().map(|x| (x - 0.3).powi(2)).sum();
        let cannot = point.x.iter().sum::<f64>() > 0.62 * point.x.len() as f64;
        let cost = (1.0 + bowl) * (1.0 + 0.1 * (trial as f64 * 0.754_877_666).fract());
        let verdict = if cannot { Verdict::Infeasible } else { Verdict::Cost(cost) };
        let begin = Instant::now();
        search.tell(point.id, Feedback { verdict, fresh: true });
        times.push(1e6 * (asking + begin.elapsed()).as_secs_f64());
    }
    times
}

fn main() {
    println!("{:16}{:16}{:>8}{:>10}{:>10}", "space", "search", "trials", "p50 µs", "p99 µs");
    for (name, space) in [("mixed 28", mixed()), ("choices 7", choices()), ("continuous 10", continuous())] {
        for &(method, _) in SearchMethod::WORDS {
            let times = times(&space, method);
            for mark in MARKS {
                let mut last = times[mark - 40..mark].to_vec();
                last.sort_by(f64::total_cmp);
                println!("{name:16}{:16}{mark:8}{:10.1}{:10.1}", method.name(), last[20], last[39]);
            }
        }
    }
}
