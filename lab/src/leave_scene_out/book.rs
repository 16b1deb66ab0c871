//! The measurements on disk, written after every step, so that a stopped run goes on where it stood.
//!
//! Recording and judging are separate. Searches and rounds are recorded with every timing; tables are
//! computed from the book alone.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use treewright_client::{Configuration, Fingerprint, Indicators, Outcome};
use treewright_render_cli::error::{CliError, Result, write_file};
use treewright_render_cli::output;
use treewright_renderer::{frame::FrameTimes, measure::Measured, tuning::who::Who};

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Book {
    /// The machine, and the versions of the measured programs.
    pub(crate) machine: Fingerprint,
    /// Of each scene: triangles as rays meet them, and whether they are placed by instances.
    pub(crate) scenes: BTreeMap<String, SceneFacts>,
    /// By `kind objective scene context`, like the rounds.
    pub(crate) searches: BTreeMap<String, RecordedSearch>,
    pub(crate) rounds: BTreeMap<String, RecordedRounds>,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct SceneFacts {
    pub(crate) triangles: u64,
    pub(crate) instanced: bool,
}

/// A search, frame by frame, and what the service held for the best after some of them.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct RecordedSearch {
    pub(crate) state: Indicators,
    pub(crate) trials: Vec<RecordedTrial>,
    /// The service's answer before anything was measured in the scene.
    pub(crate) first_answer: Configuration,
    /// By how many trials were reported.
    pub(crate) answers: BTreeMap<u32, Configuration>,
    /// Whether the machine had other work.
    pub(crate) disturbed: bool,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct RecordedTrial {
    pub(crate) configuration: Configuration,
    pub(crate) outcome: Outcome,
    pub(crate) times: Option<FrameTimes>,
}

/// Contenders in interleaved rounds. Each is built once where frames share a build, else every round.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct RecordedRounds {
    pub(crate) contenders: Vec<RecordedContender>,
    pub(crate) disturbed: bool,
}

impl RecordedRounds {
    pub(crate) fn find(&self, who: &Who) -> Option<&RecordedContender> {
        self.contenders.iter().find(|one| one.who == *who)
    }

    /// A client's reports of them: every frame in its order, each failure once; without native Embree path
    /// by path, which is in no space, and without the texts in `without`.
    pub(crate) fn frames(
        &self,
        without: &BTreeSet<String>,
    ) -> Vec<(&Configuration, Outcome, Option<FrameTimes>)> {
        let all = || self.contenders.iter().filter_map(|one| Some((one, one.configuration.as_ref()?)));
        let own = || all().filter(|(_, configuration)| !without.contains(&configuration.to_string()));
        let most = self.contenders.iter().map(|one| one.render_ms.len()).max().unwrap_or(0);
        let failed = own().filter_map(|(one, configuration)| {
            let failure = one.failure.clone()?;
            Some((configuration, Outcome::infeasible(failure), None))
        });
        let ran = (0..most).flat_map(|round| {
            own().filter(|(one, _)| one.failure.is_none()).filter_map(move |(one, configuration)| {
                let build_ms = one.build_ms.get(round).or(one.build_ms.last())?;
                let times = FrameTimes::of(*build_ms, *one.render_ms.get(round)?);
                Some((configuration, Outcome::Ok, Some(times)))
            })
        });
        failed.chain(ran).collect()
    }
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct RecordedContender {
    #[serde(rename = "name")]
    pub(crate) who: Who,
    /// Absent for native Embree path by path.
    pub(crate) configuration: Option<Configuration>,
    pub(crate) build_ms: Vec<f64>,
    pub(crate) render_ms: Vec<f64>,
    pub(crate) failure: Option<String>,
}

impl RecordedContender {
    pub(crate) fn new(measured: Measured, configuration: Option<Configuration>) -> Self {
        let Measured { who, frames, failure, .. } = measured;
        let (build_ms, render_ms) = frames.iter().map(|times| (times.build_ms, times.render_ms)).unzip();
        Self { who, configuration, build_ms, render_ms, failure }
    }

    /// Frame times with their share of the build; nothing where it failed.
    pub(crate) fn frame_ms(&self, frames_per_build: u32) -> Vec<f64> {
        if self.failure.is_some() {
            return Vec::new();
        }
        let share = 1.0 / f64::from(frames_per_build);
        let last = self.build_ms.last().copied().unwrap_or(0.0);
        let builds = self.build_ms.iter().copied().chain(std::iter::repeat(last));
        builds.zip(&self.render_ms).map(|(build_ms, render_ms)| build_ms * share + render_ms).collect()
    }
}

#[derive(Debug)]
pub(crate) struct OpenBook {
    path: PathBuf,
    pub(crate) book: Book,
}

impl OpenBook {
    /// Reads a book, or begins one of this machine.
    pub(crate) fn open(path: &Path, machine: Fingerprint) -> Result<Self> {
        let wrong = |cause: String| {
            CliError::Failed(format!("{} is no book of this program: {cause}", path.display()))
        };
        let book = if path.exists() {
            let text = std::fs::read_to_string(path).map_err(|error| wrong(error.to_string()))?;
            let book: Book = serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?;
            if (&book.machine.cpu_model, &book.machine.isa) != (&machine.cpu_model, &machine.isa) {
                return Err(wrong(format!(
                    "it was begun on {}; use another file for this machine",
                    book.machine.cpu_model
                )));
            }
            book
        } else {
            Book { machine, ..Book::default() }
        };
        Ok(Self { path: path.to_owned(), book })
    }

    pub(crate) fn save(&self) -> Result<()> {
        write_file(&self.path, output::to_json(&self.book)?.as_bytes())
    }
}
