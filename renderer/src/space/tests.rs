//! Both spaces: defaults, every value's way into the renderer, and mistakes.

use treewright_accel::{
    BuildChoice, Builder, Collapse, NativeOptions, NativeQuality, Packets, Quality, TreeParameters,
};

use treewright_client::Domain;

use super::*;
use crate::render_options::RenderOptions;

fn full() -> TuningSpace {
    TuningSpace::new(Preset::Full, &Premises::all())
}

fn spaces() -> [TuningSpace; 3] {
    let robust = Premises { builds_each_frame: true, robust: true, ..Premises::all() };
    [TuningSpace::paper(), full(), TuningSpace::new(Preset::Full, &robust)]
}

fn choice(space: &TuningSpace, text: &str) -> Result<Choice, ConfigurationError> {
    space.choice(&parse(text)?)
}

fn tree(space: &TuningSpace, text: &str) -> TreeParameters {
    match choice(space, text).map(|choice| choice.build) {
        Ok(BuildChoice::Tree(parameters)) => parameters,
        other => panic!("{text} gave {other:?}"),
    }
}

fn problem(space: &TuningSpace, text: &str) -> String {
    choice(space, text).expect_err("it is refused").to_string()
}

#[test]
fn the_papers_default_is_that_of_table_1() {
    let paper = TuningSpace::paper();
    assert_eq!(paper.default_configuration().len(), 11);
    assert_eq!(paper.choice(&paper.default_configuration()), Ok(Choice::paper_default()));
    assert_eq!(choice(&paper, ""), Ok(Choice::paper_default()));
}

#[test]
fn the_full_default_is_the_best_of_the_measured_ones() {
    let by_hand = RenderOptions { staged: true, bounce_flight: Packets::Four };
    let ours = choice(&full(), "").expect("the default is valid");
    assert_eq!(ours.render, by_hand);
    let tree = tree(&full(), "");
    assert_eq!((tree.branching_factor, tree.block_width, tree.reinsertion_passes), (16, 8, 4));
    assert_eq!((tree.quality, tree.collapse), (Quality::Sah, Collapse::Optimal));
    let each_frame = TuningSpace::new(Preset::Full, &Premises { builds_each_frame: true, ..Premises::all() });
    let quick = self::tree(&each_frame, "");
    assert_eq!((quick.branching_factor, quick.block_width, quick.reinsertion_passes), (8, 8, 0));
    assert_eq!((quick.builder, quick.collapse), (Builder::Ploc, Collapse::Builder));
    assert_eq!((quick.search_radius, quick.cluster_size), (4, 8));
    assert_eq!((tree.min_leaf_size, tree.max_leaf_size), (8, 32));
    assert_eq!((quick.min_leaf_size, quick.max_leaf_size), (16, 32));
}

#[test]
fn robust_is_the_users_word_for_both_back_ends() {
    let robust = TuningSpace::new(Preset::Full, &Premises { robust: true, ..Premises::all() });
    assert!(tree(&robust, "").robust);
    let native = NativeOptions { quality: NativeQuality::Medium, robust: true, ..NativeOptions::default() };
    let chosen = choice(&robust, "backend=native").expect("it is valid");
    assert_eq!(chosen.build, BuildChoice::Native(native));
    assert!(problem(&robust, "backend=native,native_quality=high").contains("one of low, medium"));
}

#[test]
fn every_value_of_table_1_arrives() {
    let paper = TuningSpace::paper();
    let text = "quality=3, branching_factor=8, max_depth=40, sah_block_size=4, min_leaf_size=2, max_leaf_size=9, \
                traversal_cost=2, intersection_cost=0.5, static=true, robust=true";
    let expected = TreeParameters {
        quality: Quality::SahSplit,
        branching_factor: 8,
        max_depth: 40,
        sah_block_size: 4,
        min_leaf_size: 2,
        max_leaf_size: 9,
        traversal_cost: 2.0,
        intersection_cost: 0.5,
        static_scene: true,
        robust: true,
        ..TreeParameters::default()
    };
    assert_eq!(tree(&paper, text), expected);
    let compact = tree(&paper, "compact=true,robust=true");
    assert!(compact.compact && compact.robust);
}

#[test]
fn every_value_of_the_full_space_arrives() {
    let full = full();
    let text = "quality=3,node_width=16,max_depth=40,sah_block_size=8,min_leaf_size=2,max_leaf_size=9,traversal_cost=2,\
                split_budget=1.5,block_width=8,collapse=optimal,reinsertion_passes=7";
    let expected = TreeParameters {
        quality: Quality::SahSplit,
        branching_factor: 16,
        max_depth: 40,
        sah_block_size: 8,
        min_leaf_size: 2,
        max_leaf_size: 9,
        traversal_cost: 2.0,
        split_budget: 1.5,
        block_width: 8,
        collapse: Collapse::Optimal,
        reinsertion_passes: 7,
        ..TreeParameters::default()
    };
    assert_eq!(tree(&full, text), expected);
    let own = tree(&full, "search_radius=16");
    assert_eq!((own.builder, own.search_radius), (Builder::Ploc, 16));
    let native = choice(&full, "native_quality=high,native_split_budget=2,native_presplit=true");
    let options = NativeOptions {
        quality: NativeQuality::High,
        split_budget: 2.0,
        presplit: true,
        ..NativeOptions::default()
    };
    assert_eq!(native.map(|choice| choice.build), Ok(BuildChoice::Native(options)));
    let plain = choice(&full, "staged=false").map(|choice| choice.render);
    assert_eq!(plain, Ok(RenderOptions::default()));
    for (text, packets) in [("bounce_flight=4", Packets::Four), ("bounce_flight=8", Packets::Eight)] {
        assert_eq!(choice(&full, text).map(|choice| choice.render.bounce_flight), Ok(packets));
    }
    assert!(problem(&full, "backend=native,bounce_flight=4").contains("it needs backend = tunable"));
}

