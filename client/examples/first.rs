//! The shortest program: one trial. Start a daemon first:
//! `treewrightd serve --listen 127.0.0.1:50611 --database tuning.db`. It runs without one, too.

use std::time::Duration;

use treewright_client::blocking::Client;
use treewright_client::{ClientError, Indicators, Options, Outcome, Space, StudySpec};

fn main() -> Result<(), ClientError> {
    let client = Client::connect("http://127.0.0.1:50611", Options::new())?;
    let space = Space::builder().integer("leaf", 1..=32).default(8).log().build()?;
    let study = client.study("my-renderer", StudySpec::builder(space).minimise("render_ms", 1.0).build()?)?;
    let suggestion = study.suggest(&Indicators::new());
    let leaf = suggestion.configuration().integer("leaf")?;
    let render_ms = 5.0 + leaf as f64; // build and render with the configuration, and measure
    suggestion.report([("render_ms", render_ms)].into(), Outcome::Ok)?;
    client.flush(Duration::from_secs(5))
}
