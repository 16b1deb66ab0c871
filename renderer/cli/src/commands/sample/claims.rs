//! The samples of a study that are complete, and those that other renderers are measuring, by trials.

use std::collections::{BTreeMap, BTreeSet};

use treewright_client::blocking::Client;
use treewright_client::{
    ClientError, Configuration, Indicators, OpenEnum, TrialQuery, TrialRecord, TrialState,
};

use treewright_renderer::tuning::sampling::{SAMPLE, SEQUENCE};

/// Number of others' open trials at which they are read again: most are complete by then.
const HELD_MAX: usize = 32;

#[derive(Clone, Debug)]
struct Held {
    name: String,
    state: Indicators,
    configuration: Configuration,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Claims {
    own: String,
    /// Numbers that are there, by sequence.
    done: BTreeMap<u32, BTreeSet<u32>>,
    /// Trials of others that are open, by number.
    held: BTreeMap<u64, Held>,
    /// The highest number of a trial that was looked at.
    seen: u64,
}

impl Claims {
    pub(super) fn new(own: &str) -> Self {
        Self { own: own.to_owned(), ..Self::default() }
    }

    /// Reads the trials handed out since the last look, and at times those that others had open.
    pub(super) fn look(&mut self, client: &Client, study: &str) -> Result<(), ClientError> {
        if self.held.len() >= HELD_MAX {
            self.look_again(client)?;
        }
        let query = TrialQuery::all().filter(format!("number > {}", self.seen));
        for trial in client.trials(study, query) {
            self.take(&trial?);
        }
        Ok(())
    }

    /// Reads again the trials that others had open, and the new ones.
    pub(super) fn look_at_held(&mut self, client: &Client, study: &str) -> Result<(), ClientError> {
        self.look_again(client)?;
        self.look(client, study)
    }

    /// A trial that cannot be read now stays held.
    fn look_again(&mut self, client: &Client) -> Result<(), ClientError> {
        let numbers: Vec<u64> = self.held.keys().copied().collect();
        for number in numbers {
            let Some(held) = self.held.get(&number) else { continue };
            match client.trial(&held.name) {
                Ok(trial) => {
                    self.held.remove(&number);
                    self.take(&trial);
                }
                Err(error) if error.is_not_found() => {
                    self.held.remove(&number);
                }
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    fn take(&mut self, trial: &TrialRecord) {
        let number = trial.number().unwrap_or_default();
        self.seen = self.seen.max(number);
        match trial.state {
            OpenEnum::Known(TrialState::Completed) => {
                if let (Some(sequence), Some(sample)) = (whole(trial, SEQUENCE), whole(trial, SAMPLE)) {
                    self.note(sequence, sample);
                }
            }
            OpenEnum::Known(TrialState::Open) if trial.client_id != self.own => {
                let held = Held {
                    name: trial.name.clone(),
                    state: trial.indicators.clone(),
                    configuration: trial.configuration.clone(),
                };
                self.held.insert(number, held);
            }
            _ => {}
        }
    }

    pub(super) fn note(&mut self, sequence: u32, sample: u32) {
        self.done.entry(sequence).or_default().insert(sample);
    }

    pub(super) fn has(&self, sequence: u32, sample: u32) -> bool {
        self.done.get(&sequence).is_some_and(|done| done.contains(&sample))
    }

    /// Number of complete samples among the first `samples`.
    pub(super) fn done(&self, sequence: u32, samples: u32) -> u64 {
        self.done.get(&sequence).map_or(0, |done| done.range(..samples).count() as u64)
    }

    pub(super) fn is_held(&self, state: &Indicators, configuration: &Configuration) -> bool {
        self.held.values().any(|held| held.configuration == *configuration && held.state == *state)
    }

    /// Whether another renderer opened the sample of this trial before it.
    pub(super) fn is_held_before(&self, own: &TrialRecord) -> bool {
        let before = self.held.range(..own.number().unwrap_or_default());
        before
            .into_iter()
            .any(|(_, held)| held.configuration == own.configuration && held.state == own.indicators)
    }
}

/// A measurement that is a whole number.
fn whole(trial: &TrialRecord, name: &str) -> Option<u32> {
    let value = trial.measurements.get(name)?;
    (value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&value)).then_some(value as u32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use treewright_client::Options;

    #[test]
    fn what_others_hold_is_not_forgotten_while_the_daemon_is_away() {
        // Port 9 is "discard"; no daemon listens there.
        let client = Client::connect("http://127.0.0.1:9", Options::new()).expect("it is an address");
        let held = |number: u64| Held {
            name: format!("studies/samples/trials/{number}"),
            state: Indicators::new(),
            configuration: Configuration::new(),
        };
        let mut claims = Claims::new("me");
        claims.held = [3, 5, 8].map(|number| (number, held(number))).into();
        assert!(claims.look_again(&client).is_err_and(|error| error.is_unreachable()));
        assert_eq!(claims.held.keys().copied().collect::<Vec<_>>(), [3, 5, 8]);
    }
}
