//! Figures of single studies. Their names are labels that clients choose. So only the studies used last are
//! shown, each with a fixed number of series, and all series are made at every request.

use std::sync::atomic::AtomicU64;

use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::{Registry, Unit};

use super::study::{MODES, StudyFigures};
use crate::limits::STUDIES_SHOWN;

#[derive(Clone, Debug, Hash, PartialEq, Eq, EncodeLabelSet)]
pub(super) struct StudyLabel {
    study: String,
}

#[derive(Clone, Debug, Hash, PartialEq, Eq, EncodeLabelSet)]
pub(super) struct ModeLabel {
    study: String,
    mode: &'static str,
}

#[derive(Clone, Debug, Hash, PartialEq, Eq, EncodeLabelSet)]
pub(super) struct MaximisedLabel {
    study: String,
    mode: &'static str,
    metric: String,
}

#[derive(Clone, Debug, Hash, PartialEq, Eq, EncodeLabelSet)]
pub(super) struct PredictorLabel {
    study: String,
    predictor: &'static str,
}

type FloatCounter = Counter<f64, AtomicU64>;
type FloatGauge = Gauge<f64, AtomicU64>;

figures! {
    pub(super) struct StudyFamilies {
        trials: Family<StudyLabel, Gauge>, "study_trials", "Trials that a study handed out in all";
        states: Family<StudyLabel, Gauge>, "study_states", "States that a study has met";
        open_leases: Family<StudyLabel, Gauge>, "study_open_leases", "Trials of a study under a lease";
        expired_leases: Family<StudyLabel, Counter>,
            "study_expired_leases", "Leases of a study that ran out, since it came into memory";
        frames: Family<ModeLabel, Counter>,
            "study_frames", "Reported frames with a cost, since the study came into memory";
        cost: Family<ModeLabel, FloatCounter>, "study_cost",
            "What these frames cost, in units of the objective, for shares of it; of what is maximised, the \
             sum of reciprocals";
        maximised: Family<MaximisedLabel, FloatCounter>, "study_maximised",
            "What these frames reached of the metric that a study maximises, in its own unit; higher is better";
        regret: Family<ModeLabel, FloatCounter>, "study_regret",
            "What these frames cost above the best known of their state at that time";
        model_error: Family<PredictorLabel, FloatGauge>, "study_model_error",
            "Mean relative error of a predictor on trials it had not learnt, as the absolute natural logarithm";
        model_age: Family<StudyLabel, FloatGauge>,
            "study_model_age", "Since the study's models last learnt", Seconds;
        unsaved_trials: Family<StudyLabel, Gauge>,
            "study_unsaved_trials", "Completed trials that the last checkpoint does not cover";
    }
}

impl StudyFamilies {
    /// Shows these studies and no others.
    pub(super) fn show(&self, figures: &[StudyFigures]) {
        debug_assert!(figures.len() <= usize::from(STUDIES_SHOWN), "{} studies are shown", figures.len());
        for family in [&self.trials, &self.states, &self.open_leases, &self.unsaved_trials] {
            family.clear();
        }
        for family in [&self.cost, &self.regret] {
            family.clear();
        }
        self.maximised.clear();
        self.expired_leases.clear();
        self.frames.clear();
        self.model_error.clear();
        self.model_age.clear();
        let count = |count: u64| i64::try_from(count).unwrap_or(i64::MAX);
        for figures in figures {
            let StudyFigures { study, statistics, tally, maximised, errors, unsaved_trials, model_age_ms } =
                figures;
            let label = StudyLabel { study: study.clone() };
            self.trials.get_or_create(&label).set(count(statistics.trials));
            self.states.get_or_create(&label).set(count(statistics.states));
            self.open_leases.get_or_create(&label).set(count(statistics.open_trials));
            self.unsaved_trials.get_or_create(&label).set(count(*unsaved_trials));
            self.expired_leases.get_or_create(&label).inc_by(tally.expired);
            if let Some(age_ms) = model_age_ms {
                self.model_age.get_or_create(&label).set(*age_ms as f64 / 1000.0);
            }
            for (place, (_, mode)) in MODES.iter().enumerate() {
                let label = ModeLabel { study: study.clone(), mode };
                self.frames.get_or_create(&label).inc_by(tally.frames[place]);
                self.cost.get_or_create(&label).inc_by(tally.cost[place]);
                self.regret.get_or_create(&label).inc_by(tally.regret[place]);
                if let Some(metric) = maximised {
                    let label = MaximisedLabel { study: study.clone(), mode, metric: metric.clone() };
                    self.maximised.get_or_create(&label).inc_by(tally.reached[place]);
                }
            }
            for (predictor, error) in errors {
                let label = PredictorLabel { study: study.clone(), predictor };
                self.model_error.get_or_create(&label).set(*error);
            }
        }
    }
}
