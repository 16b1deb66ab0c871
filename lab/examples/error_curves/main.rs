//! Error against run time: what each search and each predictor makes of trials, of wall time and of its own
//! compute.
//!
//! `cargo run --release -p treewright-lab --example error_curves -- [--out DIR] [--seeds N] [--trials N]`
//! writes `curves.json` and six plots to `target/curves` unless told otherwise, from 15 runs of 80 trials. A
//! plot of searches shows the simple regret: the noiseless cost of the configuration that measured best so
//! far, above the optimum, as a share of the optimum (of the default's regret for functions whose optimum
//! costs nothing). A plot of predictors shows the prequential error, the absolute logarithm of expected over
//! measured cost before the trial is learnt, of the trials since the point before. Points are geometric means
//! over the runs, bands their 95 % intervals (Student). A frame that costs the optimum (a cost of 1 for
//! predictors) is taken to last 10 ms; wall time is that of frames and compute together.

#[path = "../search_quality/bbob.rs"]
#[allow(dead_code)]
mod bbob;
mod curve;
#[path = "../search_quality/grids.rs"]
#[allow(dead_code)]
mod grids;
#[path = "../search_quality/kernels.rs"]
#[allow(dead_code)]
mod kernels;
mod plot;
mod predictors;
#[path = "../search_quality/problem.rs"]
#[allow(dead_code)]
mod problem;
#[path = "../search_quality/roofline.rs"]
mod roofline;
mod searches;
#[path = "../predictors/streams.rs"]
#[allow(dead_code)]
mod streams;
#[path = "../search_quality/trees.rs"]
mod trees;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use curve::{Axis, Curve, Kind};
pub(crate) use roofline::best_of;

/// How long a frame lasts whose configuration costs one.
const FRAME_S: f64 = 0.01;

/// What is asked for.
#[derive(Debug, PartialEq)]
struct Arguments {
    out: PathBuf,
    seeds: u64,
    trials: usize,
}

const USAGE: &str = "usage: error_curves [--out DIR] [--seeds N, at least 2] [--trials N, at least 5]";

/// `None` when something is not understood.
fn arguments(mut given: impl Iterator<Item = String>) -> Option<Arguments> {
    let mut arguments = Arguments { out: "target/curves".into(), seeds: 15, trials: 80 };
    while let Some(name) = given.next() {
        let value = given.next()?;
        match name.as_str() {
            "--out" => arguments.out = value.into(),
            "--seeds" => arguments.seeds = value.parse().ok().filter(|&seeds| seeds >= 2)?,
            "--trials" => arguments.trials = value.parse().ok().filter(|&trials| trials >= 5)?,
            _ => return None,
        }
    }
    Some(arguments)
}

/// Writes the curves as data and as plots.
fn write(curves: &[Curve], out: &Path) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(out)?;
    std::fs::write(out.join("curves.json"), serde_json::to_string_pretty(curves)?)?;
    for kind in [Kind::Search, Kind::Predictor] {
        let of_kind: Vec<&Curve> = curves.iter().filter(|curve| curve.kind == kind).collect();
        for axis in [Axis::Trials, Axis::Wall, Axis::Compute] {
            let path = out.join(format!("{}-{}.svg", kind.name(), axis.name()));
            std::fs::write(path, plot::svg(&of_kind, kind, axis)?)?;
        }
    }
    Ok(())
}

fn main() -> ExitCode {
    let Some(Arguments { out, seeds, trials }) = arguments(std::env::args().skip(1)) else {
        eprintln!("{USAGE}");
        return ExitCode::from(2);
    };
    let mut curves = searches::curves(seeds, trials);
    curves.extend(predictors::curves(seeds, 5 * trials));
    match write(&curves, &out) {
        Ok(()) => {
            println!("curves.json and six plots are in {}", out.display());
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("cannot write to {}: {error}", out.display());
            ExitCode::FAILURE
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tiny_budget_gives_data_and_plots() {
        let out = std::env::temp_dir().join(format!("error-curves-{}", std::process::id()));
        let mut curves = searches::curves(2, 6);
        curves.extend(predictors::curves(2, 12));
        write(&curves, &out).expect("a folder for temporary files");
        let text = std::fs::read_to_string(out.join("curves.json")).expect("written");
        let read: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let read = read.as_array().expect("a list");
        assert_eq!(read.len(), searches::METHODS.len() * 4 + predictors::METHODS.len() * 4);
        for curve in read {
            let points = curve["points"].as_array().expect("a list");
            let number = |point: &serde_json::Value, name: &str| point[name].as_f64().expect("a number");
            assert!(points.len() >= 2, "{curve}");
            for point in points {
                let [low, error, high] = ["low", "error", "high"].map(|name| number(point, name));
                assert!(0.0 < low && low <= error && error <= high && high.is_finite(), "{curve}");
            }
            for name in ["trials", "wall_s", "compute_us"] {
                let rises = |pair: &[serde_json::Value]| number(&pair[0], name) < number(&pair[1], name);
                assert!(points.windows(2).all(rises), "{name}: {curve}");
            }
        }
        for kind in [Kind::Search, Kind::Predictor] {
            for axis in [Axis::Trials, Axis::Wall, Axis::Compute] {
                let path = out.join(format!("{}-{}.svg", kind.name(), axis.name()));
                let svg = std::fs::read_to_string(path).expect("written");
                assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
                assert!(svg.matches("<polyline").count() >= curves.len() / 2 && svg.contains(axis.title()));
            }
        }
        std::fs::remove_dir_all(&out).expect("it is ours");
    }

    #[test]
    fn what_is_not_understood_is_no_argument() {
        let parse = |text: &str| arguments(text.split_whitespace().map(str::to_owned));
        let given = parse("--seeds 3 --out x --trials 20").expect("all known");
        assert_eq!(given, Arguments { out: "x".into(), seeds: 3, trials: 20 });
        for wrong in ["--seeds", "--seeds 1", "--trials many", "--help", "x y"] {
            assert_eq!(parse(wrong), None, "{wrong}");
        }
    }
}
