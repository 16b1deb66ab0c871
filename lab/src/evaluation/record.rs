//! The measurements as JSON Lines: a first line with the conditions, then one line a search, group or pair.
//!
//! Each line holds the hash of its scene and the version of the program; a second scene under one name is
//! refused.
//!
//! Records of older forms can be read and judged. None is added to, as its first line would say the wrong
//! form of what follows.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use treewright_client::{Configuration, Fingerprint, Outcome};
use treewright_core::policy::SearchMethod;
use treewright_render_cli::error::{CliError, Result};
use treewright_renderer::{frame::FrameTimes, statistics::Summary, tuning::objective::Objective};

use crate::json_lines::{self, wrong};

/// Version of the form.
pub(crate) const VERSION: u32 = 3;
/// The searches' method: the paper's, after Chang.
pub(crate) const METHOD: SearchMethod = SearchMethod::NelderMead;

/// Which clock costs are read from. Records by another one are refused.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Clock {
    /// Wall time: what a user waits for.
    #[default]
    Wall,
}

/// The objective in milliseconds. As in the paper a render time stands alone where builds are shared.
pub(crate) fn cost(objective: Objective, times: &FrameTimes) -> f64 {
    match objective {
        Objective::Render | Objective::Error => times.render_ms,
        Objective::Total | Objective::Motion => times.build_ms + times.render_ms,
        Objective::Auto(frames) => times.build_ms / f64::from(frames) + times.render_ms,
    }
}

/// Under which conditions everything in a record was measured.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Conditions {
    pub(crate) version: u32,
    pub(crate) machine: Fingerprint,
    pub(crate) threads: usize,
    /// Pixels across and down.
    pub(crate) size: [u32; 2],
    pub(crate) bounces: u32,
    /// The clock whose times searches minimise.
    pub(crate) clock: Clock,
    pub(crate) iterations: u32,
    pub(crate) cameras: u32,
    pub(crate) seed: u64,
    /// The parameter space, `paper` or `full`.
    pub(crate) space: String,
}

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(crate) struct Place {
    pub(crate) scene: String,
    /// From 0.
    pub(crate) camera: u32,
}

/// The scene of a measurement, and the program that took it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Provenance {
    /// SHA-256 of the scene's geometry as it was loaded, in hexadecimal digits.
    pub(crate) scene_hash: String,
    /// Version of this program.
    pub(crate) program: String,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Iteration {
    pub(crate) configuration: Configuration,
    pub(crate) step: String,
    pub(crate) outcome: Outcome,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) times: Option<FrameTimes>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Search {
    pub(crate) objective: String,
    /// Its method, e.g. `nelder_mead`.
    pub(crate) method: String,
    pub(crate) place: Place,
    pub(crate) state: BTreeMap<String, f64>,
    pub(crate) iterations: Vec<Iteration>,
    /// Cores that other programs used meanwhile, where the system tells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) other_cores: Option<f64>,
    /// Absent in records of version 2 and before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) provenance: Option<Provenance>,
}

impl Search {
    /// The objective; `None` for one that this program does not know.
    pub(crate) fn minimised(&self) -> Option<Objective> {
        Objective::ALL.into_iter().find(|one| one.name() == self.objective)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum GroupKind {
    /// Configurations by hand, beside the best of each search.
    Fixed,
    /// The predictors' answers, the default, the best fixed ones, and each search at each milestone.
    Answers,
    /// Without and with splitting.
    Pair,
    /// The results of searches over a few parameters, beside the default.
    Parts,
}

/// A configuration in rounds that are interleaved with those of the others in its group.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Member {
    pub(crate) configuration: Configuration,
    /// One a round.
    pub(crate) rounds: Vec<FrameTimes>,
    /// Why it cannot be run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) failure: Option<String>,
}

/// Configurations that were measured against each other at one place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Group {
    pub(crate) kind: GroupKind,
    pub(crate) place: Place,
    pub(crate) members: Vec<Member>,
    /// Cores that other programs used meanwhile, where the system tells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) other_cores: Option<f64>,
    /// Absent in records of version 2 and before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) provenance: Option<Provenance>,
}

impl Group {
    pub(crate) fn member(&self, configuration: &Configuration) -> Option<&Member> {
        self.members.iter().find(|member| member.configuration == *configuration)
    }

    /// The cost of a configuration in each round, in milliseconds; `None` where it is not or cannot run.
    pub(crate) fn costs(&self, configuration: &Configuration, objective: Objective) -> Option<Vec<f64>> {
        let member = self.member(configuration).filter(|member| member.failure.is_none())?;
        let costs: Vec<f64> = member.rounds.iter().map(|times| cost(objective, times)).collect();
        (!costs.is_empty()).then_some(costs)
    }

    /// Their median.
    pub(crate) fn cost(&self, configuration: &Configuration, objective: Objective) -> Option<f64> {
        Some(Summary::of(&self.costs(configuration, objective)?).median)
    }
}

