//! The quality of searches: problems by methods by seeds, as tables.
//!
//! `cargo run --release -p treewright-lab --example search_quality -- SUITE SEEDS METHOD...` with the suites
//! trees, grids, effects, kernels and unseen (on which nothing is tuned). Scores are means over the problems
//! of a suite after 20, 40 and 80 trials, then of each problem: shares of the optimum, of the configuration
//! that measured best. More is better. Beside them stand the share of the trials whose true cost is above 1.1
//! times the default's, the dearest one over the default, and the number of trials.
//!
//! The method `setups:N` is the model search where a change of the first half of the parameters needs a
//! set-up, and up to N further points keep a new one. A run costs 1 there and a new set-up 10 more; the
//! scores are those after costs of 220, 440 and 880, which pay for 20, 40 and 80 trials with new set-ups.

mod grids;
mod kernels;
mod problem;
mod run;
mod trees;

use treewright_core::policy::SearchMethod;
use treewright_core::words::Word as _;

use problem::Problem;
use run::Played;

const MARKS: [usize; 3] = [20, 40, 80];
const COSTS: [usize; 3] = [220, 440, 880];

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
    // Of each problem and seed, the searches of all methods.
    let mut rows: Vec<(String, Vec<Played>)> = Vec::new();
    for seed in 0..seeds {
        for (problem_name, problem) in suite(suite_name, seed) {
            let play = |name: &String| match name.strip_prefix("setups:") {
                Some(held) => problem.run_setups(held.parse().expect("a number of points"), seed, &COSTS),
                None => problem.run(search(name), seed, &MARKS),
            };
            rows.push((problem_name, names.iter().map(play).collect()));
        }
    }
    let mut problems: Vec<&str> = rows.iter().map(|row| row.0.as_str()).collect();
    problems.sort_unstable();
    problems.dedup();
    println!(
        "{suite_name}, {seeds} seeds, {} problems; scores at 20, 40, 80; dear, worst, trials",
        problems.len()
    );
    let print = |title: &str, index: usize, of: &str| {
        let own = || rows.iter().filter(move |row| of.is_empty() || row.0 == of);
        let at = |mark: usize| mean(own().map(|row| row.1[index].scores[mark]));
        let dear = mean(own().map(|row| row.1[index].dear));
        let worst = mean(own().map(|row| row.1[index].worst));
        let trials = mean(own().map(|row| row.1[index].trials as f64));
        println!("{title:18}{:7.3}{:7.3}{:7.3}{dear:9.3}{worst:7.2}{trials:7.0}", at(0), at(1), at(2));
    };
    for (index, name) in names.iter().enumerate() {
        print(name, index, "");
        for problem in &problems {
            print(&format!("  {problem}"), index, problem);
        }
    }
}
