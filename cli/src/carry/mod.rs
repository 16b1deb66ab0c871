//! Results on their way from one database to another: exports, imports, and copies of studies.
//!
//! A carried trial is never run again. It enters the study as a trial that its client wanted, with the result
//! that it had elsewhere, its machine, and its origin, `SITE/studies/ID@UID/trials/NUMBER`. The UID and the
//! number identify it even after site or study are renamed. So an import can be repeated, and databases can
//! be merged in any order. A trial that began in this study is skipped only while the study still holds it:
//! trials can have been removed, and databases restored.

pub(crate) mod csv_table;
pub(crate) mod foreign;
#[cfg(test)]
mod hostile;
pub(crate) mod jsonl;
pub(crate) mod optuna;
#[cfg(feature = "parquet")]
pub(crate) mod parquet_table;
mod table;
pub(crate) mod vizier;

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};
use treewright_client::blocking::Client;
use treewright_client::{
    Configuration, Domain, Fingerprint, Indicators, Measurements, OpenEnum, Outcome, Question, Space,
    StudyRecord, StudySpec, TrialQuery, TrialRecord, Value,
};

use crate::failure::{Failure, Result};
use crate::progress;

/// Prefix of the client's name in a carried trial.
const CARRIED: &str = "import:";
/// Longest name of a client, in characters.
const CLIENT_CHARACTERS: usize = 128;
/// Floating-point numbers up to this one hold every whole number.
const WHOLE_MAX: f64 = 9_007_199_254_740_992.0;
/// Number of trials between lines of progress.
const SHOW_EVERY: u64 = 100;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct CarriedTrial {
    /// Where it was measured.
    pub(crate) origin: String,
    pub(crate) client_id: String,
    pub(crate) indicators: BTreeMap<String, f64>,
    pub(crate) configuration: Configuration,
    pub(crate) measurements: BTreeMap<String, f64>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) standard_errors: BTreeMap<String, f64>,
    pub(crate) outcome: Outcome,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) cost: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) fingerprint: Option<Fingerprint>,
    /// When it was reported, RFC 3339.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) complete_time: Option<String>,
    /// Why it is excluded where it was measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) exclusion: Option<String>,
}

impl CarriedTrial {
    /// One of which nothing is known yet but where it was measured.
    pub(crate) fn new(origin: String, client_id: &str) -> Self {
        Self {
            origin,
            client_id: client_id.to_owned(),
            indicators: BTreeMap::new(),
            configuration: Configuration::new(),
            measurements: BTreeMap::new(),
            standard_errors: BTreeMap::new(),
            outcome: Outcome::Ok,
            cost: None,
            fingerprint: None,
            complete_time: None,
            exclusion: None,
        }
    }

    /// A trial with a result that says something of its configuration; `None` for any other, for what repeats
    /// a run of a front, and at a cheaper level.
    pub(crate) fn of(trial: &TrialRecord, site: &str) -> Option<Self> {
        let outcome = match &trial.outcome {
            Some(OpenEnum::Known(Outcome::Failed { .. }) | OpenEnum::Unrecognised(_)) | None => return None,
            Some(OpenEnum::Known(outcome)) => outcome.clone(),
        };
        if !trial.unreadable.is_empty() || trial.repeats_a_run() || trial.fidelity.is_some() {
            return None;
        }
        let time = |time| humantime::format_rfc3339_millis(time).to_string();
        let named = |numbers: &Measurements| -> BTreeMap<String, f64> {
            numbers.iter().map(|(name, value)| (name.to_owned(), value)).collect()
        };
        Some(Self {
            origin: origin(trial, site),
            client_id: client_id(trial).to_owned(),
            indicators: trial.indicators.iter().map(|(name, value)| (name.to_owned(), value)).collect(),
            configuration: trial.configuration.clone(),
            measurements: named(&trial.measurements),
            standard_errors: named(&trial.standard_errors),
            outcome,
            cost: trial.cost,
            // An import has to send one, and one that says nothing is none.
            fingerprint: trial.fingerprint.clone().filter(|machine| *machine != Fingerprint::default()),
            complete_time: trial.complete_time.map(time),
            exclusion: trial.exclusion.clone(),
        })
    }
}

/// Where a trial was measured: elsewhere, or in this database, which is called `site`.
fn origin(trial: &TrialRecord, site: &str) -> String {
    trial.origin.clone().unwrap_or_else(|| format!("{site}/{}", trial.name))
}

