//! Trials as comma-separated values: a column for each parameter, indicator and measurement.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::path::Path;

use treewright_client::{Configuration, Outcome, StudySpec, TrialRecord, Value};

use super::CarriedTrial;
use crate::failure::Failure;
use crate::show;

/// Prefixes of columns that hold one number or value each.
const CONFIGURATION: &str = "config.";
const INDICATOR: &str = "indicator.";
const MEASUREMENT: &str = "measurement.";

/// Writes trials as a table.
///
/// # Errors
/// [`Failure::Output`].
pub(crate) fn write(
    out: impl Write,
    spec: &StudySpec,
    trials: impl Iterator<Item = Result<TrialRecord, Failure>>,
    site: &str,
) -> Result<(), Failure> {
    // Which measurements there are is only known at the end.
    let trials: Vec<TrialRecord> = trials.collect::<Result<_, _>>()?;
    let mut measured: Vec<&str> =
        trials.iter().flat_map(|trial| trial.measurements.iter().map(|(name, _)| name)).collect();
    measured.sort_unstable();
    measured.dedup();
    let parameters: Vec<&str> = spec.space.parameters().iter().map(|one| one.name.as_str()).collect();
    let indicators: Vec<&str> = spec.indicators.indicators().iter().map(|one| one.name.as_str()).collect();
    let prefixed =
        |prefix: &str, names: &[&str]| names.iter().map(|name| format!("{prefix}{name}")).collect::<Vec<_>>();
    let mut table = csv::Writer::from_writer(out);
    let fixed =
        ["number", "state", "mode", "outcome", "reason", "lower_bound", "cost", "state_id", "client_id"];
    let header = fixed.map(str::to_owned).into_iter();
    let header = header
        .chain(["complete_time", "origin"].map(str::to_owned))
        .chain(prefixed(CONFIGURATION, &parameters))
        .chain(prefixed(INDICATOR, &indicators))
        .chain(prefixed(MEASUREMENT, &measured));
    table.write_record(header).map_err(output)?;
    for trial in &trials {
        let number = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:?}"));
        let (outcome, reason, bound) = show::outcome_parts(trial.outcome.as_ref());
        let mut row = vec![
            trial.number().map_or_else(|| trial.name.clone(), |number| number.to_string()),
            trial.state.to_string(),
            trial.mode.to_string(),
            outcome,
            reason,
            number(bound),
            number(trial.cost),
            trial.state_id.to_string(),
            trial.client_id.clone(),
            show::time(trial.complete_time),
            trial.origin.clone().unwrap_or_else(|| format!("{site}/{}", trial.name)),
        ];
        let value = |name: &&str| trial.configuration.get(name).map_or_else(String::new, Value::to_string);
        row.extend(parameters.iter().map(value));
        row.extend(indicators.iter().map(|name| number(trial.indicators.get(name))));
        row.extend(measured.iter().map(|name| number(trial.measurements.get(name))));
        table.write_record(row).map_err(output)?;
    }
    table.flush().map_err(Failure::Output)
}

fn output(error: csv::Error) -> Failure {
    Failure::Output(std::io::Error::other(error))
}

/// Reads trials from a table with a header.
///
/// # Errors
/// [`Failure::File`] with the line.
pub(crate) fn read(path: &Path) -> Result<Vec<CarriedTrial>, Failure> {
    let file = std::fs::File::open(path).map_err(|error| Failure::file(path, error.to_string()))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    parse(file, &name).map_err(|problem| Failure::file(path, problem))
}

/// Which part of a trial a column holds.
enum Column {
    Configuration(String),
    Indicator(String),
    Measurement(String),
    Outcome,
    Reason,
    LowerBound,
    Client,
    Origin,
    Other,
}

impl Column {
    fn of(title: &str) -> Self {
        let after = |prefix| title.strip_prefix(prefix).map(str::to_owned);
        if let Some(name) = after(CONFIGURATION) {
            return Self::Configuration(name);
        }
        if let Some(name) = after(INDICATOR) {
            return Self::Indicator(name);
        }
        if let Some(name) = after(MEASUREMENT) {
            return Self::Measurement(name);
        }
        match title {
            "outcome" => Self::Outcome,
            "reason" => Self::Reason,
            "lower_bound" => Self::LowerBound,
            "client_id" => Self::Client,
            "origin" => Self::Origin,
            _ => Self::Other,
        }
    }
}

