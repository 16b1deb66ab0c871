//! How the answer of a state stands against its reference: what is proven, and what is only hoped for.
//!
//! The reference of a state is its incumbent: the study's default configuration, until another one is proven better. Costs
//! and gains are estimates with 95 % intervals, drawn towards each other as far as the measurements are noisy, never the
//! luckiest of many measurements.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::words::words;

/// The probability of being better that counts as a proof.
pub const PROVEN: f64 = 0.95;

words! {
    /// How far the confirmation of a state's best configurations is.
    pub enum ConfirmationStage {
        /// The policy wants none.
        Off = "OFF",
        /// The search goes on.
        Searching = "SEARCHING",
        /// The best few run against the incumbent.
        Racing = "RACING",
        /// A challenger was proven better than the incumbent, and is the answer.
        Better = "BETTER",
        /// None was proven better than the incumbent, which is the answer.
        NothingBetter = "NOTHING_BETTER",
    }
}

/// By how much the cost of one configuration lies below that of another.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gain {
    /// As a share of the other's cost; negative where it is dearer.
    pub share: f64,
    /// The lower end of the 95 % interval; `None` where nothing is known of it.
    pub low: Option<f64>,
    /// The upper end.
    pub high: Option<f64>,
    /// The probability that it is cheaper at all, where it can be told.
    pub probability_better: Option<f64>,
}

/// In percent with its interval, as in `12.3 % [10.1, 14.6]`; `?` stands for an end of which nothing is known.
impl fmt::Display for Gain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Adding zero makes a negative zero positive.
        let percent = |share: f64| format!("{:.1}", (1000.0 * share).round() / 10.0 + 0.0);
        write!(f, "{} %", percent(self.share))?;
        if self.low.is_none() && self.high.is_none() {
            return Ok(());
        }
        let end = |end: Option<f64>| end.map_or_else(|| "?".to_owned(), percent);
        write!(f, " [{}, {}]", end(self.low), end(self.high))
    }
}

/// What came of running the best few configurations of a state against its incumbent, in rounds in which each is
/// measured once.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Confirmation {
    /// How far it is.
    pub stage: ConfirmationStage,
    /// How many rounds the incumbent has run.
    pub rounds: u64,
    /// The most that it may run.
    pub rounds_max: u64,
    /// How many measurements there were in all.
    pub measurements: u64,
    /// Of the winner over the incumbent, by these rounds alone: its interval holds at whichever moment one looks.
    pub gain: Option<Gain>,
}

impl Confirmation {
    /// Whether it will not change any more, so that a client that waits for a verdict has it.
    pub fn is_over(&self) -> bool {
        matches!(
            self.stage,
            ConfirmationStage::Off | ConfirmationStage::Better | ConfirmationStage::NothingBetter
        )
    }
}

/// How the answer of a state stands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Standing {
    /// The cost of the answer, in the objective's units, with its 95 % interval.
    pub cost: f64,
    /// The lower end of the interval.
    pub cost_low: f64,
    /// The upper end.
    pub cost_high: f64,
    /// Its gain over the study's default configuration; `None` where that was not measured in the state.
    pub gain: Option<Gain>,
    /// The answer is the incumbent: nothing is worth to be answered in its place while the state is searched, and nothing is
    /// proven better once that has ended.
    pub nothing_better: bool,
    /// How far its confirmation is.
    pub confirmation: Confirmation,
    /// How often the speed of a client's machine was found to have jumped while the state was measured.
    pub disturbances: u64,
}

impl Standing {
    /// Whether the answer is proven to cost less than the default. What is answered while the search goes on need not be: it is
    /// enough that much more is to be gained by it than lost.
    pub fn is_proven(&self) -> bool {
        let probability = self.gain.and_then(|gain| gain.probability_better);
        !self.nothing_better && probability.is_some_and(|probability| probability >= PROVEN)
    }

