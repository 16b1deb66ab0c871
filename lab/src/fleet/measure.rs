//! Searches of emulated machines, and answers to unseen scenes, in a process of one instruction set.

use std::{borrow::Cow, collections::BTreeMap, collections::btree_map::Entry};

use treewright_client::Options;
use treewright_client::blocking::{Client, Study};
use treewright_render_cli::error::Result;
use treewright_renderer::{tuning::objective::Objective, tuning::verdict::Rival, tuning::who::Who};

use super::machines::{Level, Machine};
use super::record::{At, Conditions, Record};
use crate::leave_scene_out::book::{RecordedRounds, RecordedSearch};
use crate::leave_scene_out::steps::{DEADLINE, Stage, join, space, tell};
use crate::{leave_scene_out::daemon::Daemon, leave_scene_out::hand};

/// The objective: frames that share a build, as in the paper's section 7.1.2.
const OBJECTIVE: Objective = Objective::Render;
/// The renderer's recommended configuration in rounds.
pub(crate) const RECOMMENDED: Who = Who::Named(Cow::Borrowed("recommended"));
/// The best of a search by the machine itself in the scene.
pub(crate) const OWN_SEARCH: Who = Who::Named(Cow::Borrowed("own search"));

/// A predictor's answer after `frames` frames.
pub(crate) fn answer(level: Level, frames: u32) -> Who {
    Who::Named(format!("{level:?} after {frames}").into())
}

/// A contender's frame times with their share of the build.
pub(crate) fn frame_ms(rounds: &RecordedRounds, who: &Who) -> Vec<f64> {
    let found = rounds.find(who);
    found.map(|one| one.frame_ms(OBJECTIVE.frames_per_build())).unwrap_or_default()
}

#[derive(Debug)]
pub(crate) struct Node<'a> {
    pub(crate) machine: &'a Machine,
    pub(crate) conditions: &'a Conditions,
}

impl Node<'_> {
    fn join(&self, daemon: &Daemon, machine: &Machine) -> Result<(Client, Study)> {
        let fingerprint = machine.fingerprint(&self.conditions.processor);
        let options = Options::new().client_id(machine.to_string()).fingerprint(fingerprint);
        join(daemon, OBJECTIVE, &space(OBJECTIVE), options)
    }

    /// A search by a daemon that knows nothing.
    pub(crate) fn search(&self, stage: &mut Stage) -> Result<RecordedSearch> {
        self.search_knowing(stage, &[], self.conditions.frames)
    }

    /// A search of a number of frames by a daemon that knows these searches.
    fn search_knowing(
        &self,
        stage: &mut Stage,
        known: &[&At<RecordedSearch>],
        frames: u32,
    ) -> Result<RecordedSearch> {
        let daemon = Daemon::start()?;
        self.teach(&daemon, known)?;
        let (client, study) = self.join(&daemon, self.machine)?;
        stage.explore(&client, &study, OBJECTIVE, frames)
    }

    /// Reports recorded searches as if their machines worked side by side, trial by trial.
    fn teach(&self, daemon: &Daemon, known: &[&At<RecordedSearch>]) -> Result<()> {
        let mut joined = BTreeMap::new();
        for one in known {
            if let Entry::Vacant(vacant) = joined.entry(one.machine.to_string()) {
                vacant.insert(self.join(daemon, &one.machine)?);
            }
        }
        let longest = known.iter().map(|one| one.measured.trials.len()).max().unwrap_or(0);
        for number in 0..longest {
            for one in known {
                let Some(trial) = one.measured.trials.get(number) else { continue };
                let (_, study) = &joined[&one.machine.to_string()];
                tell(study, &one.measured.state, trial, OBJECTIVE)?;
            }
        }
        for (client, _) in joined.values() {
            client.flush(DEADLINE)?;
        }
        Ok(())
    }

    /// The answers of all predictors before and after the first frames, the defaults, and the search's own.
    pub(crate) fn examine(&self, stage: &mut Stage, scene: &str, record: &Record) -> Result<RecordedRounds> {
        let Conditions { first_frames, rounds, .. } = *self.conditions;
        let space = space(OBJECTIVE);
        let mut entrants = vec![(RECOMMENDED, space.default_configuration())];
        for level in Level::ALL {
            let known = record.searches.iter().filter(|one| one.scene != scene);
            let known: Vec<_> = known.filter(|one| level.knows(self.machine, &one.machine)).collect();
            let found = self.search_knowing(stage, &known, first_frames)?;
            entrants.push((answer(level, 0), found.first_answer));
            let frozen = found.answers.into_iter().next_back();
            entrants.extend(frozen.map(|(frames, found)| (answer(level, frames), found)));
        }
        let own = record.searches.iter().find(|one| one.is_of(self.machine, scene));
        let found = own.and_then(|own| own.measured.answers.values().next_back());
        entrants.extend(found.map(|found| (OWN_SEARCH, found.clone())));
        let mut rivals = hand::native_default();
        for (who, configuration) in entrants {
            rivals.push(Rival::of(who, &space, configuration)?);
        }
        Ok(stage.rounds(rivals, OBJECTIVE, rounds))
    }
}
