//! The standing of a state's answer against its reference: proven, likely or open.
//!
//! The reference of a state is its incumbent: the study's default configuration, until another one is proven
//! better. Costs and gains are estimates with 95 % intervals, drawn towards each other by the noise of the
//! measurements. They are never the luckiest of many measurements.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::cost_view::CostView;
use crate::words::words;

/// Least probability of being better, by the paired rounds of a confirmation alone, that counts as a proof.
pub const PROVEN: f64 = 0.99;
/// Least probability of being better, by all measurements of a state, that is called likely.
pub const LIKELY: f64 = 0.8;
/// The largest gain, as a share, that counts as nothing to win.
pub const NOTHING_TO_WIN: f64 = 0.01;

words! {
    /// The standing of an answer beside the study's default configuration, for every surface.
    pub enum StandingVerdict {
        /// Better, by the paired rounds of its confirmation alone, with a probability of at least [`PROVEN`].
        /// These rounds also give the reported gain.
        Proven = "PROVEN",
        /// Better by all measurements, with a probability of at least [`LIKELY`].
        Likely = "LIKELY",
        /// Not known yet.
        Open = "OPEN",
        /// The search is over, and no configuration was shown to be better.
        NothingBetter = "NOTHING_BETTER",
        /// The search is over, and with a probability of 95 % no configuration gains more than
        /// [`NOTHING_TO_WIN`].
        NothingToWin = "NOTHING_TO_WIN",
    }
}

impl StandingVerdict {
    /// The verdict in words that fit a column of a table.
    pub fn in_short(self) -> &'static str {
        self.words().0
    }

    /// The verdict as the first half of a sentence.
    pub fn in_words(self) -> &'static str {
        self.words().1
    }

    fn words(self) -> (&'static str, &'static str) {
        match self {
            StandingVerdict::Proven => ("proven better", "it is proven to be better than the default"),
            StandingVerdict::Likely => ("likely better", "it is likely to be better than the default"),
            StandingVerdict::Open => ("open", "whether anything is better than the default is open"),
            StandingVerdict::NothingBetter => {
                ("nothing better", "nothing was shown to be better than the default")
            }
            StandingVerdict::NothingToWin => ("nothing to win", "there is nothing to win over the default"),
        }
    }
}

words! {
    /// The stage of the confirmation of a state's best configurations.
    #[derive(Default)]
    pub enum ConfirmationStage {
        /// The policy wants none.
        #[default]
        Off = "OFF",
        /// The search goes on.
        Searching = "SEARCHING",
        /// The best few run against the incumbent.
        Racing = "RACING",
        /// A challenger is the answer in the incumbent's place: it was proven better in these rounds, or is
        /// likely to be better by all measurements. The [`StandingVerdict`] says which.
        Better = "BETTER",
        /// None was shown to be better than the incumbent, which is the answer.
        NothingBetter = "NOTHING_BETTER",
    }
}

/// The gain of one configuration over another: the cost of the first lies below the other's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gain {
    /// The gain as a share of the other's cost; negative where the first is dearer.
    pub share: f64,
    /// The lower end of the 95 % interval; `None` where it is unknown.
    pub low: Option<f64>,
    /// The upper end.
    pub high: Option<f64>,
    /// The probability that it is cheaper at all, where it is known.
    pub probability_better: Option<f64>,
}

impl Gain {
    /// The gain in a study's view. Of a maximised metric it is the share by which it is above the other. An
    /// end at which the cost would be nothing says nothing of a rate.
    #[must_use]
    pub fn by(self, view: &CostView) -> Self {
        let finite = |end| Some(view.share(end)).filter(|share| share.is_finite());
        let [low, high] = [self.low, self.high].map(|end| end.and_then(finite));
        Self { share: view.share(self.share), low, high, ..self }
    }

