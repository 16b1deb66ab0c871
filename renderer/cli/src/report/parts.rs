//! The report's sentences and tables, made from results. Some of the sentences are the terminal's as well.

use treewright_accel::NativeQuality;
use treewright_client::{Configuration, Value};

use treewright_renderer::space::{Explained, Preset};
use treewright_renderer::tuning::who::{NATIVE_DEFAULT, Who};
use treewright_renderer::{measure::Standing, tuning::objective::Objective, tuning::results::TuningResults};

/// Smaller speed-ups are not reported as such: frames vary by more.
const WORTH_TELLING: f64 = 1.03;

/// Speeds over the start whose first frame is shown.
const FACTORS: [f64; 4] = [1.1, 1.2, 1.3, 1.4];

pub(super) struct StandingRow {
    pub(super) name: String,
    pub(super) build_ms: String,
    pub(super) frame_ms: String,
    pub(super) spread: String,
    pub(super) speedup: String,
    pub(super) over_used_well: String,
    pub(super) over_fixed: String,
    /// Length of the bar behind the frame time, in percent of the slowest.
    pub(super) bar: u32,
    pub(super) winner: bool,
}

pub(crate) struct WayRow {
    pub(crate) trials: u32,
    pub(crate) over_start: String,
}

pub(super) struct ConfigurationRow {
    pub(super) name: String,
    pub(super) about: &'static str,
    pub(super) default: String,
    pub(super) tuned: String,
    pub(super) tuned_changed: bool,
    pub(super) predicted: String,
    pub(super) predicted_changed: bool,
}

pub(super) fn headline(results: &TuningResults) -> String {
    let speedup = results.speedup();
    let (what, does) = match results.objective {
        Objective::Render => ("structure", "renders this scene"),
        Objective::Total | Objective::Auto(_) => ("structure", "is built and rendered"),
        Objective::Error => ("light sampling", "reaches an equal error"),
        Objective::Motion => ("way to follow", "keeps up with the motion"),
    };
    let pair = results.standing(&results.best).zip(results.standing(&results.baseline));
    let interval = pair.and_then(|(best, baseline)| best.gain_over(baseline).interval);
    if results.best == Who::Nobody || results.best == results.baseline {
        format!("Here {} is as good as anything the search found.", the(&results.baseline))
    } else if !results.search_won() {
        format!(
            "Nothing the search found is shown to be faster than {}, which is {speedup:.2}× as fast as {}.",
            the(&results.best),
            the(&results.baseline)
        )
    } else if speedup >= WORTH_TELLING && interval.is_some_and(|[low, _]| low <= 1.0) {
        format!(
            "Too noisy to tell whether the tuned {what} is faster than {}: {speedup:.2}× in the median.",
            the(&results.baseline)
        )
    } else if speedup >= WORTH_TELLING {
        let interval = interval.map_or_else(String::new, |[low, high]| format!(" [{low:.2}, {high:.2}]"));
        format!("The tuned {what} {does} {speedup:.2}×{interval} faster than {}.", the(&results.baseline))
    } else {
        format!("The tuned {what} is as fast as {}.", the(&results.baseline))
    }
}

pub(crate) fn gains(results: &TuningResults) -> String {
    let gains = &results.gains;
    let begin = format!("The best over {}, where the search began", the(&results.began_at));
    let parts = match results.began_at == Who::BestFixed {
        true => vec![
            ("The best fixed configuration, where the search began, over native Embree", gains.start),
            (
                "the best over the best fixed configuration, which is what the search added",
                gains.over_best_fixed,
            ),
            ("over native Embree, both together", gains.over_native_default),
            ("over native Embree used well", gains.over_native_used_well),
        ],
        false => vec![
            (begin.as_str(), gains.over_start),
            ("over native Embree used well", gains.over_native_used_well),
            ("over the best fixed configuration, which the search did not know", gains.over_best_fixed),
        ],
    };
    let words = parts.iter().filter_map(|(name, ratio)| Some(format!("{name}: {}", (*ratio)?)));
    let words = words.collect::<Vec<_>>().join("; ");
    if words.is_empty() {
        words
    } else {
        format!("{words}. In brackets stands where the true ratio lies with 95 % confidence.")
    }
}

