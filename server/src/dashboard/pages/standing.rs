//! The proven configuration of each state, and its savings.

use std::collections::BTreeMap;

use treewright_core::cost_view::CostView;
use treewright_core::standing::Standing;
use treewright_proto::convert::standing_from_wire;
use treewright_proto::v1;
use treewright_store::StoreError;

use super::super::benefit::{Benefit, DAY_S, DefaultCost};
use super::super::{LOADING_WAITS, Visitor, is_loading};
use super::{read_trials, seconds};
use crate::error::{Error, Result};
use crate::rpc;

/// A state with one of its trials, and what is best there as that trial's machine sees it.
pub(super) struct StateStands {
    pub(super) state: i64,
    pub(super) trial: v1::Trial,
    /// `None` where nothing was measured, or where another replica holds the study.
    pub(super) best: Option<v1::Best>,
    pub(super) standing: Option<Standing>,
    /// The address of the replica that holds the study, where that is another.
    pub(super) holder: Option<String>,
}

impl StateStands {
    /// The gain over the default, with its interval; empty where the default was not measured, or is the
    /// answer.
    pub(super) fn gain(&self, view: &CostView) -> String {
        let gain = self.standing.and_then(|standing| standing.gain).filter(|gain| gain.share != 0.0);
        gain.map(|gain| gain.by(view).to_string()).unwrap_or_default()
    }
}

/// Reads a state; `None` where no visible state has that number.
pub(super) async fn read_state(visitor: &Visitor<'_>, id: &str, state: i64) -> Result<Option<StateStands>> {
    let filter = format!("state_id = {state}");
    let Some(trial) = read_trials(visitor, id, &filter, "", 1).await?.pop() else { return Ok(None) };
    let request = v1::GetBestRequest {
        study: format!("studies/{id}"),
        indicators: trial.indicators.clone(),
        fingerprint: trial.fingerprint.clone(),
        space_revision: 0,
        start: None,
    };
    let (best, holder) = read_best(visitor, request).await?;
    let standing = best.as_ref().and_then(|best| best.standing).map(standing_from_wire);
    Ok(Some(StateStands { state, trial, best, standing, holder }))
}

/// The best configuration where anything was measured, or the address of the other replica that holds the
/// study. It waits for a study that is being loaded.
async fn read_best(
    visitor: &Visitor<'_>,
    request: v1::GetBestRequest,
) -> Result<(Option<v1::Best>, Option<String>)> {
    let mut waits = 0;
    loop {
        match rpc::trials::best(visitor.call(), request.clone()).await {
            Ok(best) => return Ok((Some(best), None)),
            Err(Error::NothingMeasured { .. }) => return Ok((None, None)),
            Err(Error::Store(StoreError::Elsewhere { address, .. })) => return Ok((None, Some(address))),
            Err(problem) if is_loading(&problem) && waits < LOADING_WAITS => waits += 1,
            Err(problem) => return Err(problem),
        }
    }
}

/// The expected final cost of a search: the answer's cost, lowered by the gain that is still expected. Once
/// the search is over it is the answer's own cost.
pub(super) async fn roofline(visitor: &Visitor<'_>, id: &str, of: &StateStands) -> Option<f64> {
    let request = v1::PredictRequest {
        study: format!("studies/{id}"),
        indicators: of.trial.indicators.clone(),
        fingerprint: of.trial.fingerprint.clone(),
        space_revision: 0,
        start: None,
    };
    let prediction = rpc::trials::predict(visitor.call(), request).await.ok()?;
    let expected = prediction.state.and_then(|state| state.expected_gain).unwrap_or(0.0);
    Some(of.standing?.cost * (1.0 - expected.clamp(0.0, 1.0)))
}

/// The savings of each state within the last day. `latest` are the newest trials. Where the day may have more
/// trials, their span stands for the whole day.
pub(super) fn benefits(
    states: &[StateStands],
    latest: &[v1::Trial],
    is_cut: bool,
    unit_s: Option<f64>,
    now_ms: i64,
) -> BTreeMap<i64, Benefit> {
    let Some(unit_s) = unit_s else { return BTreeMap::new() };
    let now_s = now_ms as f64 / 1e3;
    let age_s = |trial: &v1::Trial| seconds(trial.complete_time).map(|end| now_s - end);
    let oldest = latest.iter().filter_map(age_s).fold(0.0, f64::max);
    let window_s = if is_cut { oldest.min(DAY_S) } else { DAY_S };
    let mut costs: BTreeMap<i64, Vec<f64>> = BTreeMap::new();
    for trial in latest.iter().filter(|trial| age_s(trial).is_some_and(|age| age <= window_s)) {
        if let Some(cost) = trial.cost {
            costs.entry(trial.state_id).or_default().push(cost);
        }
    }
    let of = |one: &StateStands| {
        let default = DefaultCost::of(&one.standing?)?;
        Some((one.state, Benefit::of(default, costs.get(&one.state)?, unit_s, window_s)))
    };
    states.iter().filter_map(of).collect()
}
