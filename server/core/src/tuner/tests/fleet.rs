//! Learning between machines, and its limits.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::session::SessionPolicy;
use crate::trial::Fingerprint;
use crate::tuner::plan::Planned;

/// A machine of a simulated fleet.
#[derive(Clone, Copy)]
struct Node {
    threads: u32,
    embree: &'static str,
    /// All costs are this factor times those on the first.
    factor: f64,
    /// Its best configuration is the opposite of the others'.
    differs: bool,
}

impl Node {
    fn like(threads: u32, factor: f64) -> Self {
        Node { threads, embree: "4.3.0", factor, differs: false }
    }

    fn ask(&self) -> Ask {
        let software = BTreeMap::from([("embree".to_owned(), self.embree.to_owned())]);
        let (cpu_model, isa) = (format!("cpu {}", self.threads), "avx2".to_owned());
        let fingerprint = Fingerprint { cpu_model, isa, threads: self.threads, software };
        let client = format!("client {} {}", self.threads, self.embree);
        Ask { fingerprint: Some(fingerprint), ..ask(&client, 0.6, 0.5) }
    }

    /// The cost of a configuration here, without noise.
    fn cost(&self, trial: &Trial) -> f64 {
        let number = |name: &str| trial.configuration.get(name).and_then(Value::as_number).unwrap_or(0.0);
        let (width, least, most) = (number("width"), number("min_leaf_size"), number("max_leaf_size"));
        let travel = number("travel_cost");
        let cost = if self.differs {
            // The default's neighbourhood is good here, and the others' best region is bad.
            12.0 + 0.8 * width + 0.4 * least + 0.3 * (16.0 - most) + 0.7 * (travel - 1.5).abs()
        } else {
            16.0 - width + 0.25 * least + 0.5 * (most - 3.0).abs() + 0.9 * (travel - 6.0).abs()
        };
        self.factor * cost
    }

    /// One frame; its cost without noise, and whether it was exploited.
    fn frame(&self, tuner: &mut Tuner, random: &mut ChaCha8Rng) -> (f64, Trial) {
        let trial = tuner.suggest(&self.ask(), 0).expect("a valid question").0;
        let cost = self.cost(&trial);
        // Two uniforms: a triangle of 4 % standard deviation.
        let noise = 1.0 + 0.1 * (random.random::<f64>() - random.random::<f64>());
        let report = tuner.report(&trial, measured(noise * cost), Outcome::Ok, 1);
        (cost, report.expect("a valid report").0)
    }
}

const TRIALS: u32 = 48;

fn study(seed: u64) -> Tuner {
    seeded(seed, Policy { trials_per_state: TRIALS, ..explore_always() })
}

/// Three machines that differ by a factor only have searched the state to the end.
fn fleet(seed: u64) -> Tuner {
    let mut tuner = study(seed);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    for node in [Node::like(4, 1.0), Node::like(8, 0.55), Node::like(16, 3.0)] {
        (0..TRIALS).for_each(|_| drop(node.frame(&mut tuner, &mut random)));
    }
    tuner
}

/// The first frame at which a run's configuration cost at most the least cost over 0.98.
fn reached(costs: &[f64], least: f64) -> usize {
    costs.iter().position(|&cost| cost <= least / 0.98).map_or(costs.len() + 1, |index| index + 1)
}

/// Costs of `frames` frames of a node, in a study.
fn costs(mut tuner: Tuner, node: Node, frames: usize, seed: u64) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(1000 + seed);
    (0..frames).map(|_| node.frame(&mut tuner, &mut random).0).collect()
}

#[test]
fn a_new_machine_starts_from_what_the_fleet_knows() {
    let node = Node::like(32, 2.3);
    let (mut with, mut alone) = (0, 0);
    for seed in 0..6 {
        let (together, solo) = (
            costs(fleet(seed), node, TRIALS as usize, seed),
            costs(study(seed), node, TRIALS as usize, seed),
        );
        let least = together.iter().chain(&solo).copied().fold(f64::INFINITY, f64::min);
        with += reached(&together, least);
        alone += reached(&solo, least);
    }
    println!("frames to 98 %: {} with the fleet, {} alone", with as f64 / 6.0, alone as f64 / 6.0);
    assert!(2 * with < alone, "{with} and {alone} in six runs");
}

#[test]
fn what_the_fleet_knows_is_tried_within_the_trials_that_a_session_wants() {
    let node = Node::like(32, 2.3);
    let session_policy = SessionPolicy { trials_per_state: Some(3), ..SessionPolicy::default() };
    for seed in 0..6 {
        let mut tuner = fleet(seed);
        let mut explored = 0;
        for _ in 0..12 {
            let trial = tuner.suggest(&Ask { session_policy, ..node.ask() }, 0).expect("valid").0;
            explored += u32::from(trial.decision.is_run_of_search());
            assert!(tuner.report(&trial, measured(node.cost(&trial)), Outcome::Ok, 1).is_ok());
        }
        assert_eq!(explored, 3, "seed {seed}");
    }
}

