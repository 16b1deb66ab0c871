//! A row of the list of studies.

use treewright_core::standing::Gain;

/// A study in the list of studies, of this daemon or of another. Times are text that sorts, in UTC.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct IndexRow {
    pub(super) id: String,
    pub(super) uid: String,
    pub(super) what: String,
    pub(super) status: String,
    /// The gain over the default as the study tells it; `None` where that is not known.
    pub(super) gain: Option<Gain>,
    pub(super) gain_note: String,
    pub(super) states: i64,
    pub(super) trials: i64,
    pub(super) completed: i64,
    pub(super) open: i64,
    pub(super) last: String,
    pub(super) created: String,
    /// The address of the replica that holds the study, where that is another than the daemon that tells.
    pub(super) holder: String,
}
