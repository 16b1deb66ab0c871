//! Records as JSON Lines: a first line with the conditions, then a line a measurement.
//!
//! Lines are only added, each on the disk before the next measurement begins. One that a killed run left
//! unfinished does not count. It is cut off before more are added, and its work done again.

use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;
use treewright_render_cli::error::CliError;

/// How the first line of every record begins.
const BEGINNING: &[u8] = b"{\"conditions\":";

/// Whether there is something in a file that is not to be lost. A record whose first line was left unfinished
/// is begun again.
pub(crate) fn is_begun(path: &Path) -> Result<bool, CliError> {
    if !path.exists() {
        return Ok(false);
    }
    let there = std::fs::read(path).map_err(|error| wrong(path, &error.to_string()))?;
    let is_beginning = BEGINNING.starts_with(&there) || there.starts_with(BEGINNING);
    Ok(there.contains(&b'\n') || !is_beginning)
}

/// The whole lines of a file, each read when it is asked for.
pub(crate) fn read<T: DeserializeOwned>(
    path: &Path,
) -> Result<impl Iterator<Item = Result<T, CliError>>, CliError> {
    let mut text = std::fs::read(path).map_err(|error| wrong(path, &error.to_string()))?;
    text.truncate(whole(&text));
    let lines: Vec<Vec<u8>> = text.split_inclusive(|byte| *byte == b'\n').map(<[u8]>::to_vec).collect();
    Ok(lines.into_iter().enumerate().map(move |(number, line)| {
        serde_json::from_slice(&line).map_err(|error| wrong(path, &format!("line {}: {error}", number + 1)))
    }))
}

/// Adds a line, in place of one that was left unfinished; it is on the disk when this returns.
pub(crate) fn add(path: &Path, line: &impl Serialize) -> Result<(), CliError> {
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
        let first = json!({ "conditions": { "rounds": 3 } });
        let begun = || is_begun(&path).expect("it can be read");
        assert!(!begun());
        for left in ["", "{\"cond", "{\"conditions\":{\"rounds\":"] {
            std::fs::write(&path, left).expect("it can be written");
            assert!(!begun(), "{left}");
            add(&path, &first).expect("it can be written");
            assert_eq!(std::fs::read_to_string(&path).expect("it is there"), format!("{first}\n"));
        }
        add(&path, &json!(1)).expect("it can be written");
        let mut killed = std::fs::read(&path).expect("it is there");
        killed.extend_from_slice(b"{\"answers\":{\"mach");
        std::fs::write(&path, killed).expect("it can be written");
        let lines = || read::<Value>(&path).expect("it is there").collect::<Result<Vec<_>, _>>();
        assert_eq!(lines().expect("half a line does not count"), [first.clone(), json!(1)]);
        add(&path, &json!(2)).expect("it can be written");
        assert_eq!(lines().expect("and gives way to the next"), [first, json!(1), json!(2)]);
        std::fs::write(&path, "1\n{\n2\n").expect("it can be written");
        assert!(lines().is_err_and(|error| error.to_string().contains("line 2")));
        std::fs::write(&path, "{\"model\":").expect("it can be written");
        assert!(begun(), "what is no record is not written over");
    }
}
