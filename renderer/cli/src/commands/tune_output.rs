//! What `tune` prints at the end: the table, and a few sentences that explain it.

use comfy_table::Table;

use crate::output;
use treewright_renderer::measure::Standing;
use treewright_renderer::statistics::Summary;
use treewright_renderer::tuning::results::TuningResults;
use treewright_renderer::tuning::verdict::{NATIVE_DEFAULT, PAPER_DEFAULT};

/// Prints the results for people.
pub(crate) fn print(results: &TuningResults) {
    let per_frame = if results.objective.builds_each_frame() { "build + render ms" } else { "frame ms" };
    let mut table = output::table(&[
        "structure",
        "build ms",
        per_frame,
        "quartiles",
        "over paper default",
        "over native default",
        "quartiles",
    ]);
    for standing in &results.standings {
        add(
            &mut table,
            &standing.name,
            standing,
            results.standing(PAPER_DEFAULT),
            results.standing(NATIVE_DEFAULT),
        );
    }
    if let Some(prediction) = &results.prediction {
        let find = |name: &str| prediction.standings.iter().find(|one| one.name == name);
        for standing in &prediction.standings {
            let name = format!("{}, fresh camera", standing.name);
            add(&mut table, &name, standing, find(PAPER_DEFAULT), find(NATIVE_DEFAULT));
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
            println!(
                "break-even: after {frame} frames the whole search has paid for itself against the {}",
                results.baseline
            )
        }
        None => {
            println!(
                "break-even: never, since the tuned structure is not faster than the {}",
                results.baseline
            )
        }
    }
    let (failed, stopped, all) = (results.failed(), results.stopped(), results.trials.len());
    if failed > 0 {
        println!(
            "{failed} of {all} configurations could not be built, which is ordinary feedback for the search"
        );
    }
    if stopped > 0 {
        println!("{stopped} of {all} trials were stopped once they had cost too much");
    }
    let client = &results.client;
    if client.fallbacks + client.dropped + client.refused > 0 {
        println!(
            "{} frames went on without the daemon; {} reports were dropped, {} refused",
            client.fallbacks, client.dropped, client.refused,
        );
    }
    output::left_out(&results.scene.left_out);
    for note in results.notes.iter().chain(&results.scene.notes) {
        println!("note: {note}");
    }
}

/// A line of the table: a standing, and how it compares with two others of the same rounds.
fn add(table: &mut Table, name: &str, one: &Standing, paper: Option<&Standing>, native: Option<&Standing>) {
    if let Some(failure) = &one.failure {
        table.add_row([name.to_owned(), failure.clone()]);
        return;
    }
    let over = |other: Option<&Standing>| other.map(|other| one.speedup_over(other));
    let times =
        |ratio: Option<Summary>| ratio.map_or_else(String::new, |ratio| format!("{:.2} ×", ratio.median));
    let spread = |ratio: Summary| format!("{:.2} – {:.2}", ratio.lower_quartile, ratio.upper_quartile);
    table.add_row([
        name.to_owned(),
        format!("{:.1}", one.build_ms.median),
        format!("{:.1}", one.frame_ms.median),
        format!("{:.1} – {:.1}", one.frame_ms.lower_quartile, one.frame_ms.upper_quartile),
        times(over(paper)),
        times(over(native)),
        over(native).map_or_else(String::new, spread),
    ]);
}