#[test]
fn a_machine_whose_optimum_differs_drifts_to_its_own() {
    let node = Node { differs: true, ..Node::like(32, 1.7) };
    let frames = TRIALS as usize + 24;
    let (mut with, mut alone, mut end_with, mut end_alone) = (0.0, 0.0, 0.0, 0.0);
    for seed in 0..6 {
        let (together, solo) =
            (costs(fleet(seed), node, frames, seed), costs(study(seed), node, frames, seed));
        let least = together.iter().chain(&solo).copied().fold(f64::INFINITY, f64::min);
        let regret = |costs: &[f64]| costs.iter().map(|cost| cost / least - 1.0).sum::<f64>() / 6.0;
        (with, alone) = (with + regret(&together), alone + regret(&solo));
        end_with += regret(&together[TRIALS as usize..]) / 24.0;
        end_alone += regret(&solo[TRIALS as usize..]) / 24.0;
    }
    println!(
        "regret: {with:.2} frames with the fleet, {alone:.2} alone; at the end {end_with:.4}, {end_alone:.4}"
    );
    // The others may cost it three frames of their favourites, which are twice as dear as the best here.
    assert!(with <= alone + 3.0, "{with} and {alone}");
    assert!(end_with <= end_alone + 0.02, "{end_with} and {end_alone}");
}

#[test]
fn other_software_invalidates_what_was_measured_and_answers_say_so() {
    let node = Node::like(16, 3.0);
    let mut tuner = fleet(1);
    let mut random = ChaCha8Rng::seed_from_u64(9);
    // The machine itself has searched to the end.
    let (_, before) = node.frame(&mut tuner, &mut random);
    assert_eq!((before.mode(), before.reason().source.as_str()), (Mode::Exploit, "best_known"));
    let newer = Node { embree: "4.4.0", ..node };
    let (_, first) = newer.frame(&mut tuner, &mut random);
    assert_ne!(first.state_id, before.state_id);
    assert_eq!(first.mode(), Mode::Default, "machines are compared by the default first");
    let (_, second) = newer.frame(&mut tuner, &mut random);
    assert_eq!((second.mode(), second.reason().step.as_str()), (Mode::Explore, "transfer"));
    assert_eq!(second.reason().source, "fleet", "not its own any more, nor its group's");
    assert!(second.reason().summary.contains("embree 4.3.0 -> 4.4.0"), "{}", second.reason().summary);
    // It goes on to its own end, and the old one is where it was.
    for _ in 0..TRIALS {
        newer.frame(&mut tuner, &mut random);
    }
    let (_, last) = newer.frame(&mut tuner, &mut random);
    assert_eq!((last.mode(), last.reason().source.as_str()), (Mode::Exploit, "best_known"));
    assert_eq!(node.frame(&mut tuner, &mut random).1.state_id, before.state_id);
}

#[test]
fn a_machine_that_only_exploits_follows_its_group_before_the_fleet() {
    let mut tuner = study(3);
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let ask_as = |cpu: &str, threads: u32, client: &str| {
        let fingerprint = Fingerprint { cpu_model: cpu.into(), threads, ..Fingerprint::default() };
        Ask { fingerprint: Some(fingerprint), ..ask(client, 0.6, 0.5) }
    };
    // One machine of another processor, one of this processor; their best configurations differ.
    for (cpu, threads, node) in
        [("far", 8, Node { differs: true, ..Node::like(1, 1.0) }), ("near", 8, Node::like(1, 1.0))]
    {
        for _ in 0..TRIALS {
            let trial = tuner.suggest(&ask_as(cpu, threads, cpu), 0).expect("valid").0;
            let cost = node.cost(&trial) * (1.0 + 0.02 * random.random::<f64>());
            assert!(tuner.report(&trial, measured(cost), Outcome::Ok, 1).is_ok());
        }
    }
    let near = tuner.best(None, None).expect("valid").expect("measured");
    // Each gets its own state; a newcomer gets the one with the most frames, the first among equals.
    let states_for = |cpu: &str| {
        let Ask { indicators, fingerprint, .. } = ask_as(cpu, 8, "anybody");
        let best = tuner.best(Some(&indicators), fingerprint.as_ref()).expect("valid").expect("measured");
        let predicted = tuner.predict(&indicators, fingerprint.as_ref()).expect("valid");
        (best.state_id, predicted.insight.expect("a known state").state_id)
    };
    assert_eq!((states_for("far"), states_for("near"), states_for("nobody")), ((1, 1), (2, 2), (1, 1)));
    let policy = Policy { epsilon: 0.0, ..tuner.spec().policy.clone() };
    assert_eq!(tuner.set_policy(policy), Ok(false));
    let answer = tuner.suggest(&ask_as("near", 2, "new"), 0).expect("valid").0;
    assert_eq!((answer.mode(), answer.reason().source.as_str()), (Mode::Exploit, "group"));
    // The proven configuration and that of comparing machines differ in cost by less than the noise.
    let costs_as = |configuration: &Configuration| {
        Node::like(1, 1.0).cost(&Trial { configuration: configuration.clone(), ..answer.clone() })
    };
    let (given, best) = (costs_as(&answer.configuration), costs_as(&near.configuration));
    assert!((given / best - 1.0).abs() < 0.02, "{given} and {best}");
    let stranger = tuner.suggest(&ask_as("third", 2, "stranger"), 0).expect("valid").0;
    assert_eq!(stranger.reason().source, "fleet");
    // A machine under another client's name stays that machine.
    let twin = tuner.suggest(&ask_as("near", 8, "twin"), 0).expect("valid").0;
    assert_eq!((twin.state_id, &twin.configuration), (near.state_id, &near.configuration));
    assert!(!["group", "fleet"].contains(&twin.reason().source.as_str()));
}

