//! Trials as comma-separated values.

use std::io::{Read, Write};
use std::path::Path;

use treewright_client::{Domain, Space, StudySpec, TrialRecord, Value};

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

/// Reads trials of a study from a table with a header.
///
/// # Errors
/// [`Failure::File`] with the line.
pub(crate) fn read(path: &Path, spec: &StudySpec) -> Result<Vec<CarriedTrial>, Failure> {
    let file = std::fs::File::open(path).map_err(|error| Failure::file(path, error.to_string()))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    parse(file, &name, &spec.space).map_err(|problem| Failure::file(path, problem))
}

fn parse(input: impl Read, file: &str, space: &Space) -> Result<Vec<CarriedTrial>, String> {
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
        for (role, text) in roles.iter().zip(&record) {
            let Some(role) = role else { continue };
            let value = value(role, text, space).map_err(|problem| format!("line {line}: {problem}"))?;
            if let Some(value) = value {
                row.take(role, value).map_err(|problem| format!("line {line}: {problem}"))?;
            }
        }
        trials.extend(row.trial(file, line).map_err(|problem| format!("line {line}: {problem}"))?);
    }
    Ok(trials)
}

/// The value of a cell; `None` where it is empty. Blanks around numbers and words of ours mean nothing,
/// because people write them after a comma; in a text they belong to it (RFC 4180, section 2.4).
fn value(role: &Role, text: &str, space: &Space) -> Result<Option<Value>, String> {
    let trimmed = text.trim();
    if let Role::Configuration(name) = role
        && let Some(choice) = choice(space, name, text).or_else(|| choice(space, name, trimmed))
    {
        return Ok(Some(choice));
    }
    if trimmed.is_empty() {
        return Ok(None);
    }
    Ok(Some(match role {
        Role::Configuration(_) => Value::parse(trimmed),
        Role::Indicator(_) | Role::Measurement(_) | Role::LowerBound => {
            Value::Float(trimmed.parse().map_err(|_| format!("`{trimmed}` is no number"))?)
        }
        Role::Outcome | Role::Fingerprint => Value::Text(trimmed.to_owned()),
        Role::Reason | Role::Client | Role::Origin => Value::Text(text.to_owned()),
    }))
}

/// The choice of a parameter that reads so. An empty cell may also be a parameter that was not active.
fn choice(space: &Space, name: &str, text: &str) -> Option<Value> {
    let parameter = space.parameters().iter().find(|parameter| parameter.name == name)?;
    let Domain::Categorical { values } = &parameter.domain else { return None };
    let is_it = |value: &&Value| matches!(value, Value::Text(known) if known == text);
    let found = values.iter().find(is_it)?;
    (!text.is_empty() || parameter.active_if.is_none()).then(|| found.clone())
}

#[cfg(test)]
mod tests {
    use treewright_client::{Configuration, Outcome};

    use super::*;

    fn space() -> Space {
        let space = Space::builder().integer("level", 1..=9).default(3);
        let space = space.categorical("mode", ["fast", " slow", "slow", "", "3", "true"]).default("fast");
        space.build().expect("a space")
    }

    #[test]
    fn choices_keep_their_blanks_and_are_not_taken_for_numbers() {
        let read = |cell: &str| {
            let table = format!("config.mode,measurement.a\n{cell},1\n");
            let trials = parse(table.as_bytes(), "a.csv", &space()).expect("a table");
            trials[0].configuration.get("mode").cloned()
        };
        for text in ["fast", " slow", "slow", "", "3", "true"] {
            assert_eq!(read(text), Some(Value::Text(text.to_owned())), "{text:?}");
        }
        assert_eq!(read(" fast "), Some(Value::Text("fast".to_owned())), "written by hand");
    }

    #[test]
    fn a_table_is_read_by_its_header() {
        let table = "config.level,config.mode,indicator.mb,measurement.wall_ms,outcome,reason,lower_bound,note\n\
                     3,fast,10,812.5,OK,,,x\n\
                     5,fast,10,,INFEASIBLE,\"no, memory\",,\n\
                     7,fast,10,,ABORTED,,900,\n\
                     9,fast,10,,FAILED,crash,,\n\
                     1,fast,10,700,,,,\n";
        let trials = parse(table.as_bytes(), "a.csv", &space()).expect("a table");
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
        let problem = |table: &str| parse(table.as_bytes(), "a.csv", &space()).expect_err("a mistake");
        assert!(problem("config.level,cost\n3,1\n").contains("measurement.NAME"));
        assert!(
            problem("config.level,measurement.wall_ms\n3,fast\n").contains("line 2: `fast` is no number")
        );
        assert!(problem("measurement.a,outcome\n3,GOOD\n").contains("GOOD"));
    }
}
