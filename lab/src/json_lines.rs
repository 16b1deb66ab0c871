//! Records as JSON Lines: a first line with the conditions, then a line a measurement.
//!
//! Lines are only added, each on the disk before the next measurement begins. One that a killed run left
//! unfinished does not count. It is cut off before more are added, and its work done again.

use std::{fs::OpenOptions, io::Write as _, path::Path};

use serde::{Deserialize, Serialize, de::DeserializeOwned};
use treewright_render_cli::error::{CliError, Result};

/// How the first line of every record begins.
const BEGINNING: &[u8] = b"{\"conditions\":";

#[derive(Serialize, Deserialize)]
struct Head<C> {
    conditions: C,
}

/// Begins a record with its conditions, unless it is begun.
///
/// # Errors
/// The file cannot be read or written.
pub fn begin(path: &Path, conditions: &impl Serialize) -> Result<(), CliError> {
    if is_begun(path)? { Ok(()) } else { add(path, &Head { conditions }) }
}

/// Whether a file holds something that must not be lost. An unfinished first line is not such.
fn is_begun(path: &Path) -> Result<bool> {
    if !path.exists() {
        return Ok(false);
    }
    let there = std::fs::read(path).map_err(|error| wrong(path, &error.to_string()))?;
    let is_beginning = BEGINNING.starts_with(&there) || there.starts_with(BEGINNING);
    Ok(there.contains(&b'\n') || !is_beginning)
}

/// The conditions of a record, and its other whole lines, each read when it is asked for.
///
/// # Errors
/// The file cannot be read, or is no such record; lines that are none fail when it is their turn.
pub fn read<C: DeserializeOwned, T: DeserializeOwned>(
    path: &Path,
) -> Result<(C, impl Iterator<Item = Result<T>>)> {
    let mut text = std::fs::read(path).map_err(|error| wrong(path, &error.to_string()))?;
    text.truncate(whole(&text));
    let lines: Vec<Vec<u8>> = text.split_inclusive(|byte| *byte == b'\n').map(<[u8]>::to_vec).collect();
    let Some(first) = lines.first() else { return Err(wrong(path, "its first line says no conditions")) };
    let Head { conditions } = parsed(path, 1, first)?;
    let others = (1..).zip(lines).skip(1);
    Ok((conditions, others.map(move |(number, line)| parsed(path, number, &line))))
}

fn parsed<T: DeserializeOwned>(path: &Path, number: usize, line: &[u8]) -> Result<T> {
    serde_json::from_slice(line).map_err(|error| wrong(path, &format!("line {number}: {error}")))
}

/// Adds a line, in place of one that was left unfinished; it is on the disk when this returns.
///
/// # Errors
/// The file cannot be read or written.
pub fn add(path: &Path, line: &impl Serialize) -> Result<(), CliError> {
    let failed = |error: String| CliError::Failed(format!("{} cannot be written: {error}", path.display()));
    let mut text = serde_json::to_vec(line).map_err(|error| failed(error.to_string()))?;
    text.push(b'\n');
    let write = || {
        let mut file = OpenOptions::new().append(true).create(true).open(path)?;
        file.set_len(whole(&std::fs::read(path)?) as u64)?;
        file.write_all(&text)?;
        file.sync_data()
    };
    write().map_err(|error: std::io::Error| failed(error.to_string()))
}

/// Bytes of the lines that have an end.
fn whole(text: &[u8]) -> usize {
    text.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1)
}

/// A file that holds something else.
pub(crate) fn wrong(path: &Path, cause: &str) -> CliError {
    CliError::Failed(format!("{} is no record of this program: {cause}", path.display()))
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    #[test]
    fn what_was_cut_short_is_begun_again_and_the_rest_stays() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let path = folder.path().join("record.jsonl");
        let (conditions, head) = (json!({ "rounds": 3 }), "{\"conditions\":{\"rounds\":3}}\n");
        let begin = || begin(&path, &conditions).expect("it can be written");
        for left in ["", "{\"cond", "{\"conditions\":{\"rounds\":"] {
            std::fs::write(&path, left).expect("it can be written");
            begin();
            assert_eq!(std::fs::read_to_string(&path).expect("it is there"), head, "{left}");
        }
        add(&path, &json!(1)).expect("it can be written");
        begin();
        let mut killed = std::fs::read(&path).expect("it is there");
        killed.extend_from_slice(b"{\"answers\":{\"mach");
        std::fs::write(&path, killed).expect("it can be written");
        let lines = || {
            let (found, lines) = read::<Value, Value>(&path)?;
            assert_eq!(found, conditions);
            lines.collect::<Result<Vec<_>, _>>()
        };
        assert_eq!(lines().expect("half a line does not count"), [json!(1)]);
        add(&path, &json!(2)).expect("it can be written");
        assert_eq!(lines().expect("and gives way to the next"), [json!(1), json!(2)]);
        for (wrong, line) in [(format!("{head}{{\n2\n"), "line 2"), ("{}\n".to_owned(), "line 1")] {
            std::fs::write(&path, wrong).expect("it can be written");
            assert!(lines().is_err_and(|error| error.to_string().contains(line)), "{line}");
        }
        std::fs::write(&path, "{\"model\":").expect("it can be written");
        begin();
        let kept = std::fs::read_to_string(&path).expect("it is there");
        assert_eq!(kept, "{\"model\":", "what is no record is not written over");
    }
}
