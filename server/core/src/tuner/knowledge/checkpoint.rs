//! The knowledge from completed trials as bytes, so that a restart need not replay all trials.
//!
//! A checkpoint only saves time. It names its version and its specification and carries a check sum. Where
//! one of these does not fit, the checkpoint is ignored and all trials are replayed. A tuner from a
//! checkpoint equals a replayed one to the bit, which the replay tests check. Searches, visits and open
//! trials have rows of their own and are no part of it.

use std::collections::BTreeSet;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::fnv;
use crate::limits::UNPACKED_BYTES_MAX;
use crate::machines::PoolingStatistics;
use crate::packed::{pack_in_order, unpack};
use crate::policy::{Policy, PredictorMethod};
use crate::predict::Predictors;
use crate::predict::state_index::IndicatorStatistics;
use crate::results::ResultTable;
use crate::study::StudySpec;
use crate::tuner::knowledge::{Auxiliaries, History, Knowledge, Rechecks, Speeds};
use crate::tuner::{Checkpoint, CheckpointTooLarge};

/// To be raised whenever anything changes that a checkpoint holds, or how trials are learnt.
const VERSION: u64 = 21;

/// The knowledge of a tuner. It is taken in a moment, because it shares its tables with the tuner until one
/// of them changes.
#[derive(Clone, Debug)]
pub struct Learnt {
    mark: u64,
    completion: u64,
    spec: Arc<StudySpec>,
    body: Body,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Body {
    completed: u64,
    /// The table of each state.
    results: Vec<Arc<ResultTable>>,
    /// The statistics of each machine.
    pooling: Vec<PoolingStatistics>,
    statistics: IndicatorStatistics,
    history: History,
    forget_above: usize,
    /// The predictor of the models, and the completion after which they were begun.
    predictor: PredictorMethod,
    models_since: u64,
    predictors: Predictors,
    speeds: Speeds,
    rechecks: Rechecks,
    auxiliaries: Auxiliaries,
}

impl Learnt {
    /// The place in the order of completion up to which it goes.
    pub fn completion(&self) -> u64 {
        self.completion
    }

    /// The number of the trial that last measured each remembered configuration, by rising number. From these
    /// trials and the latest ones, the tables can be learnt again without a checkpoint.
    pub fn measured_by(&self) -> BTreeSet<u64> {
        let records = self.body.results.iter().flat_map(|results| results.records());
        records.map(|record| record.last_trial).filter(|number| *number > 0).collect()
    }

    /// Packs it: some milliseconds for each megabyte. It is an error where it is too large to be read again.
    pub fn checkpoint(&self) -> Result<Checkpoint, CheckpointTooLarge> {
        self.checkpoint_within(UNPACKED_BYTES_MAX)
    }

    fn checkpoint_within(&self, most: usize) -> Result<Checkpoint, CheckpointTooLarge> {
        let mut body = self.body.clone();
        body.predictors.apply_all(&self.spec.space);
        assert_eq!(body.predictors.deferred_count(), 0, "deferred updates are not stored");
        let packed = pack_in_order(&body, most).map_err(|bytes| CheckpointTooLarge { bytes, most })?;
        let head = [self.mark, sum_of(&packed)].map(u64::to_le_bytes);
        let bytes = [&head[0][..], &head[1][..], &packed[..]].concat();
        Ok(Checkpoint { completion: self.completion, bytes })
    }
}

impl Knowledge {
    /// The knowledge so far, of a study with this specification.
    pub fn learnt(&self, spec: &Arc<StudySpec>) -> Learnt {
        Learnt {
            mark: mark(spec),
            completion: self.last_completion,
            spec: Arc::clone(spec),
            body: Body {
                completed: self.completed,
                results: self.states.known().iter().map(|state| Arc::clone(&state.results)).collect(),
                pooling: self.states.machines.pooling(),
                statistics: self.states.indicator_statistics().clone(),
                history: self.history.clone(),
                forget_above: self.states.forget_above(),
                predictor: spec.policy.predictor,
                models_since: self.models.since,
                predictors: self.models.predictors.clone(),
                speeds: self.speeds.clone(),
                rechecks: self.rechecks.clone(),
                auxiliaries: self.auxiliaries.clone(),
            },
        }
    }

