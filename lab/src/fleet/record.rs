//! The measurements as JSON Lines: a first line with the conditions, then a line a search or examination.

use std::path::Path;

use serde::{Deserialize, Serialize};
use treewright_client::Fingerprint;
use treewright_render_cli::error::{CliError, Result};

use super::machines::Machine;
use crate::json_lines;
use crate::leave_scene_out::book::{RecordedRounds, RecordedSearch};

/// Under which conditions everything in a record was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Conditions {
    pub(crate) version: String,
    /// On which all machines are emulated.
    pub(crate) processor: Fingerprint,
    pub(crate) machines: Vec<Machine>,
    /// Each as `NAME=PATH` or `NAME=builtin:SCENE:DETAIL:SEED`.
    pub(crate) scenes: Vec<String>,
    /// Trials of a search in a scene that becomes known.
    pub(crate) frames: u32,
    /// Trials in an unseen scene before the answer is frozen.
    pub(crate) first_frames: u32,
    /// Number of measurements of each answer.
    pub(crate) rounds: u32,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct At<T> {
    pub(crate) machine: Machine,
    pub(crate) scene: String,
    pub(crate) measured: T,
}

impl<T> At<T> {
    pub(crate) fn of(machine: &Machine, scene: &str, measured: T) -> Self {
        Self { machine: machine.clone(), scene: scene.to_owned(), measured }
    }

    pub(crate) fn is_of(&self, machine: &Machine, scene: &str) -> bool {
        self.machine == *machine && self.scene == scene
    }
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Line {
    /// By a daemon that knows nothing else.
    Search(At<RecordedSearch>),
    /// The answers of all predictors to a scene that none of them has seen, in interleaved rounds.
    Answers(At<RecordedRounds>),
}

#[derive(Clone, Debug)]
pub(crate) struct Record {
    pub(crate) conditions: Conditions,
    pub(crate) searches: Vec<At<RecordedSearch>>,
    pub(crate) answers: Vec<At<RecordedRounds>>,
}

impl Record {
    /// Reads a record. A last line without an end does not count.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let (conditions, lines) = json_lines::read::<Conditions, Line>(path)?;
        let mut record = Self { conditions, searches: Vec::new(), answers: Vec::new() };
        for line in lines {
            match line? {
                Line::Search(search) => record.searches.push(search),
                Line::Answers(answers) => record.answers.push(answers),
            }
        }
        Ok(record)
    }

    /// Begins a record, or continues one with these conditions.
    pub(crate) fn open(path: &Path, conditions: &Conditions) -> Result<Self> {
        json_lines::begin(path, conditions)?;
        let record = Self::read(path)?;
        if record.conditions == *conditions {
            return Ok(record);
        }
        let path = path.display();
        Err(CliError::Usage(format!("{path} was begun under other conditions; use another file")))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Of two machines, each a group of its own.
    pub(crate) fn conditions() -> Conditions {
        let size = "32x24".parse().expect("it is a size");
        Conditions {
            version: "1".to_owned(),
            processor: Fingerprint::default(),
            machines: Machine::all(&["sse2".to_owned(), "avx2".to_owned()], &[1], &[size]),
            scenes: Vec::new(),
            frames: 24,
            first_frames: 8,
            rounds: 3,
        }
    }

    #[test]
    fn records_are_gone_on_with_under_the_same_conditions_only() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("fleet.jsonl");
        let conditions = conditions();
        Record::open(&path, &conditions).expect("it is begun");
        let at = At::of(&conditions.machines[0], "hall", RecordedRounds::default());
        json_lines::add(&path, &Line::Answers(at)).expect("it can be written");
        assert_eq!(Record::open(&path, &conditions).expect("it is a record").answers.len(), 1);
        let other = Conditions { rounds: 99, ..conditions.clone() };
        assert!(matches!(Record::open(&path, &other), Err(CliError::Usage(_))));
        std::fs::write(&path, "{}\n").expect("it can be written");
        assert!(matches!(Record::read(&path), Err(CliError::Failed(_))));
    }
}
