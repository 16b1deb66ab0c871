//! What `tune` prints at the end: the table, and a few sentences that explain it.

use super::output;
use crate::measure::Standing;
use crate::tuning::results::Results;
use crate::tuning::verdict::PREDICTED;

/// Prints the results for people.
pub(super) fn print(results: &Results) {
    let per_frame = if results.objective.builds_each_frame() { "build + render ms" } else { "render ms" };
    let mut table = output::table(&[
        "structure",
        "build ms",
        per_frame,
        "quartiles",
        "speed-up over the default",
        "quartiles",
    ]);
    let mut row = |name: &str, standing: &Standing| match &standing.failure {
        Some(failure) => {
            table.add_row([name.to_owned(), failure.clone()]);
        }
        None => {
            table.add_row([
                name.to_owned(),
                format!("{:.1}", standing.build_ms.median),
                format!("{:.1}", standing.frame_ms.median),
                format!("{:.1} – {:.1}", standing.frame_ms.lower_quartile, standing.frame_ms.upper_quartile),
                format!("{:.2} ×", standing.speedup.median),
                format!("{:.2} – {:.2}", standing.speedup.lower_quartile, standing.speedup.upper_quartile),
            ]);
        }
    };
    for standing in &results.standings {
        row(&standing.name, standing);
    }
    if let Some(prediction) = &results.prediction {
        for standing in &prediction.standings {
            let name = if standing.name == PREDICTED {
                "first prediction, fresh camera"
            } else {
                "recommended default, fresh camera"
            };
            row(name, standing);
        }
    }
    println!("\n{table}");
    println!("tuned configuration: {}", results.tuned);
    if let Some(prediction) = &results.prediction {
        println!(
            "prediction: for another camera ({:.2} of the path) the answer came in {:.1} ms, without any search: {}",
            prediction.camera_at, prediction.answer_ms, prediction.reason,
        );
    }
    let overhead = &results.overhead;
    println!(
        "tuning overhead: {:.2} ms for a report and the next suggestion (median), one in a hundred took {:.2} ms or more; {:.2} % of the time",
        overhead.waiting_ms.median,
        overhead.waiting_p99_ms,
        overhead.share_of_frame * 100.0,
    );
    match results.break_even_frame {
        Some(frame) => {
            println!("break-even: after {frame} frames the whole search has paid for itself")
        }
        None => {
            println!("break-even: never, since the tuned structure is not faster than the default")
        }
    }
    let failed = results.trials.iter().filter(|trial| trial.times.is_none()).count();
    if failed > 0 {
        println!(
            "{failed} of {} configurations could not be built, which is ordinary feedback for the search",
            results.trials.len()
        );
    }
    let client = &results.client;
    if client.fallbacks + client.dropped + client.refused > 0 {
        println!(
            "{} frames went on without the daemon; {} reports were dropped, {} refused",
            client.fallbacks, client.dropped, client.refused,
        );
    }
    for note in results.notes.iter().chain(&results.scene.notes) {
        println!("note: {note}");
    }
}
