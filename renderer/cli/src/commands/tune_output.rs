//! What `tune` prints at the end: the table, and a few sentences that explain it.

use treewright_client::{Confirmation, ConfirmationStage, Standing};

use crate::output;
use treewright_renderer::tuning::results::TuningResults;
use treewright_renderer::tuning::verdict::{self, FOUND, Gains};

/// Prints the results for people.
pub(crate) fn print(results: &TuningResults) {
    let per_frame = if results.objective.builds_each_frame() { "build + render ms" } else { "frame ms" };
    println!("\n{}", output::standings(&results.standings, per_frame));
    println!("{}", verdict(results));
    println!("{}", gains(&results.gains));
    if let Some(standing) = &results.confirmation {
        println!("{}", confirmation(standing));
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
            println!("break-even: never, since nothing is faster than the {}", results.baseline)
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

/// Who is best, and how that is shown.
fn verdict(results: &TuningResults) -> String {
    let start = verdict::start(results.space);
    let found =
        results.standing(FOUND).zip(results.standing(start)).map(|(found, start)| found.gain_over(start));
    match (results.search_won(), results.gains.over_best_fixed) {
        (true, Some(gain)) if gain.is_gain() => {
            "verdict: what the search found is faster than everybody else".to_owned()
        }
        (true, _) => {
            "verdict: what the search found won its race against the start; the rounds of this table alone leave that open".to_owned()
        }
        (false, _) => {
            let ran = found.map(|ratio| format!("; what the search found ran at {ratio} its speed"));
            let ran = ran.unwrap_or_default();
            match results.best == start {
                true => format!("verdict: nobody is shown to be faster than the {start}{ran}"),
                false => format!("verdict: the fastest is \"{}\"{ran}", results.best),
            }
        }
    }
}

/// The gain and what it is made of.
fn gains(gains: &Gains) -> String {
    let parts = [
        ("start", gains.start),
        ("× search", gains.over_best_fixed),
        ("= over native Embree default", gains.over_native_default),
        ("; over native used well", gains.over_native_used_well),
    ];
    let told = parts.iter().filter_map(|(name, ratio)| Some(format!("{name} {}", (*ratio)?)));
    let told = told.collect::<Vec<_>>().join(" ").replace(" ;", ";");
    format!("gain, with intervals of 95 %: {told}")
}

/// What the service's own race of the best few against the start came to.
fn confirmation(standing: &Standing) -> String {
    let Confirmation { stage, rounds, measurements, .. } = &standing.confirmation;
    let came_to = match stage {
        ConfirmationStage::Better => "proven better than the start",
        ConfirmationStage::NothingBetter => "nothing is proven to be better than the start",
        ConfirmationStage::Racing => "the race was not over yet",
        ConfirmationStage::Searching => "the search was not over yet",
        ConfirmationStage::Off => "the study's policy wants no confirmation",
    };
    let percent = |share: f64| format!("{:.1} %", share * 100.0);
    let gain = standing.gain.map(|gain| match (gain.low, gain.high) {
        (Some(low), Some(high)) => {
            format!("; gain over the start {} ({} to {})", percent(gain.share), percent(low), percent(high))
        }
        _ => format!("; gain over the start {}", percent(gain.share)),
    });
    format!(
        "confirmation by the service: {came_to} ({rounds} rounds, {measurements} measurements){}",
        gain.unwrap_or_default()
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use treewright_client::Gain;

    #[test]
    fn a_confirmation_is_told_with_its_interval() {
        let gain = |low| Some(Gain { share: 0.08, low, high: Some(0.11), probability_better: None });
        let confirmation_of = |gain, stage| {
            let race = Confirmation { stage, rounds: 7, rounds_max: 10, measurements: 20, gain: None };
            confirmation(&Standing {
                cost: 9.0,
                cost_low: 8.5,
                cost_high: 9.5,
                gain,
                nothing_better: stage == ConfirmationStage::NothingBetter,
                confirmation: race,
                disturbances: 0,
            })
        };
        let told = confirmation_of(gain(Some(0.05)), ConfirmationStage::Better);
        assert!(
            told.ends_with("(7 rounds, 20 measurements); gain over the start 8.0 % (5.0 % to 11.0 %)"),
            "{told}"
        );
        let told = confirmation_of(gain(None), ConfirmationStage::Racing);
        assert!(told.ends_with("gain over the start 8.0 %") && told.contains("not over"), "{told}");
        let told = confirmation_of(None, ConfirmationStage::NothingBetter);
        assert!(told.contains("nothing is proven") && told.ends_with("measurements)"), "{told}");
    }
}
