//! Studies that are named by a file: which study that is, and how it comes to be.

use std::path::Path;

use treewright_client::StudyRecord;
use treewright_client::blocking::Client;

use super::StudyFile;
use crate::failure::{Failure, Result};

/// A study by its id, or by a file that describes it, from which it is created where there is none.
pub(crate) fn find_or_create(client: &Client, study: &str, inline: Option<StudyFile>) -> Result<StudyRecord> {
    if let Some(file) = inline {
        return Ok(client.create_study(study, &file.spec()?)?);
    }
    let path = Path::new(study);
    let is_file = path.extension().is_some_and(|extension| extension == "toml" || extension == "json");
    if is_file {
        let file = StudyFile::read(path)?;
        return Ok(client.create_study(&id_of(&file, path, None)?, &file.spec()?)?);
    }
    client.get_study(study).map_err(|problem| {
        if problem.is_not_found() {
            Failure::Data(format!(
                "{problem}; name a study file to create it, or describe it with --tune NAME=LOW..HIGH:DEFAULT"
            ))
        } else {
            problem.into()
        }
    })
}

/// The id of a study in a file: as said, as in the file, or as the file is called.
pub(crate) fn id_of(file: &StudyFile, path: &Path, said: Option<&str>) -> Result<String> {
    let stem = || path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let id = said.map(str::to_owned).or_else(|| file.id.clone()).or_else(stem).unwrap_or_default();
    if path == Path::new("-") && said.is_none() && file.id.is_none() {
        return Err(Failure::Usage("the study has no id; add --id ID".into()));
    }
    Ok(id)
}
