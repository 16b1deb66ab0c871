//! What the costs of a state are for people: those on the machine when nothing else runs on it.

use super::{ResultTable, hash, moment};
use crate::configuration::Configuration;
use crate::trial::Trial;

impl ResultTable {
    /// Notes the cost of a trial that is about to be learnt, and the factor of the machine's speed by which
    /// it is divided then.
    pub fn note_pace(&mut self, trial: &Trial, cost: f64, factor: f64) {
        self.pace.note(factor, self.noise().unwrap_or(0.0));
        let is_known = self.record(&trial.configuration).is_some_and(|record| record.measurements > 0);
        if let Some(moment) = moment(trial).filter(|_| is_known) {
            self.quiet.note(hash(&trial.configuration), moment, cost);
        }
    }

    /// The factor that converts costs to those of the machine at its fastest; at most 1.
    pub fn pace(&self) -> f64 {
        self.pace.factor()
    }

    /// The cost of a configuration on the quiet machine. `None` where the machine was steady or the
    /// configuration ran too seldom: then its cost here times the [pace](Self::pace) is that.
    pub fn at_rest(&self, configuration: &Configuration) -> Option<f64> {
        self.quiet.cost(hash(configuration))
    }

    /// The cost of a configuration on the quiet machine, where its cost here is known.
    pub fn reported(&self, configuration: &Configuration, cost: f64) -> f64 {
        self.at_rest(configuration).unwrap_or_else(|| self.pace() * cost)
    }
}
