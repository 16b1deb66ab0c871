//! A trial that is excluded is as one that was never measured.

use proptest::prelude::*;

use super::*;
use crate::testing::cases;
use crate::tuner::replay_tests::Rows;

/// A study after some frames in three states, of which one was measured far too fast.
fn disturbed(policy: Policy, frames: usize, disturbed: usize) -> (Tuner, Rows) {
    let (mut tuner, mut rows) = (tuner(policy), Rows::default());
    for frame in 0..frames {
        let place = 0.3 * (frame / 7 % 3) as f64;
        let (trial, handed) = tuner.suggest(&ask("a", place, 0.5), 0).expect("valid");
        rows.write(&handed);
        let ms = if frame == disturbed { 1e-3 } else { cost(&trial) };
        rows.write(&tuner.report(&trial, measured(ms), Outcome::Ok, 1).expect("valid").1);
    }
    (tuner, rows)
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn an_excluded_trial_is_as_one_that_was_never_measured(
        frames in 20usize..60,
        at in 0.0..1.0,
        which in 0usize..3,
    ) {
        let half = Policy { epsilon: 0.5, trials_per_state: 8, ..Policy::default() };
        let models = Policy { predictor: PredictorMethod::RbfGreedyGq, ..half.clone() };
        let policy = [explore_always(), half, models][which].clone();
        // Not the last one: the counts are read from it.
        let at = (at * (frames - 1) as f64) as usize;
        let (mut tuner, mut rows) = disturbed(policy, frames, at);
        let mut marked = rows.trials(&tuner);
        let (number, state_id) = (marked[at].number, marked[at].state_id);
        rows.write(&tuner.disown(state_id));
        let exploits = |visit: &Visit| matches!(visit.decision, VisitDecision::Exploit { .. });
        let rests = |visit: &Visit| visit.state_id == state_id && exploits(visit);
        prop_assert!(!rows.snapshot(&tuner).visits.iter().any(rests), "it is decided again");
        let mut without = marked.clone();
        marked[at].exclusion = Some("the machine was disturbed".to_owned());
        without.remove(at);
        let [mut excluded, mut never] = [marked, without].map(|trials| {
            Restoring::of_all(tuner.spec().clone(), rows.snapshot(&tuner), trials).expect("consistent")
        });
        let saved = |tuner: &Tuner| tuner.knowledge.learnt(tuner.spec()).checkpoint();
        prop_assert_eq!(saved(&excluded), saved(&never));
        prop_assert_eq!(excluded.statistics(), tuner.statistics());
        for _ in 0..6 {
            for x in [0.0, 0.3, 0.6] {
                let indicators = ask("a", x, 0.5).indicators;
                let best = excluded.best(Some(&indicators), None).expect("valid");
                prop_assert_eq!(&best, &never.best(Some(&indicators), None).expect("valid"));
                prop_assert!(best.is_none_or(|best| best.trial != number && best.cost > 1.0));
            }
            let question = ask("a", 0.3 * (at / 7 % 3) as f64, 0.5);
            let next = [&mut excluded, &mut never].map(|tuner| {
                let trial = tuner.suggest(&question, 2).expect("valid").0;
                finish(tuner, &trial, Outcome::Ok)
            });
            prop_assert_eq!(&next[0], &next[1]);
        }
    }
}
