//! Configurations as C reads them.

use std::collections::BTreeMap;
use std::ffi::{CString, c_char};
use std::mem::MaybeUninit;

use treewright_client::{ClientError, NoSuchValue, Value};

use crate::edge::{ErrorOut, Text, guard, need, store};
use crate::error::{Failure, c_text};

/// A configuration with its texts in C's form.
#[derive(Debug)]
pub(crate) struct Configuration {
    values: treewright_client::Configuration,
    texts: BTreeMap<String, CString>,
    json: CString,
    /// Its notes as an answer: status, verdict or reason, and trial.
    notes: [CString; 3],
}

impl Configuration {
    pub(crate) fn new(values: treewright_client::Configuration) -> Self {
        let text = |(name, value): (&str, &Value)| match value {
            Value::Text(text) => Some((name.to_owned(), c_text(text))),
            _ => None,
        };
        let texts = values.iter().filter_map(text).collect();
        let json = c_text(&serde_json::to_string(&values).unwrap_or_default());
        Self { values, texts, json, notes: Default::default() }
    }

    pub(crate) fn noted(values: treewright_client::Configuration, notes: [&str; 3]) -> Self {
        Self { notes: notes.map(c_text), ..Self::new(values) }
    }

    /// A note; C reads it while the configuration lives.
    pub(crate) fn notes(&self) -> [Text; 3] {
        [0, 1, 2].map(|place| Text::of(&self.notes[place]))
    }
}

/// Reads what [`tw_configuration_json`] writes.
pub(crate) fn from_json(text: &str) -> Result<treewright_client::Configuration, Failure> {
    serde_json::from_str(text)
        .map_err(|error| Failure::invalid(format!("the configuration is no JSON object: {error}")))
}

fn get<T>(
    configuration: Option<&Configuration>,
    name: Text,
    room: Option<&mut MaybeUninit<T>>,
    get: impl FnOnce(&treewright_client::Configuration, &str) -> Result<T, NoSuchValue>,
) -> Result<(), Failure> {
    let values = &need(configuration, "configuration")?.values;
    store(room, get(values, name.read("the parameter's name")?).map_err(ClientError::from)?)
}

exports! {
    fn tw_configuration_integer(
        configuration: Option<&Configuration>, name: Text, value: Option<&mut MaybeUninit<i64>>; error
    ) -> bool {
        get(configuration, name, value, |values, name| values.integer(name))
    }

    fn tw_configuration_float(
        configuration: Option<&Configuration>, name: Text, value: Option<&mut MaybeUninit<f64>>; error
    ) -> bool {
        get(configuration, name, value, |values, name| values.float(name))
    }

    fn tw_configuration_boolean(
        configuration: Option<&Configuration>, name: Text, value: Option<&mut MaybeUninit<bool>>; error
    ) -> bool {
        get(configuration, name, value, |values, name| values.boolean(name))
    }

    fn tw_configuration_text(
        configuration: Option<&Configuration>, name: Text, error: ErrorOut
    ) -> *const c_char {
        let body = || {
            let configuration = need(configuration, "configuration")?;
            let name = name.read("the parameter's name")?;
            configuration.values.text(name).map_err(ClientError::from)?;
            Ok(configuration.texts.get(name).map_or(std::ptr::null(), |text| text.as_ptr()))
        };
        guard(error, body).unwrap_or(std::ptr::null())
    }

    fn tw_configuration_has(configuration: Option<&Configuration>, name: Text) -> bool {
        let body = || Ok(need(configuration, "configuration")?.values.get(name.read("the name")?).is_some());
        guard(ErrorOut::nowhere(), body).unwrap_or(false)
    }

    fn tw_configuration_json(configuration: Option<&Configuration>) -> *const c_char {
        configuration.map_or(c"{}".as_ptr(), |configuration| configuration.json.as_ptr())
    }

    fn tw_configuration_reason(configuration: Option<&Configuration>) -> *const c_char {
        configuration.map_or(c"".as_ptr(), |configuration| configuration.notes[1].as_ptr())
    }

    fn tw_configuration_new(json: Text; error) -> Option<Box<Configuration>> {
        Ok(Configuration::new(from_json(json.read("the configuration")?)?))
    }

    fn tw_configuration_free(configuration: Configuration);
}
