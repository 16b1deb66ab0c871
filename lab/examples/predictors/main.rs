//! The prequential error of each predictor on streams of trials, and that of `auto` over the least of them,
//! as JSON lines; goal: 1.05.
//!
//! `cargo run --release -p treewright-lab --example predictors`

mod streams;

use std::collections::BTreeMap;

use serde_json::json;
use treewright_core::policy::PredictorMethod;

use streams::Stream;

/// Errors of each predictor and of `auto` on a stream, a run a seed, and how far `auto` is above the least:
/// of the means over the seeds, and in the worst run.
fn errors(which: &str, streams: &[Stream], seeds: std::ops::Range<u64>) {
    let mut ratios = Vec::new();
    for stream in streams {
        let mut sums: BTreeMap<PredictorMethod, f64> = BTreeMap::new();
        let mut worst = 0.0f64;
        for seed in seeds.clone() {
            let errors = stream.run(seed).predictor_errors();
            let mean = |auto: bool| {
                let chosen =
                    errors.iter().filter(move |(method, _)| (*method == PredictorMethod::Auto) == auto);
                chosen.map(|(_, interval)| interval.mean).fold(f64::INFINITY, f64::min)
            };
            worst = worst.max(mean(true) / mean(false));
            for (method, interval) in errors {
                *sums.entry(method).or_default() += interval.mean / (seeds.end - seeds.start) as f64;
            }
        }
        let auto = sums.remove(&PredictorMethod::Auto).unwrap_or(f64::NAN);
        let (best, least) =
            sums.iter().min_by(|a, b| a.1.total_cmp(b.1)).map_or(("none", f64::NAN), |(m, e)| (m.name(), *e));
        ratios.push(auto / least);
        let each: BTreeMap<&str, f64> = sums.iter().map(|(method, error)| (method.name(), *error)).collect();
        let found = json!({
            "errors": stream.name, "streams": which, "auto": auto, "best": best, "auto_over_best": auto / least,
            "worst_run": worst, "each": each,
        });
        println!("{found}");
    }
    let (most, above) =
        (ratios.iter().copied().fold(0.0, f64::max), ratios.iter().filter(|&&r| r > 1.05).count());
    println!(
        "{}",
        json!({ "streams": which, "auto_over_best_at_most": most, "above_1.05": above, "of": ratios.len() })
    );
}

fn main() {
    errors("known", &streams::known(), 0..4);
    errors("unseen", &streams::unseen(), 100..104);
}
