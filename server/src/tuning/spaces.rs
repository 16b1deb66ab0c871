//! Changes of a study's space, and answers to clients that work with an earlier one.
//!
//! A change is one row of the study and the removal of its searches and its checkpoint. Trials are not
//! touched: they are read in the present space whenever the study is loaded, which a change asks for. What
//! the present space cannot express is left out, and its open trials are given back.

use std::sync::Arc;

use prost::Message as _;
use treewright_core::configuration::{Configuration, RawConfiguration};
use treewright_core::decision::Decision;
use treewright_core::policy::Policy;
use treewright_core::space::{EarlierSpaces, SpaceError};
use treewright_core::study::StudySpec;
use treewright_core::trial::{Mode, Trial};
use treewright_core::tuner::{Best, Change, Prediction, TunerError};
use treewright_proto::convert::space_to_wire;
use treewright_store::{Fence, StudyRecord};

use super::compute::compute;
use super::loading::adopt;
use super::planning::{Preparation, Prepared};
use super::{Live, Tuning};
use crate::convert::from_proto::{SpaceChange, Suggest};
use crate::convert::names::StudyName;
use crate::error::{Error, Result};
use crate::limits;

/// The effect of a change on the trials of before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SpaceEffect {
    /// Completed trials inside the new space.
    pub kept: u64,
    /// Completed trials outside.
    pub outside: u64,
    /// Open trials outside, which are given back.
    pub given_back: u64,
}

struct ChangedStudy {
    spec: StudySpec,
    earlier: EarlierSpaces,
    outside: Vec<Trial>,
    /// False where the study has this space already.
    is_new: bool,
}

impl Tuning {
    /// Changes a study's space, or finds it changed so.
    pub async fn change_space(
        &self,
        study: &StudyName,
        change: &SpaceChange,
    ) -> Result<(StudyRecord, SpaceEffect)> {
        let (fence, changed) = self
            .with_tuner(&study.id, |live, _, _| {
                live.is_meant(study)?;
                Ok::<_, Error>((live.fence().clone(), live.changed(change)?))
            })
            .await??;
        let is_wanted = changed.is_new && !change.validate_only;
        let effect = self.effect(&fence, changed).await?;
        if is_wanted {
            self.store_change(study, change).await?;
            let SpaceEffect { kept, outside, .. } = effect;
            tracing::info!(study = study.id, revision = change.revision + 1, kept, outside, "space changed");
        }
        let study = self.find(study.clone()).await?;
        Ok((self.get_study(&study.id).await?, effect))
    }

    /// Counts the trials that a change keeps.
    async fn effect(&self, fence: &Fence, changed: ChangedStudy) -> Result<SpaceEffect> {
        let mut effect = SpaceEffect { given_back: changed.outside.len() as u64, ..SpaceEffect::default() };
        let spaces = Arc::new((changed.spec.space, changed.earlier));
        let mut after = 0;
        loop {
            let trials = self.store().completed_trials(fence, after, limits::TRIALS_PER_READ).await?;
            let Some(last) = trials.last().and_then(|trial| trial.completion) else {
                return Ok(effect);
            };
            assert!(last > after, "these trials come again and again");
            after = last;
            let (study, spaces) = (fence.study().to_owned(), Arc::clone(&spaces));
            let adopted = compute(move || adopt(&study, trials, &spaces.0, &spaces.1)).await??;
            let kept = adopted.iter().filter(|(_, trial)| trial.is_some()).count() as u64;
            effect.kept += kept;
            effect.outside += adopted.len() as u64 - kept;
        }
    }

    /// Stores a change, unless it was stored meanwhile. No checkpoint is saved meanwhile: one from before the
    /// change could be taken for one of its space after a further change.
    async fn store_change(&self, study: &StudyName, change: &SpaceChange) -> Result<()> {
        let _alone = self.pause_checkpoints().await?;
        let receipts = self
            .with_tuner(&study.id, |live, store, _| {
                // The name may have gone to another study meanwhile.
                live.is_meant(study)?;
                let changed = live.changed(change)?;
                if !changed.is_new {
                    return Ok(None);
                }
                let mut given_back = Vec::new();
                for trial in &changed.outside {
                    given_back.push(live.tuner.abandon(trial)?.1);
                }
                let given_back = live.commit(store, &given_back);
                live.is_stale = true;
                let stored = store.change_space(live.fence(), &changed.spec, &changed.earlier);
                Ok::<_, Error>(Some((given_back, stored)))
            })
            .await??;
        if let Some((given_back, stored)) = receipts {
            self.metrics().durable(given_back).await?;
            self.metrics().durable(stored).await?;
        }
        Ok(())
    }
}

