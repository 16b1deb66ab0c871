//! The configurations to run with when the daemon does not answer: those of the daemon that ran here.
//!
//! In a state it is the daemon's latest answer that ran there, else the cheapest of those that ran there. In
//! a state in which nothing ran it is the latest answer that ran in another state and failed in none. What
//! was only explored in other states is no answer.

use std::collections::VecDeque;

use crate::{Configuration, Indicators, StudySpec, checks, limits};

/// A configuration in a state, and how it did there.
#[derive(Debug)]
struct Remembered {
    indicators: Indicators,
    configuration: Configuration,
    /// The place of the daemon's last answer with it among all answers; `None` where it was only explored.
    answered: Option<u64>,
    /// The objective of its last two runs to the end, which may be one; `None` if it failed since.
    costs: Option<[f64; 2]>,
}

impl Remembered {
    /// The dearer of its last two runs, so that a cost that was read wrongly misleads for one run.
    fn cost(&self) -> Option<f64> {
        self.costs.map(|[before, last]| before.max(last))
    }
}

/// The last configurations of one study, each once for a state; what ran last comes last.
#[derive(Debug, Default)]
pub(crate) struct RememberedConfigurations {
    all: VecDeque<Remembered>,
    answers: u64,
}

impl RememberedConfigurations {
    /// A configuration ran to its end in a state, at this cost; or it could not be run. `is_answer`: the
    /// daemon answered it, and did not explore.
    pub(crate) fn note(
        &mut self,
        spec: &StudySpec,
        indicators: &Indicators,
        configuration: &Configuration,
        is_answer: bool,
        cost: Option<f64>,
    ) {
        let is_this = |one: &Remembered| {
            one.configuration == *configuration && checks::are_one_state(spec, &one.indicators, indicators)
        };
        let place = self.all.iter().position(is_this);
        let known = place.and_then(|place| self.all.remove(place));
        let (answered, before) = known.map_or((None, None), |known| (known.answered, known.costs));
        self.answers += u64::from(is_answer);
        self.all.push_back(Remembered {
            indicators: indicators.clone(),
            configuration: configuration.clone(),
            answered: if is_answer { Some(self.answers) } else { answered },
            costs: cost.map(|cost| [before.map_or(cost, |[_, last]| last), cost]),
        });
        if self.all.len() > limits::REMEMBERED_CONFIGURATIONS {
            let explored = self.all.iter().position(|one| one.answered.is_none());
            self.all.remove(explored.unwrap_or(0));
        }
    }

    /// The configuration to run in a state; `None` where only the defaults are left.
    pub(crate) fn last_good(&self, spec: &StudySpec, indicators: &Indicators) -> Option<&Configuration> {
        let is_here = |one: &&Remembered| checks::are_one_state(spec, &one.indicators, indicators);
        let (here, elsewhere): (Vec<&Remembered>, Vec<&Remembered>) = self.all.iter().partition(is_here);
        let ran: Vec<(&Remembered, f64)> =
            here.into_iter().filter_map(|one| Some((one, one.cost()?))).collect();
        let answers_here = ran.iter().map(|(one, _)| *one).filter(|one| one.answered.is_some());
        let cheapest = || ran.iter().min_by(|a, b| a.1.total_cmp(&b.1)).map(|(one, _)| *one);
        let fails = |configuration: &Configuration| {
            self.all.iter().any(|one| one.costs.is_none() && one.configuration == *configuration)
        };
        let answers =
            elsewhere.into_iter().filter(|one| one.answered.is_some() && !fails(&one.configuration));
        let latest = answers_here.max_by_key(|one| one.answered).or_else(cheapest);
        latest.or_else(|| answers.max_by_key(|one| one.answered)).map(|one| &one.configuration)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Scale, Space};

    fn spec() -> StudySpec {
        let space = Space::builder().integer("quality", -1000..=1000).default(0).build().unwrap();
        let spec = StudySpec::builder(space).indicator("size", 0.0..=100.0, Scale::Linear);
        spec.minimise("ms", 1.0).build().unwrap()
    }

