//! The page's sentences and tables, made from results.

use crate::converge::bootstrap::Interval;
use crate::converge::curve::Point;
use crate::converge::equal_error::{BASELINES, EqualError, Row};
use crate::converge::results::{ComparisonResults, ContenderResult};
use crate::converge::slope::Verdict;
use treewright_render_cli::report::thousands;
use treewright_renderer::tuning::who::{NATIVE_DEFAULT, Who};

/// A line of the table of contenders.
pub(super) struct ContenderRow {
    pub(super) name: String,
    pub(super) origin: String,
    pub(super) setup_s: String,
    pub(super) build_ms: String,
    pub(super) frame_ms: String,
    pub(super) samples: String,
    pub(super) relative_mse: String,
    pub(super) ssim: String,
    pub(super) flip: String,
    pub(super) slope: String,
    pub(super) plateau: String,
    pub(super) verdict: &'static str,
}

/// The times to one error.
pub(super) struct EqualErrorTable {
    pub(super) title: String,
    pub(super) baselines: Vec<String>,
    pub(super) rows: Vec<EqualErrorRow>,
}

/// A line of it.
pub(super) struct EqualErrorRow {
    pub(super) name: String,
    pub(super) time_s: String,
    pub(super) time_with_setup_s: String,
    pub(super) ratios: Vec<String>,
    pub(super) ratios_with_setup: Vec<String>,
}

/// An estimate and its interval, with `digits` digits after the point.
pub(crate) fn with_range(interval: &Interval, digits: usize) -> String {
    match interval.range {
        Some([low, high]) => format!("{:.digits$} [{low:.digits$}, {high:.digits$}]", interval.estimate),
        None => format!("{:.digits$}", interval.estimate),
    }
}

/// An estimate and its interval, as powers of ten.
fn with_range_scientific(interval: &Interval) -> String {
    match interval.range {
        Some([low, high]) => format!("{:.2e} [{low:.2e}, {high:.2e}]", interval.estimate),
        None => format!("{:.2e}", interval.estimate),
    }
}

fn or_dash(interval: Option<Interval>, text: impl Fn(&Interval) -> String) -> String {
    interval.as_ref().map_or_else(|| "–".to_owned(), text)
}

/// Milliseconds as seconds.
pub(crate) fn seconds(time_ms: f64) -> String {
    match time_ms {
        ..1e3 => format!("{:.2}", time_ms / 1e3),
        ..1e5 => format!("{:.1}", time_ms / 1e3),
        _ => format!("{:.0}", time_ms / 1e3),
    }
}

/// The subject of the page: the tuned contender, or the predicted one.
fn hero(results: &ComparisonResults) -> Option<&ContenderResult> {
    [Who::Tuned, Who::Predicted]
        .iter()
        .filter_map(|who| results.contender(who))
        .find(|found| !found.curve.runs.is_empty())
}

/// The row of a contender where the error is least.
fn last_row<'a>(results: &'a ComparisonResults, who: &Who) -> Option<(&'a EqualError, &'a Row)> {
    let last = results.equal_error.last()?;
    Some((last, last.rows.iter().find(|row| row.who == *who)?))
}

pub(super) fn headline(results: &ComparisonResults) -> String {
    let sentence = hero(results).and_then(|found| {
        let (_, row) = last_row(results, &found.curve.who)?;
        let speedup = row.speedups.first()?;
        let ratio = speedup.ratio.estimate;
        let is_open = speedup.ratio.range.is_some_and(|[low, high]| low <= 1.0 && high >= 1.0);
        Some(if is_open {
            format!(
                "Whether the {} configuration reaches the same picture sooner than {} is not shown: {}×.",
                found.curve.who,
                speedup.over,
                with_range(&speedup.ratio, 2)
            )
        } else if ratio >= 1.0 {
            format!(
                "The {} configuration reaches the same picture {ratio:.2}× sooner than {}.",
                found.curve.who, speedup.over
            )
        } else {
            format!(
                "The {} configuration takes {:.2}× as long as {} for the same picture.",
                found.curve.who,
                1.0 / ratio,
                speedup.over
            )
        })
    });
    sentence.unwrap_or_else(|| "How soon each configuration's picture is good enough.".to_owned())
}

pub(super) fn explanation(results: &ComparisonResults) -> String {
    let runs = results.contenders.iter().map(|found| found.curve.runs.len()).max().unwrap_or(0);
    let with_setup = hero(results).and_then(|found| {
        let (_, row) = last_row(results, &found.curve.who)?;
        let speedup = row.speedups.first()?;
        (found.curve.setup_ms > 0.0).then(|| {
            format!(
                " With the {} s counted that finding the configuration took, the factor is {}.",
                seconds(found.curve.setup_ms),
                with_range(&speedup.ratio_with_setup, 2)
            )
        })
    });
    format!(
        "Built and rendered for {} s each, {runs} independent run{} with the contenders taking turns frame by frame. \
         Intervals hold the truth with 95 % probability.{}",
        seconds(results.budget_ms),
        if runs == 1 { "" } else { "s" },
        with_setup.unwrap_or_default()
    )
}

