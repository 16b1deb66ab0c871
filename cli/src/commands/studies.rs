//! Studies: list, create, show, change, copy, rename, delete.

use std::path::Path;

use treewright_client::blocking::Client;
use treewright_client::{Best, Configuration, Policy, StudyRecord, StudySpec, TextChange, TrialQuery};

use super::carry::create_with_trials;
use crate::arguments::study::{CloneStudy, EditStudy, StudyCommand};
use crate::carry::{CarriedTrial, Importer, Tally};
use crate::failure::{Failure, Result};
use crate::files;
use crate::output::either;
use crate::progress;
use crate::show;
use crate::study_file::StudyFile;
use crate::study_file::find::id_of;

pub(super) fn list(client: &Client, tags: &[String], json: bool) -> Result<String> {
    let studies = tagged(client, tags)?;
    either(json, &studies, || some_or_none(&studies, tags, show::studies))
}

/// The studies with all these tags.
fn tagged(client: &Client, tags: &[String]) -> Result<Vec<StudyRecord>> {
    let mut studies = client.list_studies()?;
    studies.retain(|study| tags.iter().all(|tag| study.tags.contains(tag)));
    Ok(studies)
}

fn some_or_none<T>(studies: &[T], tags: &[String], show: impl Fn(&[T]) -> String) -> String {
    match (studies.is_empty(), tags.is_empty()) {
        (false, _) => show(studies),
        (true, true) => "no studies yet".to_owned(),
        (true, false) => format!("no study is tagged {}", tags.join(", ")),
    }
}

/// Most states of a study whose standings are read.
const STATES_READ: i64 = 12;

/// The standing of each study. The daemon reads every study into its memory for that.
pub(super) fn standings(client: &Client, tags: &[String], json: bool) -> Result<String> {
    let mut all = Vec::new();
    for study in tagged(client, tags)? {
        let found = best_of_states(client, &study, STATES_READ)?;
        all.push((study, found));
    }
    let records: Vec<_> =
        all.iter().map(|(study, best)| serde_json::json!({ "study": study.name, "best": best })).collect();
    either(json, &records, || some_or_none(&all, tags, show::standings))
}

/// The best of each of the first states in which something was measured.
pub(super) fn best_of_states(client: &Client, study: &StudyRecord, most: i64) -> Result<Vec<Best>> {
    let (name, mut found) = (study.identified_name(), Vec::new());
    for state in 1..=study.statistics.states.min(most) {
        found.extend(client.best_of_state(&name, state)?);
    }
    Ok(found)
}

pub(super) fn run(client: &Client, command: &StudyCommand, json: bool) -> Result<String> {
    match command {
        StudyCommand::Create { file, id } => create(client, file, id.as_deref(), json),
        StudyCommand::Show { name, format: Some(language) } => {
            StudyFile::of(&client.get_study(name)?)?.write(*language)
        }
        StudyCommand::Show { name, format: None } => {
            let study = client.get_study(name)?;
            // The study is shown even where its states cannot be read.
            let found = if json {
                Vec::new()
            } else {
                best_of_states(client, &study, STATES_READ).unwrap_or_default()
            };
            either(json, &study, || show::study(&study, &found))
        }
        // Answered without a daemon.
        StudyCommand::Schema => Ok(String::new()),
        StudyCommand::Clone(copy) => {
            let tally = clone(client, copy)?;
            either(json, &tally, || tally.words())
        }
        StudyCommand::Edit(change) => match &change.file {
            Some(file) => edit_space(client, change, file, json),
            None => edit_texts(client, change, json),
        },
        StudyCommand::Rename { name, to } => rename(client, name, to, json),
        StudyCommand::Delete { name, yes } => delete(client, name, *yes, json),
    }
}

fn create(client: &Client, path: &Path, id: Option<&str>, json: bool) -> Result<String> {
    let file = StudyFile::read(path)?;
    let study = client.create_study(&id_of(&file, path, id)?, &file.spec()?)?;
    either(json, &study, || {
        let mut text = format!("{} is ready", study.name);
        if study.statistics.trials > 0 {
            text += &format!(", with {} trial(s)", study.statistics.trials);
        }
        if !study.policy_differs.is_empty() {
            text += &format!(
                "; its stored policy differs in {} and stays (change it with `treewright policy`)",
                study.policy_differs.join(", ")
            );
        }
        text
    })
}

