//! The entrants of `converge`: those that always take part, and the configurations of the command line.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::Value;
use treewright_accel::NativeQuality;
use treewright_client::Configuration;

use crate::converge::curve::Entrant;
use treewright_render_cli::arguments::{SpaceArguments, read_configuration};
use treewright_render_cli::error::Result;
use treewright_renderer::space::{self, Choice, Premises, Preset, TuningSpace};
use treewright_renderer::tuning::verdict::{self, Rival};
use treewright_renderer::tuning::who::{NATIVE_DEFAULT, Who};
use treewright_renderer::{measure::Contender, tuning::objective::Objective};

/// Which configurations take part besides those that always do.
#[derive(Args, Clone, Debug)]
pub(super) struct EntrantArguments {
    #[command(flatten)]
    space: SpaceArguments,

    /// The configuration of the contender "tuned", as JSON: an object of parameters, the output of
    /// `treewright best`, or that of `tune --json`, whose tuning time is then counted.
    #[arg(long, value_name = "FILE")]
    tuned: Option<PathBuf>,

    /// Another configuration, as for `image`; can be repeated.
    #[arg(long, value_name = "NAME=VALUE,…")]
    config: Vec<String>,
}

fn entrant(rival: impl Into<Rival>, setup_ms: f64, origin: impl Into<String>) -> Entrant {
    Entrant { rival: rival.into(), setup_ms, origin: origin.into() }
}

impl EntrantArguments {
    /// The entrants that always take part and those of the command line, checked.
    pub(super) fn read(&self) -> Result<Vec<Entrant>> {
        let space = self.space.whole(Objective::Render)?;
        let given = |who: Who, configuration: &Configuration| -> Result<Rival> {
            Ok(Rival::of(who, &space, space.complete(configuration)?)?)
        };
        let untuned = |who, choice, origin: &str| entrant(Contender { who, choice }, 0.0, origin);
        let native = Choice::native(NativeQuality::Medium);
        let mut all = vec![
            untuned(Who::PaperDefault, Choice::paper_default(), "the paper's Table 1"),
            untuned(NATIVE_DEFAULT, native, "rtcCommitScene untold, single rays"),
        ];
        let premises = Premises { robust: self.space.robust, ..Premises::all() };
        let full = TuningSpace::new(Preset::Full, &premises);
        let used_well = verdict::used_well(&full).into_iter();
        all.extend(used_well.map(|rival| entrant(rival, 0.0, "with our stages and packets")));
        all.push(untuned(Who::BestFixed, full.default_choice(), "where searches start"));
        if let Some(path) = &self.tuned {
            let (configuration, tuning_ms) = (read_configuration(path)?, tuning_ms(path));
            let known = if tuning_ms.is_some() { "" } else { ", which does not say how long tuning took" };
            let origin = format!("{}{known}", path.display());
            all.push(entrant(given(Who::Tuned, &configuration)?, tuning_ms.unwrap_or(0.0), origin));
        }
        for text in &self.config {
            let who = Who::Named(text.clone().into());
            all.push(entrant(given(who, &space::parse(text)?)?, 0.0, "the command line"));
        }
        Ok(all)
    }
}

/// How long it took to find a configuration, where its file says so.
fn tuning_ms(path: &Path) -> Option<f64> {
    let value: Value = serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()?;
    value.pointer("/break_even/tuning_ms")?.as_f64().filter(|tuning_ms| *tuning_ms >= 0.0)
}