    /// What is proven, in a few words that fit a column of a table.
    pub fn in_short(&self) -> &'static str {
        match (self.confirmation.stage, self.nothing_better) {
            (ConfirmationStage::Racing, _) => "confirming",
            (ConfirmationStage::Searching, true) => "searching",
            (ConfirmationStage::Searching | ConfirmationStage::Off, false) if self.is_proven() => {
                "proven better"
            }
            (ConfirmationStage::Searching | ConfirmationStage::Off, false) => "likely better",
            (ConfirmationStage::Better, _) => "proven better",
            (ConfirmationStage::Off | ConfirmationStage::NothingBetter, _) => "nothing better",
        }
    }

    /// What is proven, as a sentence for people, without its full stop.
    pub fn verdict(&self) -> String {
        let Confirmation { rounds, rounds_max, measurements, gain, .. } = self.confirmation;
        let known = match (self.nothing_better, self.is_proven()) {
            (true, _) => "nothing is proven better than the incumbent",
            (false, true) => "it is proven better than the default",
            (false, false) => "it is likely to be better than the default",
        };
        let mut text = match self.confirmation.stage {
            ConfirmationStage::Off => format!("{known}; the policy wants no confirmation"),
            ConfirmationStage::Searching => format!("{known} so far; the search goes on"),
            ConfirmationStage::Racing => {
                format!(
                    "{known} so far; confirmation goes on, {rounds} of at most {rounds_max} rounds are run"
                )
            }
            ConfirmationStage::Better => match gain {
                None => format!("confirmed as better in {rounds} rounds"),
                Some(gain) if gain.low.is_some_and(|low| low > 0.0) => {
                    format!("confirmed as better in {rounds} rounds, {gain} below the incumbent")
                }
                // What the rounds leave open was settled by all that was measured.
                Some(gain) => format!(
                    "proven better by all measurements together; the {rounds} rounds of confirmation alone say {gain} below the incumbent"
                ),
            },
            ConfirmationStage::NothingBetter => format!(
                "nothing was proven better than the incumbent in {rounds} rounds of {measurements} measurements"
            ),
        };
        match self.disturbances {
            0 => {}
            1 => text += "; the speed of a machine jumped once meanwhile",
            often => text += &format!("; the speed of a machine jumped {often} times meanwhile"),
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn standing(stage: ConfirmationStage, nothing_better: bool) -> Standing {
        let gain = Gain { share: 0.123, low: Some(0.101), high: Some(0.146), probability_better: Some(0.99) };
        let confirmation =
            Confirmation { stage, rounds: 4, rounds_max: 10, measurements: 16, gain: Some(gain) };
        let (cost, cost_low, cost_high) = (4.0, 3.9, 4.1);
        Standing {
            cost,
            cost_low,
            cost_high,
            gain: Some(gain),
            nothing_better,
            confirmation,
            disturbances: 2,
        }
    }

    #[test]
    fn a_gain_tells_its_interval_as_far_as_it_is_known() {
        let gain = |share, low, high| Gain { share, low, high, probability_better: None }.to_string();
        assert_eq!(gain(0.1234, Some(0.101), Some(0.146)), "12.3 % [10.1, 14.6]");
        assert_eq!(gain(-0.02, None, Some(0.05)), "-2.0 % [?, 5.0]");
        assert_eq!(gain(-0.000_001, None, None), "0.0 %");
    }

    #[test]
    fn a_verdict_says_what_is_proven_and_what_goes_on() {
        let racing = standing(ConfirmationStage::Racing, true);
        assert_eq!(racing.in_short(), "confirming");
        assert!(racing.verdict().contains("4 of at most 10 rounds"), "{}", racing.verdict());
        assert!(racing.verdict().ends_with("jumped 2 times meanwhile"));
        let better = standing(ConfirmationStage::Better, false);
        assert_eq!(better.in_short(), "proven better");
        assert!(better.verdict().contains("12.3 % [10.1, 14.6] below the incumbent"));
        let wide = Gain { low: Some(-0.172), high: Some(0.274), share: 0.077, probability_better: None };
        let mut by_all = better;
        by_all.confirmation.gain = Some(wide);
        let said = by_all.verdict();
        assert!(
            said.starts_with("proven better by all measurements") && said.contains("[-17.2, 27.4]"),
            "{said}"
        );
        let nothing = standing(ConfirmationStage::NothingBetter, true);
        assert_eq!(nothing.in_short(), "nothing better");
        assert!(nothing.verdict().starts_with("nothing was proven better"));
        let searching = Standing { disturbances: 0, ..standing(ConfirmationStage::Searching, true) };
        assert!(searching.verdict().ends_with("the search goes on"));
        let found = standing(ConfirmationStage::Searching, false);
        assert_eq!(found.in_short(), "proven better");
        let gain = found.gain.map(|gain| Gain { probability_better: Some(0.9), ..gain });
        let likely = Standing { gain, ..found };
        assert_eq!(likely.in_short(), "likely better");
        assert!(likely.verdict().starts_with("it is likely to be better"), "{}", likely.verdict());
    }
}
