//! The report's sentences and tables, made from results.

use treewright_client::{Configuration, Value};

use crate::space;
use crate::tuning::results::Results;
use crate::tuning::verdict::{DEFAULT, NATIVE_MEDIUM, PREDICTED, TUNED};

/// A speed-up below this is not told as one: frames vary more than that.
const WORTH_TELLING: f64 = 1.03;

/// A line of the table of measured structures.
pub(super) struct StandingRow {
    pub(super) name: String,
    pub(super) build_ms: String,
    pub(super) frame_ms: String,
    pub(super) spread: String,
    pub(super) speedup: String,
    /// Length of the bar behind the frame time, in percent of the slowest.
    pub(super) bar: u32,
    pub(super) winner: bool,
}

/// A line of the table of configurations.
pub(super) struct ConfigurationRow {
    pub(super) name: String,
    pub(super) about: &'static str,
    pub(super) default: String,
    pub(super) tuned: String,
    pub(super) tuned_changed: bool,
    pub(super) predicted: String,
    pub(super) predicted_changed: bool,
}

pub(super) fn headline(results: &Results) -> String {
    let speedup = results.speedup();
    let (verb, subject) = match results.objective.builds_each_frame() {
        false => ("renders this scene", "tuned structure"),
        true => ("is built and rendered", "tuned structure"),
    };
    if speedup >= WORTH_TELLING {
        format!("The {subject} {verb} {speedup:.2}× faster than the recommended default.")
    } else {
        "Here the recommended default is as good as anything the search found.".to_owned()
    }
}

pub(super) fn explanation(results: &Results) -> String {
    let native = results
        .standing(NATIVE_MEDIUM)
        .zip(results.standing(TUNED))
        .map(|(native, tuned)| native.frame_ms.median / tuned.frame_ms.median);
    let native = match native {
        Some(ratio) if ratio.is_finite() && ratio >= WORTH_TELLING => {
            format!(" Against Embree's own built-in structure it is {ratio:.2}× as fast.")
        }
        Some(ratio) if ratio.is_finite() => {
            format!(" Embree's own built-in structure takes {ratio:.2}× the tuned one's time.")
        }
        _ => String::new(),
    };
    let frames = results.standing(TUNED).map_or(0, |standing| standing.frame_ms.count);
    format!("Medians of {frames} paired frames, measured again after the search.{native}")
}

pub(super) fn standings(results: &Results) -> Vec<StandingRow> {
    let slowest = results.standings.iter().map(|standing| standing.frame_ms.median).fold(1e-9, f64::max);
    results
        .standings
        .iter()
        .map(|standing| StandingRow {
            name: standing.name.clone(),
            build_ms: match &standing.failure {
                Some(_) => "cannot be built".to_owned(),
                None => format!("{:.1}", standing.build_ms.median),
            },
            frame_ms: format!("{:.1}", standing.frame_ms.median),
            spread: format!(
                "{:.1} – {:.1}",
                standing.frame_ms.lower_quartile, standing.frame_ms.upper_quartile
            ),
            speedup: format!("{:.2}×", standing.speedup.median),
            bar: (100.0 * standing.frame_ms.median / slowest).round().clamp(0.0, 100.0) as u32,
            winner: standing.name == TUNED,
        })
        .collect()
}

pub(super) fn search_summary(results: &Results) -> String {
    let failed = results.trials.iter().filter(|trial| trial.times.is_none()).count();
    let failures = match failed {
        0 => String::new(),
        1 => " One of them could not be built at all, which the search takes as an answer, too.".to_owned(),
        _ => {
            format!(" {failed} of them could not be built at all, which the search takes as an answer, too.")
        }
    };
    format!("The search tried {} configurations.{failures}", results.trials.len())
}

pub(super) fn prediction(results: &Results) -> Option<String> {
    results.prediction.as_ref().map(|prediction| {
        let speedup = prediction.speedup();
        let verdict = if speedup >= WORTH_TELLING {
            format!("With it, that view renders {speedup:.2}× faster than with the recommended default")
        } else {
            format!("With it, that view runs at {speedup:.2}× the recommended default's speed")
        };
        format!(
            "Then the camera moved to a place that was never tuned. The service answered in {:.1} ms from what it had learned. {verdict}, \
             without a single trial there.",
            prediction.answer_ms,
        )
    })
}

