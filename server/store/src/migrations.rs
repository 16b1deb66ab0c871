//! The schema of each database, from its first version to the one that this program knows.
//!
//! The files of `migrations/` are part of the program. The list here is compared with the folder by a test.
//! (sqlx's own macro would list them, at the build time that `from_row` names.)

use std::borrow::Cow;

use sqlx::SqlStr;
use sqlx::migrate::{Migration, MigrationType, Migrator};

/// `NUMBER_NAME` of every file of a folder of `migrations/`, in their order.
macro_rules! files {
    ($folder:literal: $($name:literal),+ $(,)?) => {
        &[$(($name, include_str!(concat!("../../../migrations/", $folder, "/", $name, ".sql")))),+]
    };
}

const SQLITE: &[(&str, &str)] = files!("sqlite":
    "0001_studies_states_trials_visits",
    "0002_visits_weigh",
    "0003_checkpoints",
    "0004_tokens",
    "0005_states_fingerprint",
    "0006_visits_since",
    "0007_trials_by_state",
    "0008_studies_uid",
    "0009_trials_exclusion",
    "0010_trials_standard_errors",
);

#[cfg(feature = "postgres")]
const POSTGRES: &[(&str, &str)] = files!("postgres":
    "0001_studies_states_trials_visits",
    "0002_tokens",
    "0003_states_fingerprint",
    "0004_visits_since",
    "0005_trials_by_state",
    "0006_studies_uid",
    "0007_trials_exclusion",
    "0008_trials_standard_errors",
);

pub(crate) fn sqlite() -> Migrator {
    migrator(SQLITE)
}

#[cfg(feature = "postgres")]
pub(crate) fn postgres() -> Migrator {
    migrator(POSTGRES)
}

fn migrator(files: &'static [(&'static str, &'static str)]) -> Migrator {
    let migrations: Vec<Migration> = files.iter().copied().map(migration).collect();
    assert!((1..).zip(&migrations).all(|(version, one)| one.version == version), "versions rise from 1");
    Migrator { migrations: migrations.into(), ..Migrator::DEFAULT }
}

fn migration((name, text): (&'static str, &'static str)) -> Migration {
    let (version, description) = name.split_once('_').expect("NUMBER_NAME");
    Migration::new(
        version.parse().expect("a number"),
        // The form in which sqlx reads it from a file's name, and in which earlier versions stored it.
        Cow::Owned(description.replace('_', " ")),
        MigrationType::Simple,
        SqlStr::from_static(text),
        text.starts_with("-- no-transaction"),
    )
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// The list equals sqlx's own reading of the folder, including the check sums that databases hold.
    #[tokio::test]
    async fn every_file_is_listed_as_sqlx_reads_it() {
        let top = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../migrations");
        for (folder, ours) in [("sqlite", sqlite()), ("postgres", postgres())] {
            let read = Migrator::new(top.join(folder)).await.expect("the folder");
            let rows = |migrator: &Migrator| -> Vec<_> {
                let row = |m: &Migration| (m.version, m.description.clone(), m.checksum.clone(), m.no_tx);
                migrator.iter().map(row).collect()
            };
            assert_eq!(rows(&ours), rows(&read), "{folder}");
        }
    }
}
