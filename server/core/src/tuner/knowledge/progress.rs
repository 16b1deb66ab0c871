//! The progress of a state's search, without luck: the gain of each octave of its trials by the posterior.
//!
//! The lowest of more and more noisy measurements falls for ever. So at the end of each octave the best by
//! the [posterior](crate::statistics::estimate) is compared with the best at the end of the octave before.
//! Both costs come from one posterior, which shows no gain that the measurements do not show.

use crate::configuration::Configuration;
use crate::limits::PROGRESS_SAMPLES_MAX;
use crate::matrix::distance_2;
use crate::results::ResultTable;
use crate::search::Layout;
use crate::space::Space;
use crate::statistics::estimate::CostPosterior;
use crate::tuner::knowledge::assessment::samples;

/// The best configuration of a state, and the share by which it costs less than the former best. `None` where
/// nothing was measured.
pub(crate) fn gained(
    space: &Space,
    results: &ResultTable,
    before: Option<&Configuration>,
) -> Option<(Configuration, f64)> {
    // The best, an even choice of the others, and the former best.
    let records = results.spread(PROGRESS_SAMPLES_MAX / 2, PROGRESS_SAMPLES_MAX / 2, before.as_slice());
    let layout = Layout::of(space);
    let then = before.and_then(|before| records.iter().position(|record| record.configuration == *before));
    let samples = samples(&records, &layout, space, results.assumed_noise(), [then, None]);
    let posterior = CostPosterior::of(&samples, distance_2)?;
    let means = posterior.means();
    assert_eq!(means.len(), records.len(), "a mean for every record");
    let best = (0..means.len()).min_by(|&a, &b| means[a].total_cmp(&means[b]))?;
    let gain = then.map_or(0.0, |then| posterior.compare(best, then).gain);
    Some((records[best].configuration.clone(), gain))
}