    /// The gain with an interval that holds another estimate's interval as well. An end that one of them does
    /// not know is unknown.
    #[must_use]
    pub fn widened(self, other: Self) -> Self {
        let low = self.low.zip(other.low).map(|(one, other)| one.min(other));
        let high = self.high.zip(other.high).map(|(one, other)| one.max(other));
        Self { low, high, ..self }
    }
}

/// In percent with its interval, as in `12.3 % [10.1, 14.6]`. `?` stands for an unknown end, and for a gain
/// that is not finite.
impl fmt::Display for Gain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Adding zero makes a negative zero positive.
        let percent = |share: f64| match (1000.0 * share).round() / 10.0 + 0.0 {
            percent if percent.is_finite() => format!("{percent:.1}"),
            _ => "?".to_owned(),
        };
        write!(f, "{} %", percent(self.share))?;
        if self.low.is_none() && self.high.is_none() {
            return Ok(());
        }
        let end = |end: Option<f64>| end.map_or_else(|| "?".to_owned(), percent);
        write!(f, " [{}, {}]", end(self.low), end(self.high))
    }
}

/// The outcome of running the best few configurations of a state against its incumbent, in rounds in which
/// each is measured once. The default is that of a policy that wants none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Confirmation {
    /// The stage.
    pub stage: ConfirmationStage,
    /// The number of rounds that the incumbent has run.
    pub rounds: u64,
    /// The most that it may run.
    pub rounds_max: u64,
    /// The number of measurements in all.
    pub measurements: u64,
    /// The gain of the answer over the default by these rounds alone, or over the incumbent where the default
    /// did not run in them. Its interval holds at any time.
    pub gain: Option<Gain>,
}

impl Confirmation {
    /// Whether it is final, so that a client that waits for a verdict has it.
    pub fn is_over(&self) -> bool {
        matches!(
            self.stage,
            ConfirmationStage::Off | ConfirmationStage::Better | ConfirmationStage::NothingBetter
        )
    }
}

/// The standing of a state's answer. By default nothing is known but its cost, which is 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Standing {
    /// The cost of the answer, in the objective's units, with its 95 % interval.
    pub cost: f64,
    /// The lower end of the interval.
    pub cost_low: f64,
    /// The upper end.
    pub cost_high: f64,
    /// Its gain over the study's default configuration; `None` where that was not measured in the state.
    pub gain: Option<Gain>,
    /// The answer is the incumbent. While the state is searched, no other configuration is worth its risk;
    /// afterwards, none is proven better.
    pub nothing_better: bool,
    /// The state of its confirmation.
    pub confirmation: Confirmation,
    /// The number of jumps of clients' machines while the state was measured.
    pub disturbances: u64,
    /// The most that any other configuration may gain over the answer, with a probability of 95 %, as a
    /// share; `None` where it is unknown.
    pub gain_at_most: Option<f64>,
}

impl Standing {
    /// The standing of the answer beside the default.
    pub fn verdict(&self) -> StandingVerdict {
        let stage = self.confirmation.stage;
        let by_rounds = self.confirmation.gain;
        let is_proven = by_rounds.is_some_and(|gain| match gain.probability_better {
            Some(probability) => probability >= PROVEN,
            // An earlier version of the daemon does not send it.
            None => gain.low.is_some_and(|low| low > 0.0),
        });
        let probability = self.gain.and_then(|gain| gain.probability_better);
        if stage == ConfirmationStage::Better && is_proven {
            StandingVerdict::Proven
        } else if probability.is_some_and(|probability| probability >= LIKELY) {
            StandingVerdict::Likely
        } else if stage != ConfirmationStage::NothingBetter {
            StandingVerdict::Open
        } else if self.gain_at_most.is_some_and(|most| most <= NOTHING_TO_WIN) {
            StandingVerdict::NothingToWin
        } else {
            StandingVerdict::NothingBetter
        }
    }

