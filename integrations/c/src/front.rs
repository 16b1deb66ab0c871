//! Pareto fronts of stored trials, as C reads them.

use std::ffi::{CString, c_char};

use treewright_client::{ClientError, FrontQuery};

use crate::edge::{Array, ErrorOut, Text, free, guard, need};
use crate::error::c_text;
use crate::study::Study;

/// A front as JSON.
#[derive(Debug)]
pub(crate) struct Front(CString);

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_study_front(
    study: Option<&Study>,
    metrics: Array<Text>,
    count: usize,
    state: i64,
    error: ErrorOut,
) -> Option<Box<Front>> {
    guard(error, || {
        let metrics = metrics.read(count, "the list of metrics")?;
        let metrics: Vec<&str> =
            metrics.iter().map(|each| each.read("the name of a metric")).collect::<Result<_, _>>()?;
        let named = (!metrics.is_empty()).then(|| treewright_client::Front::new(&metrics));
        let front = named.transpose().map_err(ClientError::from)?;
        let query = FrontQuery { front, state: (state != 0).then_some(state), reference: None };
        let found = need(study, "study")?.0.front(&query)?;
        Ok(Box::new(Front(c_text(&serde_json::to_string(&found).unwrap_or_default()))))
    })
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_front_json(front: Option<&Front>) -> *const c_char {
    front.map_or(c"{}".as_ptr(), |front| front.0.as_ptr())
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_front_free(front: Option<Box<Front>>) {
    free(front);
}
