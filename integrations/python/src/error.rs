//! Errors of the SDK as exceptions: one class for all, and one for each thing that can be done about it.

use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use treewright_client::ClientError;

create_exception!(
    treewright,
    TreewrightError,
    PyException,
    "Something went wrong; the message names cause and remedy."
);
create_exception!(treewright, Invalid, TreewrightError, "An argument is wrong; nothing was sent.");
create_exception!(treewright, Unreachable, TreewrightError, "No daemon answered in time; later one may.");
create_exception!(treewright, Refused, TreewrightError, "The daemon will not do it.");

pub(crate) fn raised(error: ClientError) -> PyErr {
    let words = error.to_string();
    match error {
        ClientError::BadUrl { .. } | ClientError::Invalid { .. } | ClientError::NoSuchValue(_) => {
            Invalid::new_err(words)
        }
        ClientError::Away { .. }
        | ClientError::NotNow { .. }
        | ClientError::NoLocalDaemon { .. }
        | ClientError::Late { .. }
        | ClientError::Unflushed { .. } => Unreachable::new_err(words),
        ClientError::Refused { .. } => Refused::new_err(words),
        _ => TreewrightError::new_err(words),
    }
}

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let python = module.py();
    module.add("TreewrightError", python.get_type::<TreewrightError>())?;
    module.add("Invalid", python.get_type::<Invalid>())?;
    module.add("Unreachable", python.get_type::<Unreachable>())?;
    module.add("Refused", python.get_type::<Refused>())
}