/// Both ends of a range, and every value of a list.
fn ends(domain: &Domain) -> Vec<Value> {
    match domain {
        Domain::Integer { min, max, .. } => vec![Value::from(*min), Value::from(*max)],
        Domain::Float { min, max, .. } => vec![Value::from(*min), Value::from(*max)],
        Domain::Categorical { values } => values.clone(),
        Domain::Boolean => vec![Value::from(false), Value::from(true)],
    }
}

#[test]
fn every_end_of_every_domain_is_accepted_and_makes_a_difference() {
    for space in spaces() {
        for Explained { parameter, about } in space.explained() {
            assert!(!about.is_empty() && !about.ends_with('.'), "{}", parameter.name);
            let mut seen: Vec<String> = Vec::new();
            for value in ends(&parameter.domain) {
                let text = format!("{}={value}", parameter.name);
                let choice = choice(&space, &text);
                let choice = choice.unwrap_or_else(|error| panic!("{text}: {error}"));
                match &choice.build {
                    BuildChoice::Tree(tree) => assert_eq!(tree.check(), Ok(()), "{text}"),
                    BuildChoice::Native(options) => assert_eq!(options.check(), Ok(()), "{text}"),
                    BuildChoice::BruteForce => unreachable!("no space offers it"),
                }
                assert_eq!(choice.update.check(), Ok(()), "{text}");
                seen.push(format!("{choice:?}"));
            }
            let count = seen.len();
            seen.sort();
            seen.dedup();
            // Two values that give equal work would be one parameter too many, or a misspelt word.
            assert_eq!(seen.len(), count, "{}", parameter.name);
        }
    }
}

#[test]
fn a_value_takes_along_what_it_needs() {
    let full = full();
    let get = |text: &str, name: &str| {
        let complete = full.complete(&parse(text).expect("it reads")).expect("it is sound");
        complete.get(name).cloned()
    };
    assert_eq!(get("quality=2", "backend"), Some("tunable".into()));
    assert_eq!(get("reinsertion_passes=2", "collapse"), Some("optimal".into()));
    assert_eq!(get("reinsertion_passes=2", "backend"), Some("tunable".into()));
    assert_eq!(get("native_presplit=true", "native_quality"), Some("high".into()));
    assert_eq!(get("native_quality=low", "backend"), Some("native".into()));
    assert_eq!(get("sah_block_size=2", "quality"), Some(Value::from(2)), "the default where it fits");
    assert_eq!(get("node_width=16", "collapse"), Some("optimal".into()));
    assert!(problem(&full, "node_width=4,branching_factor=2").contains("it needs collapse = builder"));
    assert_eq!(get("max_leaf_size=2", "min_leaf_size"), Some(Value::from(2)), "it gives way");
    assert!(problem(&full, "backend=native,quality=2").contains("it needs backend = tunable"));
}

#[test]
fn mistakes_are_named() {
    let paper = TuningSpace::paper();
    let problem = |text: &str| problem(&paper, text);
    assert!(
        problem("colour=blue").contains("\"colour\"") && problem("colour=blue").contains("max_leaf_size")
    );
    assert!(problem("quality").contains("\"quality\" is not of the form"));
    assert!(problem("quality=9").contains("from 1 to 3"));
    assert!(problem("quality=fast").contains("is fast; it must be"));
    assert!(problem("branching_factor=3").contains("one of 2, 4, 8"));
    assert!(problem("intersection_cost=0").contains("from 0.1 to 10"));
    assert!(
        problem("min_leaf_size=9,max_leaf_size=3")
            .contains("max_leaf_size = 3 break the constraint `min_leaf_size <= max_leaf_size`")
    );
    assert!(problem("compact=true,quality=3").contains("it needs compact = false"));
    assert!(problem("quality=1,sah_block_size=4").contains("it needs quality = 2 or 3"));
}

#[test]
fn inactive_parameters_are_left_out() {
    let paper = TuningSpace::paper();
    let complete = |text: &str| paper.complete(&parse(text).expect("it reads")).expect("it is sound");
    assert_eq!(complete("quality=1").len(), 8);
    assert_eq!(complete("compact=true"), Configuration::new().with("compact", true).with("robust", false));
}