/// The part of an origin that identifies a trial: from the study's identity on, where the origin has one.
fn key(origin: &str) -> &str {
    let is_key = |rest: &str| {
        rest.split_once("/trials/")
            .is_some_and(|(uid, _)| uid.len() == 16 && uid.bytes().all(|byte| byte.is_ascii_hexdigit()))
    };
    origin.rsplit_once('@').map(|(_, rest)| rest).filter(|rest| is_key(rest)).unwrap_or(origin)
}

/// The client that measured a trial, here or elsewhere.
fn client_id(trial: &TrialRecord) -> &str {
    let carried = trial.origin.as_ref().and_then(|_| trial.client_id.strip_prefix(CARRIED));
    carried.unwrap_or(&trial.client_id)
}

/// Counts of the fates of an import's trials.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Tally {
    /// The study that they went into.
    pub(crate) study: String,
    pub(crate) imported: u64,
    /// There already, from here or from an earlier import.
    pub(crate) known: u64,
    /// Not added, because they are excluded where they come from.
    pub(crate) excluded: u64,
    /// Cannot be trials of this study.
    pub(crate) misfits: u64,
    /// Why the first of these cannot.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) first_misfit: Option<String>,
    /// Nothing was written.
    pub(crate) dry_run: bool,
}

impl Tally {
    pub(crate) fn words(&self) -> String {
        let would = if self.dry_run { "would be added" } else { "added" };
        let mut text =
            format!("{}: {} trial(s) {would}, {} already known", self.study, self.imported, self.known);
        if self.excluded > 0 {
            text += &format!(", {} excluded", self.excluded);
        }
        if self.misfits > 0 {
            let first = self.first_misfit.as_deref().unwrap_or_default();
            text += &format!(", {} do not fit (the first: {first})", self.misfits);
        }
        text + "\n"
    }
}

pub(crate) struct Importer<'a> {
    client: &'a Client,
    study: &'a str,
    spec: &'a StudySpec,
    space_revision: u32,
    /// The name of this database.
    site: String,
    /// The study, named with its identity.
    name: String,
    /// Prefixes of this study's origins: today's, and that of versions in which studies had no identity.
    own: [String; 2],
    /// The [keys](key) of the trials that were imported before.
    known: BTreeSet<String>,
    /// The study's own trials, by their numbers; read when the first that may be one of them comes.
    held: Option<BTreeMap<u64, CarriedTrial>>,
    /// Values of indicators that the trials lack.
    indicators: BTreeMap<String, f64>,
    dry_run: bool,
}

impl<'a> Importer<'a> {
    /// Looks at what the study has already.
    pub(crate) fn new(
        client: &'a Client,
        study: &'a StudyRecord,
        site: &str,
        indicators: &[(String, f64)],
        dry_run: bool,
    ) -> Result<Self> {
        let wanted = TrialQuery::all().filter("mode = PINNED AND state = COMPLETED");
        let mut known = BTreeSet::new();
        for trial in client.trials(&study.identified_name(), wanted) {
            known.extend(trial?.origin.map(|origin| key(&origin).to_owned()));
        }
        Ok(Self {
            client,
            study: study.id(),
            spec: study.spec()?,
            space_revision: study.space_revision,
            site: site.to_owned(),
            name: study.identified_name(),
            own: [format!("{}/trials/", study.uid), format!("{site}/{}/trials/", study.name)],
            known,
            held: None,
            indicators: indicators.iter().cloned().collect(),
            dry_run,
        })
    }

    /// Adds the trials that the study does not hold yet.
    pub(crate) fn run(mut self, trials: impl Iterator<Item = Result<CarriedTrial>>) -> Result<Tally> {
        let mut tally = Tally { study: self.study.to_owned(), dry_run: self.dry_run, ..Tally::default() };
        for trial in trials {
            let mut trial = trial?;
            trial.configuration = in_kinds(&self.spec.space, &trial.configuration);
            let key = key(&trial.origin).to_owned();
            if self.known.contains(&key) || self.holds(&key, &trial)? {
                tally.known += 1;
                continue;
            }
            if trial.exclusion.is_some() {
                tally.excluded += 1;
                continue;
            }
            let added = match self.fit(&trial) {
                Ok((question, measured)) if !self.dry_run => match self.add(&trial, &question, &measured) {
                    // One that the service does not take does not hold up the others.
                    Err(Failure::Client(problem)) if problem.is_invalid_argument() => {
                        Err(problem.to_string())
                    }
                    added => Ok(added?),
                },
                Ok(_) => Ok(()),
                Err(problem) => Err(problem),
            };
            match added {
                Ok(()) => {
                    self.known.insert(key);
                    tally.imported += 1;
                }
                Err(problem) => {
                    tally.misfits += 1;
                    tally.first_misfit.get_or_insert_with(|| format!("{}: {problem}", trial.origin));
                }
            }
            if tally.imported > 0 && tally.imported.is_multiple_of(SHOW_EVERY) {
                progress::status(&format!("{} trials added", tally.imported));
            }
        }
        progress::status_end();
        Ok(tally)
    }

