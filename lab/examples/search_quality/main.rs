//! How well the searches search: problems by methods by seeds, as tables.
//!
//! `cargo run --release -p treewright-lab --example search_quality -- SUITE SEEDS METHOD...` with the suites
//! bbob, bbob4, quiet, offset, trees, grids, effects, kernels, unseen (which nothing is tuned on) and
//! stencil, or a file of a recorded landscape; `model@4` has four points out at a time. Scores are means over
//! the problems of a suite after 20, 40 and 80 trials: decimal logarithms of gaps (less is better), or shares
//! of the optimum (more is better), of the configuration that measured best; in brackets of the best that was
//! ever tried. Ranks are among the methods given, on equal problems and seeds.

mod bbob;
mod grids;
mod kernels;
mod problem;
mod recorded;
mod roofline;
mod trees;

use treewright_core::policy::SearchMethod;
use treewright_core::words::Word as _;

use problem::{Kind, Problem, Run};
pub(crate) use roofline::best_of;

const MARKS: [usize; 3] = [20, 40, 80];

/// A method and how many points it has out at a time: `model` or `model@4`.
fn method(name: &str) -> (SearchMethod, usize) {
    let (name, in_flight) = match name.split_once('@') {
        Some((name, count)) => (name, count.parse().expect("a number of points")),
        None => (name, 1),
    };
    (search(name), in_flight)
}

fn search(name: &str) -> SearchMethod {
    SearchMethod::from_word(name).unwrap_or_else(|| panic!("{name} is no search"))
}

fn suite(name: &str, seed: u64) -> Vec<Problem> {
    let bbob = |functions: &[u32], noise, offset| {
        let one = |&number: &u32| [2, 5, 10].map(|d| bbob::problem(number, d, seed, noise, offset));
        functions.iter().flat_map(one).collect()
    };
    match name {
        "bbob" => bbob(&bbob::FUNCTIONS, 0.1, 0.0),
        "bbob4" => bbob(&[1, 8, 15, 21], 0.1, 0.0),
        "quiet" => bbob(&[1, 8, 15, 21], 0.0, 0.0),
        "offset" => bbob(&[1, 8, 15, 21], 0.1, 1000.0),
        "trees" => vec![trees::problem(seed)],
        "grids" => grids::GRIDS
            .iter()
            .flat_map(|name| [true, false].map(|n| grids::problem(name, seed, n, 0.02)))
            .collect(),
        "effects" => vec![grids::random_effects(seed)],
        "kernels" => kernels::KERNELS.iter().map(|name| kernels::problem(name, seed)).collect(),
        "unseen" => kernels::UNSEEN.iter().map(|name| kernels::problem(name, seed)).collect(),
        "stencil" => vec![grids::problem("stencil", seed, false, 0.02)],
        file => vec![recorded::problem(file)],
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [suite_name, seeds, names @ ..] = arguments.as_slice() else {
        panic!("give a suite, a number of seeds and methods");
    };
    let seeds: u64 = seeds.parse().expect("a number of seeds");
    // Of each problem and seed, the runs of all methods.
    let mut rows: Vec<(String, Kind, Vec<Run>)> = Vec::new();
    for seed in 0..seeds {
        for problem in suite(suite_name, seed) {
            let run = |name: &String| {
                let (method, in_flight) = method(name);
                problem.run(method, in_flight, seed, &MARKS)
            };
            let runs = names.iter().map(run).collect();
            rows.push((problem.name, problem.kind, runs));
        }
    }
    let mut problems: Vec<&String> = rows.iter().map(|row| &row.0).collect();
    problems.sort();
    problems.dedup();
    println!("{suite_name}, {seeds} seeds, {} problems", problems.len());
    println!(
        "{:18}{:>28}{:>20}{:>10}{:>8}{:>8}",
        "", "score at 20, 40, 80 [tried]", "mean rank", "µs", "infeas.", "repeats"
    );
    for (index, name) in names.iter().enumerate() {
        let at = |mark: usize| mean(rows.iter().map(|row| row.2[index].scores[mark]));
        let touched = mean(rows.iter().map(|row| row.2[index].touched[2]));
        let rank = |mark: usize| {
            mean(rows.iter().map(|(_, kind, runs)| {
                let score = |run: &Run| if *kind == Kind::Gap { run.scores[mark] } else { -run.scores[mark] };
                let mine = score(&runs[index]);
                let (below, equal) = runs.iter().fold((0.0, 0.0), |(below, equal), run| {
                    (
                        below + f64::from(u8::from(score(run) < mine)),
                        equal + f64::from(u8::from(score(run) == mine)),
                    )
                });
                below + (equal + 1.0) / 2.0
            }))
        };
        let mut micros: Vec<f64> = rows.iter().flat_map(|row| row.2[index].micros.iter().copied()).collect();
        micros.sort_by(f64::total_cmp);
        let infeasible = mean(rows.iter().map(|row| row.2[index].infeasible as f64));
        let repeats = mean(rows.iter().map(|row| row.2[index].repeats as f64));
        println!(
            "{name:18}{:7.3}{:7.3}{:7.3} [{:6.3}]{:6.2}{:6.2}{:6.2}{:10.0}{infeasible:8.1}{repeats:8.1}",
            at(0),
            at(1),
            at(2),
            touched,
            rank(0),
            rank(1),
            rank(2),
            micros[micros.len() / 2]
        );
    }
    if problems.len() > 1 {
        for problem in problems {
            print!("{problem:18}");
            for (index, _) in names.iter().enumerate() {
                let of = rows.iter().filter(|row| &row.0 == problem);
                print!(
                    "  {}",
                    MARKS
                        .iter()
                        .enumerate()
                        .map(|(mark, _)| format!(
                            "{:7.3}",
                            mean(of.clone().map(|row| row.2[index].scores[mark]))
                        ))
                        .collect::<String>()
                );
            }
            println!();
        }
    }
}
