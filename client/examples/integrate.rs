//! A tuned renderer, with everything that has to be added to one. Start a daemon first:
//! `treewrightd serve --listen 127.0.0.1:50611 --database tuning.db`. It runs without one, too.

use std::time::{Duration, Instant};

use treewright_client::blocking::Client;
use treewright_client::{ClientError, Configuration, Indicators, Options, Outcome, Scale, Space, StudySpec};

/// The study: its parameters, with the values used so far as defaults, its indicators, and its objective.
fn spec() -> Result<StudySpec, ClientError> {
    let space = Space::builder()
        .integer("max_leaf_size", 1..=32)
        .default(8)
        .log()
        .boolean("compact")
        .default(false)
        .build()?;
    let spec = StudySpec::builder(space)
        .indicator("triangles", 0.0..=1e8, Scale::Log)
        .minimise("build_ms", 1.0)
        .minimise("render_ms", 1.0)
        .build()?;
    Ok(spec)
}

fn main() -> Result<(), ClientError> {
    let client = Client::connect("http://127.0.0.1:50611", Options::new().client_id("my-renderer"))?;
    let study = client.study("my-scene", spec()?)?;
    let mut tuner = study.tuner();
    let mut previous = None;
    for _frame in 0..100 {
        let indicators = Indicators::from([("triangles", 262_267.0)]);
        let suggestion = tuner.next(&indicators, previous.take()); // at most 50 ms, whatever happens
        let (build_ms, render_ms) = render_frame(suggestion.configuration())?;
        let measurements = [("build_ms", build_ms), ("render_ms", render_ms)].into();
        previous = Some(suggestion.finished(measurements, Outcome::Ok)?);
    }
    drop(previous); // the last result goes into the outbox
    client.flush(Duration::from_secs(5))?;

    match study.best(&Indicators::new()) {
        Ok(best) => println!("{:.3} ms with {}", best.cost, best.configuration),
        Err(problem) => println!("ran with the defaults: {problem}"),
    }
    Ok(())
}

/// Pretends to build a tree and to render with it: smaller leaves cost more to build and less to render.
fn render_frame(configuration: &Configuration) -> Result<(f64, f64), ClientError> {
    let leaf = u32::try_from(configuration.integer("max_leaf_size")?).unwrap_or(1);
    let compact = configuration.boolean("compact")?;
    let stopwatch = |work: u32| {
        let start = Instant::now();
        std::hint::black_box(
            (0..work * 1000).fold(1u32, |sum, each| sum.rotate_left(3) ^ std::hint::black_box(each)),
        );
        start.elapsed().as_secs_f64() * 1e3
    };
    Ok((stopwatch(300 / leaf + 20 * u32::from(compact)), stopwatch(40 * leaf + 50 * u32::from(!compact))))
}
