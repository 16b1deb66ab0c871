//! The output of `converge` at the end.

use crate::converge::bootstrap::{Interval, in_words};
use crate::{converge::equal_error::EqualError, converge::results::ComparisonResults};
use treewright_render_cli::output;
use treewright_renderer::tuning::who::{NATIVE_DEFAULT, Who};

pub(super) fn print(results: &ComparisonResults) {
    let reference = &results.reference;
    println!(
        "{}: {} triangles, {}x{}, {} s for each of {} runs",
        results.scene.name,
        results.scene.triangles,
        results.size[0],
        results.size[1],
        seconds(results.budget_ms),
        results.contenders.iter().map(|found| found.curve.runs.len()).max().unwrap_or(0),
    );
    println!(
        "reference: {} samples a pixel, its own relative error {:.2e}; curves are trusted down to {:.2e}\n",
        reference.samples, reference.relative_mse, reference.trusted_from
    );
    let mut table =
        output::table(&["contender", "tuning s", "build ms", "ms a sample", "samples", "relative error"]);
    for found in &results.contenders {
        let curve = &found.curve;
        if let Some(failure) = &curve.failure {
            table.add_row([curve.who.to_string(), failure.clone()]);
            continue;
        }
        let mean = |interval: Option<Interval>| interval.map_or(f64::NAN, |interval| interval.estimate);
        table.add_row([
            curve.who.to_string(),
            seconds(curve.setup_ms),
            format!("{:.1}", mean(found.build_ms)),
            in_words(found.frame_ms, 2),
            format!("{:.0}", mean(found.samples)),
            format!("{:.2e}", mean(found.relative_mse)),
        ]);
    }
    println!("{table}");
    for target in &results.equal_error {
        println!("\n{}", target_in_words(target));
        let mut table = output::table(&[
            "contender",
            "seconds",
            "sooner than native",
            "sooner than paper",
            "seconds, tuning counted",
            "than native",
            "than paper",
        ]);
        for row in &target.rows {
            let ratio = |baseline: Who, with_setup: bool| {
                let speedup = row.speedups.iter().find(|speedup| speedup.over == baseline);
                let ratio = speedup.map(|one| if with_setup { one.ratio_with_setup } else { one.ratio });
                in_words(ratio, 2)
            };
            table.add_row([
                row.who.to_string(),
                seconds(row.time_ms.estimate),
                ratio(NATIVE_DEFAULT, false),
                ratio(Who::PaperDefault, false),
                seconds(row.time_with_setup_ms.estimate),
                ratio(NATIVE_DEFAULT, true),
                ratio(Who::PaperDefault, true),
            ]);
        }
        println!("{table}");
    }
    for note in &results.scene.notes {
        println!("note: {note}");
    }
}

fn seconds(time_ms: f64) -> String {
    match time_ms {
        ..1e3 => format!("{:.2}", time_ms / 1e3),
        ..1e5 => format!("{:.1}", time_ms / 1e3),
        _ => format!("{:.0}", time_ms / 1e3),
    }
}

fn target_in_words(target: &EqualError) -> String {
    let error = format!("relative error {:.2e}", target.relative_mse);
    match target.samples {
        Some(1) => format!("{error}: {NATIVE_DEFAULT} after its first sample"),
        Some(samples) => format!("{error}: {NATIVE_DEFAULT} after {samples} samples"),
        None => format!("{error}: the least that all reach"),
    }
}
