//! Trials as comma-separated values.

use std::io::{Read, Write};
use std::path::Path;

use treewright_client::{StudySpec, TrialRecord, Value};

use super::CarriedTrial;
use super::table::{self, FINGERPRINT, MEASUREMENT, Role, Row, TrialCell};
use crate::failure::Failure;
use crate::show;

/// Writes trials as a table.
///
/// # Errors
/// [`Failure::Output`], and what reading the trials gives.
pub(crate) fn write(
    out: impl Write,
    spec: &StudySpec,
    trials: impl Iterator<Item = Result<TrialRecord, Failure>>,
    site: &str,
) -> Result<(), Failure> {
    // Which measurements there are is only known at the end.
    let trials: Vec<TrialRecord> = trials.collect::<Result<_, _>>()?;
    let mut columns = table::columns(spec, &trials, site);
    // JSON in each row of a table for people.
    columns.retain(|column| column.title != FINGERPRINT);
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record(columns.iter().map(|column| &column.title)).map_err(output)?;
    for trial in &trials {
        csv.write_record(columns.iter().map(|column| column.of(trial).map_or_else(String::new, text)))
            .map_err(output)?;
    }
    csv.flush().map_err(Failure::Output)
}

fn text(cell: TrialCell) -> String {
    match cell {
        TrialCell::Boolean(value) => value.to_string(),
        TrialCell::Integer(value) => value.to_string(),
        TrialCell::Number(value) => format!("{value:?}"),
        TrialCell::Text(value) => value,
        TrialCell::Time(value) => show::time(Some(value)),
    }
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

fn parse(input: impl Read, file: &str) -> Result<Vec<CarriedTrial>, String> {
    let mut table = csv::Reader::from_reader(input);
    let header = table.headers().map_err(|error| error.to_string())?;
    let roles: Vec<Option<Role>> = header.iter().map(|title| Role::of(title.trim())).collect();
    if !roles.iter().any(|role| matches!(role, Some(Role::Measurement(_)))) {
        return Err(format!("its header has no column {MEASUREMENT}NAME"));
    }
    let mut trials = Vec::new();
    for (index, record) in table.records().enumerate() {
        // The header is the first line.
        let line = index + 2;
        let record = record.map_err(|error| error.to_string())?;
        let mut row = Row::default();
        for (role, text) in roles.iter().zip(record.iter().map(str::trim)) {
            if let Some(role) = role.as_ref().filter(|_| !text.is_empty()) {
                let taken = value(role, text).and_then(|value| row.take(role, value));
                taken.map_err(|problem| format!("line {line}: {problem}"))?;
            }
        }
        trials.extend(row.trial(file, line).map_err(|problem| format!("line {line}: {problem}"))?);
    }
    Ok(trials)
}
fn value(role: &Role, text: &str) -> Result<Value, String> {
    Ok(match role {
        Role::Configuration(_) => Value::parse(text),
        Role::Indicator(_) | Role::Measurement(_) | Role::LowerBound => {
            Value::Float(text.parse().map_err(|_| format!("`{text}` is no number"))?)
        }
        Role::Outcome | Role::Reason | Role::Client | Role::Origin | Role::Fingerprint => {
            Value::Text(text.to_owned())
        }
    })
}

#[cfg(test)]
mod tests {
    use treewright_client::{Configuration, Outcome};

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
