//! Export and import.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use treewright_client::blocking::Client;
use treewright_client::{Operation, Policy, PolicyChange, StudyRecord, StudySpec, TrialQuery};

use crate::arguments::data::{Export, ExportFormat, Import};
use crate::carry::foreign::Foreign;
#[cfg(feature = "parquet")]
use crate::carry::parquet_table;
use crate::carry::{CarriedTrial, Importer, Tally, csv_table, jsonl, optuna, vizier};
use crate::failure::{Failure, Result};
use crate::files;
use crate::output::either;
use crate::progress;
use crate::study_file::StudyFile;

pub(super) fn export(client: &Client, export: &Export) -> Result<String> {
    match &export.out {
        None => {
            let mut out = BufWriter::new(std::io::stdout());
            write(client, export, &mut out)?;
            out.flush().map_err(Failure::Output)?;
        }
        Some(path) => {
            if path.exists() && !export.overwrite {
                return Err(Failure::file(path, "it exists already; name another file, or add --overwrite"));
            }
            // Whole or not at all: beside it first, then in its place.
            let beside = beside(path);
            let written = write_file(client, export, &beside).and_then(|()| {
                std::fs::rename(&beside, path).map_err(|error| Failure::file(path, error.to_string()))
            });
            written.inspect_err(|_| {
                // The first error counts more than a leftover file.
                let _ = std::fs::remove_file(&beside);
            })?;
        }
    }
    Ok(String::new())
}

/// A name that no other file of the folder has.
fn beside(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{}.part", std::process::id()));
    path.with_file_name(name)
}

fn write_file(client: &Client, export: &Export, path: &Path) -> Result<()> {
    let file = File::create_new(path).map_err(|error| Failure::file(path, error.to_string()))?;
    let mut out = BufWriter::new(file);
    write(client, export, &mut out)?;
    out.flush().map_err(Failure::Output)
}

fn write(client: &Client, export: &Export, out: &mut (impl Write + Send)) -> Result<()> {
    let site = export.site.clone().unwrap_or_else(files::host);
    let study = client.get_study(&export.study)?;
    let query = TrialQuery::all().filter(&export.filter).in_present_space();
    let trials = client.trials(&study.identified_name(), query);
    // In a table, what a trial at a cheaper level measured would look like a result.
    let trials = trials.filter(|trial| !trial.as_ref().is_ok_and(|trial| trial.fidelity.is_some()));
    let trials = trials.map(|trial| trial.map_err(Failure::from));
    match export.format {
        ExportFormat::Csv => csv_table::write(out, study.spec()?, trials, &site),
        #[cfg(feature = "parquet")]
        ExportFormat::Parquet => {
            let header = jsonl::Header::new(&site, StudyFile::of(&study)?);
            parquet_table::write(out, &header, study.spec()?, trials)
        }
        ExportFormat::Jsonl => {
            jsonl::write_line(out, &jsonl::Header::new(&site, StudyFile::of(&study)?))?;
            for trial in trials {
                if let Some(carried) = CarriedTrial::of(&trial?, &site) {
                    jsonl::write_line(out, &carried)?;
                }
            }
            Ok(())
        }
    }
}

pub(super) fn import(client: &Client, import: &Import, json: bool) -> Result<String> {
    let path = import.file.as_path();
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let tally = match (&import.optuna_study, &import.vizier_study, extension.as_str()) {
        (Some(name), _, _) => from_other(client, import, optuna::read(path, name)?)?,
        (_, Some(name), _) => from_other(client, import, vizier::read(path, name)?)?,
        (_, _, "csv") => into_named_study(client, import, |spec| csv_table::read(path, spec))?,
        #[cfg(feature = "parquet")]
        (_, _, "parquet") => from_parquet(client, import, path)?,
        (_, _, "db" | "sqlite" | "sqlite3") => {
            return Err(Failure::Usage(
                "say which study to read and where to put it: --optuna-study NAME or --vizier-study NAME, and --study ID".into(),
            ));
        }
        _ => from_jsonl(client, import, path)?,
    };
    either(json, &tally, || tally.words())
}