    fn configuration(quality: i64) -> Configuration {
        Configuration::new().with("quality", quality)
    }

    /// A memory, and what it holds in a state.
    #[derive(Default)]
    struct Told(RememberedConfigurations);

    impl Told {
        fn note(&mut self, state: f64, quality: i64, is_answer: bool, cost: Option<f64>) {
            let indicators = Indicators::from([("size", state)]);
            self.0.note(&spec(), &indicators, &configuration(quality), is_answer, cost);
        }

        fn good(&self, state: f64) -> Option<i64> {
            let found = self.0.last_good(&spec(), &Indicators::from([("size", state)]))?;
            Some(found.integer("quality").unwrap())
        }
    }

    #[test]
    fn what_failed_is_not_handed_out_again_until_it_runs() {
        let mut memory = Told::default();
        assert_eq!(memory.good(1.0), None);
        memory.note(1.0, 1, false, Some(3.0));
        memory.note(1.0, 2, false, Some(2.0));
        memory.note(1.0, 2, false, None);
        assert_eq!(memory.good(1.0), Some(1));
        memory.note(1.0, 1, false, None);
        assert_eq!(memory.good(1.0), None);
        memory.note(1.0, 2, false, Some(2.0));
        assert_eq!(memory.good(1.0), Some(2));
    }

    #[test]
    fn what_was_explored_last_is_no_reason_to_run_it() {
        let mut memory = Told::default();
        memory.note(1.0, 1, false, Some(3.0));
        memory.note(1.0, 2, false, Some(30.0));
        assert_eq!(memory.good(1.0), Some(1), "the cheapest");
        memory.note(1.0, 3, true, Some(4.0));
        memory.note(1.0, 4, false, Some(3.5));
        assert_eq!(memory.good(1.0), Some(3), "the daemon knows more than this client");
        memory.note(1.0, 5, true, Some(4.2));
        memory.note(1.0, 3, false, Some(4.0));
        assert_eq!(memory.good(1.0), Some(5), "its latest answer");
    }

    #[test]
    fn a_state_in_which_nothing_ran_gets_answers_of_others_alone() {
        let mut memory = Told::default();
        memory.note(1.0, 1, false, Some(3.0));
        assert_eq!(memory.good(50.0), None);
        memory.note(1.0, 2, true, Some(3.0));
        memory.note(1.0, 3, true, Some(3.0));
        assert_eq!(memory.good(50.0), Some(3));
        memory.note(50.0, 3, false, None);
        assert_eq!((memory.good(50.0), memory.good(1.0)), (Some(2), Some(3)), "it fails in one state");
        assert_eq!(memory.good(90.0), Some(2), "what failed anywhere is not carried on");
    }

    #[test]
    fn a_cost_that_was_read_wrongly_misleads_for_one_run() {
        let mut memory = Told::default();
        memory.note(1.0, 1, false, Some(3.0));
        memory.note(1.0, 2, false, Some(0.0));
        assert_eq!(memory.good(1.0), Some(2));
        memory.note(1.0, 2, false, Some(9.0));
        assert_eq!(memory.good(1.0), Some(1));
    }

    #[test]
    fn it_does_not_grow_and_keeps_answers_longest() {
        let mut memory = Told::default();
        memory.note(1.0, 7, true, Some(5.0));
        for quality in 10..500 {
            memory.note(1.0, quality, false, Some(1.0));
            memory.note(1.0, -quality, false, None);
        }
        assert_eq!((memory.0.all.len(), memory.good(1.0)), (limits::REMEMBERED_CONFIGURATIONS, Some(7)));
        (10..500).for_each(|quality| memory.note(1.0, quality, true, Some(1.0)));
        assert_eq!((memory.0.all.len(), memory.good(1.0)), (limits::REMEMBERED_CONFIGURATIONS, Some(499)));
    }
}