impl Live {
    fn changed(&self, change: &SpaceChange) -> Result<ChangedStudy> {
        let (spec, present) = (self.tuner.spec(), self.earlier.revision());
        let is_there = spec.space == change.space;
        if is_there && (change.revision == present || change.revision.checked_add(1) == Some(present)) {
            let (spec, earlier) = ((**spec).clone(), self.earlier.clone());
            return Ok(ChangedStudy { spec, earlier, outside: Vec::new(), is_new: false });
        }
        if change.revision != present {
            let study = self.fence().study().to_owned();
            return Err(Error::SpaceChanged { study, present, given: change.revision });
        }
        let last_trial = self.tuner.statistics().trials;
        let earlier = self.earlier.changed(&spec.space, &change.space, last_trial, change.fixed.clone());
        let earlier = earlier.map_err(|error| Error::invalid("space", error))?;
        let bytes: usize = earlier.spaces().map(|space| space_to_wire(space).encoded_len()).sum();
        if bytes > limits::EARLIER_SPACES_BYTES {
            let most = limits::EARLIER_SPACES_BYTES;
            let problem = format!("the earlier spaces have {bytes} bytes, more than {most}; copy the study");
            return Err(Error::invalid("space", problem));
        }
        let adopted = |own: &Configuration| earlier.adopt(present, own.to_raw(), &change.space);
        let pinned = spec.policy.pinned.as_ref().map(|pinned| {
            let problem = format!("the pinned configuration {pinned} is outside it; end the pin first");
            adopted(pinned).ok_or_else(|| Error::invalid("space", problem))
        });
        let policy = Policy { pinned: pinned.transpose()?, ..spec.policy.clone() };
        // The store has a trial as it was handed out, and reads that. Its client may have it as it is by now.
        let is_outside = |trial: &&Trial| {
            let (revision, by_now) = (earlier.revision_of(trial.number), &trial.configuration);
            let own =
                if revision < present { self.expressed(revision, by_now) } else { Some(by_now.clone()) };
            let stored = own.and_then(|own| earlier.adopt(revision, own.to_raw(), &change.space));
            stored.is_none() || stored != adopted(by_now)
        };
        let outside = self.tuner.clients().open_trials().filter(is_outside).cloned().collect();
        let spec = StudySpec { space: change.space.clone(), policy, ..(**spec).clone() };
        spec.validate().map_err(|error| Error::invalid("space", error))?;
        Ok(ChangedStudy { spec, earlier, outside, is_new: true })
    }

    /// The revision with which a client works, where that is an earlier one.
    pub(super) fn outdated(&self, revision: u32) -> Option<u32> {
        (revision > 0 && revision < self.earlier.revision()).then_some(revision)
    }

    /// Answers a question of a client that works with an earlier space. The trial is as in that space; what
    /// is stored is as in the present one.
    pub(super) fn suggest_outdated(
        &mut self,
        suggest: &Suggest,
        revision: u32,
        prepared: Prepared,
        now_ms: i64,
    ) -> Result<Result<(Trial, Change), TunerError>, Preparation> {
        let mut suggest = suggest.clone();
        suggest.ask.start = self.start_of(revision, suggest.ask.start.take());
        if let Some(wanted) = suggest.wanted.take() {
            match self.earlier.adopt(revision, wanted, &self.tuner.spec().space) {
                // A client that gets another configuration than it wants would take it for that.
                Some(wanted) if self.expressed(revision, &wanted).is_some() => {
                    suggest.wanted = Some(wanted.into());
                }
                _ => return Ok(Err(SpaceError::outside(revision).into())),
            }
        }
        let known_here =
            || self.cheapest_known(revision, self.tuner.question(&suggest.ask).ok()?.state()?.get());
        let fallback = self.fallback(revision, suggest.ask.start.as_ref()).or_else(known_here);
        if fallback.is_none() && suggest.wanted.is_none() {
            // Nothing has changed yet.
            return Ok(Err(TunerError::Outdated(revision)));
        }
        let last = self.tuner.statistics().trials;
        Ok(self.decide(&suggest, prepared, now_ms)?.and_then(|(trial, mut change)| {
            if let Some(configuration) = self.expressed(revision, &trial.configuration) {
                return Ok((Trial { configuration, ..trial }, change));
            }
            let present = &self.tuner.spec().space;
            let nearest = |drawn: Configuration| self.earlier.nearest(revision, &drawn, present);
            let new = self.tuner.explored_instead((&trial, &suggest.ask), nearest);
            let said = if new.is_some() { new_words(revision) } else { words(revision) };
            // Where the default is to run, theirs comes nearest to it.
            let known = || self.cheapest_known(revision, trial.state_id);
            let known = || if trial.mode() == Mode::Default { None } else { known() };
            let chosen = new.or_else(known).or(fallback).ok_or(TunerError::Outdated(revision));
            let chosen = chosen.inspect_err(|_| self.fence().break_up())?;
            // One that it was given before may be running.
            if trial.number > last {
                self.tuner.clients_mut().forgo(&trial);
            }
            let instead =
                self.tuner.suggest_wanted(&suggest.ask.at(now_ms), chosen.into(), Some(said), now_ms);
            // The first answer is not stored, so the copy in memory is ahead of the database.
            let (trial, further) = instead.inspect_err(|_| self.fence().break_up())?;
            change.trials.extend(further.trials);
            change.states.extend(further.states);
            change.visits.extend(further.visits);
            change.forgotten.extend(further.forgotten);
            let configuration = self.expressed(revision, &trial.configuration);
            let configuration = configuration.ok_or(TunerError::Outdated(revision));
            let configuration = configuration.inspect_err(|_| self.fence().break_up())?;
            Ok((Trial { configuration, ..trial }, change))
        }))
    }