    /// The verdict in a few words that fit a column of a table; for an open one, the present stage.
    pub fn in_short(&self) -> &'static str {
        match (self.verdict(), self.confirmation.stage) {
            (_, ConfirmationStage::Racing) => "confirming",
            (StandingVerdict::Open, ConfirmationStage::Searching) => "searching",
            (verdict, _) => verdict.in_short(),
        }
    }

    /// The verdict with its probability, as a sentence for people, without its full stop. Gains are shares of
    /// the cost.
    pub fn sentence(&self) -> String {
        self.sentence_by(&CostView::default())
    }

    /// [`Standing::sentence`] with gains in a study's view of costs.
    pub fn sentence_by(&self, view: &CostView) -> String {
        let Confirmation { rounds, rounds_max, measurements, gain, .. } = self.confirmation;
        let verdict = self.verdict();
        let mut text = verdict.in_words().to_owned();
        let shown = if verdict == StandingVerdict::Proven { gain } else { self.gain };
        let probability = shown.and_then(|gain| gain.probability_better);
        match (verdict, probability) {
            (StandingVerdict::Proven, _) => text += &format!(" in {rounds} paired rounds"),
            (StandingVerdict::Likely, Some(probability)) => {
                text += &format!(", with probability {probability:.2}")
            }
            _ => {}
        }
        match (verdict, shown, self.gain_at_most) {
            (StandingVerdict::Proven | StandingVerdict::Likely, Some(gain), _) => {
                text += &format!(", by {}", gain.by(view));
            }
            (StandingVerdict::NothingBetter | StandingVerdict::NothingToWin, _, Some(most))
                if view.share(most).is_finite() =>
            {
                text += &format!(": at most {} % with 95 %", view.percent(most));
            }
            _ => {}
        }
        match self.confirmation.stage {
            ConfirmationStage::Off => text += "; the policy wants no confirmation",
            ConfirmationStage::Searching => text += "; the search goes on",
            ConfirmationStage::Racing => {
                text += &format!("; confirmation goes on, {rounds} of at most {rounds_max} rounds are run");
            }
            ConfirmationStage::Better if verdict == StandingVerdict::Proven => {}
            ConfirmationStage::Better | ConfirmationStage::NothingBetter => {
                text += &format!("; {rounds} rounds of {measurements} measurements leave it at that");
            }
        }
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

    fn gain(probability: Option<f64>) -> Option<Gain> {
        let (low, high) = (Some(0.101), Some(0.146));
        Some(Gain { share: 0.123, low, high, probability_better: probability })
    }

    fn standing(stage: ConfirmationStage, by_all: f64, by_rounds: Option<f64>) -> Standing {
        let gain_of_rounds = by_rounds.and_then(|probability| gain(Some(probability)));
        let confirmation =
            Confirmation { stage, rounds: 4, rounds_max: 10, measurements: 16, gain: gain_of_rounds };
        Standing {
            cost: 4.0,
            cost_low: 3.9,
            cost_high: 4.1,
            gain: gain(Some(by_all)),
            nothing_better: stage == ConfirmationStage::NothingBetter,
            confirmation,
            disturbances: 0,
            gain_at_most: Some(0.034),
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
    fn a_gain_is_widened_by_what_another_estimate_holds() {
        let gain = |share, low, high| Gain { share, low, high, probability_better: Some(0.9) };
        let own = gain(0.1, Some(0.05), Some(0.15));
        assert_eq!(
            own.widened(gain(0.02, Some(-0.1), Some(0.12))),
            gain(0.1, Some(-0.1), Some(0.15)),
            "the share stays"
        );
        assert_eq!(own.widened(gain(0.2, None, Some(0.3))), gain(0.1, None, Some(0.3)));
    }

    #[test]
    fn a_rate_whose_cost_would_be_nothing_has_no_end() {
        let rate = CostView::maximising("fps", 1.0);
        let printed = |share, low, high| {
            let gain = Gain { share, low: Some(low), high: Some(high), probability_better: None };
            gain.by(&rate).to_string()
        };
        assert_eq!(printed(0.75, 0.5, 1.0), "300.0 % [100.0, ?]");
        assert_eq!(printed(1.0, 0.5, 1.0), "? % [100.0, ?]");
    }

    #[test]
    fn each_verdict_has_one_meaning() {
        use ConfirmationStage::{Better, NothingBetter, Off, Racing, Searching};
        for (stage, by_all, by_rounds, verdict, in_short) in [
            (Better, 0.999, Some(0.995), StandingVerdict::Proven, "proven better"),
            // All measurements together are no proof.
            (Better, 0.999, Some(0.97), StandingVerdict::Likely, "likely better"),
            (Better, 0.97, None, StandingVerdict::Likely, "likely better"),
            (Searching, 0.999, None, StandingVerdict::Likely, "likely better"),
            (Searching, 0.79, None, StandingVerdict::Open, "searching"),
            (Searching, 0.0, None, StandingVerdict::Open, "searching"),
            (Racing, 0.9, Some(0.995), StandingVerdict::Likely, "confirming"),
            (Racing, 0.3, None, StandingVerdict::Open, "confirming"),
            (Off, 0.9, None, StandingVerdict::Likely, "likely better"),
            (Off, 0.5, None, StandingVerdict::Open, "open"),
            (NothingBetter, 0.31, None, StandingVerdict::NothingBetter, "nothing better"),
            // The incumbent of other states, which this state's own rounds do not prove.
            (NothingBetter, 0.9, Some(0.995), StandingVerdict::Likely, "likely better"),
        ] {
            let one = standing(stage, by_all, by_rounds);
            assert_eq!((one.verdict(), one.in_short()), (verdict, in_short), "{one:?}");
        }
        let none = standing(NothingBetter, 0.0, None);
        let to_win = |most| Standing { gain_at_most: Some(most), ..none }.verdict();
        assert_eq!(
            (to_win(0.01), to_win(0.011)),
            (StandingVerdict::NothingToWin, StandingVerdict::NothingBetter)
        );
        // One run of a configuration, and none of the default.
        let alone = Standing { gain: None, ..standing(Searching, 1.0, None) };
        assert_eq!(alone.verdict(), StandingVerdict::Open);
    }

    #[test]
    fn sentences_say_what_is_known_with_its_probability_and_what_goes_on() {
        let said = |stage, by_all, by_rounds| standing(stage, by_all, by_rounds).sentence();
        assert_eq!(
            said(ConfirmationStage::Better, 0.999, Some(0.995)),
            "it is proven to be better than the default in 4 paired rounds, by 12.3 % [10.1, 14.6]"
        );
        assert_eq!(
            said(ConfirmationStage::Searching, 0.9, None),
            "it is likely to be better than the default, with probability 0.90, by 12.3 % [10.1, 14.6]; the search goes on"
        );
        assert_eq!(
            said(ConfirmationStage::NothingBetter, 0.3, None),
            "nothing was shown to be better than the default: at most 3.4 % with 95 %; 4 rounds of 16 measurements leave it at that"
        );
        let racing = said(ConfirmationStage::Racing, 0.5, None);
        assert!(racing.contains("is open; confirmation goes on, 4 of at most 10 rounds"), "{racing}");
        let rate = standing(ConfirmationStage::Better, 0.999, Some(0.995));
        let rate = rate.sentence_by(&CostView::maximising("fps", 1.0));
        assert!(rate.ends_with("by 14.0 % [11.2, 17.1]"), "shares of the default's rate: {rate}");
        let unknown =
            Standing { gain_at_most: Some(1.0), ..standing(ConfirmationStage::NothingBetter, 0.3, None) };
        let unknown = unknown.sentence_by(&CostView::maximising("fps", 1.0));
        assert!(unknown.starts_with("nothing was shown to be better than the default; 4"), "{unknown}");
        let jumped = Standing { disturbances: 2, ..standing(ConfirmationStage::Searching, 0.5, None) };
        assert!(jumped.sentence().ends_with("jumped 2 times meanwhile"));
    }
}
