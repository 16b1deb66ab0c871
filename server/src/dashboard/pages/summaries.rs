//! Summaries of studies for the list of studies: the gain of each over its default, and how far it is.
//!
//! The list has to open at once, however many trials its studies have. So summaries are made in the
//! background, one study after another, and kept until the study's counts change. A page shows those that
//! are kept, and waits a moment only for studies that were never summarised.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::ops::Bound;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use prost_types::Timestamp;
use tokio::sync::Notify;
use tokio::time::{Instant, timeout};
use treewright_core::standing::{ConfirmationStage, Gain, Standing, StandingVerdict};
use treewright_proto::convert::signed;
use treewright_proto::v1;

use super::super::Visitor;
use super::standing::read_state;
use super::{PageFrame, read_trials};
use crate::access::caller::Caller;
use crate::error::{Error, Result};
use crate::limits;
use crate::tuning::Tuning;

/// Most states of a study in its summary: the first.
pub(super) const STATES: i64 = 24;

/// A study's row in the list of studies, beside its counts.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct StudySummary {
    /// The gain of the answers over the default in the study's view, as the mean over the states. `None`
    /// where the default was measured in none.
    pub(super) gain: Option<Gain>,
    /// The reference of the gain, and how sure it is.
    pub(super) gain_note: String,
    /// `searching`, `confirming`, `running` or `finished`; empty where nothing is known.
    pub(super) progress: &'static str,
    /// The last time at which its newest trial was handed out or reported.
    pub(super) last: Option<Timestamp>,
    /// The address of the replica that holds the study, where that is another.
    pub(super) holder: Option<String>,
    /// Nothing is missing from the summary.
    pub(super) is_whole: bool,
}

/// The summaries of the studies that were listed.
#[derive(Default)]
pub(super) struct Summaries {
    known: Mutex<KnownSummaries>,
    /// The task that makes summaries.
    turn: tokio::sync::Mutex<()>,
    /// All that were asked for are made.
    done: Notify,
}

#[derive(Default)]
struct KnownSummaries {
    by_uid: HashMap<String, KnownSummary>,
    /// The id and the counts of each study to summarise, by its identity.
    pending: BTreeMap<String, (String, v1::StudyStatistics)>,
    /// The study whose turn was last.
    turn_of: String,
    changes: u64,
}

struct KnownSummary {
    counts: v1::StudyStatistics,
    made: Instant,
    summary: StudySummary,
}

impl KnownSummary {
    fn is_due(&self, counts: v1::StudyStatistics, now: Instant) -> bool {
        let age = now.saturating_duration_since(self.made);
        let is_old = self.counts != counts && age >= limits::DASHBOARD_SUMMARY_AGE;
        is_old || (!self.summary.is_whole && age >= limits::DASHBOARD_SUMMARY_RETRY)
    }
}

impl KnownSummaries {
    /// Takes the study whose turn it is. They come round in the order of their identities, so that none has
    /// to wait for others that change again and again.
    fn take_next(&mut self) -> Option<(String, (String, v1::StudyStatistics))> {
        let after = (Bound::Excluded(self.turn_of.as_str()), Bound::Unbounded);
        let next = self.pending.range::<str, _>(after).chain(&self.pending).next();
        self.turn_of = next.map(|(uid, _)| uid.clone())?;
        self.pending.remove_entry(&self.turn_of)
    }
}