    /// The start of a client with an earlier revision of the space, in the present one; `None` where it is
    /// not in both.
    fn start_of(&self, revision: u32, start: Option<RawConfiguration>) -> Option<RawConfiguration> {
        let start = self.earlier.adopt(revision, start?, &self.tuner.spec().space)?;
        self.expressed(revision, &start).is_some().then(|| start.into())
    }

    /// The start of a client with any revision of the space, in the present one.
    pub(super) fn present_start(
        &self,
        revision: u32,
        start: Option<RawConfiguration>,
    ) -> Option<RawConfiguration> {
        match self.outdated(revision) {
            Some(revision) => self.start_of(revision, start),
            None => start,
        }
    }

    /// A prediction as a client with a revision of the space, and with a start or none, can run it.
    pub(super) fn in_revision(
        &self,
        revision: u32,
        start: Option<&RawConfiguration>,
        prediction: Prediction,
    ) -> Result<Prediction, TunerError> {
        let Some(revision) = self.outdated(revision) else {
            return Ok(prediction);
        };
        if let Some(configuration) = self.expressed(revision, &prediction.configuration) {
            return Ok(Prediction { configuration, ..prediction });
        }
        let state = prediction.insight.as_ref().map(|insight| insight.state_id);
        let chosen = state.and_then(|state| self.cheapest_known(revision, state));
        let chosen = chosen.or_else(|| self.fallback(revision, start));
        let configuration = chosen.and_then(|chosen| self.expressed(revision, &chosen));
        let configuration = configuration.ok_or(TunerError::Outdated(revision))?;
        let decision = Decision { said: Some(words(revision)), ..prediction.decision };
        Ok(Prediction { configuration, predicted_cost: None, decision, insight: prediction.insight })
    }

    /// The best configuration of a state as a client with a revision of the space can run it. The second
    /// value is false where the cheapest measured one that the client knows takes its place.
    pub(super) fn best_in_revision(&self, revision: u32, best: Best) -> Result<(Best, bool), TunerError> {
        let Some(revision) = self.outdated(revision) else {
            return Ok((best, true));
        };
        if let Some(configuration) = self.expressed(revision, &best.configuration) {
            return Ok((Best { configuration, ..best }, true));
        }
        let fits = |known: &Configuration| self.expressed(revision, known).is_some();
        let other =
            self.tuner.knowledge().cheapest_instead(best, fits).ok_or(TunerError::Outdated(revision))?;
        let configuration = self.expressed(revision, &other.configuration);
        let configuration = configuration.ok_or(TunerError::Outdated(revision))?;
        Ok((Best { configuration, ..other }, false))
    }

    /// The cheapest configuration measured in a state that can be expressed in an earlier revision.
    fn cheapest_known(&self, revision: u32, state: u64) -> Option<Configuration> {
        self.tuner.knowledge().cheapest(state, |known| self.expressed(revision, known).is_some())
    }

    /// A configuration of the present space in an earlier one.
    fn expressed(&self, revision: u32, configuration: &Configuration) -> Option<Configuration> {
        self.earlier.express(revision, configuration, &self.tuner.spec().space)
    }

    /// A configuration that a client of an earlier revision can always run: its start, its default, or the
    /// present one.
    fn fallback(&self, revision: u32, start: Option<&RawConfiguration>) -> Option<Configuration> {
        let present = &self.tuner.spec().space;
        let own = start.and_then(|start| present.configuration(start.clone()).ok());
        let theirs = self.earlier.space(revision)?.default_configuration();
        let theirs = self.earlier.adopt(revision, theirs.into(), present);
        let defaults = [own, theirs, Some(present.default_configuration())];
        defaults.into_iter().flatten().find(|default| self.expressed(revision, default).is_some())
    }
}

/// Why a client with an earlier revision gets what it gets.
fn words(revision: u32) -> String {
    format!("It is the best known for a program that knows revision {revision} of the space.")
}

/// Why a client with an earlier revision explores with another configuration than the search proposes.
fn new_words(revision: u32) -> String {
    format!("It is new, drawn for a program that knows revision {revision} of the space.")
}
