//! The model of cost: a process that is fitted to all measurements, or to the best and the latest.

use super::acquire::EstimatedPoint;
use super::cheaper::CheaperPoint;
use super::{FITTED_MAX, ModelSearch, ModelledPoint, Observed, PENDING_COUNT, PRIOR};
use crate::gp::acquisition::mean_above;
use crate::gp::warping::ShiftedLog;
use crate::gp::{Hyperparameters, Process, Sample, Schedule};

/// With more points than are fitted the covariance is learnt once in this number of measurements.
const LEARN_EVERY: u64 = 4;
/// Rounds of ascent of the first fit, those of later fits, and the number of points from which on a fit has
/// one step.
const ROUNDS_FIRST: usize = 30;
const ROUNDS: usize = 4;
const ROUNDS_UNTIL: usize = 32;
/// The logarithm of the likelihood ratio from which on a trend is used: twenty to one.
const TREND_EVIDENCE: f64 = 3.0;

/// The points that ran in full and have a cost, and those that ran at cheaper levels.
type CostData<'a> = (&'a [&'a ModelledPoint], &'a [CheaperPoint]);

pub(super) struct CostModel {
    pub(super) process: Process,
    /// The relative deviation of a measurement of the best.
    pub(super) noise: f64,
    /// The log likelihood of the measurements, before pending points were added.
    pub(super) evidence: f64,
}

impl ModelSearch {
    /// The steps of learning of the next fit, which has `places` points in full. Notes the fit.
    pub(super) fn schedule(&mut self, places: usize) -> Schedule {
        let rounds = match (self.fitted, places) {
            (0, _) => ROUNDS_FIRST,
            (_, ..ROUNDS_UNTIL) => ROUNDS,
            _ => 0,
        };
        let told = self.told + self.cheaper.runs.len() as u64;
        let is_late = self.seen.len() > FITTED_MAX && !self.told.is_multiple_of(LEARN_EVERY);
        let learn = told > self.fitted && !is_late;
        self.fitted = told;
        Schedule { steps: if learn { rounds } else { 0 }, ahead: learn }
    }

    /// The model of cost with a quadratic trend, if the measurements speak for it clearly: their log
    /// likelihood without one is `plain`.
    pub(super) fn trended(&mut self, data: CostData, plain: f64, schedule: Schedule) -> Option<CostModel> {
        let (mut hyper, steps) = match self.trended.take() {
            // This model is fitted half as often, so it learns twice as much at a time.
            Some(hyper) => (hyper, if schedule.ahead { (2 * schedule.steps).max(1) } else { 0 }),
            None => (Hyperparameters::with_trend(&self.setup.layout.kinds(), &PRIOR), ROUNDS_FIRST),
        };
        let schedule = Schedule { steps, ..schedule };
        let model = self.costs(data, &mut hyper, schedule);
        self.trended = Some(hyper);
        model.filter(|model| model.evidence > plain + TREND_EVIDENCE)
    }

    pub(super) fn costs(
        &self,
        (measured, cheaper): CostData,
        hyper: &mut Hyperparameters,
        schedule: Schedule,
    ) -> Option<CostModel> {
        let kinds = self.setup.layout.kinds();
        let layout = &self.setup.layout;
        let below = |point: &CheaperPoint| layout.at_cheaper(point.level, &point.place.features);
        let below: Vec<Vec<f64>> = cheaper.iter().map(below).collect();
        let places = measured.iter().copied().chain(cheaper.iter().map(|point| &point.place));
        let costs: Vec<f64> = places.map(|place| place.observed.cost()).collect();
        let counts = measured.iter().map(|place| place.count);
        let mut counts: Vec<f64> = counts.chain(cheaper.iter().map(|point| point.count)).collect();
        let points = measured.iter().map(|place| place.features.as_slice());
        let mut points: Vec<&[f64]> = points.chain(below.iter().map(Vec::as_slice)).collect();
        let warping = ShiftedLog::new(&costs);
        let mut views = warping.views();
        let sample = |points: &[&[f64]], counts| Sample::new(kinds.clone(), points, counts).prepared();
        let first = sample(&points, counts.clone());
        let (mut process, view) = Process::learn(first, &views, hyper, &PRIOR, schedule)?;
        let evidence = process.log_likelihood;
        let censored = |place: &ModelledPoint| matches!(place.observed, Observed::AtLeast(_));
        if !cheaper.is_empty() || measured.iter().any(|place| censored(place)) {
            let values = &mut views[view].0;
            let level_of = |index: usize| Some(cheaper.get(index.checked_sub(measured.len())?)?.level);
            for level in 0..self.cheaper.shares.len() {
                let is_of = |index: usize| level_of(index) == Some(level);
                let shift = process.shift_of(is_of);
                let values = values.iter_mut().enumerate().filter(|(index, _)| is_of(*index));
                values.for_each(|(_, value)| *value -= shift);
            }
            for (value, place) in values.iter_mut().zip(measured).filter(|(_, place)| censored(place)) {
                *value = mean_above(*value, process.predict(&place.features), process.noise);
            }
            process = Process::fit(sample(&points, counts.clone()), views[view].0.clone(), hyper, &PRIOR)?;
        }
        let noise = warping.relative(view, process.noise.sqrt());
        // Pending points count as measured at their expected cost.
        let pending: Vec<Vec<f64>> = self.pending.points().map(|point| self.grid(&point.x).1).collect();
        if pending.is_empty() {
            return Some(CostModel { process, noise, evidence });
        }
        let mut values = views[view].0.clone();
        values.extend(pending.iter().map(|features| process.predict(features).mean));
        counts.extend(pending.iter().map(|_| PENDING_COUNT));
        points.extend(pending.iter().map(Vec::as_slice));
        let process = Process::fit(sample(&points, counts), values, hyper, &PRIOR)?;
        Some(CostModel { process, noise, evidence })
    }
}

/// The measured points, as a model of cost sees them.
pub(super) fn known(measured: &[&ModelledPoint], cost: Option<&Process>) -> Vec<EstimatedPoint> {
    let believed = |place: &ModelledPoint| match (cost, place.observed) {
        // An aborted point is never the best.
        (_, Observed::AtLeast(_)) => f64::INFINITY,
        (Some(cost), _) => cost.predict(&place.features).mean,
        (None, _) => 0.0,
    };
    let points = measured.iter().map(|place| (place.x.clone(), believed(place)));
    points.map(|(x, believed)| EstimatedPoint { x, believed, in_full: true }).collect()
}

#[cfg(test)]
mod tests {
    use super::super::ModelSearch;
    use crate::search::{Search as _, SearchSetup, Verdict};

    #[test]
    fn what_a_point_counts_for_is_stored_only_where_it_is_less_than_usual() {
        let mut search = ModelSearch::new(SearchSetup::plain(3, vec![0.5; 2], 40, Vec::new()));
        search.hear(vec![0.25, 0.75], Verdict::Cost(3.0));
        search.weigh(&[0.25, 0.75], 1.0);
        assert_eq!(search.place(0).count, 1.0);
        let stored = |search: &ModelSearch| serde_json::to_string(search).expect("plain data");
        assert!(!stored(&search).contains("lacks"));
        search.weigh(&[0.25, 0.75], 0.25);
        search.weigh(&[0.5, 0.5], 0.125);
        assert_eq!((search.seen.len(), search.place(0).count), (1, 0.25));
        assert_eq!(serde_json::from_str::<ModelSearch>(&stored(&search)).ok(), Some(search));
    }
}
