//! Studies as JSON Lines: the first line is the study, every further one a trial.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::CarriedTrial;
use crate::failure::{Failure, Result};
use crate::study_file::StudyFile;

/// Version of the form; a reader refuses a higher one.
const VERSION: u32 = 1;

#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Header {
    /// Marks the file as an export; its value is the version.
    treewright_export: u32,
    /// The name of the database.
    pub(crate) site: String,
    pub(crate) study: StudyFile,
}

impl Header {
    pub(crate) fn new(site: &str, study: StudyFile) -> Self {
        Self { treewright_export: VERSION, site: site.to_owned(), study }
    }

    /// Reads a line that [`write_line`] wrote. The error names the fault.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let header: Self = serde_json::from_str(text)
            .map_err(|error| format!("it does not begin like an export of a study: {error}"))?;
        if header.treewright_export > VERSION {
            let found = header.treewright_export;
            return Err(format!("it is of version {found}, and this program knows {VERSION}"));
        }
        Ok(header)
    }
}

pub(crate) fn write_line(out: &mut impl Write, record: &impl Serialize) -> Result<()> {
    let mut line = serde_json::to_vec(record)?;
    line.push(b'\n');
    out.write_all(&line).map_err(Failure::Output)
}

/// Opens an export: its first line, and the trials one after the other.
pub(crate) fn read(path: &Path) -> Result<(Header, impl Iterator<Item = Result<CarriedTrial>>)> {
    let problem = |line: usize, error: String| Failure::file(path, format!("line {line}: {error}"));
    let file = File::open(path).map_err(|error| Failure::file(path, error.to_string()))?;
    let mut lines = BufReader::new(file).lines().enumerate();
    let (_, first) = lines.next().ok_or_else(|| Failure::file(path, "it is empty"))?;
    let first = first.map_err(|error| problem(1, error.to_string()))?;
    let header = Header::parse(&first).map_err(|error| problem(1, error))?;
    let path = path.to_owned();
    let trials = lines.filter(|(_, line)| !line.as_ref().is_ok_and(|line| line.trim().is_empty()));
    let trials = trials.map(move |(index, line)| {
        let problem = |error: String| Failure::file(&path, format!("line {}: {error}", index + 1));
        let line = line.map_err(|error| problem(error.to_string()))?;
        serde_json::from_str(&line).map_err(|error| problem(error.to_string()))
    });
    Ok((header, trials))
}