/// A search over a few parameters, which its configurations hold alone (paper, section 4.2).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct PartSearch {
    /// Which parameters, by the name of [`super::parts::Part`].
    pub(crate) part: String,
    /// From 0; each run draws points of its own.
    pub(crate) run: u32,
    pub(crate) search: Search,
}

/// Under what the recommended build and the one that also splits triangles were compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Versus {
    /// Frames of this height in pixels, four across to three down (section 4.1).
    Height(u32),
    /// The cylinder of needles at one of several angles of a round (section 4.3).
    Needles {
        /// From 0.
        angle: u32,
        angles: u32,
    },
}

/// The recommended build without and with splitting, in interleaved rounds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Pair {
    pub(crate) versus: Versus,
    /// Without splitting, then with it.
    pub(crate) group: Group,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Line {
    Search(Search),
    Group(Group),
    Part(PartSearch),
    Pair(Pair),
}

impl Line {
    fn measured(&self) -> (&Place, Option<&Provenance>) {
        match self {
            Self::Search(search) | Self::Part(PartSearch { search, .. }) => {
                (&search.place, search.provenance.as_ref())
            }
            Self::Group(group) | Self::Pair(Pair { group, .. }) => (&group.place, group.provenance.as_ref()),
        }
    }
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Record {
    pub(crate) conditions: Conditions,
    pub(crate) searches: Vec<Search>,
    /// The latest of each kind and place.
    pub(crate) groups: BTreeMap<(GroupKind, Place), Group>,
    pub(crate) parts: Vec<PartSearch>,
    /// The latest of each scene.
    pub(crate) pairs: BTreeMap<(String, Versus), Group>,
    /// The hash of each scene's geometry, where a line holds it.
    pub(crate) scenes: BTreeMap<String, String>,
    /// Versions of this program that measured.
    pub(crate) programs: BTreeSet<String>,
}

impl Record {
    pub(crate) fn new(conditions: Conditions) -> Self {
        Self { conditions, ..Self::default() }
    }

    /// Reads a file; the line that a killed run left unfinished is passed over.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let (conditions, lines) = json_lines::read::<Conditions, Line>(path)?;
        if conditions.version > VERSION {
            let found = conditions.version;
            return Err(wrong(path, &format!("it is of version {found}, and this program knows {VERSION}")));
        }
        let mut record = Self::new(conditions);
        for (number, line) in lines.enumerate() {
            let line = line?;
            let failed = |error: CliError| wrong(path, &format!("line {}: {error}", number + 2));
            record.check(&line).map_err(failed)?;
            record.take(line);
        }
        Ok(record)
    }

    pub(crate) fn has_search(&self, objective: Objective, place: &Place) -> bool {
        let is_it = |one: &Search| one.objective == objective.name() && one.method == METHOD.name();
        self.searches.iter().any(|one| is_it(one) && one.place == *place)
    }

    /// Refuses a scene under the name of one that has another geometry.
    pub(crate) fn admit(&self, scene: &str, hash: &str) -> Result<()> {
        match self.scenes.get(scene).filter(|known| *known != hash) {
            None => Ok(()),
            Some(known) => {
                let short = |hash: &str| hash.chars().take(12).collect::<String>();
                Err(CliError::Usage(format!(
                    "another scene was measured under the name {scene} (geometry {}, this one has {}); \
                     give this one another name, or use another file",
                    short(known),
                    short(hash)
                )))
            }
        }
    }

    fn check(&self, line: &Line) -> Result<()> {
        let (place, Some(provenance)) = line.measured() else { return Ok(()) };
        self.admit(&place.scene, &provenance.scene_hash)
    }

    pub(crate) fn take(&mut self, line: Line) {
        if let (place, Some(Provenance { scene_hash, program })) = line.measured() {
            self.scenes.insert(place.scene.clone(), scene_hash.clone());
            self.programs.insert(program.clone());
        }
        match line {
            Line::Search(search) => self.searches.push(search),
            Line::Group(group) => {
                self.groups.insert((group.kind, group.place.clone()), group);
            }
            Line::Part(part) => self.parts.push(part),
            Line::Pair(pair) => {
                self.pairs.insert((pair.group.place.scene.clone(), pair.versus), pair.group);
            }
        }
    }
}

#[derive(Debug)]
pub(crate) struct OpenRecord {
    path: PathBuf,
    pub(crate) record: Record,
}

