//! Values, numbers and configurations between Python and the SDK.

use std::collections::BTreeMap;

use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyString};
use treewright_client::{Configuration, Indicators, Measurements, Value};

use crate::error::Invalid;

/// A mapping of names to numbers.
pub(crate) type Numbers = BTreeMap<String, f64>;

pub(crate) fn indicators(numbers: Option<Numbers>) -> Indicators {
    numbers.unwrap_or_default().into_iter().collect()
}

pub(crate) fn measurements(numbers: Numbers) -> Measurements {
    numbers.into_iter().collect()
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

pub(crate) fn configuration_of(values: &Bound<'_, PyDict>) -> PyResult<Configuration> {
    let pair = |(name, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
        Ok((name.extract::<String>()?, value_of(&value)?))
    };
    values.iter().map(pair).collect()
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
