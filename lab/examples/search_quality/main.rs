//! The quality of searches: problems by methods by seeds, as tables.
//!
//! `cargo run --release -p treewright-lab --example search_quality -- SUITE SEEDS METHOD...` with the suites
//! trees, grids, effects, kernels and unseen (on which nothing is tuned). Scores are means over the problems
//! of a suite after 20, 40 and 80 trials: shares of the optimum, more is better. They are of the
//! configuration that measured best, and in brackets of the truly best one that was tried. Ranks are among
//! the methods given, on equal problems and seeds.

mod grids;
mod kernels;
mod problem;
mod run;
mod trees;

use treewright_core::policy::SearchMethod;
use treewright_core::words::Word as _;

use problem::Problem;
use run::Run;

const MARKS: [usize; 3] = [20, 40, 80];

fn search(name: &str) -> SearchMethod {
    SearchMethod::from_word(name).unwrap_or_else(|| panic!("{name} is no search"))
}

fn suite(name: &str, seed: u64) -> Vec<(String, Problem)> {
    let kernels = |names: &[&str]| {
        names.iter().map(|name| ((*name).to_owned(), kernels::problem(name, seed))).collect()
    };
    let grid = |name: &str, counted: bool| {
        (format!("{name}{}", if counted { "-n" } else { "" }), grids::problem(name, seed, counted))
    };
    match name {
        "trees" => vec![(name.to_owned(), trees::problem(seed))],
        "grids" => grids::GRIDS.iter().flat_map(|name| [true, false].map(|n| grid(name, n))).collect(),
        "effects" => vec![("random effects".to_owned(), grids::random_effects(seed))],
        "kernels" => kernels(&kernels::KERNELS),
        "unseen" => kernels(&kernels::UNSEEN),
        _ => panic!("{name} is no suite"),
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
    let mut rows: Vec<(String, Vec<Run>)> = Vec::new();
    for seed in 0..seeds {
        for (problem_name, problem) in suite(suite_name, seed) {
            let runs = names.iter().map(|name| problem.run(search(name), seed, &MARKS)).collect();
            rows.push((problem_name, runs));
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
        let at = |mark: usize| mean(rows.iter().map(|row| row.1[index].scores[mark]));
        let touched = mean(rows.iter().map(|row| row.1[index].touched[2]));
        let rank = |mark: usize| {
            mean(rows.iter().map(|(_, runs)| {
                let score = |run: &Run| -run.scores[mark];
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
        let mut micros: Vec<f64> = rows.iter().flat_map(|row| row.1[index].micros.iter().copied()).collect();
        micros.sort_by(f64::total_cmp);
        let infeasible = mean(rows.iter().map(|row| row.1[index].infeasible as f64));
        let repeats = mean(rows.iter().map(|row| row.1[index].repeats as f64));
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
                            mean(of.clone().map(|row| row.1[index].scores[mark]))
                        ))
                        .collect::<String>()
                );
            }
            println!();
        }
    }
}