fn site(import: &Import) -> String {
    import.site.clone().unwrap_or_else(files::host)
}

fn from_jsonl(client: &Client, import: &Import, path: &Path) -> Result<Tally> {
    let (header, trials) = jsonl::read(path)?;
    into_its_study(client, import, &header, trials)
}

#[cfg(feature = "parquet")]
fn from_parquet(client: &Client, import: &Import, path: &Path) -> Result<Tally> {
    match parquet_table::read(path)? {
        (Some(header), trials) => into_its_study(client, import, &header, trials.into_iter().map(Ok)),
        (None, trials) => into_named_study(client, import, |_| Ok(trials)),
    }
}

/// Adds trials that come with their study.
fn into_its_study(
    client: &Client,
    import: &Import,
    header: &jsonl::Header,
    trials: impl Iterator<Item = Result<CarriedTrial>>,
) -> Result<Tally> {
    let id = match import.study.clone().or_else(|| header.study.id.clone()) {
        Some(id) => id,
        None => return Err(Failure::Usage("the file does not name a study; add --study ID".into())),
    };
    let add = |study: &StudyRecord| {
        Importer::new(client, study, &site(import), &import.indicators, import.dry_run)?.run(trials)
    };
    into_new_or_known(client, import, &id, &header.study, add)
}

/// Adds the trials of a table without a specification to a study that the caller names.
fn into_named_study(
    client: &Client,
    import: &Import,
    read: impl FnOnce(&StudySpec) -> Result<Vec<CarriedTrial>>,
) -> Result<Tally> {
    let Some(id) = &import.study else {
        return Err(Failure::Usage("the file does not contain a study; add --study ID".into()));
    };
    let study = client.get_study(id)?;
    let trials = read(study.spec()?)?;
    let importer = Importer::new(client, &study, &site(import), &import.indicators, import.dry_run)?;
    importer.run(trials.into_iter().map(Ok))
}

fn from_other(client: &Client, import: &Import, read: Foreign) -> Result<Tally> {
    if read.without_value > 0 {
        progress::note(&format!("{} trial(s) without a finite value were skipped", read.without_value));
    }
    // Clap sees that it is there.
    let id = import.study.clone().unwrap_or_default();
    let file = read.study.clone();
    let add = |study: &StudyRecord| {
        let metric = read.metric_in(study.spec()?).map_err(Failure::Data)?;
        let trials = read.with_metric(&metric).trials;
        let importer = Importer::new(client, study, &site(import), &import.indicators, import.dry_run)?;
        importer.run(trials.into_iter().map(Ok))
    };
    into_new_or_known(client, import, &id, &file, add)
}

/// Adds trials to the study of this id, which is created where there is none.
fn into_new_or_known(
    client: &Client,
    import: &Import,
    id: &str,
    file: &StudyFile,
    add: impl FnOnce(&StudyRecord) -> Result<Tally>,
) -> Result<Tally> {
    match client.get_study(id) {
        Err(problem) if problem.is_not_found() && !import.dry_run => {
            create_with_trials(client, id, file.spec()?, add)
        }
        found => add(&found?),
    }
}

/// Creates a study and adds trials to it. A frozen study learns nothing, so it freezes afterwards.
pub(super) fn create_with_trials(
    client: &Client,
    id: &str,
    mut spec: StudySpec,
    add: impl FnOnce(&StudyRecord) -> Result<Tally>,
) -> Result<Tally> {
    let is_frozen = spec.policy.operation == Some(Operation::Freeze.into());
    if is_frozen {
        spec.policy.operation = None;
    }
    let study = client.create_study(id, &spec)?;
    let tally = add(&study)?;
    if is_frozen {
        let name = study.identified_name();
        client.update_policy(&name, &PolicyChange::set(Policy::new().operation(Operation::Freeze)))?;
    }
    Ok(tally)
}
