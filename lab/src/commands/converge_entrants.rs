//! The entrants of `converge`: the two defaults, native Embree used well, the best fixed configuration, the
//! configurations on the command line, and the daemon's answers.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::Args;
use serde_json::Value;
use treewright_accel::NativeQuality;
use treewright_client::blocking::{Client, Study};
use treewright_client::{Configuration, Mode, Policy, SessionPolicy};

use crate::converge::curve::Entrant;
use treewright_render_cli::arguments::{Size, SpaceArguments};
use treewright_render_cli::error::CliError;
use treewright_render_cli::interrupt::Interrupt;
use treewright_render_cli::output;
use treewright_render_cli::server::ServerArguments;
use treewright_renderer::frame::{Renderer, milliseconds};
use treewright_renderer::integrator::View;
use treewright_renderer::limits::ITERATIONS_MAX;
use treewright_renderer::measure::Contender;
use treewright_renderer::space::{self, Choice, Premises, Preset, TuningSpace};
use treewright_renderer::tuning::confirmation::confirm;
use treewright_renderer::tuning::objective::{Objective, specification, study_id};
use treewright_renderer::tuning::patience::Patience;
use treewright_renderer::tuning::search;
use treewright_renderer::tuning::verdict::{self, Rival};
use treewright_renderer::tuning::who::{NATIVE_DEFAULT, Who};
use treewright_renderer::tuning::workload::Workload;
use treewright_scene::indicators::SceneIndicators;

/// Longest wait of a confirmation for an answer of the daemon.
const PATIENCE: Duration = Duration::from_secs(60);

/// Which configurations take part besides those that always do.
#[derive(Args, Clone, Debug)]
pub(super) struct EntrantArguments {
    #[command(flatten)]
    pub(super) space: SpaceArguments,

    /// The configuration of the contender "tuned", as JSON: an object of parameters, the output of
    /// `treewright best`, or that of `tune --json`, whose tuning time is then counted.
    #[arg(long, value_name = "FILE")]
    pub(super) tuned: Option<PathBuf>,

    /// Another configuration, as for `image`; can be repeated.
    #[arg(long, value_name = "NAME=VALUE,…")]
    pub(super) config: Vec<String>,

    /// Ask this daemon for its prediction, and tune on the spot unless --tuned is given. Both take part, and
    /// the time they take counts.
    #[arg(long, value_name = "URL")]
    pub(super) server: Option<String>,

    #[command(flatten)]
    pub(super) credentials: treewright_client::CredentialArguments,

    /// Id of the daemon's study. Default: the one that `tune --objective render` uses, so that the prediction
    /// can use what was tuned before.
    #[arg(long, value_name = "ID", requires = "server")]
    pub(super) study: Option<String>,

    /// How long a question to the daemon may take at most, in milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 500, requires = "server", value_parser = clap::value_parser!(u64).range(1..=60_000))]
    pub(super) deadline_ms: u64,

    /// Number of configurations to try when tuning; 0 only asks for the prediction.
    #[arg(long, value_name = "N", default_value_t = 80, requires = "server", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(0..=i64::from(ITERATIONS_MAX)))]
    pub(super) iterations: u32,
}

/// An entrant, and what the results say about it besides its measurements.
#[derive(Clone, Debug)]
pub(super) struct Chosen {
    pub(super) entrant: Entrant,
    pub(super) configuration: Option<Configuration>,
    pub(super) origin: String,
}

/// The view, picture size and threads that entrants are tuned for.
#[derive(Clone, Copy, Debug)]
pub(super) struct EntrantSetting {
    pub(super) view: View,
    pub(super) size: Size,
    pub(super) threads: usize,
}

fn untuned(who: Who, choice: Choice, origin: &str) -> Chosen {
    let contender = Contender { who, choice };
    Chosen { entrant: Entrant { contender, setup_ms: 0.0 }, configuration: None, origin: origin.to_owned() }
}

fn chosen(
    who: Who,
    space: &TuningSpace,
    configuration: &Configuration,
    setup_ms: f64,
    origin: String,
) -> Result<Chosen, CliError> {
    let contender = verdict::contender(who, space, configuration)?;
    let configuration = Some(space.complete(configuration)?);
    Ok(Chosen { entrant: Entrant { contender, setup_ms }, configuration, origin })
}

impl EntrantArguments {
    /// The entrants that always take part and those of the command line, checked.
    pub(super) fn read(&self, threads: usize) -> Result<Vec<Chosen>, CliError> {
        let space = self.space.whole(Objective::Render, threads)?;
        let native = Choice::native(NativeQuality::Medium);
        let mut all = vec![
            untuned(Who::PaperDefault, Choice::paper_default(), "the paper's Table 1"),
            untuned(NATIVE_DEFAULT, native, "rtcCommitScene untold, single rays"),
        ];
        let full = TuningSpace::new(
            Preset::Full,
            &Premises { robust: self.space.robust, threads, ..Premises::all() },
        );
        for Rival { contender, configuration } in verdict::used_well(&full) {
            let origin = "with our stages and packets".to_owned();
            all.push(Chosen { entrant: Entrant { contender, setup_ms: 0.0 }, configuration, origin });
        }
        all.push(untuned(Who::BestFixed, full.default_choice(), "where searches start"));
        if let Some(path) = &self.tuned {
            let (configuration, tuning_ms) = read_tuned(path)?;
            let known = if tuning_ms.is_some() { "" } else { ", which does not say how long tuning took" };
            let origin = format!("{}{known}", path.display());
            all.push(chosen(Who::Tuned, &space, &configuration, tuning_ms.unwrap_or(0.0), origin)?);
        }
        for text in &self.config {
            let who = Who::Named(text.clone().into());
            all.push(chosen(who, &space, &space::parse(text)?, 0.0, "the command line".to_owned())?);
        }
        Ok(all)
    }