impl Summaries {
    fn lock(&self) -> MutexGuard<'_, KnownSummaries> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn changes(&self) -> u64 {
        self.lock().changes
    }

    /// The summary of a study by its identity; `None` before the first.
    pub(super) fn of(&self, uid: &str) -> Option<StudySummary> {
        self.lock().by_uid.get(uid).map(|known| known.summary.clone())
    }

    /// Renews the summaries of these studies in the background, and makes first ones of those that are shown,
    /// for which it waits [`limits::DASHBOARD_SUMMARY_WAIT`] at most.
    pub(super) async fn refresh(
        self: &Arc<Self>,
        tuning: &Arc<Tuning>,
        studies: &[v1::Study],
        shown: &BTreeSet<String>,
    ) {
        let done = self.done.notified();
        let (has_work, is_awaited) = self.note(studies, shown, Instant::now());
        if has_work {
            let (summaries, tuning) = (Arc::clone(self), Arc::clone(tuning));
            tokio::spawn(async move { summaries.work(&tuning).await });
        }
        if is_awaited {
            // What is not ready yet is shown by a later page.
            let _ = timeout(limits::DASHBOARD_SUMMARY_WAIT, done).await;
        }
    }

    /// Notes which studies are to be summarised: whether any was added, and whether a first one is missing.
    fn note(&self, studies: &[v1::Study], shown: &BTreeSet<String>, now: Instant) -> (bool, bool) {
        let mut guard = self.lock();
        let known = &mut *guard;
        let (mut has_work, mut is_awaited) = (false, false);
        for study in studies {
            let counts = study.statistics.unwrap_or_default();
            let is_due = match known.by_uid.get(&study.uid) {
                Some(kept) => kept.is_due(counts, now),
                None => shown.contains(&study.uid),
            };
            if !is_due || known.pending.len() >= limits::DASHBOARD_STUDIES {
                continue;
            }
            is_awaited |= !known.by_uid.contains_key(&study.uid);
            let wanted = (super::id(&study.name).to_owned(), counts);
            has_work |= known.pending.insert(study.uid.clone(), wanted).is_none();
        }
        (has_work, is_awaited)
    }

    async fn work(&self, tuning: &Tuning) {
        let _turn = self.turn.lock().await;
        loop {
            let next = self.lock().take_next();
            let Some((uid, (id, counts))) = next else { break };
            let made = summarise(tuning, &id, &uid).await;
            self.keep(uid, counts, made);
        }
        self.done.notify_waiters();
    }

    /// Keeps a summary. Where none could be made, the former one stays for a while.
    fn keep(&self, uid: String, counts: v1::StudyStatistics, made: Result<StudySummary>) {
        let mut known = self.lock();
        let former = known.by_uid.remove(&uid).map(|former| former.summary);
        let summary = match made {
            Ok(summary) => summary,
            Err(error) => {
                tracing::debug!(study = uid, %error, "no summary for the dashboard");
                StudySummary { is_whole: false, ..former.clone().unwrap_or_default() }
            }
        };
        known.changes += u64::from(former.as_ref() != Some(&summary));
        // Those of deleted studies stay behind.
        if known.by_uid.len() >= 2 * limits::DASHBOARD_STUDIES {
            known.by_uid.clear();
        }
        known.by_uid.insert(uid, KnownSummary { counts, made: Instant::now(), summary });
        assert!(known.by_uid.len() <= 2 * limits::DASHBOARD_STUDIES, "{} summaries", known.by_uid.len());
    }
}

async fn summarise(tuning: &Tuning, id: &str, uid: &str) -> Result<StudySummary> {
    let record = tuning.get_study(id).await?;
    if record.uid.to_string() != uid {
        return Err(Error::Replaced(id.to_owned()));
    }
    let (caller, view) = (Caller::Anyone, record.spec.objective.view());
    let visitor = Visitor { tuning, caller: &caller, frame: PageFrame { has_token: false } };
    let newest = read_trials(&visitor, id, "", "number desc", 1).await?.pop();
    let (mut standings, mut holder) = (Vec::new(), None);
    for number in 1..=signed(record.statistics.states).min(STATES) {
        let Some(state) = read_state(&visitor, id, number).await? else { continue };
        standings.extend(state.standing);
        if state.holder.is_some() {
            holder = state.holder;
            break;
        }
    }
    let gains: Vec<Gain> = standings.iter().filter_map(|standing| standing.gain).collect();
    Ok(StudySummary {
        gain: mean_gain(&gains).map(|gain| gain.by(&view)),
        gain_note: note_of(&standings, gains.len(), view.better_side()),
        progress: progress(&standings),
        last: newest.and_then(|trial| last_time(&trial)),
        // A state in which nothing was measured has nothing to show before the counts change.
        is_whole: holder.is_none(),
        holder,
    })
}

fn last_time(trial: &v1::Trial) -> Option<Timestamp> {
    let times = [trial.create_time, trial.complete_time].into_iter().flatten();
    times.max_by_key(|time| (time.seconds, time.nanos))
}