fn clone(client: &Client, copy: &CloneStudy) -> Result<Tally> {
    let original = client.get_study(&copy.name)?;
    if let Ok(there) = client.get_study(&copy.to) {
        return Err(Failure::Data(format!("{} already exists; choose another id", there.name)));
    }
    let mut file = copy.spec.as_deref().map_or_else(|| StudyFile::of(&original), StudyFile::read)?;
    file.id = None;
    create_with_trials(client, &copy.to, file.spec()?, |target| {
        if copy.no_trials {
            return Ok(Tally { study: copy.to.clone(), ..Tally::default() });
        }
        let site = files::host();
        let importer = Importer::new(client, target, &site, &copy.indicators, false)?;
        let completed = TrialQuery::all().filter("state = COMPLETED").in_present_space();
        let trials = client.trials(&original.identified_name(), completed);
        importer.run(trials.filter_map(|trial| match trial {
            Ok(trial) => CarriedTrial::of(&trial, &site).map(Ok),
            Err(problem) => Some(Err(problem.into())),
        }))
    })
}

fn edit_texts(client: &Client, change: &EditStudy, json: bool) -> Result<String> {
    let texts = TextChange {
        display_name: change.display_name.clone(),
        note: change.note.clone(),
        tags: None,
        added_tags: change.tags.iter().cloned().collect(),
        removed_tags: change.untags.iter().cloned().collect(),
    };
    let study = client.update_texts(&change.name, &texts)?;
    either(json, &study, || show::texts(&study))
}

/// Changes the space of a study, or shows what that would mean.
fn edit_space(client: &Client, change: &EditStudy, file: &Path, json: bool) -> Result<String> {
    let (study, file) = (client.get_study(&change.name)?, StudyFile::read(file)?.spec()?);
    let before = study.spec()?;
    let others = [
        ("indicators", file.indicators == before.indicators),
        ("objective", file.objective == before.objective),
        ("state_tolerance", file.state_tolerance == before.state_tolerance),
        ("seed", file.seed == before.seed),
    ];
    if let Some((what, _)) = others.iter().find(|(_, is_same)| !is_same) {
        let message = format!("{what}: not as in {}, which keeps it; use `study clone --spec`", study.name);
        return Err(Failure::Data(message));
    }
    if let Some(words) = kept_words(&file, &study) {
        progress::note(&words);
    }
    let fixed: Configuration = change.fixed.iter().cloned().collect();
    let differences = show::space::differences(&before.space, &file.space, &fixed);
    let (name, revision) = (study.identified_name(), study.space_revision);
    let changed = client.change_space(&name, revision, &file.space, &fixed, !change.yes)?;
    let record = serde_json::json!({
        "study": changed.study.name,
        "space_revision": changed.study.space_revision,
        "is_changed": change.yes && !differences.is_empty(),
        "differences": differences,
        "kept_trials": changed.kept_trials,
        "outside_trials": changed.outside_trials,
        "given_back_trials": changed.given_back_trials,
    });
    either(json, &record, || show::space::changed(&differences, &changed, change.yes))
}

/// The fields that the study keeps though its file says otherwise, and the commands that change them.
fn kept_words(file: &StudySpec, study: &StudyRecord) -> Option<String> {
    let differs = |name: &str, unset: &str| {
        let said = file.policy.show(name);
        said.is_some_and(|said| study.policy.show(name).as_deref().unwrap_or(unset) != said)
    };
    let policy = Policy::FIELDS.iter().filter(|field| differs(field.name, field.unset));
    let mut kept: Vec<_> = policy.map(|field| format!("policy.{}", field.name)).collect();
    let texts = [
        ("display_name", !file.display_name.is_empty() && file.display_name != study.display_name),
        ("note", !file.note.is_empty() && file.note != study.note),
        ("tags", !file.tags.is_empty() && file.tags != study.tags),
    ];
    kept.extend(texts.iter().filter(|(_, differs)| *differs).map(|(name, _)| (*name).to_owned()));
    let (kept, id) = ((!kept.is_empty()).then(|| kept.join(", "))?, study.id());
    Some(format!(
        "{kept}: not as in {}, and not changed by the file; use `treewright policy {id}` for the policy, \
         `treewright study edit {id} --note`, `--tag` or `--display-name` for the texts",
        study.name
    ))
}

fn rename(client: &Client, name: &str, to: &str, json: bool) -> Result<String> {
    let study = client.rename_study(name, to)?;
    either(json, &study, || format!("renamed {name} to {to}, with {} trial(s)", study.statistics.trials))
}

fn delete(client: &Client, name: &str, yes: bool, json: bool) -> Result<String> {
    if !yes {
        let study = client.get_study(name)?;
        let trials = study.statistics.trials;
        let message =
            format!("this deletes {} and its {trials} trial(s) for ever; add --yes to confirm", study.name);
        return Err(Failure::Usage(message));
    }
    client.delete_study(name)?;
    either(json, &serde_json::json!({ "deleted": name }), || format!("deleted {name}"))
}