impl OpenRecord {
    /// Opens or begins a record. One of other conditions, or of an older form, is refused.
    pub(crate) fn open(path: &Path, conditions: &Conditions) -> Result<Self> {
        json_lines::begin(path, conditions)?;
        let record = Record::read(path)?;
        let (found, asked) = (&record.conditions, conditions);
        if found.version < VERSION {
            return Err(CliError::Usage(format!(
                "{} is of version {}, and this program adds lines of version {VERSION}; it can be judged as it \
                 is, but begin another file for more",
                path.display(),
                found.version
            )));
        }
        if (Conditions { machine: asked.machine.clone(), ..found.clone() }) != *asked {
            return Err(CliError::Usage(format!(
                "{} was begun under other conditions ({}; asked for are {}); use another file",
                path.display(),
                words(found),
                words(asked)
            )));
        }
        if (&found.machine.cpu_model, &found.machine.isa) != (&asked.machine.cpu_model, &asked.machine.isa) {
            let cpu = &found.machine.cpu_model;
            return Err(CliError::Usage(format!("{} was begun on {cpu}; use another file", path.display())));
        }
        Ok(Self { path: path.to_owned(), record })
    }

    /// Adds a line; it is on the disk when this returns. One of another scene is refused.
    pub(crate) fn add(&mut self, line: Line) -> Result<()> {
        self.record.check(&line)?;
        json_lines::add(&self.path, &line)?;
        self.record.take(line);
        Ok(())
    }
}

fn words(conditions: &Conditions) -> String {
    let Conditions { threads, size: [width, height], bounces, iterations, cameras, seed, space, .. } =
        conditions;
    format!(
        "{threads} threads, {width}x{height}, {bounces} bounces, {iterations} iterations, {cameras} cameras, \
         seed {seed}, {space} space"
    )
}

#[cfg(test)]
mod tests {
    use super::super::testing::{self, conditions};
    use super::*;

    /// A group at a camera of the hall.
    fn of(camera: u32, hash: Option<&str>) -> Line {
        let place = Place { scene: "hall".to_owned(), camera };
        let provenance =
            hash.map(|hash| Provenance { scene_hash: hash.to_owned(), program: "7.8.9".to_owned() });
        let group = testing::group(GroupKind::Fixed, "hall", &[(testing::numbered(3), &[0.3][..])]);
        Line::Group(Group { place, provenance, ..group })
    }

    #[test]
    fn another_scene_under_the_same_name_is_refused_when_written_and_when_read() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let path = folder.path().join("record.jsonl");
        let mut open = OpenRecord::open(&path, &conditions(80)).expect("it is begun");
        // An older line says nothing of its scene.
        for hash in [None, Some("aaaaaaaaaaaaaaaa"), Some("aaaaaaaaaaaaaaaa")] {
            open.add(of(open.record.groups.len() as u32, hash)).expect("it is that scene");
        }
        let message = open.add(of(3, Some("bbbbbbbbbbbbbbbb"))).expect_err("another scene").to_string();
        for word in ["hall", "aaaaaaaaaaaa,", "bbbbbbbbbbbb)", "another name"] {
            assert!(message.contains(word), "{word} in {message}");
        }
        let read = Record::read(&path).expect("nothing of another scene was written");
        assert_eq!((read.groups.len(), &read.programs), (3, &BTreeSet::from(["7.8.9".to_owned()])));
        assert!(read.admit("hall", "bbbbbbbbbbbbbbbb").is_err());
        read.admit("barn", "bbbbbbbbbbbbbbbb").expect("a scene that is new");
        // Two records in one file.
        let mut text = std::fs::read_to_string(&path).expect("it is there");
        text +=
            &format!("{}\n", serde_json::to_string(&of(4, Some("cccccccccccccccc"))).expect("it is text"));
        std::fs::write(&path, text).expect("it can be written");
        let message = Record::read(&path).expect_err("two scenes").to_string();
        assert!(message.contains("line 5") && message.contains("under the name hall"), "{message}");
    }

    #[test]
    fn an_older_record_is_read_and_not_added_to() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let path = folder.path().join("record.jsonl");
        let old = Conditions { version: VERSION - 1, ..conditions(80) };
        let text = format!("{}\n", serde_json::json!({ "conditions": old }));
        std::fs::write(&path, &text).expect("it can be written");
        for asked in [&conditions(80), &old] {
            let message = OpenRecord::open(&path, asked).expect_err("another version").to_string();
            let [found, known] = [VERSION - 1, VERSION].map(|version| format!("version {version}"));
            for word in [found.as_str(), &known, "another file"] {
                assert!(message.contains(word), "{word} in {message}");
            }
        }
        assert_eq!(std::fs::read_to_string(&path).expect("it is there"), text);
        assert_eq!(Record::read(&path).expect("it is read").conditions, old);
    }

    #[test]
    fn a_record_by_processor_time_is_refused() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let path = folder.path().join("record.jsonl");
        let mut head = serde_json::json!({ "conditions": conditions(80) });
        head["conditions"]["clock"] = "cpu".into();
        std::fs::write(&path, format!("{head}\n")).expect("it can be written");
        let message = Record::read(&path).expect_err("another clock").to_string();
        assert!(message.contains("line 1") && message.contains("cpu"), "{message}");
    }
}
