//! The common part of the commands that record: scenes, conditions, and one measurement after the other.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use treewright_accel::Device;
use treewright_client::{Configuration, Fingerprint, detect_fingerprint};
use treewright_render_cli::arguments::Size;
use treewright_render_cli::error::{CliError, Result, check_folder};
use treewright_renderer::limits::{ITERATIONS_MAX, THREADS_MAX};
use treewright_renderer::space::{Premises, Preset, TuningSpace};

use crate::evaluation::record::{Clock, Conditions, OpenRecord, Place, Record, VERSION};
use crate::{evaluation::measure::ALL, evaluation::measure::best_within, leave_scene_out::suite::Entry};

/// Scenes of this program that stand in for those of the paper that cannot be had, in about their sizes.
const BUILT_IN: [&str; 2] = ["gallery=builtin:gallery:1:7", "voxels=builtin:voxels:0.6:7"];
const BOUNCES: u32 = 3;
const SEED: u64 = 1;

/// Where the record is, and under which conditions it is made.
#[derive(Args, Clone, Debug)]
pub(super) struct ConditionArguments {
    /// The record, as JSON Lines. A new run continues where the last one stopped, even after `kill -9`.
    #[arg(long, value_name = "FILE.jsonl")]
    pub(super) record: PathBuf,

    #[command(flatten)]
    pub(super) scenes: SceneArguments,

    /// Iterations per search, each of which builds and renders.
    #[arg(long, value_name = "N", default_value_t = 80, value_parser = clap::value_parser!(u32).range(2..=i64::from(ITERATIONS_MAX)))]
    iterations: u32,

    /// Cameras along each scene's path.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(5..=1000))]
    pub(super) cameras: u32,

    /// Render threads; 0 for one per core.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u64).range(0..=THREADS_MAX as u64))]
    threads: u64,

    /// Size in pixels.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "320x240")]
    size: Size,

    /// Start no measurement after this many seconds.
    #[arg(long, value_name = "S")]
    pub(super) seconds: Option<u64>,
}

/// Which scenes.
#[derive(Args, Clone, Debug)]
pub(super) struct SceneArguments {
    /// Another scene, NAME=PATH or NAME=builtin:SCENE:DETAIL:SEED; can be repeated.
    #[arg(long, value_name = "NAME=PATH")]
    scene: Vec<Entry>,

    /// Only these scenes. Default: the built-in scenes and those of --scene.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    only: Vec<String>,
}

impl SceneArguments {
    pub(super) fn entries(&self) -> Result<Vec<Entry>> {
        self.beside_named(&BUILT_IN)
    }

    /// As [`Self::beside`], of built-in scenes as they are written on the command line.
    pub(super) fn beside_named(&self, built_in: &[&str]) -> Result<Vec<Entry>> {
        let built_in: Result<_, String> = built_in.iter().map(|text| text.parse()).collect();
        self.beside(built_in.map_err(CliError::Usage)?)
    }

    /// The given built-in scenes and the named ones.
    pub(super) fn beside(&self, built_in: Vec<Entry>) -> Result<Vec<Entry>> {
        let mut all = built_in;
        all.extend(self.scene.iter().cloned());
        if let Some(unknown) = self.only.iter().find(|name| all.iter().all(|entry| entry.name != **name)) {
            return Err(CliError::Usage(format!("no scene is called {unknown}; see --scene")));
        }
        all.retain(|entry| self.only.is_empty() || self.only.contains(&entry.name));
        Ok(all)
    }
}

/// Takes one missing measurement after the other until the time is up, and says how long the rest lasts.
pub(super) fn take_all<T>(
    missing: Vec<T>,
    seconds: Option<u64>,
    mut take: impl FnMut(T) -> Result<String>,
) -> Result<()> {
    let (begin, all) = (Instant::now(), missing.len());
    for (done, one) in (1_usize..).zip(missing) {
        if seconds.is_some_and(|seconds| begin.elapsed() >= Duration::from_secs(seconds)) {
            eprintln!("the time is up; this command goes on from here");
            break;
        }
        let what = take(one)?;
        let left_s = begin.elapsed().as_secs_f64() / done as f64 * (all - done) as f64;
        eprintln!("{done}/{all} {what}; about {:.0} min left", left_s / 60.0);
    }
    Ok(())
}

/// A machine with the versions of the programs that are measured on it.
pub(super) fn with_versions(machine: Fingerprint, threads: usize) -> Result<Fingerprint> {
    let (major, minor, patch) = Device::open(threads)?.version();
    let machine = machine.software("treewright-lab", env!("CARGO_PKG_VERSION"));
    Ok(machine.software("embree", format!("{major}.{minor}.{patch}")))
}

pub(super) fn space(conditions: &Conditions) -> TuningSpace {
    let preset = if conditions.space == "paper" { Preset::Paper } else { Preset::Full };
    TuningSpace::new(preset, &Premises::all())
}

/// Adds the best of each search at a place after each number of trials in `after`, and at its end.
pub(super) fn add_found(record: &Record, place: &Place, after: &[usize], all: &mut Vec<Configuration>) {
    for search in record.searches.iter().filter(|search| search.place == *place) {
        let Some(objective) = search.minimised() else { continue };
        for trials in after.iter().copied().chain([ALL]) {
            let found = best_within(search, trials, objective);
            if let Some((found, _)) = found.filter(|(found, _)| !all.contains(&found.configuration)) {
                all.push(found.configuration.clone());
            }
        }
    }
}

impl ConditionArguments {
    /// The record and the conditions under which it is gone on with.
    pub(super) fn open(&self) -> Result<(Conditions, OpenRecord)> {
        check_folder(&self.record)?;
        let conditions = self.conditions()?;
        let open = OpenRecord::open(&self.record, &conditions)?;
        Ok((conditions, open))
    }

    fn conditions(&self) -> Result<Conditions> {
        let threads = usize::try_from(self.threads).unwrap_or(THREADS_MAX);
        Ok(Conditions {
            version: VERSION,
            machine: with_versions(detect_fingerprint(), threads)?,
            threads,
            size: self.size.0,
            bounces: BOUNCES,
            clock: Clock::Wall,
            iterations: self.iterations,
            cameras: self.cameras,
            seed: SEED,
            space: Preset::Paper.name().to_owned(),
        })
    }
}
