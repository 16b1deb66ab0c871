//! Trials as comma-separated values.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Read, Write};
use std::path::Path;

use treewright_client::{Configuration, Domain, Space, StudySpec, TrialRecord, Value};

use super::table::{self, FINGERPRINT, MEASUREMENT, Role, Row, TrialCell};
use super::{CarriedTrial, in_kinds};
use crate::failure::{Failure, Result};
use crate::show;

pub(crate) fn write(
    out: impl Write,
    spec: &StudySpec,
    trials: impl Iterator<Item = Result<TrialRecord>>,
    site: &str,
) -> Result<()> {
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

pub(crate) fn read(path: &Path, spec: &StudySpec) -> Result<Vec<CarriedTrial>> {
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
        let mut row = Row::new(file, line);
        for (role, text) in roles.iter().zip(&record) {
            let Some(role) = role else { continue };
            let value = value(role, text, space).map_err(|problem| format!("line {line}: {problem}"))?;
            if let Some(value) = value {
                row.take(role, value).map_err(|problem| format!("line {line}: {problem}"))?;
            }
        }
        let trial = row.trial().map_err(|problem| format!("line {line}: {problem}"))?;
        trials.extend(trial.map(|trial| {
            let configuration = without_inactive(space, &trial.configuration);
            CarriedTrial { configuration, ..trial }
        }));
    }
    Ok(trials)
}

/// Leaves out empty choices of parameters that are not active: their cells are empty for that reason.
fn without_inactive(space: &Space, read: &Configuration) -> Configuration {
    let known = in_kinds(space, read);
    let mut active: BTreeMap<&str, Value> = BTreeMap::new();
    let mut empty = BTreeSet::new();
    for parameter in space.parameters() {
        let name = parameter.name.as_str();
        let is_active = parameter.active_if.as_ref().is_none_or(|condition| {
            let value = active.get(condition.parameter.as_str());
            value.is_some_and(|value| condition.any_of.contains(value))
        });
        let value = known.get(name);
        if is_active {
            active.insert(name, value.unwrap_or(&parameter.default).clone());
        } else if value == Some(&Value::Text(String::new())) {
            empty.insert(name);
        }
    }
    let left = read.iter().filter(|(name, _)| !empty.contains(name));
    left.map(|(name, value)| (name.to_owned(), value.clone())).collect()
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
        Role::Indicator(_) | Role::Measurement(_) | Role::StandardError(_) | Role::LowerBound => {
            Value::Float(trimmed.parse().map_err(|_| format!("`{trimmed}` is no number"))?)
        }
        Role::Outcome | Role::Fingerprint => Value::Text(trimmed.to_owned()),
        Role::Reason | Role::Client | Role::Origin | Role::Exclusion => Value::Text(text.to_owned()),
    }))
}

/// The choice of a parameter that reads so.
fn choice(space: &Space, name: &str, text: &str) -> Option<Value> {
    let parameter = space.parameters().iter().find(|parameter| parameter.name == name)?;
    let Domain::Categorical { values } = &parameter.domain else { return None };
    let is_it = |value: &&Value| matches!(value, Value::Text(known) if known == text);
    values.iter().find(is_it).cloned()
}

#[cfg(test)]
mod tests {
    use treewright_client::Outcome;

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
    fn an_empty_cell_is_an_empty_choice_where_its_parameter_is_active() {
        let space = Space::builder().integer("level", 1..=9).default(3);
        let space = space.categorical("suffix", ["x", ""]).default("x").active_if("level", [8]);
        let space = space.categorical("more", ["y", ""]).default("y").active_if("suffix", [""]);
        let space = space.build().expect("a space");
        let read = |row: &str| {
            // The order of columns is not that of parameters.
            let table = format!("config.more,config.suffix,config.level,measurement.a\n{row},1\n");
            let trials = parse(table.as_bytes(), "a.csv", &space).expect("a table");
            trials[0].configuration.clone()
        };
        let level = |level: i64| Configuration::new().with("level", level);
        assert_eq!(read(",,8"), level(8).with("suffix", "").with("more", ""));
        assert_eq!(read("y,,8"), level(8).with("suffix", "").with("more", "y"));
        assert_eq!(read(",x,8"), level(8).with("suffix", "x"));
        assert_eq!(read(",,7"), level(7));
        // By default it is not active.
        assert_eq!(read(",,"), Configuration::new());
        let float = Configuration::new().with("level", 8.0).with("suffix", "").with("more", "");
        assert_eq!(read(",,8.0"), float, "kinds are put right later");
    }

    #[test]
    fn a_table_is_read_by_its_header() {
        let table = "config.level,config.mode,indicator.mb,measurement.wall_ms,outcome,reason,lower_bound,note,\
                     standard_error.wall_ms\n\
                     3,fast,10,812.5,OK,,,x,2.5\n\
                     5,fast,10,,INFEASIBLE,\"no, memory\",,,\n\
                     7,fast,10,,ABORTED,,900,,\n\
                     9,fast,10,,FAILED,crash,,,\n\
                     1,fast,10,700,,,,,\n";
        let trials = parse(table.as_bytes(), "a.csv", &space()).expect("a table");
        assert_eq!(trials.len(), 4);
        assert_eq!(trials[0].configuration, Configuration::new().with("level", 3).with("mode", "fast"));
        assert_eq!(trials[0].measurements["wall_ms"], 812.5);
        assert_eq!(trials[0].standard_errors["wall_ms"], 2.5);
        assert!(trials[1].standard_errors.is_empty());
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