    /// Asks the daemon for its prediction, then tunes with its help. A failure becomes a note.
    pub(super) fn ask(
        &self,
        renderer: &mut Renderer,
        setting: &EntrantSetting,
        interrupt: Interrupt,
        notes: &mut Vec<String>,
    ) -> Result<Vec<Chosen>, CliError> {
        let Some(server) = &self.server else {
            return Ok(Vec::new());
        };
        let server = ServerArguments {
            server: server.clone(),
            study: self.study.clone(),
            deadline_ms: self.deadline_ms,
            credentials: self.credentials.clone(),
        };
        let client = server.connect(setting.threads)?;
        let scene = renderer.scene().clone();
        let space = Arc::new(self.space.of(&scene, Objective::Render, setting.threads)?);
        let id = server.study.clone().unwrap_or_else(|| study_id(Objective::Render, &space));
        let study = client.study(&id, specification(&space, Objective::Render, Policy::new())?)?;
        let mut all = Vec::new();

        let begin = Instant::now();
        let Size { width, height } = setting.size;
        let workload = Workload::of(&scene, width, height, setting.view.bounces);
        let indicators = workload.state(&SceneIndicators::of(&scene).with_camera(&setting.view.camera));
        let answer = study.predict(&indicators)?;
        let answer_ms = milliseconds(begin);
        if answer.mode == Mode::Default {
            notes.push(format!(
                "there is no first prediction: the study {id} knows nothing yet; tune at other cameras first (tune --at)"
            ));
        } else {
            let reason = answer.reason.summary;
            all.push(chosen(Who::Predicted, &space, &answer.configuration, answer_ms, reason)?);
        }
        if self.tuned.is_none() && self.iterations > 0 {
            let setting = search::SearchSetting {
                objective: Objective::Render,
                baseline: verdict::baseline(space.preset()).choice,
                space: Arc::clone(&space),
                view: setting.view,
                width: setting.size.width,
                height: setting.size.height,
                frames: 1,
                indicators,
            };
            let begin = Instant::now();
            let winner = self.tune(renderer, &client, &study, &setting, interrupt)?;
            let origin = format!("{} trials of the study {id}", self.iterations);
            all.push(chosen(Who::Tuned, &space, &winner, milliseconds(begin), origin)?);
        }
        Ok(all)
    }

    fn tune(
        &self,
        renderer: &mut Renderer,
        client: &Client,
        study: &Study,
        setting: &search::SearchSetting,
        interrupt: Interrupt,
    ) -> Result<Configuration, CliError> {
        let insight = study.predict(&setting.indicators)?.state;
        let done = insight.map_or(0, |insight| u32::try_from(insight.tried).unwrap_or(0));
        let room = done.saturating_add(self.iterations).min(ITERATIONS_MAX);
        study.set_session_policy(SessionPolicy {
            epsilon: Some(1.0),
            trials_per_state: Some(room),
            ..SessionPolicy::default()
        })?;
        let bar = output::bar(u64::from(self.iterations), "trials");
        let found = search::run(renderer, &mut study.tuner(), setting, self.iterations, None, |_| {
            bar.inc(1);
            !interrupt.requested()
        })?;
        bar.finish_and_clear();
        let start = setting.space.default_configuration();
        let contender = verdict::contender(Who::BestFixed, &setting.space, &start)?;
        let known = [Rival { contender, configuration: Some(start) }];
        let patience = Patience { limit: PATIENCE, go_on: &|| !interrupt.requested() };
        let searched = found.trials.len();
        let confirmed = confirm(renderer, client, study, patience, setting, searched, &known)?;
        study.set_session_policy(SessionPolicy::default())?;
        if interrupt.requested() {
            return Err(CliError::Interrupted);
        }
        Ok(confirmed.configuration)
    }
}

/// Reads a configuration, and how long it took to find it where the file says so.
fn read_tuned(path: &Path) -> Result<(Configuration, Option<f64>), CliError> {
    let wrong = |cause: String| {
        CliError::Failed(format!(
            "{} does not hold a configuration: {cause}; it must be an object like {{\"quality\": 3}}, or what tune --json wrote",
            path.display()
        ))
    };
    let text = std::fs::read_to_string(path)
        .map_err(|error| CliError::Failed(format!("{} cannot be read: {error}", path.display())))?;
    let mut value: Value = serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?;
    let tuning_ms = value.pointer("/break_even/tuning_ms").and_then(Value::as_f64);
    for key in ["tuned", "configuration"] {
        if let Some(inner) = value.get_mut(key) {
            value = inner.take();
            break;
        }
    }
    let configuration = serde_json::from_value(value).map_err(|error| wrong(error.to_string()))?;
    Ok((configuration, tuning_ms.filter(|tuning_ms| *tuning_ms >= 0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn configurations_are_read_with_the_time_they_took() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let path = folder.path().join("tuned.json");
        let read = |text: &str| {
            std::fs::write(&path, text).expect("it can be written");
            read_tuned(&path)
        };
        let expected = Configuration::new().with("quality", 3);
        for (text, tuning_ms) in [
            (r#"{"quality": 3}"#, None),
            (r#"{"cost": 5, "configuration": {"quality": 3}}"#, None),
            (r#"{"tuned": {"quality": 3}, "break_even": {"tuning_ms": 1234.5}}"#, Some(1234.5)),
        ] {
            assert_eq!(read(text).ok(), Some((expected.clone(), tuning_ms)), "{text}");
        }
        assert!(read("[1]").is_err_and(|error| error.to_string().contains("tuned.json does not hold")));
        assert!(read("{").is_err());
    }
}
