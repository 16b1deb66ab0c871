//! What the costs of a state are for people: those on the machine when nothing else runs on it.

use super::{ResultTable, hash, moment};
use crate::configuration::Configuration;
use crate::quiet::QuietCosts;
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

    /// Forgets what the costs on the quiet machine follow from, because costs are understood otherwise now.
    pub(crate) fn forget_at_rest(&mut self) {
        self.quiet = QuietCosts::default();
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decision::Choice;
    use crate::space::Space;
    use crate::trial::Outcome;

    #[test]
    fn regressions_that_are_learnt_again_and_again_leave_the_costs_at_rest() {
        let space = Space::builder().integer("a", 0..=9).default(4).build().expect("valid");
        let (default, mut table) = (space.default_configuration(), ResultTable::default());
        for number in 1..=40 {
            let cost = if number <= 20 { 15.0 } else { 10.0 };
            let trial = Trial::new(number, "a", 1, default.clone(), Choice::Wanted.decided());
            let trial = Trial { outcome: Some(Outcome::Ok), cost: Some(cost), ..trial };
            table.note_pace(&trial, cost, 1.0);
            if number % 4 == 0 {
                table.withhold(&default);
            }
            table.learn(&trial, &default);
        }
        let at_rest = table.at_rest(&default).expect("other programs ran at first");
        assert!((at_rest / 10.0 - 1.0).abs() < 0.01, "{at_rest}");
        table.forget_at_rest();
        assert_eq!(table.at_rest(&default), None);
    }
}
