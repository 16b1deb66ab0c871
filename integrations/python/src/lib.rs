//! The native half of the Python package `treewright`: the blocking client SDK as classes. Parts that are
//! nicer to write in Python (asyncio, the Optuna sampler, the autotune cache) stand in `python/treewright`.
//!
//! The interpreter's lock is let go wherever a call may wait. Handles are shared between threads as Python
//! shares objects; the SDK below is thread-safe.

mod best;
mod client;
mod convert;
mod error;
mod front;
mod pareto;
mod prediction;
mod space;
mod suggestion;
mod trials;

use pyo3::prelude::*;

/// The native half of `treewright`, with equal names.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<space::Space>()?;
    module.add_class::<client::Client>()?;
    module.add_class::<client::Study>()?;
    module.add_class::<best::Best>()?;
    module.add_class::<front::Front>()?;
    module.add_class::<front::FrontTrial>()?;
    module.add_class::<prediction::Prediction>()?;
    module.add_class::<suggestion::Suggestion>()?;
    module.add_class::<suggestion::Tuner>()?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    error::register(module)
}