/// The answers on the way, each once.
pub(crate) fn on_the_way(results: &TuningResults) -> Vec<WayRow> {
    let mut rows = Vec::new();
    let mut last = None;
    for milestone in &results.milestones {
        if let Some(ratio) = milestone.over_start.filter(|_| last != Some(&milestone.configuration)) {
            last = Some(&milestone.configuration);
            rows.push(WayRow { trials: milestone.trials, over_start: ratio.to_string() });
        }
    }
    rows
}

/// The frames and the time after which answers are shown to be faster than the start by round factors.
pub(crate) fn until(results: &TuningResults) -> Option<String> {
    let one = |factor: &f64| {
        let (frame, ms) = results.spent_until(results.trials_until(*factor)?);
        Some(format!("{factor} × after frame {frame} ({:.1} s)", ms / 1000.0))
    };
    let all: Vec<String> = FACTORS.iter().filter_map(one).collect();
    (!all.is_empty()).then(|| all.join(", "))
}

/// A contender inside a sentence.
fn the(who: &Who) -> String {
    match who {
        Who::PaperDefault => "the default of the paper".to_owned(),
        Who::Native(NativeQuality::Medium) => "native Embree".to_owned(),
        Who::UsedWell => "native Embree used well".to_owned(),
        other => format!("the {other}"),
    }
}

pub(super) fn explanation(results: &TuningResults) -> String {
    let others = [Who::PaperDefault, NATIVE_DEFAULT, Who::UsedWell, Who::BestFixed];
    let ratios: Vec<String> = others
        .into_iter()
        .filter(|who| *who != results.baseline && *who != results.best)
        .filter_map(|who| Some(format!("{:.2} times that of {}", results.speedup_over(&who)?, the(&who))))
        .collect();
    let other =
        if ratios.is_empty() { String::new() } else { format!(" Its speed is {}.", ratios.join(", ")) };
    let frames = results.standing(&results.best).map_or(0, |standing| standing.frame_ms.count);
    let disturbed = if results.disturbance.disturbed {
        " The machine was disturbed meanwhile: see the notes."
    } else {
        ""
    };
    format!(
        "Medians of {frames} paired frames, measured again after the search{}.{other}{disturbed}{}",
        results.in_processes(),
        why(results)
    )
}

/// Why there is no gain: what the service says of its answer, beside the start as its default.
fn why(results: &TuningResults) -> String {
    let own = results.confirmation.as_ref().filter(|_| !results.search_won());
    own.map_or_else(String::new, |own| format!(" The service says of its answer: {}.", own.sentence()))
}

pub(super) fn standings(results: &TuningResults) -> Vec<StandingRow> {
    let over = |one: &Standing, who: &Who| {
        results.standing(who).map_or_else(String::new, |other| one.gain_over(other).to_string())
    };
    let slowest = results.standings.iter().map(|standing| standing.frame_ms.median).fold(1e-9, f64::max);
    results
        .standings
        .iter()
        .map(|standing| StandingRow {
            name: standing.title(),
            over_used_well: over(standing, &Who::UsedWell),
            over_fixed: over(standing, &Who::BestFixed),
            build_ms: match &standing.failure {
                Some(_) => "cannot be built".to_owned(),
                None => format!("{:.1}", standing.build_ms.median),
            },
            frame_ms: format!("{:.1}", standing.frame_ms.median),
            spread: format!(
                "{:.1} – {:.1}",
                standing.frame_ms.lower_quartile, standing.frame_ms.upper_quartile
            ),
            speedup: match results.standing(&results.baseline) {
                Some(baseline) => format!("{:.2}×", standing.speedup_over(baseline).median),
                None => String::new(),
            },
            bar: (100.0 * standing.frame_ms.median / slowest).round().clamp(0.0, 100.0) as u32,
            winner: standing.who == results.best,
        })
        .collect()
}