/// The mean of gains in several states: geometric over the ratios of the costs. The states' errors are
/// independent of each other.
pub(super) fn mean_gain(gains: &[Gain]) -> Option<Gain> {
    if let [] | [_] = gains {
        return gains.first().copied();
    }
    let count = gains.len() as f64;
    // A share of 1 would be a cost of nothing.
    let log = |share: f64| (1.0 - share.min(0.999)).ln();
    let share = |log: f64| -log.exp_m1();
    let mean = gains.iter().map(|gain| log(gain.share)).sum::<f64>() / count;
    let reach = |end: fn(&Gain) -> Option<f64>| {
        let squares = gains.iter().map(|gain| Some((log(end(gain)?) - log(gain.share)).powi(2)));
        squares.sum::<Option<f64>>().map(|sum| sum.sqrt() / count)
    };
    Some(Gain {
        share: share(mean),
        low: reach(|gain| gain.low).map(|reach| share(mean + reach)),
        high: reach(|gain| gain.high).map(|reach| share(mean - reach)),
        probability_better: None,
    })
}

/// The words beside a gain: `below the default, proven better`.
fn note_of(standings: &[Standing], gains: usize, side: &str) -> String {
    let proven = standings.iter().filter(|one| one.verdict() == StandingVerdict::Proven).count();
    match (standings, gains) {
        ([], _) => String::new(),
        ([one], 0) => one.in_short().to_owned(),
        ([one], _) => format!("{side} the default, {}", one.in_short()),
        (all, 0) => format!("{proven} of {} states proven better", all.len()),
        (all, _) => {
            format!("{side} the default on average, {proven} of {} states proven better", all.len())
        }
    }
}

