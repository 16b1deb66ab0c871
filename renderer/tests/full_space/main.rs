//! Every value of every parameter of the full space, with every grouping of rays, over scenes that stand,
//! move and are made of instances.
//!
//! All pairs of values are tried. `TREEWRIGHT_STRESS_STRENGTH=3` tries all triples:
//!
//! `TREEWRIGHT_STRESS_STRENGTH=3 cargo test --release -p treewright-renderer --test full_space`
//!
//! After a crash, `-- --nocapture` tells the configuration: it is the last one.

mod batch;
mod covering;
mod scenes;

use batch::Case;
use covering::covering;
use scenes::Kind;
use treewright_client::Configuration;
use treewright_renderer::space::{Premises, Preset, TuningSpace};

/// The number of parameters whose values are tried together.
const STRENGTH: &str = "TREEWRIGHT_STRESS_STRENGTH";

/// Runs the configurations of the space, robust or not, over every kind of scene.
fn all_agree(configurations: impl Fn(&TuningSpace) -> Vec<Configuration>) {
    let spaces = [false, true]
        .map(|robust| TuningSpace::new(Preset::Full, &Premises { robust, ..Premises::all() }))
        .map(|space| (configurations(&space), space));
    let mut found = Vec::new();
    for kind in Kind::all() {
        let mut case = Case::new(kind);
        for (number, (configurations, space)) in spaces.iter().enumerate() {
            for configuration in configurations {
                let what = format!("{kind:?}{}, {configuration}", ["", ", robust"][number]);
                println!("{what}");
                if let Err(problem) = case.run(space, configuration) {
                    found.push(format!("{what}: {problem}"));
                }
            }
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn the_starts_agree_with_brute_force() {
    all_agree(|_| vec![Configuration::new(), Configuration::new().with("backend", "native")]);
}

#[test]
fn every_combination_of_values_agrees_with_brute_force() {
    let strength = std::env::var(STRENGTH).map_or(2, |strength| strength.parse().expect("a whole number"));
    all_agree(|space| covering(space, strength));
}
