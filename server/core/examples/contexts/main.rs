//! The cost of frames while contexts come and go: the regret of whole sessions, and that of answers without
//! exploring.
//!
//! `cargo run -p treewright-core --example contexts -- [SEEDS] [WORLD...]` prints a line a world. Four
//! parameters, whose best values move with two indicators; 5 % of noise; the policy's defaults. Regret is
//! the true cost over the least in that context, less one: 1.0 is twice the optimum's cost, and the best
//! fixed configuration has 0.57. Worlds:
//!
//! - `fresh`: every round brings another context, which never comes again; blocks of 40 rounds.
//! - `irrelevant-N`: the same beside N more indicators that say nothing.
//! - `turns`: ten contexts that are visited in turn, 15 frames each; one number for each of the first eight
//!   visits, and from the third on.
//! - `machines`, `own`, `indicator`: `fresh` on two machines in turn, of which one wants the opposite. They
//!   differ by fingerprint alone, have studies of their own, or differ by an indicator.
//! - `table`: a table in which 63 % of the configurations cannot be run, searched in one state by 80
//!   trials: trials that failed after 10, 20, 40 and 80, and the optimum over the best that ran. It is that
//!   of a compressor (level, memory level, strategy, window) whose output must not exceed a limit;
//!   `table=FILE` reads a recorded one, of lines `level,memory,strategy,window,size,cost`.
//! - `frozen`: the same table in two states; the second has 10 to 40 trials, then the study is frozen: how
//!   many of 24 answers, in as many worlds, were never measured there, and how many fail.
//! - `second`: a client joins a state that another has explored for 40 frames: how often it explores
//!   nothing in 80, and what its last frame costs over the optimum.

// An example may read a file, and its worlds need not be the same bytes everywhere.
#![allow(clippy::disallowed_methods)]

mod second;
mod table;
mod world;

use world::{Frame, Kind, rounds, turns};

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The means of blocks of `length` frames.
fn blocks(runs: &[Vec<f64>], length: usize) -> Vec<f64> {
    let count = runs[0].len() / length;
    let block = |index: usize| {
        mean(&runs.iter().map(|run| mean(&run[index * length..(index + 1) * length])).collect::<Vec<_>>())
    };
    (0..count).map(block).collect()
}

fn told(values: &[f64]) -> String {
    values.iter().map(|value| format!("{value:.3}")).collect::<Vec<_>>().join(" / ")
}

fn fresh(seeds: u64, kind: Kind) -> String {
    let runs: Vec<_> = (0..seeds).map(|seed| rounds(seed, kind)).collect();
    format!("{}; {}", told(&blocks(&regrets(&runs), 40)), apart(&runs, 80))
}

fn regrets(runs: &[Vec<Frame>]) -> Vec<Vec<f64>> {
    runs.iter().map(|run| run.iter().map(|one| one.regret).collect()).collect()
}

/// The costs of exploring and of other frames, from one on.
fn apart(runs: &[Vec<Frame>], from: usize) -> String {
    let of = |explored: bool| {
        let frames = runs.iter().flat_map(|run| run[from..].iter()).filter(|one| one.explored == explored);
        let regrets: Vec<f64> = frames.map(|one| one.regret).collect();
        format!("{:.3} in {}", mean(&regrets), regrets.len())
    };
    format!("from {from} on exploring {}, else {}", of(true), of(false))
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let seeds: u64 = arguments.first().and_then(|text| text.parse().ok()).unwrap_or(8);
    let mut worlds: Vec<String> = arguments.into_iter().skip(1).collect();
    if worlds.is_empty() {
        let all = [
            "fresh",
            "irrelevant-5",
            "irrelevant-20",
            "turns",
            "machines",
            "own",
            "indicator",
            "table",
            "frozen",
            "second",
        ];
        worlds = all.map(String::from).to_vec();
    }
    for world in worlds {
        let line = match world.split_once(['-', '=']).unwrap_or((&world, "")) {
            ("fresh", _) => fresh(seeds, Kind::Fresh { irrelevant: 0 }),
            ("irrelevant", count) => {
                fresh(seeds, Kind::Fresh { irrelevant: count.parse().expect("a number") })
            }
            ("machines", _) => fresh(seeds, Kind::Machines),
            ("own", _) => fresh(seeds, Kind::Own),
            ("indicator", _) => fresh(seeds, Kind::Indicator),
            ("turns", _) => {
                let runs: Vec<Vec<Frame>> = (0..seeds).map(turns).collect();
                let visits = blocks(&regrets(&runs), 150);
                format!(
                    "visits {}; from the third on {:.3}; {}",
                    told(&visits[..8]),
                    mean(&visits[2..]),
                    apart(&runs, 300)
                )
            }
            ("table", file) => table::search(seeds, file),
            ("frozen", file) => table::frozen(file),
            ("second", _) => second::run(2 * seeds),
            (other, _) => panic!("{other} is no world"),
        };
        println!("{world}: {line}");
    }
}