pub(crate) fn search_summary(results: &TuningResults) -> String {
    let stops = match results.stopped() {
        0 => String::new(),
        1 => " One was stopped once it had cost too much.".to_owned(),
        stopped => format!(" {stopped} were stopped once they had cost too much."),
    };
    let failures = match results.failed() {
        0 => String::new(),
        1 => " One of them could not be built at all, which the search takes as an answer, too.".to_owned(),
        failed => {
            format!(" {failed} of them could not be built at all, which the search takes as an answer, too.")
        }
    };
    let (trials, configurations) = (results.trials.len(), results.configurations());
    format!(
        "{trials} trials ran {configurations} different configurations, repeats included.{failures}{stops}"
    )
}

pub(super) fn prediction(results: &TuningResults) -> Option<String> {
    results.prediction.as_ref().map(|prediction| {
        let speedup = prediction.speedup();
        let over = |who: Who| {
            let find = |who: &Who| prediction.standings.iter().find(|one| one.who == *who);
            Some(format!("{} as fast as {}", find(&Who::Predicted)?.gain_over(find(&who)?), the(&who)))
        };
        let honest: Vec<String> = [Who::UsedWell, Who::BestFixed].into_iter().filter_map(over).collect();
        let honest = if honest.is_empty() { String::new() } else { format!(" ({})", honest.join(", ")) };
        let verdict = if speedup >= WORTH_TELLING {
            format!("With it, that view renders {speedup:.2}× faster than with {}", the(&results.baseline))
        } else {
            format!("With it, that view runs at {speedup:.2}× the speed of {}", the(&results.baseline))
        };
        format!(
            "Then the camera moved to a place that was never tuned. The service answered in {:.1} ms from what it had learned. {verdict}{honest}, \
             without a single trial there.",
            prediction.answer_ms,
        )
    })
}

pub(crate) fn overhead(results: &TuningResults) -> String {
    let overhead = &results.overhead;
    format!(
        "Telling the service a result and getting the next suggestion took {:.2} ms (median), {:.2} % of the time, and one in a hundred \
         {:.2} ms or more. The whole search waited {:.0} ms for it.",
        overhead.waiting_ms.median,
        overhead.share_of_frame * 100.0,
        overhead.waiting_p99_ms,
        overhead.waiting_total_ms,
    )
}

/// The frames of the search that cost more than its start.
pub(crate) fn safety(results: &TuningResults) -> Option<String> {
    results.safety.map(|safety| format!("In the search {}.", safety.sentence(&the(&results.began_at))))
}

pub(crate) fn break_even(results: &TuningResults) -> String {
    match results.break_even_frame {
        Some(frame) => format!(
            "The search spent {:.1} s, slow trials and all builds included. After {frame} {} it has paid for itself: \
             from then on, tuning and rendering together took less time than rendering with {} from the start.",
            results.break_even.tuning_ms / 1000.0,
            if results.objective == Objective::Error { "pictures" } else { "frames" },
            the(&results.baseline),
        ),
        None => format!(
            "Nothing is faster than {}, so the search does not pay for itself here.",
            the(&results.baseline)
        ),
    }
}

pub(super) fn machine(results: &TuningResults) -> String {
    let machine = &results.machine;
    let cpu = if machine.cpu_model.is_empty() { "an unnamed processor" } else { &machine.cpu_model };
    format!("{cpu}, {} threads, {}", machine.threads, machine.isa)
}

