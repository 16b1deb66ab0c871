//! Damaged and hostile files: a reader answers each with trials or with a problem, and never panics.

use std::path::{Path, PathBuf};

use sqlx::ConnectOptions as _;
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqliteSynchronous};
#[cfg(feature = "parquet")]
use treewright_client::{Indicators, Measurements, TrialRecord};

use super::{csv_table, jsonl, optuna, vizier};
use crate::study_file::StudyFile;

/// A source of numbers, equal in every run (xorshift64*; Vigna, 2016).
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % limit.max(1)
    }
}

/// A file with a few bytes changed, added, doubled or cut off.
fn damaged(whole: &[u8], numbers: &mut Numbers) -> Vec<u8> {
    let mut bytes = whole.to_vec();
    for _ in 0..=numbers.below(4) {
        let place = numbers.below(bytes.len());
        match numbers.below(6) {
            0 => bytes.truncate(place),
            1 => bytes.insert(place, numbers.below(256) as u8),
            2 => {
                let end = (place + numbers.below(40)).min(bytes.len());
                let piece = bytes[place..end].to_vec();
                bytes.splice(place..place, piece);
            }
            _ => {
                if let Some(byte) = bytes.get_mut(place) {
                    *byte = [0, 1, b'-', b'9', b'e', 0x7f, 0xff][numbers.below(7)];
                }
            }
        }
    }
    bytes
}

/// Reads many damaged copies of a file. Also a study that was read must be one or say why it is none.
fn survives(name: &str, whole: &[u8], copies: usize, read: impl Fn(&Path) -> Option<StudyFile>) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(name);
    let mut numbers = Numbers(0x9e37_79b9_7f4a_7c15);
    let mut read_any = false;
    for copy in 0..copies {
        let bytes = if copy == 0 { whole.to_vec() } else { damaged(whole, &mut numbers) };
        std::fs::write(&path, bytes).expect("a file");
        if let Some(study) = read(&path) {
            read_any = true;
            let _ = study.spec();
        }
    }
    assert!(read_any, "not even the file as it is was read");
}

fn study() -> StudyFile {
    let text = r#"{"parameters": [{"name": "level", "type": "integer", "min": 1, "max": 30, "default": 3},
                                  {"name": "kind", "type": "categorical", "values": ["a", " b"], "default": "a"}],
                   "objective": [{"metric": "loss"}]}"#;
    serde_json::from_str(text).expect("a study")
}

#[test]
fn damaged_json_lines_are_refused() {
    let mut whole = Vec::new();
    jsonl::write_line(&mut whole, &jsonl::Header::new("here", study())).expect("written");
    whole.extend(
        br#"{"origin":"a/studies/x/trials/1","client_id":"c","indicators":{},"configuration":{"level":3},"measurements":{"loss":1.5},"outcome":{"kind":"OK"}}
"#,
    );
    survives("a.jsonl", &whole, 4000, |path| {
        let (header, trials) = jsonl::read(path).ok()?;
        trials.for_each(drop);
        Some(header.study)
    });
}

#[test]
fn damaged_tables_are_refused() {
    let whole = b"config.level,config.kind,measurement.loss,outcome,reason,lower_bound,fingerprint\n\
                  3, b,1.5,OK,,,\n4,a,,ABORTED,,7.5,\"{}\"\n5,a,,INFEASIBLE,\"no, memory\",,\n";
    let spec = study().spec().expect("a specification");
    survives("a.csv", whole, 4000, |path| csv_table::read(path, &spec).ok().map(|_| study()));
}

#[cfg(feature = "parquet")]
#[test]
fn damaged_parquet_files_are_refused() {
    let spec = study().spec().expect("a specification");
    let trial = TrialRecord {
        indicators: Indicators::new(),
        configuration: spec.space.default_configuration().into(),
        measurements: Measurements::new().with("loss", 1.5),
        standard_errors: Measurements::new().with("loss", 0.25),
        ..crate::analysis::tests::trial(1, 1, [0, 1], false, "a", 1.5)
    };
    let mut whole = Vec::new();
    let header = jsonl::Header::new("here", study());
    super::parquet_table::write(&mut whole, &header, &spec, vec![Ok(trial)].into_iter()).expect("written");
    survives("a.parquet", &whole, 4000, |path| super::parquet_table::read(path).ok()?.0.map(|h| h.study));
}