/// How far a study is, by the confirmations of its states.
fn progress(standings: &[Standing]) -> &'static str {
    let has = |stage: ConfirmationStage| standings.iter().any(|one| one.confirmation.stage == stage);
    if has(ConfirmationStage::Racing) {
        "confirming"
    } else if standings.is_empty() || has(ConfirmationStage::Searching) {
        "searching"
    } else if has(ConfirmationStage::Off) {
        // Without a confirmation no end is given.
        "running"
    } else {
        "finished"
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use treewright_core::policy::Policy;
    use treewright_core::space::Space;
    use treewright_core::standing::Confirmation;
    use treewright_core::study::StudySpec;
    use treewright_core::tuner::Ask;
    use treewright_store::MemoryStore;

    use super::*;
    use crate::clock::ManualClock;
    use crate::convert::from_proto::Suggest;

    fn gain(share: f64, half: f64) -> Gain {
        Gain { share, low: Some(share - half), high: Some(share + half), probability_better: None }
    }

    fn standing(stage: ConfirmationStage) -> Standing {
        let gain = Some(gain(0.2, 0.1));
        let confirmation = Confirmation { stage, gain, ..Confirmation::default() };
        Standing { cost: 8.0, cost_low: 7.9, cost_high: 8.1, gain, confirmation, ..Standing::default() }
    }

    #[test]
    fn a_mean_gain_lies_between_and_is_surer_than_each() {
        assert_eq!(mean_gain(&[]), None);
        assert_eq!(mean_gain(&[gain(0.2, 0.1)]), Some(gain(0.2, 0.1)));
        let same = mean_gain(&[gain(0.2, 0.1); 4]).expect("four gains");
        let (low, high) = (same.low.expect("known"), same.high.expect("known"));
        assert!((same.share - 0.2).abs() < 1e-12, "{same:?}");
        assert!(low > 0.14 && low < 0.16 && high > 0.24 && high < 0.26, "half of the interval: {same:?}");
        let mixed = mean_gain(&[gain(0.5, 0.01), gain(0.0, 0.01)]).expect("two gains");
        assert!((mixed.share - (1.0 - 0.5_f64.sqrt())).abs() < 1e-12, "{mixed:?}");
        let open = Gain { low: None, ..gain(0.5, 0.01) };
        let half = mean_gain(&[open, gain(0.0, 0.01)]).expect("two gains");
        assert!(half.low.is_none() && half.high.is_some(), "{half:?}");
    }

    #[test]
    fn a_study_is_as_far_as_its_last_state() {
        use ConfirmationStage::{Better, NothingBetter, Off, Racing, Searching};
        for (stages, said) in [
            (&[Better, Searching][..], "searching"),
            (&[], "searching"),
            (&[Better, Searching, Racing], "confirming"),
            (&[Better, NothingBetter], "finished"),
            (&[Off, Off], "running"),
        ] {
            let standings: Vec<Standing> = stages.iter().map(|stage| standing(*stage)).collect();
            assert_eq!(progress(&standings), said, "{stages:?}");
        }
        let one = [standing(Better)];
        assert_eq!(note_of(&one, 1, "below"), "below the default, proven better");
        let two = [standing(Better), standing(Searching)];
        assert_eq!(note_of(&two, 2, "above"), "above the default on average, 1 of 2 states proven better");
        assert_eq!(note_of(&[], 0, "below"), "");
    }

    fn study(uid: &str, trials: i64) -> v1::Study {
        let statistics = Some(v1::StudyStatistics { trials, ..v1::StudyStatistics::default() });
        v1::Study { name: format!("studies/{uid}"), uid: uid.to_owned(), statistics, ..v1::Study::default() }
    }

    #[tokio::test(start_paused = true)]
    async fn only_what_is_new_or_has_changed_is_summarised() {
        let (summaries, shown) = (Summaries::default(), BTreeSet::from(["a".to_owned()]));
        let note = |studies: &[v1::Study]| summaries.note(studies, &shown, Instant::now());
        assert_eq!(note(&[study("a", 1), study("b", 1)]), (true, true));
        assert_eq!(note(&[study("a", 1)]), (false, true), "it is being made");
        let (uid, (_, counts)) = summaries.lock().take_next().expect("only what is shown");
        assert!(uid == "a" && summaries.lock().pending.is_empty());
        let whole = StudySummary { is_whole: true, ..StudySummary::default() };
        summaries.keep(uid, counts, Ok(whole.clone()));
        assert_eq!((summaries.of("a"), summaries.changes()), (Some(whole), 1));
        tokio::time::advance(Duration::from_secs(3600)).await;
        assert_eq!(note(&[study("a", 1)]), (false, false), "nothing has changed");
        assert_eq!(note(&[study("a", 2)]), (true, false));
        let (uid, (_, counts)) = summaries.lock().take_next().expect("it has changed");
        summaries.keep(uid, counts, Err(Error::Draining));
        assert_eq!(note(&[study("a", 3)]), (false, false), "not at every page");
        tokio::time::advance(limits::DASHBOARD_SUMMARY_RETRY).await;
        assert_eq!(note(&[study("a", 2)]), (true, false), "it could not be made");
    }

    #[test]
    fn no_study_waits_for_others_that_change_again_and_again() {
        let (summaries, studies) = (Summaries::default(), ["a", "b", "c"].map(|uid| study(uid, 1)));
        let shown: BTreeSet<String> = studies.iter().map(|study| study.uid.clone()).collect();
        let turns = [0; 6].map(|_| {
            // What was summarised has changed before the next one is taken.
            summaries.note(&studies, &shown, Instant::now());
            summaries.lock().take_next().expect("one is due").0
        });
        assert_eq!(turns, ["a", "b", "c", "a", "b", "c"]);
    }

    #[tokio::test]
    async fn a_state_without_measurements_is_not_asked_for_again_and_again() {
        let (store, clock) = (Arc::new(MemoryStore::new()), Arc::new(ManualClock::at(1_000)));
        let tuning = Tuning::new(store, clock);
        let space = Space::builder().integer("a", 0..=9).default(4).build().expect("valid");
        let spec = StudySpec::builder(space).minimise("render_ms", 1.0).build().expect("valid");
        let spec = spec.with_policy(Policy::default());
        let created = tuning.create_study("hall", &spec).await.expect("created");
        let ask = Ask { client_id: "one".to_owned(), ..Ask::default() };
        let suggest = Suggest { study: "hall".into(), ask, wanted: None, space_revision: 0 };
        tuning.suggest(suggest).await.expect("a trial");
        let uid = created.study.uid.to_string();
        let made = summarise(&tuning, "hall", &uid).await.expect("the study is there");
        assert!(made.is_whole && made.gain.is_none() && made.last.is_some(), "{made:?}");
        let another = summarise(&tuning, "hall", "0000000000000abc").await;
        assert!(matches!(another, Err(Error::Replaced { .. })), "{another:?}");
    }
}