    /// Whether the study itself measured this.
    fn holds(&mut self, key: &str, trial: &CarriedTrial) -> Result<bool> {
        let Some(number) = self.own.iter().find_map(|own| key.strip_prefix(own)?.parse().ok()) else {
            return Ok(false);
        };
        let held = match self.held.take() {
            Some(held) => held,
            None => self.read_held()?,
        };
        // Times are not compared: a table has none, and a trial that comes home from another site has the
        // time of its import there.
        let is_held = held.get(&number).is_some_and(|own| {
            own.measurements == trial.measurements
                && is_same(&self.spec.space, &trial.configuration, &own.configuration)
        });
        self.held = Some(held);
        Ok(is_held)
    }

    fn read_held(&self) -> Result<BTreeMap<u64, CarriedTrial>> {
        let mut held = BTreeMap::new();
        let completed = TrialQuery::all().filter("state = COMPLETED").in_present_space();
        for trial in self.client.trials(&self.name, completed) {
            let trial = trial?;
            held.extend(trial.number().zip(CarriedTrial::of(&trial, &self.site)));
        }
        Ok(held)
    }

    /// The trial as one of this study. The error says why it cannot be.
    fn fit(&self, trial: &CarriedTrial) -> Result<(Question, Measurements), String> {
        let mut indicators = Indicators::new();
        for indicator in self.spec.indicators.indicators() {
            let name = indicator.name.as_str();
            let value = trial.indicators.get(name).or_else(|| self.indicators.get(name));
            let value =
                value.ok_or_else(|| format!("it has no indicator {name}; add --indicator {name}=NUMBER"))?;
            indicators = indicators.with(name, *value);
        }
        let whole = self.spec.space.complete(&trial.configuration).map_err(|error| error.to_string())?;
        if trial.outcome == Outcome::Ok {
            let mut terms = self.spec.objective.terms().iter();
            if let Some(term) = terms.find(|term| !trial.measurements.contains_key(&term.metric)) {
                return Err(format!("it did not measure {}", term.metric));
            }
        }
        let mut numbers = trial.measurements.iter().chain(&trial.standard_errors);
        if let Some((name, value)) = numbers.find(|(_, value)| !(value.is_finite() && **value >= 0.0)) {
            return Err(format!("{name} is {value}, and must be finite and at least 0"));
        }
        let mut errors = trial.standard_errors.keys();
        if let Some(name) = errors.find(|name| !trial.measurements.contains_key(*name)) {
            return Err(format!("it has a standard error of {name}, which it did not measure"));
        }
        if trial.outcome == Outcome::Ok {
            has_cost(self.spec, &trial.measurements)?;
        }
        let measured = trial.measurements.iter().map(|(name, value)| (name.clone(), *value)).collect();
        let errors = trial.standard_errors.iter();
        let measured =
            errors.fold(measured, |all: Measurements, (name, error)| all.with_standard_error(name, *error));
        let client_id: String = trial.client_id.chars().filter(|each| !each.is_control()).collect();
        // With the prefix, a name of more than 121 characters is too long, and loses its end. It identifies
        // nobody here: the origin identifies the trial.
        let client_id = format!("{CARRIED}{client_id}").chars().take(CLIENT_CHARACTERS).collect();
        let question = Question {
            indicators,
            client_id: Some(client_id),
            fingerprint: Some(trial.fingerprint.clone().unwrap_or_default()),
            session: Some(0),
            wanted: Some(whole.into()),
            origin: Some(trial.origin.clone()),
            space_revision: self.space_revision,
            ..Question::default()
        };
        Ok((question, measured))
    }

    fn add(&self, trial: &CarriedTrial, question: &Question, measured: &Measurements) -> Result<()> {
        let open = self.client.ask(&self.name, question)?;
        if let Err(problem) = self.client.tell(&open.name, measured, &trial.outcome) {
            // Else it would wait for its lease to end.
            let _ = self.client.give_back(&open.name);
            return Err(problem.into());
        }
        Ok(())
    }
}

