//! Words for the results of a comparison.

use treewright_renderer::tuning::who::NATIVE_DEFAULT;

use super::bootstrap::Interval;
use super::equal_error::EqualError;

/// An estimate and its interval, with `digits` digits after the point.
pub(crate) fn with_range(interval: &Interval, digits: usize) -> String {
    match interval.range {
        Some([low, high]) => format!("{:.digits$} [{low:.digits$}, {high:.digits$}]", interval.estimate),
        None => format!("{:.digits$}", interval.estimate),
    }
}

/// Milliseconds as seconds.
pub(crate) fn seconds(time_ms: f64) -> String {
    match time_ms {
        ..1e3 => format!("{:.2}", time_ms / 1e3),
        ..1e5 => format!("{:.1}", time_ms / 1e3),
        _ => format!("{:.0}", time_ms / 1e3),
    }
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
