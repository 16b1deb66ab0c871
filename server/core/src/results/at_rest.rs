//! What the costs of a state are for people: those on the machine when nothing else runs on it.

use super::{Record, ResultTable, hash, moment};
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

    /// The cost of a configuration on the quiet machine beside an answer, whose cost there is `at_rest` if
    /// that is known. A configuration that ran too long ago or too seldom for an estimate of its own has the
    /// answer's, times the `ratio` of its cost to the answer's as far as that was found by comparing the two.
    /// Costs that are far apart in time say less: a machine that changes little by little moves the mean of
    /// the answer and leaves the other. They give the ratio only where there is no other.
    pub(crate) fn reported_beside(
        &self,
        (configuration, cost): (&Configuration, f64),
        (answer, at_rest): (&Record, Option<f64>),
        ratio: Option<f64>,
    ) -> f64 {
        if let Some(own) = self.at_rest(configuration) {
            return own;
        }
        match at_rest.filter(|_| answer.mean_cost > 0.0) {
            Some(at_rest) => (ratio.unwrap_or(cost / answer.mean_cost) * at_rest).min(f64::MAX),
            None => self.pace() * cost,
        }
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

    #[test]
    fn what_ran_too_seldom_has_the_factor_of_the_answer_beside_it() {
        let space = Space::builder().integer("a", 0..=9).default(4).build().expect("valid");
        let (default, mut table) = (space.default_configuration(), ResultTable::default());
        let answer = space.decode(&[0.0]);
        assert_ne!(answer, default);
        for number in 1..=60 {
            // Other programs run at first, and nobody takes them for the machine's speed.
            let configuration = if number == 1 { &default } else { &answer };
            let cost = if number <= 20 { 15.0 } else { 10.0 };
            let trial = Trial::new(number, "a", 1, configuration.clone(), Choice::Wanted.decided());
            let trial = Trial { outcome: Some(Outcome::Ok), cost: Some(cost), ..trial };
            table.note_pace(&trial, cost, 1.0);
            if number <= 20 {
                table.learn(&trial, &default);
            }
        }
        let known = table.at_rest(&answer).expect("other programs ran at first");
        let (record, cost) = (table.record(&answer).expect("it ran"), 20.0);
        let beside =
            |at_rest, ratio| table.reported_beside((&default, cost), (record, at_rest), ratio) / known;
        assert!((beside(Some(known), None) / (cost / 15.0) - 1.0).abs() < 0.01);
        assert!((beside(Some(known), Some(1.25)) - 1.25).abs() < 1e-12);
        assert_eq!(beside(None, Some(1.25)), table.pace() * cost / known);
        let own = table.reported_beside((&answer, cost), (record, Some(1.0)), Some(2.0));
        assert_eq!(own, known, "its own estimate counts");
    }
}
