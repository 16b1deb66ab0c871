//! The progress of a state's search, without luck: the gain of each octave of its trials by the posterior.
//!
//! The lowest of more and more noisy measurements falls for ever. So at the end of each octave the best by
//! the [posterior](crate::statistics::estimate) is compared with the best at the end of the octave before.
//! Both costs come from one posterior, which shows no gain that the measurements do not show.

use crate::configuration::Configuration;
use crate::limits::PROGRESS_SAMPLES_MAX;
use crate::matrix::distance_2;
use crate::results::{Record, ResultTable};
use crate::search::Layout;
use crate::space::Space;
use crate::statistics::estimate::CostPosterior;
use crate::tuner::assessment::samples;

/// The best configuration of a state, and the share by which it costs less than the former best. `None` where
/// nothing was measured.
pub(super) fn gained(
    space: &Space,
    results: &ResultTable,
    before: Option<&Configuration>,
) -> Option<(Configuration, f64)> {
    let records = chosen(results, before);
    let layout = Layout::of(space);
    let then = before.and_then(|before| records.iter().position(|record| record.configuration == *before));
    let samples = samples(&records, &layout, space, [then, None]);
    let posterior = CostPosterior::of(&samples, distance_2)?;
    let means = posterior.means();
    assert_eq!(means.len(), records.len(), "a mean for every record");
    let best = (0..means.len()).min_by(|&a, &b| means[a].total_cmp(&means[b]))?;
    let gain = then.map_or(0.0, |then| posterior.compare(best, then).gain);
    Some((records[best].configuration.clone(), gain))
}

/// The records that the posterior rests on: all, or the former best, the best half, and an even choice of the
/// rest.
fn chosen<'a>(results: &'a ResultTable, before: Option<&Configuration>) -> Vec<&'a Record> {
    let ranked: Vec<&Record> = results.ranked().collect();
    if ranked.len() <= PROGRESS_SAMPLES_MAX {
        return ranked;
    }
    let best = PROGRESS_SAMPLES_MAX / 2;
    let rest = PROGRESS_SAMPLES_MAX - best;
    let mut places: Vec<usize> = (0..best).collect();
    places.extend((0..rest).map(|index| best + index * (ranked.len() - best) / rest));
    let then = before.and_then(|before| ranked.iter().position(|record| record.configuration == *before));
    if let Some(then) = then.filter(|then| !places.contains(then)) {
        places.push(then);
    }
    assert!(places.len() <= PROGRESS_SAMPLES_MAX + 1, "{} samples", places.len());
    places.into_iter().map(|place| ranked[place]).collect()
}
