//! The output of `tune` at the end: the table, and a few sentences that explain it.

use crate::output;
use crate::report::{parts, session};
use treewright_renderer::measure::Standing;
use treewright_renderer::tuning::objective::Objective;
use treewright_renderer::tuning::results::TuningResults;
use treewright_renderer::tuning::who::Who;

/// Frames after which the time of the whole session is shown.
const SESSIONS: [u32; 3] = [100, 1000, 10_000];

pub(crate) fn print(results: &TuningResults) {
    let per_frame = match results.objective {
        Objective::Render => "frame ms",
        Objective::Total => "build + render ms",
        Objective::Error => "ms to an error of 10 %",
        Objective::Motion => "mean frame ms",
        Objective::Auto(_) => "frame + share of build ms",
    };
    println!("\n{}", output::standings(&results.standings, per_frame));
    println!("{}", verdict(results));
    println!("gain{}: {}", results.in_processes(), parts::gains(results));
    if let Some(way) = on_the_way(results) {
        println!("{way}");
    }
    if let Some(standing) = &results.confirmation {
        println!("confirmation by the service, beside the start as its default: {}", standing.sentence());
    }
    println!("recommended configuration: {}", results.tuned);
    if let Some(prediction) = &results.prediction {
        println!(
            "\nprediction: for another camera ({:.2} of the path) the answer came in {:.1} ms, without any search: {}\n{}",
            prediction.camera_at,
            prediction.answer_ms,
            prediction.reason,
            output::standings(&prediction.standings, per_frame),
        );
    }
    println!("{}\nbreak-even: {}", parts::overhead(results), parts::break_even(results));
    if let Some(safety) = parts::safety(results) {
        println!("{safety}");
    }
    if let Some(session) = whole_session(results) {
        println!("{session}");
    }
    println!("{}", parts::search_summary(results));
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

/// The best configuration, and the evidence for it.
fn verdict(results: &TuningResults) -> String {
    let start = &results.began_at;
    let found = results.standing(&Who::Found).zip(results.standing(start));
    let found = found.map(|(found, start)| found.gain_over(start));
    match (results.search_won(), results.gains.over_start) {
        (true, Some(gain)) if gain.is_gain() => match level_with(results).as_slice() {
            [] => format!(
                "verdict: what the search found is faster than everybody that it was to beat: {gain} over the {start}"
            ),
            names => format!(
                "verdict: what the search found is faster than the {start} ({gain}); the rounds of this table leave open \
                 whether it is faster than the {}",
                names.join(", the ")
            ),
        },
        (true, _) => {
            "verdict: what the search found won its race against the start; the rounds of this table alone leave that open".to_owned()
        }
        (false, _) => {
            let ran = found.map(|ratio| format!("; what the search found ran at {ratio} its speed"));
            let ran = ran.unwrap_or_default();
            match results.best == *start {
                true => format!("verdict: nobody is shown to be faster than the {start}{ran}"),
                false => format!("verdict: the fastest is \"{}\"{ran}", results.best),
            }
        }
    }
}

/// All contenders that might have won and than which the winner is not shown to be faster.
fn level_with(results: &TuningResults) -> Vec<String> {
    let winner = results.standing(&results.best);
    let knows_all = results.began_at == Who::BestFixed;
    let others = results.standings.iter().filter(|other| {
        let is_known = knows_all || !other.who.takes_knowledge();
        other.who != results.best && other.failure.is_none() && is_known
    });
    let is_open = |other: &&Standing| winner.is_some_and(|winner| !winner.gain_over(other).is_gain());
    others.filter(is_open).map(|other| other.who.to_string()).collect()
}

/// The answers on the way, each once.
fn on_the_way(results: &TuningResults) -> Option<String> {
    let rows = parts::on_the_way(results);
    let steps: Vec<String> =
        rows.iter().map(|row| format!("after {} trials {}", row.trials, row.over_start)).collect();
    let shown = parts::until(results).map_or_else(String::new, |until| format!("; shown: {until}"));
    let start = &results.began_at;
    (!steps.is_empty()).then(|| format!("on the way, over the {start}: {}{shown}", steps.join(", ")))
}

/// The time of the whole session over that of the baseline.
fn whole_session(results: &TuningResults) -> Option<String> {
    let ratios: Vec<String> = SESSIONS
        .iter()
        .filter_map(|frames| {
            Some(format!("{:.2} after {frames} frames", session::ratio_at(results, f64::from(*frames))?))
        })
        .collect();
    let baseline = &results.baseline;
    (!ratios.is_empty()).then(|| {
        format!("time of the whole session, with {baseline} from the first frame = 1: {}", ratios.join(", "))
    })
}
