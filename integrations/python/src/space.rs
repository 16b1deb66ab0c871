//! The specification of a study, put together call by call.

use std::ops::RangeInclusive;

use pyo3::prelude::*;
use pyo3::types::PyTuple;
use treewright_client::{ClientError, Condition, Constraint, Domain, Parameter, Scale, SpaceError, Value};

use crate::convert::value_of;
use crate::error::Invalid;

/// The tuned parameters. Every method returns the space itself; Client.study reports mistakes.
#[pyclass(module = "treewright", frozen)]
#[derive(Debug, Default)]
pub(crate) struct Space {
    parts: std::sync::Mutex<Parts>,
}

#[derive(Debug, Default)]
struct Parts {
    parameters: Vec<Parameter>,
    /// Mistakes are reported with all others.
    constraints: Vec<Result<Constraint, SpaceError>>,
}

fn scale(log: bool) -> Scale {
    if log { Scale::Log } else { Scale::Linear }
}

/// `("quality", "high")`, or `("quality", "medium", "high")` for either.
fn condition(given: Option<Bound<'_, PyTuple>>) -> PyResult<Option<Condition>> {
    let Some(given) = given else { return Ok(None) };
    if given.len() < 2 {
        return Err(Invalid::new_err("active_if is (PARAMETER, VALUE, ...)"));
    }
    let any_of = given.iter().skip(1).map(|value| value_of(&value)).collect::<PyResult<_>>()?;
    Ok(Some(Condition { parameter: given.get_item(0)?.extract()?, any_of }))
}

impl Space {
    fn add<'py>(
        this: PyRef<'py, Self>,
        name: String,
        domain: Domain,
        default: Value,
        active_if: Option<Bound<'py, PyTuple>>,
        setup: bool,
    ) -> PyResult<PyRef<'py, Self>> {
        let active_if = condition(active_if)?;
        this.with(|parts| parts.parameters.push(Parameter { name, domain, default, active_if, setup }));
        Ok(this)
    }

    fn with<T>(&self, change: impl FnOnce(&mut Parts) -> T) -> T {
        change(&mut self.parts.lock().unwrap_or_else(std::sync::PoisonError::into_inner))
    }

    /// The finished space, or its mistakes.
    pub(crate) fn build(&self) -> Result<treewright_client::Space, ClientError> {
        self.with(|parts| {
            let constraints: Vec<Constraint> = parts.constraints.iter().cloned().collect::<Result<_, _>>()?;
            Ok(treewright_client::Space::new(parts.parameters.clone(), constraints)?)
        })
    }
}

#[pymethods]
impl Space {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    /// A whole number of a range with both ends; `default` is the value used so far. With `step` only values
    /// that are so far apart, from the smallest on. With `setup` a change of it needs a build, a compilation
    /// or the like; that of other parameters only a run.
    #[pyo3(signature = (name, min, max, *, default, log=false, active_if=None, step=None, setup=false))]
    #[allow(clippy::too_many_arguments)] // most are keywords of Python
    fn integer<'py>(
        this: PyRef<'py, Self>,
        name: String,
        min: i64,
        max: i64,
        default: i64,
        log: bool,
        active_if: Option<Bound<'py, PyTuple>>,
        step: Option<i64>,
        setup: bool,
    ) -> PyResult<PyRef<'py, Self>> {
        if let Some(step) = step {
            this.with(|parts| parts.constraints.push(Ok(Constraint::step(&name, min, step))));
        }
        Self::add(
            this,
            name,
            Domain::Integer { min, max, scale: scale(log) },
            Value::Integer(default),
            active_if,
            setup,
        )
    }

    /// A number of a range with both ends.
    #[pyo3(signature = (name, min, max, *, default, log=false, active_if=None, setup=false))]
    #[allow(clippy::too_many_arguments)] // most are keywords of Python
    fn float<'py>(
        this: PyRef<'py, Self>,
        name: String,
        min: f64,
        max: f64,
        default: f64,
        log: bool,
        active_if: Option<Bound<'py, PyTuple>>,
        setup: bool,
    ) -> PyResult<PyRef<'py, Self>> {
        let domain = Domain::Float { min, max, scale: scale(log) };
        Self::add(this, name, domain, Value::Float(default), active_if, setup)
    }

    /// True or false.
    #[pyo3(signature = (name, *, default, active_if=None, setup=false))]
    fn boolean<'py>(
        this: PyRef<'py, Self>,
        name: String,
        default: bool,
        active_if: Option<Bound<'py, PyTuple>>,
        setup: bool,
    ) -> PyResult<PyRef<'py, Self>> {
        Self::add(this, name, Domain::Boolean, Value::Boolean(default), active_if, setup)
    }

    /// One of up to 64 words, which have no order, or numbers, which are searched in their order.
    #[pyo3(signature = (name, values, *, default, active_if=None, setup=false))]
    fn choice<'py>(
        this: PyRef<'py, Self>,
        name: String,
        values: Vec<Bound<'py, PyAny>>,
        default: Bound<'py, PyAny>,
        active_if: Option<Bound<'py, PyTuple>>,
        setup: bool,
    ) -> PyResult<PyRef<'py, Self>> {
        let values = values.iter().map(value_of).collect::<PyResult<_>>()?;
        let default = value_of(&default)?;
        Self::add(this, name, Domain::Categorical { values }, default, active_if, setup)
    }

    /// Every configuration has lesser <= greater.
    fn less_or_equal(this: PyRef<'_, Self>, lesser: String, greater: String) -> PyRef<'_, Self> {
        this.with(|parts| parts.constraints.push(Ok(Constraint::order(&lesser, &greater))));
        this
    }

    /// Every configuration fulfils an expression, such as `"block_x * block_y <= 1024"`.
    fn constraint(this: PyRef<'_, Self>, expression: String) -> PyRef<'_, Self> {
        this.with(|parts| parts.constraints.push(Constraint::parse(&expression).map_err(Into::into)));
        this
    }

    fn __len__(&self) -> usize {
        self.with(|parts| parts.parameters.len())
    }
}

/// A range of an indicator: lowest, highest, and optionally `"log"`.
#[derive(FromPyObject)]
pub(crate) enum Range {
    Linear((f64, f64)),
    Scaled((f64, f64, String)),
}

impl Range {
    pub(crate) fn read(self) -> PyResult<(RangeInclusive<f64>, Scale)> {
        let (min, max, scale) = match self {
            Range::Linear((min, max)) => (min, max, "linear".to_owned()),
            Range::Scaled(scaled) => scaled,
        };
        match scale.as_str() {
            "log" => Ok((min..=max, Scale::Log)),
            "linear" => Ok((min..=max, Scale::Linear)),
            other => Err(Invalid::new_err(format!("{other:?} is no scale; use \"log\" or \"linear\""))),
        }
    }
}

/// The lower and the upper limit of a measurement; `None` for no limit on that side.
pub(crate) type Ends = (Option<f64>, Option<f64>);
