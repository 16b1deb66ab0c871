//! Paired trials: the incumbent and a challenger in turn, so that a disturbance of the machine hits both.
//!
//! The ratio of two frames that run one after the other is steadier than their costs, which drift with the
//! clock, the heat and the neighbours. Both are reported like any other trial, so the service's estimates
//! rest on them, too.

use crate::{ClientError, Configuration, Indicators, Study, Suggestion};

/// Which of a pair runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The configuration in use today.
    Incumbent,
    /// The configuration that may be better.
    Challenger,
}

/// The order within two pairs: a steady growth, such as that of heat, harms both equally.
const ORDER: [Side; 4] = [Side::Incumbent, Side::Challenger, Side::Challenger, Side::Incumbent];

/// Trials of two configurations in turn; see [`Study::paired`].
#[derive(Debug)]
pub struct Paired {
    study: Study,
    indicators: Indicators,
    incumbent: Configuration,
    challenger: Configuration,
    asked: usize,
}

impl Paired {
    pub(crate) fn new(
        study: &Study,
        indicators: &Indicators,
        incumbent: &Configuration,
        challenger: &Configuration,
    ) -> Self {
        let (incumbent, challenger) = (incumbent.clone(), challenger.clone());
        Self { study: study.clone(), indicators: indicators.clone(), incumbent, challenger, asked: 0 }
    }

    /// The next trial, and whose it is. It is reported like any other; after each two there is one more pair.
    ///
    /// # Errors
    /// As for [`Study::trial_of`]; the next call asks for that side again.
    pub async fn ask(&mut self) -> Result<(Side, Suggestion), ClientError> {
        let side = ORDER[self.asked % ORDER.len()];
        let configuration = match side {
            Side::Incumbent => &self.incumbent,
            Side::Challenger => &self.challenger,
        };
        let suggestion = self.study.trial_of(&self.indicators, configuration).await?;
        self.asked += 1;
        Ok((side, suggestion))
    }
}