pub(super) fn overhead(results: &Results) -> String {
    let overhead = &results.overhead;
    format!(
        "Telling the service a result and getting the next suggestion took {:.2} ms (median), {:.2} % of the time. The whole search waited {:.0} ms for it.",
        overhead.waiting_ms.median,
        overhead.share_of_frame * 100.0,
        overhead.waiting_total_ms,
    )
}

pub(super) fn break_even(results: &Results) -> String {
    match results.break_even_frame {
        Some(frame) => format!(
            "The search spent {:.1} s, slow trials and all builds included. After {frame} frames it has paid for itself: \
             from then on, tuning and rendering together took less time than rendering with the default from the start.",
            results.break_even.tuning_ms / 1000.0,
        ),
        None => {
            "The tuned structure is not faster than the default, so the search does not pay for itself here."
                .to_owned()
        }
    }
}

pub(super) fn machine(results: &Results) -> String {
    let machine = &results.machine;
    let cpu = if machine.cpu_model.is_empty() { "an unnamed processor" } else { &machine.cpu_model };
    format!("{cpu}, {} threads, {}", machine.threads, machine.isa)
}

pub(super) fn configurations(results: &Results) -> Vec<ConfigurationRow> {
    let space = space::table_1();
    let default = space.default_configuration();
    let predicted = results.prediction.as_ref().map(|prediction| &prediction.configuration);
    let text = |configuration: Option<&Configuration>, name: &str| {
        configuration.map_or_else(String::new, |configuration| {
            configuration.get(name).map_or_else(|| "no effect".to_owned(), value_in_words)
        })
    };
    space
        .parameters()
        .iter()
        .map(|parameter| {
            let name = parameter.name.as_str();
            let changed = |configuration: &Configuration| configuration.get(name) != default.get(name);
            ConfigurationRow {
                name: name.to_owned(),
                about: about(name),
                default: text(Some(&default), name),
                tuned: text(Some(&results.tuned), name),
                tuned_changed: changed(&results.tuned),
                predicted: text(predicted, name),
                predicted_changed: predicted.is_some_and(changed),
            }
        })
        .collect()
}

/// What a parameter does, in plain words.
fn about(parameter: &str) -> &'static str {
    match parameter {
        "quality" => "how carefully the tree is built: 1 fast, 2 careful, 3 careful and splitting triangles",
        "branching_factor" => "how many boxes each box holds",
        "max_depth" => "how deep boxes may be nested",
        "sah_block_size" => "triangles are counted in groups of this many",
        "min_leaf_size" => "fewest triangles in an innermost box",
        "max_leaf_size" => "most triangles in an innermost box",
        "traversal_cost" => "what the builder believes a box test costs",
        "intersection_cost" => "what the builder believes a triangle test costs",
        "static" => "promise that the geometry will not change",
        "compact" => "use Embree's memory-saving structure instead",
        "robust" => "watertight tests at edges, at some cost",
        _ => "",
    }
}

fn value_in_words(value: &Value) -> String {
    match value {
        Value::Boolean(true) => "yes".to_owned(),
        Value::Boolean(false) => "no".to_owned(),
        Value::Float(value) => format!("{value:.2}"),
        Value::Integer(_) | Value::Text(_) => value.to_string(),
    }
}

/// `1234567` as `1 234 567`, with thin spaces.
pub(super) fn thousands(number: usize) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push('\u{2009}');
        }
        text.push(digit);
    }
    text
}

/// Relative frame time of the winner: the roofline.
pub(super) fn roofline(results: &Results) -> f64 {
    1.0 / results.speedup().max(f64::MIN_POSITIVE)
}

/// Relative frame time of the prediction on the fresh camera.
pub(super) fn predicted(results: &Results) -> Option<f64> {
    let prediction = results.prediction.as_ref()?;
    let names: Vec<&str> = prediction.standings.iter().map(|standing| standing.name.as_str()).collect();
    (names == [DEFAULT, PREDICTED]).then(|| 1.0 / prediction.speedup().max(f64::MIN_POSITIVE))
}