#[test]
fn what_fails_on_the_nearest_relation_is_no_answer_of_machines() {
    let mut tuner = tuner(exploit_always());
    let space = tuner.spec().space.clone();
    let [best, other] = [0.3, 0.6].map(|travel| space.decode(&[0.9, 0.1, 0.2, travel]));
    let [first, second, third] = [4, 8, 16].map(|threads| Node::like(threads, 1.0));
    for (node, outcome) in [(first, infeasible()), (second, Outcome::Ok)] {
        let runs =
            [(space.default_ref(), Outcome::Ok, 20.0), (&other, Outcome::Ok, 12.0), (&best, outcome, 10.0)];
        for (configuration, outcome, cost) in runs {
            for _ in 0..2 {
                let trial =
                    tuner.suggest_wanted(&node.ask(), configuration.to_raw(), None, 0).expect("valid").0;
                assert!(tuner.report(&trial, measured(cost), outcome.clone(), 1).is_ok());
            }
        }
    }
    assert_eq!(tuner.suggest(&third.ask(), 0).expect("valid").0.configuration, other);
}

/// Costs of configurations by their travel cost.
const USUAL: [(f64, f64); 7] =
    [(0.1, 16.0), (0.2, 15.0), (0.3, 12.0), (0.4, 14.0), (0.5, 15.0), (0.6, 17.0), (0.8, 14.0)];

/// The measurements of a state: the costs of configurations by their travel cost.
fn tell(tuner: &mut Tuner, ask: &Ask, costs: &[(f64, f64)]) {
    let space = tuner.spec().space.clone();
    for (travel, cost) in costs {
        let configuration = space.decode(&[0.9, 0.1, 0.2, *travel]);
        let trial = tuner.suggest_wanted(ask, configuration.to_raw(), None, 0).expect("valid").0;
        assert!(tuner.report(&trial, measured(*cost), Outcome::Ok, 1).is_ok());
    }
}

#[test]
fn one_absurd_report_of_a_machine_or_a_state_decides_for_no_other() {
    let good = |tuner: &Tuner| tuner.spec().space.decode(&[0.9, 0.1, 0.2, 0.3]);
    for absurd in [1e-300, 1e-6] {
        // A machine that ran something bad once, and read its cost wrongly.
        let mut tuner = tuner(exploit_always());
        for (threads, factor) in [(4, 1.0), (8, 2.0)] {
            let costs = USUAL.map(|(travel, cost)| (travel, factor * cost));
            (0..2).for_each(|_| tell(&mut tuner, &Node::like(threads, 1.0).ask(), &costs));
        }
        tell(&mut tuner, &Node::like(8, 1.0).ask(), &[(0.95, absurd)]);
        let answer = tuner.suggest(&Node::like(16, 1.0).ask(), 0).expect("valid").0;
        assert_eq!(answer.reason().source, "fleet");
        assert_eq!(answer.configuration, good(&tuner), "{absurd:e}");
        // Two states, in one of which something middling was read wrongly.
        let mut study = Tuner::new(Arc::clone(tuner.spec())).expect("valid");
        for (x, middling) in [(0.1, 15.0), (0.4, absurd)] {
            (0..2).for_each(|_| tell(&mut study, &ask("a", x, 0.5), &USUAL));
            tell(&mut study, &ask("a", x, 0.5), &[(0.95, middling)]);
        }
        let best = study.best(None, None).expect("valid").expect("measured");
        assert_eq!(best.state_id, 1, "the two costs are equal but for what was read wrongly");
        let answer = suggest(&mut study, "b", 0.25, 0.9);
        assert_eq!(answer.reason().source, "portfolio");
        assert_eq!(answer.configuration, good(&study), "{absurd:e}");
    }
}

