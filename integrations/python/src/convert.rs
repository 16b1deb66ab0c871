//! Values, numbers and configurations between Python and the SDK.

use std::collections::BTreeMap;

use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyMapping, PyString};
use treewright_client::{Configuration, Indicators, Measurements, Value};

use crate::error::Invalid;

/// Values by name, from a dictionary or another mapping, in the order of the names.
pub(crate) struct Named<T>(pub(crate) BTreeMap<String, T>);

pub(crate) type Numbers = Named<f64>;

impl<T> Default for Named<T> {
    fn default() -> Self {
        Self(BTreeMap::new())
    }
}

impl<'py, T: FromPyObjectOwned<'py>> FromPyObject<'_, 'py> for Named<T> {
    type Error = PyErr;

    fn extract(values: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        dictionary(&values)?.extract::<BTreeMap<String, T>>().map(Self)
    }
}

/// Any mapping as a dictionary, which is all that PyO3 makes maps of.
fn dictionary<'py>(values: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    if let Ok(dictionary) = values.cast::<PyDict>() {
        return Ok(dictionary.clone());
    }
    let dictionary = PyDict::new(values.py());
    dictionary.update(values.cast::<PyMapping>()?)?;
    Ok(dictionary)
}

pub(crate) fn indicators(numbers: Option<Numbers>) -> Indicators {
    numbers.unwrap_or_default().0.into_iter().collect()
}

/// Measurements from a dictionary and from keywords, and the standard errors of some of them.
pub(crate) fn measurements(
    numbers: Option<Numbers>,
    named: Option<Numbers>,
    errors: Option<Numbers>,
) -> Measurements {
    let mut all = numbers.unwrap_or_default().0;
    all.extend(named.unwrap_or_default().0);
    let errors = errors.unwrap_or_default().0.into_iter();
    errors.fold(all.into_iter().collect(), |all: Measurements, (name, error)| {
        all.with_standard_error(name, error)
    })
}

/// A Python value as one of a parameter. A `bool` is an `int` to Python, so it is asked for first.
pub(crate) fn value_of(value: &Bound<'_, PyAny>) -> PyResult<Value> {
    if let Ok(boolean) = value.cast::<PyBool>() {
        return Ok(Value::Boolean(boolean.is_true()));
    }
    if value.is_instance_of::<PyInt>() {
        return Ok(Value::Integer(value.extract()?));
    }
    if value.is_instance_of::<PyFloat>() {
        return Ok(Value::Float(value.extract()?));
    }
    if let Ok(text) = value.cast::<PyString>() {
        return Ok(Value::Text(text.extract()?));
    }
    Err(Invalid::new_err(format!("{value} is no value of a parameter; use bool, int, float or str")))
}

pub(crate) fn configuration_of(values: &Bound<'_, PyAny>) -> PyResult<Configuration> {
    let pair = |(name, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
        Ok((name.extract::<String>()?, value_of(&value)?))
    };
    dictionary(values)?.iter().map(pair).collect()
}

/// A configuration as a dictionary of bare values.
pub(crate) fn shown<'py>(python: Python<'py>, configuration: &Configuration) -> PyResult<Bound<'py, PyDict>> {
    let dictionary = PyDict::new(python);
    for (name, value) in configuration.iter() {
        match value {
            Value::Integer(whole) => dictionary.set_item(name, whole)?,
            Value::Float(number) => dictionary.set_item(name, number)?,
            Value::Text(text) => dictionary.set_item(name, text)?,
            Value::Boolean(boolean) => dictionary.set_item(name, boolean)?,
        }
    }
    Ok(dictionary)
}

/// A configuration, which Python reads as a dictionary of bare values.
pub(crate) struct Shown(pub(crate) Configuration);

impl<'py> IntoPyObject<'py> for &Shown {
    type Target = PyDict;
    type Output = Bound<'py, PyDict>;
    type Error = PyErr;

    fn into_pyobject(self, python: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        shown(python, &self.0)
    }
}