/// A configuration in the kinds of its parameters. Programs that keep whole numbers with empty cells among
/// them as floating-point ones write 8.0 for 8, and some write True for true.
fn in_kinds(space: &Space, configuration: &Configuration) -> Configuration {
    let in_kind = |(name, value): (&str, &Value)| {
        let domain = space.parameters().iter().find(|one| one.name == name).map(|one| &one.domain);
        let is_whole = match domain {
            Some(Domain::Integer { .. }) => true,
            Some(Domain::Categorical { values }) => matches!(values.first(), Some(Value::Integer(_))),
            Some(Domain::Float { .. } | Domain::Boolean) | None => false,
        };
        let value = match (value, domain) {
            (Value::Float(number), _) if is_whole && number.fract() == 0.0 && number.abs() <= WHOLE_MAX => {
                Value::Integer(*number as i64)
            }
            (Value::Text(word), Some(Domain::Boolean)) => {
                word.to_ascii_lowercase().parse::<bool>().map_or_else(|_| value.clone(), Value::Boolean)
            }
            _ => value.clone(),
        };
        (name.to_owned(), value)
    };
    configuration.iter().map(in_kind).collect()
}

/// Whether a carried configuration can be one that a study of the space holds. One from before a change of
/// the space may have values that are not of it, and lacks parameters that had other values than their
/// defaults.
fn is_same(space: &Space, carried: &Configuration, own: &Configuration) -> bool {
    let whole = |configuration: &Configuration| space.complete(configuration).ok();
    let is_own = |(name, value): (&str, &Value)| own.get(name) == Some(value);
    whole(carried).is_none_or(|one| whole(own) == Some(one)) || carried.iter().all(is_own)
}

/// Whether measurements have a cost, unless they are beyond a limit. The service refuses others.
fn has_cost(spec: &StudySpec, measurements: &BTreeMap<String, f64>) -> Result<(), String> {
    match spec.objective.beyond(measurements) {
        Ok(Some(_)) => Ok(()),
        Ok(None) => spec.objective.cost(measurements).map(drop),
        Err(problem) => Err(problem),
    }
    .map_err(|problem| problem.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read_as_other_programs_write_them() {
        let space = Space::builder().integer("level", 1..=9).default(3).boolean("long").default(false);
        let space = space.categorical("mode", ["True", "8.0"]).default("True");
        let space = space.float("rate", 0.0..=9.0).default(1.0).build().expect("a space");
        let written = |level: f64, long: &str| {
            Configuration::new()
                .with("level", level)
                .with("long", long)
                .with("mode", "True")
                .with("rate", 2.0)
        };
        let read = Configuration::new().with("level", 8).with("long", true);
        let read = read.with("mode", "True").with("rate", 2.0);
        for long in ["True", "TRUE", "true"] {
            assert_eq!(in_kinds(&space, &written(8.0, long)), read);
        }
        assert_eq!(in_kinds(&space, &read), read);
        // What is no value of the parameter stays what it is, and does not fit.
        for other in [written(8.5, "True"), written(8.0, "yes"), written(1e300, "True")] {
            assert!(space.complete(&in_kinds(&space, &other)).is_err(), "{other}");
        }
    }

    #[test]
    fn a_trial_from_before_a_change_of_the_space_is_the_one_that_is_held() {
        let space = Space::builder().integer("level", 1..=9).default(3).boolean("long").default(false);
        let space = space.build().expect("a space");
        // It ran before `long` came, which was true then.
        let own = Configuration::new().with("level", 8).with("long", true);
        let carried = Configuration::new().with("level", 8);
        assert!(is_same(&space, &carried, &own));
        assert!(is_same(&space, &carried.clone().with("gone", 1), &own), "whatever it had beside");
        assert!(is_same(&space, &Configuration::new(), &own.clone().with("level", 3).with("long", false)));
        assert!(!is_same(&space, &Configuration::new().with("level", 7), &own));
        assert!(!is_same(&space, &carried.with("long", false), &own));
    }

    #[test]
    fn what_has_no_cost_does_not_fit() {
        let space = Space::builder().boolean("compact").default(false).build().expect("a space");
        let spec = StudySpec::builder(space).maximise("rate", 1.0).limit("memory_mb", None, Some(2000.0));
        let spec = spec.build().expect("a good study");
        let fits = |rate: f64, memory_mb: f64| {
            has_cost(&spec, &[("rate".to_owned(), rate), ("memory_mb".to_owned(), memory_mb)].into())
        };
        assert_eq!(fits(3.0, 100.0), Ok(()));
        assert!(fits(0.0, 100.0).expect_err("no cost").contains("must be above 0"));
        assert_eq!(fits(0.0, 3000.0), Ok(()), "it is infeasible, whatever it costs");
        let unlimited = has_cost(&spec, &BTreeMap::from([("rate".to_owned(), 3.0)]));
        assert!(unlimited.expect_err("a limit").contains("\"memory_mb\" is missing"));
    }
}
