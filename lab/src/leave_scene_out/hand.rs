//! Configurations that anybody can write down, for either objective: candidates for the best fixed one.

use treewright_client::Configuration;
use treewright_render_cli::error::Result;
use treewright_renderer::space::{TuningSpace, parse};
use treewright_renderer::tuning::objective::Objective;
use treewright_renderer::tuning::verdict::{self, Rival};
use treewright_renderer::tuning::who::{NATIVE_DEFAULT, Who};

/// For frames that share a build: missing values are those of the start of that space.
const RENDER: [&str; 10] = [
    "backend=tunable,min_leaf_size=4,max_leaf_size=28",
    "backend=tunable,min_leaf_size=8,max_leaf_size=32",
    "backend=tunable,min_leaf_size=16,max_leaf_size=32",
    "backend=tunable,min_leaf_size=25,max_leaf_size=32",
    "backend=tunable,min_leaf_size=25,max_leaf_size=32,traversal_cost=2",
    "backend=tunable,min_leaf_size=8,max_leaf_size=32,traversal_cost=2",
    "backend=tunable,min_leaf_size=8,max_leaf_size=32,quality=3,split_budget=1.5",
    "backend=tunable,min_leaf_size=16,max_leaf_size=32,quality=3,split_budget=1.5",
    "backend=tunable,min_leaf_size=8,max_leaf_size=32,node_width=8",
    "backend=tunable,min_leaf_size=8,max_leaf_size=32,reinsertion_passes=12",
];

/// For frames that pay for a build of their own.
const TOTAL: [&str; 11] = [
    "backend=tunable,search_radius=4,cluster_size=8,block_width=8,min_leaf_size=8,max_leaf_size=32",
    "backend=tunable,search_radius=8,cluster_size=8,block_width=8,min_leaf_size=16,max_leaf_size=32",
    "backend=tunable,search_radius=4,cluster_size=2,block_width=8,min_leaf_size=8,max_leaf_size=32",
    "backend=tunable,quality=1,block_width=4,min_leaf_size=4,max_leaf_size=28",
    "backend=tunable,quality=1,block_width=4,min_leaf_size=8,max_leaf_size=32",
    "backend=tunable,quality=1,block_width=8,min_leaf_size=8,max_leaf_size=32",
    "backend=tunable,quality=1,block_width=8,min_leaf_size=16,max_leaf_size=32",
    "backend=tunable,quality=1,block_width=8,min_leaf_size=25,max_leaf_size=32",
    "backend=tunable,quality=1,collapse=optimal,node_width=16,reinsertion_passes=0,block_width=8,min_leaf_size=16,max_leaf_size=32",
    "backend=tunable,quality=2,block_width=8,min_leaf_size=16,max_leaf_size=32",
    "backend=tunable,quality=2,block_width=8,min_leaf_size=25,max_leaf_size=32,sah_block_size=8",
];

pub(crate) fn native_default() -> Vec<Rival> {
    verdict::natives().into_iter().filter(|one| one.who == NATIVE_DEFAULT).map(Rival::from).collect()
}

/// Native Embree as everybody uses it and used well.
pub(crate) fn natives(space: &TuningSpace) -> Vec<Rival> {
    native_default().into_iter().chain(verdict::used_well(space)).collect()
}

/// Native Embree and every candidate for an objective once.
pub(crate) fn rivals(space: &TuningSpace, objective: Objective) -> Result<Vec<Rival>> {
    let mut all = natives(space);
    let texts = match objective {
        Objective::Render | Objective::Error => &RENDER[..],
        Objective::Total | Objective::Motion | Objective::Auto(_) => &TOTAL[..],
    };
    let given = texts.iter().map(|text| parse(text)).collect::<Result<Vec<_>, _>>()?;
    push(&mut all, space, space.default_configuration())?;
    for given in given {
        push(&mut all, space, space.complete(&given)?)?;
    }
    Ok(all)
}

/// Adds a configuration under its own text, unless it is there.
pub(crate) fn push(all: &mut Vec<Rival>, space: &TuningSpace, configuration: Configuration) -> Result<()> {
    if all.iter().all(|rival| rival.configuration.as_ref() != Some(&configuration)) {
        let who = Who::Named(configuration.to_string().into());
        all.push(Rival::of(who, space, configuration)?);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_candidate_is_sound() {
        for objective in [Objective::Render, Objective::Total] {
            let space = super::super::steps::space(objective);
            let all = rivals(&space, objective).expect("all of them are of the space");
            assert!(all.len() > 10 && all.iter().filter(|rival| rival.configuration.is_none()).count() == 1);
            let names: std::collections::BTreeSet<String> =
                all.iter().map(|rival| rival.contender.who.to_string()).collect();
            assert_eq!(names.len(), all.len(), "each once");
        }
    }
}
