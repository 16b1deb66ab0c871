//! The search of one state together with the trials that carry its points.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use treewright_model::plain::is_default;

use crate::configuration::{Configuration, RawConfiguration};
use crate::limits::LOST_CONFIGURATIONS_MAX;
use crate::packed::{PackedError, pack, unpack};
use crate::search::{AnySearch, Feedback, Verdict};
use crate::space::Space;
use crate::tuner::exploring::race::Confirming;
use crate::tuner::knowledge::Stored;

/// The search of one state and its points in flight. Once its budget is spent the search itself is dropped,
/// because the state's table holds its results. Opaque, exact through serde.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Exploration {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) search: Option<AnySearch>,
    /// The number of a dropped search's answers that added no configuration.
    #[serde(default, skip_serializing_if = "is_default")]
    repeats: u64,
    /// The largest number of runs that a session wanted of the search, beyond the policy.
    #[serde(default, skip_serializing_if = "is_default")]
    room: u32,
    /// The point of the search that each open trial measures, by trial number.
    pub(crate) open: BTreeMap<u64, u64>,
    /// The race of the best few against the incumbent, once the search is over.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) confirming: Option<Confirming>,
    /// The incumbent where that is not the default configuration: proven better here, or expected to be by
    /// other states.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) confirmed: Option<Stored>,
    /// Leases that were lost in the state, of configurations that were never measured there; the latest last.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    lost: Vec<LostLeases>,
    /// The cost of all trials at cheaper levels, in full trials.
    #[serde(default, skip_serializing_if = "is_default")]
    pub(crate) cheaper_trials: f64,
    /// No search was begun yet.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    is_unbegun: bool,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct LostLeases {
    configuration: RawConfiguration,
    count: u32,
    /// A client measured it as its start: that is no reason to call it infeasible.
    #[serde(default, skip_serializing_if = "is_default")]
    is_start: bool,
    /// The last session that lost one without having shown that it lives; 0 for none.
    #[serde(default, skip_serializing_if = "is_default")]
    silent_session: u64,
}

impl LostLeases {
    fn are_of(&self, configuration: &Configuration, is_start: bool) -> bool {
        self.is_start == is_start && self.configuration == *configuration.values()
    }
}

impl Exploration {
    pub(crate) fn new(search: AnySearch) -> Self {
        let begun = Exploration { search: Some(search), is_unbegun: false, ..Exploration::unbegun() };
        assert!(begun.is_begun() && begun.open.is_empty(), "a search that has just begun");
        begun
    }

    /// Of a state in which no search was begun.
    pub(crate) fn unbegun() -> Self {
        Exploration {
            search: None,
            repeats: 0,
            room: 0,
            open: BTreeMap::new(),
            confirming: None,
            confirmed: None,
            lost: Vec::new(),
            cheaper_trials: 0.0,
            is_unbegun: true,
        }
    }

    /// Whether a search was begun; it may be over.
    pub(crate) fn is_begun(&self) -> bool {
        !self.is_unbegun
    }

    /// Replaces the search by a new one. Lost leases and the cost of trials at cheaper levels are remembered.
    pub(crate) fn restart(&mut self, search: AnySearch) {
        let (lost, cheaper_trials) = (std::mem::take(&mut self.lost), self.cheaper_trials);
        let (confirming, confirmed) = (self.confirming.take(), self.confirmed.take());
        *self = Exploration { lost, cheaper_trials, confirming, confirmed, ..Exploration::new(search) };
    }

    /// Forgets the search and its confirmed winner. Lost leases are remembered.
    pub(crate) fn forget_search(&mut self) {
        *self = Exploration { lost: std::mem::take(&mut self.lost), ..Exploration::unbegun() };
        assert!(!self.is_begun() && self.confirmed.is_none(), "nothing is left of the search");
    }

    /// Drops the search, and where results of its own state are `disowned` also the race, its winner and the
    /// cost of trials at cheaper levels. Another search begins with the rest of the table.
    pub(crate) fn disbelieve(&mut self, disowned: bool) {
        self.end();
        if disowned {
            (self.confirming, self.confirmed, self.cheaper_trials) = (None, None, 0.0);
        }
    }

    /// The number of lost leases of a configuration, as a client's start or as any other.
    pub(crate) fn lost(&self, configuration: &Configuration, is_start: bool) -> u32 {
        let lost = self.lost.iter().find(|lost| lost.are_of(configuration, is_start));
        lost.map_or(0, |lost| lost.count)
    }