/// Sentences about the two pictures of `samples` samples and their difference.
pub(super) fn pictures(results: &TuningResults, difference: f64, samples: u32) -> String {
    let kind = match results.objective {
        Objective::Error => {
            return format!(
                "Both pictures have {samples} samples per pixel and equal expectations; their noise differs. Times are for a picture \
                 whose error is 10 % of its brightness."
            );
        }
        Objective::Render => "render",
        Objective::Total | Objective::Auto(_) => "build and render",
        Objective::Motion => "bring the structure along and render",
    };
    format!(
        "Only the time differs; the picture does not change. The two pictures differ by {:.4} % of their brightness on average \
         ({samples} samples per pixel; times are for one sample, to {kind}).",
        difference * 100.0
    )
}

pub(super) fn what_was_tuned(results: &TuningResults) -> &'static str {
    match results.space {
        Preset::Paper => {
            "Millions of times per frame, a ray tracer asks what a ray of light hits first. To avoid testing every triangle, it sorts \
             them into nested boxes, the acceleration structure. How that tree is built is controlled by eleven numbers and switches."
        }
        Preset::Light => {
            "A pixel of a path tracer is the mean of many random paths, and their differences are seen as noise. How paths look for \
             light is controlled by a few numbers and switches; what counts is the time until the noise is below an error."
        }
        Preset::Follow => {
            "Where things move, the nested boxes that a ray tracer sorts triangles into have to follow. They can be rebuilt for each \
             frame, which is dear, or fitted to what moved, which is cheap until they overlap; or only what decays is rebuilt. Which \
             tree is built, how often, and what is repaired in between is controlled by three numbers and choices."
        }
        Preset::Full => {
            "Millions of times per frame, a ray tracer asks what a ray of light hits first. To avoid testing every triangle, it sorts \
             them into nested boxes, the acceleration structure. Embree, a widely used library, brings one ready-made; another can be built to measure. How it is built, how it lies \
             in memory and in which groups rays are sent through it is controlled by some two dozen numbers and switches."
        }
    }
}

pub(super) fn configurations(results: &TuningResults) -> Vec<ConfigurationRow> {
    let default = &results.start;
    let predicted = results.prediction.as_ref().map(|prediction| &prediction.configuration);
    let text = |configuration: Option<&Configuration>, name: &str| {
        configuration.map_or_else(String::new, |configuration| {
            configuration.get(name).map_or_else(|| "no effect".to_owned(), value_in_words)
        })
    };
    // A parameter that is inactive everywhere is left out.
    let matters = |name: &str| {
        [Some(default), Some(&results.tuned), predicted].iter().flatten().any(|one| one.get(name).is_some())
    };
    results
        .parameters
        .iter()
        .filter(|one| matters(&one.parameter.name))
        .map(|Explained { parameter, about }| {
            let name = parameter.name.as_str();
            // A change without effect is not marked.
            let changed = |configuration: &Configuration| {
                configuration.get(name).is_some_and(|value| Some(value) != default.get(name))
            };
            ConfigurationRow {
                name: name.to_owned(),
                about,
                default: text(Some(default), name),
                tuned: text(Some(&results.tuned), name),
                tuned_changed: changed(&results.tuned),
                predicted: text(predicted, name),
                predicted_changed: predicted.is_some_and(changed),
            }
        })
        .collect()
}

fn value_in_words(value: &Value) -> String {
    match value {
        Value::Boolean(true) => "yes".to_owned(),
        Value::Boolean(false) => "no".to_owned(),
        Value::Float(value) => format!("{value:.2}"),
        Value::Integer(_) | Value::Text(_) => value.to_string(),
    }
}

/// A number with thin spaces between its thousands.
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

/// Relative frame time of the best: the roofline.
pub(super) fn roofline(results: &TuningResults) -> f64 {
    1.0 / results.speedup().max(f64::MIN_POSITIVE)
}

/// Relative frame time of the prediction on the fresh camera.
pub(super) fn predicted(results: &TuningResults) -> Option<f64> {
    let prediction = results.prediction.as_ref()?;
    let [first, .., last] = prediction.standings.as_slice() else { return None };
    (first.who == results.baseline && last.who == Who::Predicted)
        .then(|| 1.0 / prediction.speedup().max(f64::MIN_POSITIVE))
}