pub(super) fn caption(point: &Point, from: &str) -> String {
    format!(
        "{} samples, {from}; relative error {:.2e}, similarity {:.3}, FLIP {:.3}",
        point.samples, point.relative_mse, point.ssim, point.flip
    )
}

pub(super) fn reference(results: &ComparisonResults) -> String {
    let reference = &results.reference;
    format!(
        "The reference has {} samples a pixel, none of them shared with a contender. Its own relative error, estimated from two \
         independent halves, is {:.2e}; it is part of every error here, and below {:.2e} the curves are not trusted (hollow marks).",
        thousands(reference.samples as usize),
        reference.relative_mse,
        reference.trusted_from
    )
}

/// A verdict in a few words.
pub(crate) fn verdict_in_words(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Unbiased => "falls to the reference's own error",
        Verdict::Biased => "BIASED: ends on a plateau",
        Verdict::Unclear => "cannot be told",
    }
}

pub(super) fn contenders(results: &ComparisonResults) -> Vec<ContenderRow> {
    let row = |found: &ContenderResult| ContenderRow {
        name: found.curve.who.to_string(),
        origin: match &found.curve.failure {
            Some(failure) => failure.clone(),
            None => found.origin.clone(),
        },
        setup_s: if found.curve.setup_ms > 0.0 { seconds(found.curve.setup_ms) } else { "–".to_owned() },
        build_ms: or_dash(found.build_ms, |build| with_range(build, 1)),
        frame_ms: or_dash(found.frame_ms, |frame| with_range(frame, 2)),
        samples: or_dash(found.samples, |samples| format!("{:.0}", samples.estimate)),
        relative_mse: or_dash(found.relative_mse, with_range_scientific),
        ssim: or_dash(found.ssim, |ssim| with_range(ssim, 4)),
        flip: or_dash(found.flip, |flip| with_range(flip, 4)),
        slope: or_dash(found.convergence.slope, |slope| with_range(slope, 3)),
        plateau: or_dash(found.convergence.squared_bias, with_range_scientific),
        verdict: verdict_in_words(found.convergence.verdict),
    };
    results.contenders.iter().map(row).collect()
}

/// The error of a table, in words.
pub(crate) fn target_in_words(target: &EqualError) -> String {
    let error = format!("relative error {:.2e}", target.relative_mse);
    match target.samples {
        Some(1) => format!("{error}: {NATIVE_DEFAULT} after its first sample"),
        Some(samples) => format!("{error}: {NATIVE_DEFAULT} after {samples} samples"),
        None => format!("{error}: the least that all reach"),
    }
}

pub(super) fn equal_error(results: &ComparisonResults) -> Vec<EqualErrorTable> {
    let table = |target: &EqualError| EqualErrorTable {
        title: target_in_words(target),
        baselines: BASELINES.map(|who| who.to_string()).into(),
        rows: target
            .rows
            .iter()
            .map(|row| {
                let ratios = |with_setup: bool| {
                    BASELINES
                        .map(|baseline| {
                            let speedup = row.speedups.iter().find(|speedup| speedup.over == baseline);
                            speedup.map_or_else(
                                || "–".to_owned(),
                                |one| {
                                    with_range(if with_setup { &one.ratio_with_setup } else { &one.ratio }, 2)
                                },
                            )
                        })
                        .into()
                };
                EqualErrorRow {
                    name: row.who.to_string(),
                    time_s: seconds(row.time_ms.estimate),
                    time_with_setup_s: seconds(row.time_with_setup_ms.estimate),
                    ratios: ratios(false),
                    ratios_with_setup: ratios(true),
                }
            })
            .collect(),
    };
    results.equal_error.iter().map(table).collect()
}

pub(super) fn slopes(results: &ComparisonResults) -> String {
    let biased: Vec<String> = results
        .contenders
        .iter()
        .filter(|found| found.convergence.verdict == Verdict::Biased)
        .map(|found| found.curve.who.to_string())
        .collect();
    let verdict = if biased.is_empty() {
        "No curve ends on a plateau above the reference's own error: no bias is seen.".to_owned()
    } else {
        format!(
            "These end on a plateau above the reference's own error, which no time will remove: {}.",
            biased.join(", ")
        )
    };
    format!(
        "On logarithmic axes the error of an unbiased estimator falls with slope −1 over rendering time. The slope is fitted to the \
         runs' mean curve with the reference's own error taken off. The plateau is how far above the reference's own error a curve would \
         end: the squared bias of the runs' mean picture, freed from chance pixel by pixel. Where a few bright dots decide the error, \
         slopes vary more from run to run than a handful of runs shows. {verdict}"
    )
}

pub(super) fn machine(results: &ComparisonResults) -> String {
    let machine = &results.machine;
    let cpu = if machine.cpu_model.is_empty() { "an unnamed processor" } else { &machine.cpu_model };
    let (major, minor, patch) = results.embree;
    format!("{cpu}, {} threads, {}, Embree {major}.{minor}.{patch}", machine.threads, machine.isa)
}