#[test]
fn what_was_stopped_in_a_state_is_not_answered_there_while_others_are_known() {
    let mut tuner = tuner(exploit_always());
    for x in [0.1, 0.4] {
        (0..2).for_each(|_| tell(&mut tuner, &ask("a", x, 0.5), &USUAL));
    }
    let (default, new) = (tuner.spec().space.default_configuration(), StateId(3));
    let mut stopped: Vec<Configuration> = Vec::new();
    // The default is none of those that other states know.
    for _ in 0..USUAL.len() {
        let here = tuner.knowledge.states.contains(new).then_some(new);
        let answer = tuner.exploiting(&Planned::AtOnce).measured_answer(&[0.25, 0.9], here);
        let configuration = answer.configuration.clone();
        assert_eq!(answer.asked().reason().source, "portfolio");
        assert!(configuration != default && !stopped.contains(&configuration), "{configuration:?}");
        stop(&mut tuner, &configuration);
        stopped.push(configuration);
    }
    assert_eq!(suggest(&mut tuner, "b", 0.25, 0.9).mode(), Mode::Default, "it was not stopped");
    stop(&mut tuner, &default);
    let answer = tuner.exploiting(&Planned::AtOnce).measured_answer(&[0.25, 0.9], Some(new));
    assert_eq!(answer.configuration, stopped[0], "all of them were stopped, and this one is the best");
    let careful = suggest(&mut tuner, "n", 0.25, 0.9);
    assert_eq!(careful.configuration, stopped[0], "who never explores gets nothing that never ran");
    let predictor = PredictorMethod::NearestNeighbour;
    tuner.set_policy(Policy { epsilon: 1e-12, predictor, ..explore_always() }).expect("valid");
    let explored = suggest(&mut tuner, "c", 0.25, 0.9);
    assert_eq!(explored.mode(), Mode::Explore, "{}", explored.reason().summary);
    assert!(!tuner.knowledge.states.results(new).is_tried(&explored.configuration), "{explored:?}");
}

/// A client stops a configuration in a third state.
fn stop(tuner: &mut Tuner, configuration: &Configuration) {
    let trial = tuner.suggest_wanted(&ask("w", 0.25, 0.9), configuration.to_raw(), None, 0).expect("valid").0;
    assert_eq!(trial.state_id, 3);
    assert!(tuner.report(&trial, measured(100.0), Outcome::Aborted { lower_bound: 100.0 }, 1).is_ok());
}

#[test]
fn other_states_hear_of_what_was_dear_once() {
    let mut tuner = tuner(exploit_always());
    let space = tuner.spec().space.clone();
    let of = |width: f64, travel: f64| space.decode(&[width, 0.1, 0.2, travel]);
    let usual = USUAL.map(|(travel, cost)| (of(0.9, travel), cost));
    let dear = [0.3, 0.6].map(|travel| (of(0.5, travel), 500.0));
    for (configuration, cost) in usual.into_iter().chain(dear.clone()) {
        let trial =
            tuner.suggest_wanted(&ask("a", 0.1, 0.5), configuration.to_raw(), None, 0).expect("valid").0;
        assert!(tuner.report(&trial, measured(cost), Outcome::Ok, 1).is_ok());
    }
    tuner.knowledge.states.note_search(StateId(1));
    let there = StateId(suggest(&mut tuner, "b", 0.9, 0.5).state_id);
    let start = tuner
        .exploiting(&Planned::AtOnce)
        .transfer
        .evidence(there)
        .beginning(&space)
        .expect("a state was searched");
    let layout = crate::search::Layout::of(&space);
    let better = space.decode(&start.main_effects.descend(&layout, &space.encode(&dear[0].0)));
    assert_ne!(better.get("width"), Some(&Value::Integer(4)), "{better:?}");
}

#[test]
fn what_was_dear_here_once_is_no_answer_of_other_machines() {
    let mut tuner = tuner(exploit_always());
    for (threads, factor) in [(4, 1.0), (8, 2.0)] {
        let costs = USUAL.map(|(travel, cost)| (travel, factor * cost));
        (0..2).for_each(|_| tell(&mut tuner, &Node::like(threads, 1.0).ask(), &costs));
    }
    let mut costs = USUAL.map(|(travel, cost)| (travel, 3.0 * cost));
    costs[2].1 = 2000.0;
    tell(&mut tuner, &Node::like(16, 1.0).ask(), &costs);
    let dear = tuner.spec().space.decode(&[0.9, 0.1, 0.2, costs[2].0]);
    let answer = tuner
        .exploiting(&Planned::AtOnce)
        .transfer
        .best_by_machines(StateId(3))
        .map(|answer| answer.configuration);
    assert_ne!(answer, Some(dear));
}
