//! After the search: its best few against the incumbent, by the service's own confirmation.
//!
//! The service asks for these trials like for any other, and says when its verdict stands. Before that it
//! gets measurements of the configurations that anybody would try, native Embree among them, so that they
//! take part.

use std::time::Duration;

use treewright_client::blocking::{Client, Study};
use treewright_client::{ClientError, Configuration, OpenEnum, Rule, Source, Standing};

use super::patience::{Patience, PatientTuner};
use super::search::{self, Iteration, SearchSetting, run_choice};
use super::{apart::Apart, verdict::Rival};
use crate::{film::Film, frame::Renderer};

/// Rounds of the configurations that anybody would try; the race has more for those that do well in them.
const ROUNDS: u32 = 2;
/// Least room of a confirmation: five contenders in ten rounds and a few more.
const TRIALS_LEAST: u32 = 60;
/// Most trials of a confirmation: ten rounds of five, thirty of two, and as much again.
const TRIALS_MAX: u32 = 220;
/// Trials without the daemon's answer after which its verdict is given up.
const UNANSWERED_MAX: u32 = 10;
/// Longest time for the reports of a stage to reach the service.
const FLUSH: Duration = Duration::from_secs(10);

/// The result of a confirmation.
#[derive(Clone, Debug)]
pub struct Confirmed {
    /// The service's best configuration.
    pub configuration: Configuration,
    /// Its standing: the gain over the start, with an interval. Absent where nothing was measured.
    pub standing: Option<Standing>,
    /// Its trials.
    pub trials: Vec<Iteration>,
}

/// Measures `known` configurations in a few interleaved rounds and reports them to the service. Then it goes
/// on with trials of the service's choice until the confirmation of the best is over, it has taken as many
/// trials as the search (`searched`), or `patience` says that the user wants no more.
///
/// # Errors
/// The service is away.
pub fn confirm(
    renderer: &mut Renderer,
    client: &Client,
    study: &Study,
    patience: Patience<'_>,
    setting: &SearchSetting,
    searched: usize,
    known: &[Rival],
) -> Result<Confirmed, ClientError> {
    let go_on = patience.go_on;
    // The search's last reports come first: these trials are for that state.
    patience.call(|| client.flush(FLUSH))?;
    tell(renderer, study, patience, setting, known)?;
    patience.call(|| client.flush(FLUSH))?;
    if !go_on() {
        return settled(study, patience, setting, Vec::new());
    }
    let mut tuner = PatientTuner::new(study, patience);
    let mut unanswered = 0;
    let wanted = |trial: &Iteration| {
        unanswered += u32::from(trial.source != Source::Daemon);
        !is_over(trial) && unanswered < UNANSWERED_MAX && go_on()
    };
    let trials_max = u32::try_from(searched).unwrap_or(TRIALS_MAX).clamp(TRIALS_LEAST, TRIALS_MAX);
    let trials = search::trials(renderer, &mut tuner, setting, trials_max, wanted)?;
    drop(tuner);
    patience.call(|| client.flush(FLUSH))?;
    settled(study, patience, setting, trials)
}

/// The service's best configuration now.
fn settled(
    study: &Study,
    patience: Patience<'_>,
    setting: &SearchSetting,
    trials: Vec<Iteration>,
) -> Result<Confirmed, ClientError> {
    let best = patience.call(|| study.best(&setting.indicators))?;
    Ok(Confirmed { configuration: best.configuration, standing: best.standing, trials })
}

/// Whether the service wants no more trials.
pub fn is_over(trial: &Iteration) -> bool {
    trial.rule == Some(OpenEnum::Known(Rule::Finished))
}

/// Measures configurations beyond the service's questions once a round; each becomes a trial.
fn tell(
    renderer: &mut Renderer,
    study: &Study,
    patience: Patience<'_>,
    setting: &SearchSetting,
    known: &[Rival],
) -> Result<(), ClientError> {
    let mut film = Film::new(setting.size);
    for _ in 0..ROUNDS {
        for rival in known {
            let Some(configuration) = &rival.configuration else { continue };
            if !(patience.go_on)() {
                return Ok(());
            }
            let trial = patience.call(|| study.trial_of(&setting.indicators, configuration))?;
            let (choice, apart) = (&rival.contender.choice, &mut Apart::default());
            let (outcome, times) = run_choice(renderer, choice, None, setting, &mut film, apart);
            trial.report(setting.measurements(times), outcome)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tuning::search::testing::trial;

    #[test]
    fn only_the_service_says_that_it_is_over() {
        let mut last = trial(Some(3.0), 4);
        assert!(!is_over(&last), "an answer without a rule is no verdict");
        last.rule = Some(OpenEnum::Known(Rule::Confirming));
        assert!(!is_over(&last));
        last.rule = Some(OpenEnum::Known(Rule::Finished));
        assert!(is_over(&last));
    }
}
