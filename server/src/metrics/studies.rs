//! Figures of single studies. Their names are labels that clients choose. So only the studies used last are
//! shown, each with a fixed number of series, and all series are made at every request.

use std::sync::atomic::AtomicU64;

use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::{Registry, Unit};

use super::Labels;
use super::study::{MODES, StudyFigures};
use crate::limits::STUDIES_SHOWN;

type FloatCounter = Counter<f64, AtomicU64>;
type FloatGauge = Gauge<f64, AtomicU64>;

figures! {
    pub(super) struct StudyFamilies {
        trials: Family<Labels<1, String>, Gauge>, "study_trials", "Trials that a study handed out in all";
        states: Family<Labels<1, String>, Gauge>, "study_states", "States that a study has met";
        open_leases: Family<Labels<1, String>, Gauge>, "study_open_leases", "Trials of a study under a lease";
        expired_leases: Family<Labels<1, String>, Counter>,
            "study_expired_leases", "Leases of a study that ran out, since it came into memory";
        frames: Family<Labels<2, String>, Counter>,
            "study_frames", "Reported frames with a cost, since the study came into memory";
        cost: Family<Labels<2, String>, FloatCounter>, "study_cost",
            "What these frames cost, in units of the objective, for shares of it; of what is maximised, the \
             sum of reciprocals";
        maximised: Family<Labels<3, String>, FloatCounter>, "study_maximised",
            "What these frames reached of the metric that a study maximises, in its own unit; higher is better";
        regret: Family<Labels<2, String>, FloatCounter>, "study_regret",
            "What these frames cost above the best known of their state at that time";
        model_error: Family<Labels<2, String>, FloatGauge>, "study_model_error",
            "Mean relative error of a predictor on trials it had not learnt, as the absolute natural logarithm";
        model_age: Family<Labels<1, String>, FloatGauge>,
            "study_model_age", "Since the study's models last learnt", Seconds;
        unsaved_trials: Family<Labels<1, String>, Gauge>,
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
            let study = ("study", study.clone());
            let label = [study.clone()];
            self.trials.get_or_create(&label).set(count(statistics.trials));
            self.states.get_or_create(&label).set(count(statistics.states));
            self.open_leases.get_or_create(&label).set(count(statistics.open_trials));
            self.unsaved_trials.get_or_create(&label).set(count(*unsaved_trials));
            self.expired_leases.get_or_create(&label).inc_by(tally.expired);
            if let Some(age_ms) = model_age_ms {
                self.model_age.get_or_create(&label).set(*age_ms as f64 / 1000.0);
            }
            for (place, (_, mode)) in MODES.iter().enumerate() {
                let mode = ("mode", (*mode).to_owned());
                let label = [study.clone(), mode.clone()];
                self.frames.get_or_create(&label).inc_by(tally.frames[place]);
                self.cost.get_or_create(&label).inc_by(tally.cost[place]);
                self.regret.get_or_create(&label).inc_by(tally.regret[place]);
                if let Some(metric) = maximised {
                    let label = [study.clone(), mode, ("metric", metric.clone())];
                    self.maximised.get_or_create(&label).inc_by(tally.reached[place]);
                }
            }
            for (predictor, error) in errors {
                let label = [study.clone(), ("predictor", (*predictor).to_owned())];
                self.model_error.get_or_create(&label).set(*error);
            }
        }
    }
}