    /// Notes a lost lease of a configuration, and returns their number.
    pub(crate) fn note_lost(&mut self, configuration: &Configuration, is_start: bool) -> u32 {
        let lost = self.latest_lost(configuration, is_start);
        lost.count += 1;
        lost.count
    }

    /// Notes a session that lost a lease of a configuration without having shown that it lives. Whether
    /// another one had before.
    pub(crate) fn note_silence(&mut self, configuration: &Configuration, session: u64) -> bool {
        let lost = self.latest_lost(configuration, false);
        let before = std::mem::replace(&mut lost.silent_session, session);
        before != 0 && before != session
    }

    /// The lost leases of a configuration, which are the latest from now on.
    fn latest_lost(&mut self, configuration: &Configuration, is_start: bool) -> &mut LostLeases {
        let known = self.lost.iter().position(|lost| lost.are_of(configuration, is_start));
        let own = known.map(|place| self.lost.remove(place));
        if self.lost.len() >= LOST_CONFIGURATIONS_MAX {
            self.lost.remove(0);
        }
        let none = || {
            let configuration = configuration.to_raw();
            LostLeases { configuration, count: 0, is_start, silent_session: 0 }
        };
        self.lost.push(own.unwrap_or_else(none));
        let last = self.lost.len() - 1;
        &mut self.lost[last]
    }

    /// Whether leases of a configuration are known to be lost, as a client's start or as any other.
    pub(crate) fn has_lost(&self, configuration: &Configuration) -> bool {
        self.lost.iter().any(|lost| lost.configuration == *configuration.values())
    }

    /// Forgets the lost leases of a configuration that has a result now.
    pub(crate) fn forgive(&mut self, configuration: &Configuration) {
        self.lost.retain(|lost| lost.configuration != *configuration.values());
        assert_eq!(self.lost(configuration, false), 0, "the leases are forgotten");
    }

    /// Notes that a session wants the search to go on for `room` runs.
    pub(crate) fn make_room(&mut self, room: usize) {
        self.room = self.room.max(u32::try_from(room).unwrap_or(u32::MAX));
    }

    /// The largest number of runs that a session wanted.
    pub(crate) fn room(&self) -> usize {
        self.room as usize
    }

    /// The number of answers that added no configuration.
    pub(crate) fn repeats(&self) -> u64 {
        self.search.as_ref().map_or(self.repeats, |search| search.repeats())
    }

    /// Drops the search.
    pub(crate) fn end(&mut self) {
        let repeats = self.repeats();
        self.repeats = repeats;
        self.search = None;
        assert_eq!(self.repeats(), repeats, "the repeats of a dropped search count on");
    }

    /// Whether the configurations that it names are of the space.
    pub(crate) fn fits(&self, space: &Space) -> bool {
        self.confirming.as_ref().is_none_or(|race| race.fits(space))
            && self.confirmed.as_ref().is_none_or(|confirmed| space.owns(&confirmed.0))
    }

    /// Whether a trial runs a contender of the race.
    pub(crate) fn confirms(&self, trial: u64) -> bool {
        self.confirming.as_ref().is_some_and(|race| race.runs(trial))
    }

    /// Packs it into few bytes, exact to the bit.
    pub fn pack(&self) -> Vec<u8> {
        pack(self)
    }

    /// Reads the bytes that [`pack`](Exploration::pack) wrote.
    pub fn unpack(bytes: &[u8]) -> Result<Self, PackedError> {
        unpack(bytes)
    }

    /// Ends the hold of a trial at a cheaper level, which cost `share` of a full one, on its point. Without a
    /// verdict it failed.
    pub(crate) fn release_cheaper(&mut self, trial: u64, share: f64, verdict: Option<Verdict>) {
        assert!(share > 0.0 && share < 1.0, "a level that costs {share} of a full trial");
        self.cheaper_trials += share;
        if let (Some(point), Some(search)) = (self.open.remove(&trial), &mut self.search) {
            search.tell_cheaper(point, verdict);
        }
    }

    /// Ends the trial's hold on its point: the point is answered, or without feedback goes back and is
    /// asked again. `false` when the trial carried no point.
    pub(crate) fn release(&mut self, trial: u64, feedback: Option<Feedback>) -> bool {
        if let Some(race) = &mut self.confirming {
            race.release(trial, None);
        }
        assert!(!self.confirms(trial), "the race does not wait for trial {trial}");
        let Some(point) = self.open.remove(&trial) else { return false };
        match (&mut self.search, feedback) {
            (Some(search), Some(feedback)) => search.tell(point, feedback),
            (Some(search), None) => search.withdraw(point),
            (None, _) => {}
        }
        true
    }
}