fn parse(input: impl Read, file: &str) -> Result<Vec<CarriedTrial>, String> {
    let mut table = csv::Reader::from_reader(input);
    let header = table.headers().map_err(|error| error.to_string())?;
    let columns: Vec<Column> = header.iter().map(|title| Column::of(title.trim())).collect();
    if !columns.iter().any(|column| matches!(column, Column::Measurement(_))) {
        return Err(format!("its header has no column {MEASUREMENT}NAME"));
    }
    let mut trials = Vec::new();
    for (index, row) in table.records().enumerate() {
        // The header is the first line.
        let line = index + 2;
        let row = row.map_err(|error| error.to_string())?;
        let mut parts = Parts::default();
        for (column, text) in columns.iter().zip(row.iter()).filter(|(_, text)| !text.trim().is_empty()) {
            parts.take(column, text.trim()).map_err(|problem| format!("line {line}: {problem}"))?;
        }
        if let Some(trial) = parts.trial(file, line).map_err(|problem| format!("line {line}: {problem}"))? {
            trials.push(trial);
        }
    }
    Ok(trials)
}

#[derive(Default)]
struct Parts {
    configuration: Configuration,
    indicators: BTreeMap<String, f64>,
    measurements: BTreeMap<String, f64>,
    outcome: Option<String>,
    reason: String,
    lower_bound: Option<f64>,
    client_id: Option<String>,
    origin: Option<String>,
}

impl Parts {
    fn take(&mut self, column: &Column, text: &str) -> Result<(), String> {
        let number = || text.parse::<f64>().map_err(|_| format!("`{text}` is no number"));
        match column {
            Column::Configuration(name) => self.configuration.set(name.clone(), Value::parse(text)),
            Column::Indicator(name) => {
                self.indicators.insert(name.clone(), number()?);
            }
            Column::Measurement(name) => {
                self.measurements.insert(name.clone(), number()?);
            }
            Column::Outcome => self.outcome = Some(text.to_owned()),
            Column::Reason => text.clone_into(&mut self.reason),
            Column::LowerBound => self.lower_bound = Some(number()?),
            Column::Client => self.client_id = Some(text.to_owned()),
            Column::Origin => self.origin = Some(text.to_owned()),
            Column::Other => {}
        }
        Ok(())
    }

    /// `None` for one without a result, such as one that is open or failed.
    fn trial(self, file: &str, line: usize) -> Result<Option<CarriedTrial>, String> {
        let outcome = match self.outcome.as_deref() {
            None if self.measurements.is_empty() => return Ok(None),
            None | Some("OK") => Outcome::Ok,
            Some("INFEASIBLE") => Outcome::infeasible(self.reason),
            Some("ABORTED") => Outcome::aborted(self.lower_bound.ok_or("ABORTED needs a lower_bound")?),
            Some("FAILED") => return Ok(None),
            Some(other) => {
                return Err(format!("outcome `{other}` is none of OK, INFEASIBLE, ABORTED, FAILED"));
            }
        };
        Ok(Some(CarriedTrial {
            origin: self.origin.unwrap_or_else(|| format!("{file}:{line}")),
            client_id: self.client_id.unwrap_or_else(|| file.to_owned()),
            indicators: self.indicators,
            configuration: self.configuration,
            measurements: self.measurements,
            outcome,
            cost: None,
            fingerprint: None,
            complete_time: None,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_read_by_its_header() {
        let table = "config.level,config.mode,indicator.mb,measurement.wall_ms,outcome,reason,lower_bound,note\n\
                     3,fast,10,812.5,OK,,,x\n\
                     5,fast,10,,INFEASIBLE,\"no, memory\",,\n\
                     7,fast,10,,ABORTED,,900,\n\
                     9,fast,10,,FAILED,crash,,\n\
                     1,fast,10,700,,,,\n";
        let trials = parse(table.as_bytes(), "a.csv").expect("a table");
        assert_eq!(trials.len(), 4);
        assert_eq!(trials[0].configuration, Configuration::new().with("level", 3).with("mode", "fast"));
        assert_eq!(trials[0].measurements["wall_ms"], 812.5);
        assert_eq!(trials[0].origin, "a.csv:2");
        assert_eq!(trials[1].outcome, Outcome::infeasible("no, memory"));
        assert_eq!(trials[2].outcome, Outcome::aborted(900.0));
        assert_eq!(trials[3].outcome, Outcome::Ok);
    }

    #[test]
    fn mistakes_are_named_with_their_line() {
        let problem = |table: &str| parse(table.as_bytes(), "a.csv").expect_err("a mistake");
        assert!(problem("config.level,cost\n3,1\n").contains("measurement.NAME"));
        assert!(
            problem("config.level,measurement.wall_ms\n3,fast\n").contains("line 2: `fast` is no number")
        );
        assert!(problem("measurement.a,outcome\n3,GOOD\n").contains("GOOD"));
    }
}