fn execute(path: &Path, statements: &[String]) {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    runtime.block_on(async {
        // Nothing waits for the disk: these files need not outlive a crash.
        let options = SqliteConnectOptions::new().filename(path).create_if_missing(true);
        let options = options.synchronous(SqliteSynchronous::Off).journal_mode(SqliteJournalMode::Memory);
        let mut database = options.connect().await.expect("a database");
        for statement in statements {
            let asserted = sqlx::AssertSqlSafe(statement.clone());
            // Some values are none that a column takes.
            let _ = sqlx::query(asserted).execute(&mut database).await;
        }
    });
}

/// Values that no program writes into a column.
const VALUES: [&str; 12] = [
    "NULL",
    "x'ff00'",
    "''",
    "'word'",
    "9e999",
    "-9e999",
    "1e300",
    "9223372036854775807",
    "-9223372036854775808",
    "0.5",
    "'{}'",
    "(SELECT printf('%.100000c', 'x'))",
];

/// Puts each value into each column of a database, alone, and reads it.
fn odd_values(original: &Path, columns: &[(&str, &str)], read: impl Fn(&Path) -> Option<StudyFile>) {
    assert!(read(original).is_some(), "as it is, it is read");
    let copy = original.with_extension("copy");
    for (table, column) in columns {
        for value in VALUES {
            for rows in ["", " WHERE rowid = 1"] {
                std::fs::copy(original, &copy).expect("a copy");
                execute(&copy, &[format!("UPDATE {table} SET {column} = {value}{rows}")]);
                if let Some(study) = read(&copy) {
                    let _ = study.spec();
                }
            }
        }
    }
}

fn optuna_file(folder: &Path) -> PathBuf {
    optuna::tests::database(folder)
}

fn read_optuna(path: &Path) -> Option<StudyFile> {
    optuna::read(path, "mine").ok().map(|read| read.with_metric("loss").study)
}

#[test]
fn odd_values_in_a_database_of_optuna_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let columns = [
        ("studies", "study_id"),
        ("studies", "study_name"),
        ("study_directions", "direction"),
        ("study_directions", "objective"),
        ("trials", "number"),
        ("trials", "state"),
        ("trials", "study_id"),
        ("trial_params", "param_name"),
        ("trial_params", "param_value"),
        ("trial_params", "distribution_json"),
        ("trial_values", "value"),
        ("trial_values", "trial_id"),
    ];
    odd_values(&optuna_file(folder.path()), &columns, read_optuna);
}

#[test]
fn odd_distributions_of_optuna_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let original = optuna_file(folder.path());
    let copy = original.with_extension("copy");
    let numbers =
        ["0", "-1", "1", "1e308", "-1e308", "9223372036854775807", "-9223372036854775808", "null", "\"x\""];
    for name in
        ["IntDistribution", "FloatDistribution", "DiscreteUniformDistribution", "IntLogUniformDistribution"]
    {
        for low in numbers {
            for high in numbers {
                for step in ["1", "2", "0", "-3", "9223372036854775807", "1e-320", "null"] {
                    let text = format!(
                        r#"{{"name": "{name}", "attributes": {{"low": {low}, "high": {high}, "step": {step}, "q": {step}, "log": true}}}}"#
                    );
                    std::fs::copy(&original, &copy).expect("a copy");
                    let change = format!(
                        "UPDATE trial_params SET distribution_json = '{text}' WHERE param_name = 'Depth'"
                    );
                    execute(&copy, &[change]);
                    if let Some(study) = read_optuna(&copy) {
                        let _ = study.spec();
                    }
                }
            }
        }
    }
}

#[test]
fn damaged_databases_of_optuna_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let whole = std::fs::read(optuna_file(folder.path())).expect("a file");
    survives("a.db", &whole, 600, read_optuna);
}

fn read_vizier(path: &Path) -> Option<StudyFile> {
    vizier::read(path, "mine").ok().map(|read| read.study)
}

#[test]
fn odd_and_damaged_databases_of_vizier_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("vizier.db");
    vizier::tests::example(&path);
    let columns = [
        ("studies", "study_name"),
        ("studies", "owner_id"),
        ("studies", "study_id"),
        ("studies", "serialized_study"),
        ("trials", "serialized_trial"),
        ("trials", "trial_id"),
        ("trials", "owner_id"),
    ];
    odd_values(&path, &columns, read_vizier);
    let whole = std::fs::read(&path).expect("a file");
    survives("b.db", &whole, 600, read_vizier);
}