    /// Takes over a checkpoint where the states are known and nothing was learnt. An error says why the
    /// checkpoint is of no use; nothing has then changed.
    pub(crate) fn take_over(&mut self, spec: &StudySpec, checkpoint: &Checkpoint) -> Result<(), String> {
        let (head, packed) = checkpoint.bytes.split_at_checked(16).ok_or("it is cut off")?;
        let word = |place: usize| {
            head[place..place + 8].iter().rev().fold(0, |word: u64, &byte| word << 8 | u64::from(byte))
        };
        if word(0) != mark(spec) {
            return Err("it is of another version or specification".into());
        }
        if word(8) != sum_of(packed) {
            return Err("it is damaged".into());
        }
        let mut body: Body = unpack(packed).map_err(|error| error.to_string())?;
        if body.results.len() > self.states.len() || body.results.len() != body.history.len() {
            return Err("it knows states that do not exist".into());
        }
        if body.statistics.width() != self.states.indicator_statistics().width() {
            return Err("it is of other indicators".into());
        }
        if body.pooling.len() > self.states.machines.len() {
            return Err("it knows machines that do not exist".into());
        }
        let space = &spec.space;
        let tables = body.results.iter_mut().all(|results| Arc::make_mut(results).settle(space));
        let metrics = spec.objective.auxiliary().len();
        let indicators = spec.indicators.indicators().len();
        let corrections = body.speeds.fits(space)
            && body.rechecks.fits(space)
            && body.auxiliaries.fits(space, metrics, indicators);
        if !(tables && corrections && body.predictors.settle(space)) {
            return Err("it does not fit its study".into());
        }
        let current = body.predictor == spec.policy.predictor && body.models_since == self.models.since;
        let needed = Predictors::are_needed(spec.policy.predictor);
        if current {
            self.models.predictors = body.predictors;
        } else if needed && checkpoint.completion > self.models.since {
            return Err("it lacks the models that the policy needs".into());
        }
        (self.completed, self.last_completion) = (body.completed, checkpoint.completion);
        self.states.take_over(body.results, &body.pooling, body.statistics, body.forget_above);
        (self.history, self.speeds, self.auxiliaries) = (body.history, body.speeds, body.auxiliaries);
        self.rechecks = body.rechecks;
        (self.history.len()..self.states.len()).for_each(|_| self.history.found());
        assert_eq!(self.history.len(), self.states.len(), "every state has a history");
        Ok(())
    }
}

/// A number for the version and for all of a specification on which learning depends.
fn mark(spec: &StudySpec) -> u64 {
    let (display_name, note, tags) = <(String, String, BTreeSet<String>)>::default();
    let learning = StudySpec { policy: Policy::default(), display_name, note, tags, ..spec.clone() };
    let text = serde_json::to_vec(&learning).expect("a specification is plain data");
    sum_of(&text) ^ sum_of(&VERSION.to_le_bytes()) ^ sum_of(env!("CARGO_PKG_VERSION").as_bytes())
}

/// A check sum: FNV-1a over words instead of bytes, so that megabytes take milliseconds.
fn sum_of(bytes: &[u8]) -> u64 {
    let words =
        bytes.chunks(8).map(|chunk| chunk.iter().fold(1, |word: u64, &byte| word << 8 | u64::from(byte)));
    words.fold(fnv::EMPTY, |hash, word| {
        let mixed = fnv::add(hash, word);
        mixed ^ (mixed >> 32)
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::testing::cases;
    use crate::trial::Outcome;
    use crate::tuner::tests::{ask, cost, measured, spec};
    use crate::tuner::{Change, Restoring, Snapshot, Tuner};

    /// A tuner that has learnt from three states, its rows, and the checkpoint.
    fn learnt(policy: Policy) -> (Tuner, Snapshot, Checkpoint) {
        let mut tuner = Tuner::new(Arc::new(spec(policy))).expect("valid");
        let mut rows = Change::default();
        for frame in 0..60 {
            let (trial, change) =
                tuner.suggest(&ask("a", 0.3 * f64::from(frame % 3), 0.5), 0).expect("valid");
            rows.states.extend(change.states);
            let report = tuner.report(&trial, measured(cost(&trial)), Outcome::Ok, 1).expect("valid");
            rows.states.extend(report.1.states);
        }
        rows.states.sort_by_key(|state| state.id);
        rows.states.reverse();
        rows.states.dedup_by_key(|state| state.id);
        rows.states.reverse();
        let snapshot = Snapshot { states: rows.states, visits: vec![], last_trial: 60, models_since: 0 };
        let checkpoint = tuner.knowledge.learnt(tuner.spec()).checkpoint().expect("a small study");
        (tuner, snapshot, checkpoint)
    }

    #[test]
    fn a_checkpoint_brings_back_all_that_was_learnt() {
        for predictor in [PredictorMethod::Auto, PredictorMethod::NearestNeighbour] {
            let policy = Policy { predictor, epsilon: 0.5, ..Policy::default() };
            let (tuner, snapshot, checkpoint) = learnt(policy);
            let restoring =
                Restoring::new(tuner.spec().clone(), snapshot, Some(&checkpoint)).expect("consistent");
            assert_eq!((restoring.passed_over(), restoring.after()), (None, 60));
            let back = restoring.finish([]).expect("whole");
            let results = |tuner: &Tuner| {
                tuner.knowledge.states.known().iter().map(|s| s.results.clone()).collect::<Vec<_>>()
            };
            assert_eq!(results(&back), results(&tuner));
            assert_eq!(back.knowledge.models.predictors, tuner.knowledge.models.predictors);
            assert_eq!(back.knowledge.history, tuner.knowledge.history);
            assert_eq!(
                (back.statistics(), back.knowledge.states.remembered()),
                (tuner.statistics(), tuner.knowledge.states.remembered())
            );
            // And it can be saved again, to equal bytes.
            assert_eq!(back.knowledge.learnt(back.spec()).checkpoint(), Ok(checkpoint));
        }
    }

    #[test]
    fn what_could_not_be_read_again_is_not_packed() {
        let (tuner, _, checkpoint) = learnt(Policy::default());
        let refused =
            tuner.knowledge.learnt(tuner.spec()).checkpoint_within(1_000).expect_err("more than that");
        assert!(refused.bytes > 1_000 && refused.to_string().contains("1000"), "{refused}");
        assert_eq!(tuner.knowledge.learnt(tuner.spec()).checkpoint_within(refused.bytes), Ok(checkpoint));
    }

    #[test]
    fn what_does_not_fit_is_passed_over_with_its_reason() {
        let nearest = Policy { predictor: PredictorMethod::NearestNeighbour, ..Policy::default() };
        let (tuner, snapshot, checkpoint) = learnt(nearest);
        let refusal = |spec: StudySpec, snapshot: &Snapshot, bytes: Vec<u8>| {
            let checkpoint = Checkpoint { bytes, ..checkpoint.clone() };
            let restoring =
                Restoring::new(Arc::new(spec), snapshot.clone(), Some(&checkpoint)).expect("consistent");
            assert_eq!(restoring.after(), 0);
            restoring.passed_over().expect("passed over").to_owned()
        };
        let (spec, bytes) = (tuner.spec().as_ref(), &checkpoint.bytes);
        assert_eq!(refusal(spec.clone(), &snapshot, bytes[..9].to_vec()), "it is cut off");
        let mut damaged = bytes.clone();
        *damaged.last_mut().expect("bytes") ^= 1;
        assert_eq!(refusal(spec.clone(), &snapshot, damaged), "it is damaged");
        let other = StudySpec { seed: spec.seed + 1, ..spec.clone() };
        assert_eq!(refusal(other, &snapshot, bytes.clone()), "it is of another version or specification");
        let told = StudySpec { note: "a\nb".into(), tags: BTreeSet::from(["a".to_owned()]), ..spec.clone() };
        assert_eq!(mark(&told), mark(spec), "nothing is learnt from texts");
        let fewer = Snapshot { states: snapshot.states[..2].to_vec(), ..snapshot.clone() };
        assert_eq!(refusal(spec.clone(), &fewer, bytes.clone()), "it knows states that do not exist");
        let policy = Policy { predictor: PredictorMethod::Auto, ..Policy::default() };
        let lacks = refusal(StudySpec { policy, ..spec.clone() }, &snapshot, bytes.clone());
        assert_eq!(lacks, "it lacks the models that the policy needs");
    }

    proptest! {
        #![proptest_config(cases(64))]

        #[test]
        fn the_sum_tells_every_single_damage(
            bytes in prop::collection::vec(any::<u8>(), 1..100), at: usize, by in 1u8..,
        ) {
            let mut damaged = bytes.clone();
            let at = at % bytes.len();
            damaged[at] ^= by;
            prop_assert_ne!(sum_of(&bytes), sum_of(&damaged));
        }
    }
}
