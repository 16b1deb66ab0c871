//! The specification of a study, put together call by call. The first mistake is kept, and making the study
//! returns it, so that a program checks for errors once.

use treewright_client::{
    Condition, Constraint, Domain, Front, Parameter, Policy, Scale, Space, StudyBuilder, StudySpec, Value,
};

use crate::edge::{Array, ErrorOut, Text, guard, set};
use crate::error::Failure;

/// A specification under construction.
#[derive(Default)]
pub(crate) struct Spec {
    parameters: Vec<Parameter>,
    constraints: Vec<Constraint>,
    /// All but the space and the policy, in the order of the calls.
    steps: Vec<Box<dyn Fn(StudyBuilder) -> StudyBuilder>>,
    /// Whether an indicator or a term of the objective is among them.
    is_defined: bool,
    policy: Policy,
    mistake: Option<String>,
}

impl Spec {
    /// The finished specification, or the first mistake.
    pub(crate) fn finish(&self) -> Result<StudySpec, Failure> {
        self.study()?.build().map_err(|error| Failure::invalid(error.to_string()))
    }

    /// The specification of a front, or the first mistake.
    pub(crate) fn of_front(&self, front: &Front) -> Result<StudySpec, Failure> {
        let study = self.study()?;
        if self.is_defined {
            return Err(Failure::invalid(
                "a front has an objective and an indicator of its own; name its metrics alone",
            ));
        }
        study.front(front).build().map_err(|error| Failure::invalid(error.to_string()))
    }

    /// The space alone, or the first mistake.
    pub(crate) fn space(&self) -> Result<Space, Failure> {
        if let Some(mistake) = &self.mistake {
            return Err(Failure::invalid(mistake));
        }
        let mut space = Space::builder();
        for parameter in &self.parameters {
            space = space.with_parameter(parameter.clone());
        }
        for constraint in &self.constraints {
            space = space.with_constraint(constraint.clone());
        }
        space.build().map_err(|error| Failure::invalid(error.to_string()))
    }

    fn study(&self) -> Result<StudyBuilder, Failure> {
        let study = StudySpec::builder(self.space()?).policy(self.policy.clone());
        Ok(self.steps.iter().fold(study, |study, step| step(study)))
    }

    /// Says something of the study.
    fn say(&mut self, step: impl Fn(StudyBuilder) -> StudyBuilder + 'static) {
        self.steps.push(Box::new(step));
    }

    /// Says something of which a front has its own.
    fn define(&mut self, step: impl Fn(StudyBuilder) -> StudyBuilder + 'static) {
        self.is_defined = true;
        self.say(step);
    }

    pub(crate) fn indicator(&mut self, name: &str, min: f64, max: f64, scale: Scale) {
        let name = name.to_owned();
        self.define(move |study| study.indicator(&name, min..=max, scale));
    }

    fn parameter(&mut self, name: &str, domain: Domain, default: Value) {
        self.parameters.push(Parameter::new(name, domain, default));
    }

    /// A parameter whose values are a list of numbers of one kind.
    fn numbers<T: Copy + Into<Value>>(
        &mut self,
        name: &Text,
        values: &Array<T>,
        count: usize,
        default: T,
    ) -> Result<(), String> {
        let name = name.words("a parameter's name")?;
        let numbers =
            values.read(count, "the list of choices").map_err(|_| format!("{name} has no choices"))?;
        let values = numbers.iter().map(|&number| number.into()).collect();
        self.parameter(name, Domain::Categorical { values }, default.into());
        Ok(())
    }

    /// A value of a parameter as people write it.
    fn value_of(&self, parameter: &str, text: &str) -> Result<Value, String> {
        let found = self.parameters.iter().find(|one| one.name == parameter);
        let domain = &found.ok_or_else(|| format!("there is no parameter {parameter:?} yet"))?.domain;
        let of_text = matches!(domain, Domain::Categorical { values } if matches!(values.first(), Some(Value::Text(_))));
        let of_floats = matches!(domain, Domain::Float { .. })
            || matches!(domain, Domain::Categorical { values } if matches!(values.first(), Some(Value::Float(_))));
        Ok(match Value::parse(text) {
            _ if of_text => Value::Text(text.to_owned()),
            Value::Integer(whole) if of_floats => Value::Float(whole as f64),
            other => other,
        })
    }
}

/// Changes a specification; a mistake is kept for later.
pub(crate) fn change(spec: Option<&mut Spec>, change: impl FnOnce(&mut Spec) -> Result<(), String>) {
    if let Some(spec) = spec
        && let Err(mistake) = change(spec)
    {
        spec.mistake.get_or_insert(mistake);
    }
}

/// Takes a text over; a mistake is kept for later.
fn take(spec: Option<&mut Spec>, text: Text, what: &str, put: impl FnOnce(&mut Spec, String)) {
    change(spec, |spec| {
        put(spec, text.words(what)?.to_owned());
        Ok(())
    });
}

fn scale_of(scale: i32) -> Result<Scale, String> {
    match scale {
        0 => Ok(Scale::Linear),
        1 => Ok(Scale::Log),
        other => Err(format!("{other} is no scale; use TW_LINEAR or TW_LOG")),
    }
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_new() -> Option<Box<Spec>> {
    guard(ErrorOut::nowhere(), || Ok(Box::default()))
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_free(spec: Option<Box<Spec>>) {
    drop(spec);
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_integer(
    spec: Option<&mut Spec>,
    name: Text,
    min: i64,
    max: i64,
    default: i64,
    scale: i32,
) {
    change(spec, |spec| {
        let domain = Domain::Integer { min, max, scale: scale_of(scale)? };
        spec.parameter(name.words("a parameter's name")?, domain, Value::Integer(default));
        Ok(())
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_float(
    spec: Option<&mut Spec>,
    name: Text,
    min: f64,
    max: f64,
    default: f64,
    scale: i32,
) {
    change(spec, |spec| {
        let domain = Domain::Float { min, max, scale: scale_of(scale)? };
        spec.parameter(name.words("a parameter's name")?, domain, Value::Float(default));
        Ok(())
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_boolean(spec: Option<&mut Spec>, name: Text, default: bool) {
    change(spec, |spec| {
        spec.parameter(name.words("a parameter's name")?, Domain::Boolean, Value::Boolean(default));
        Ok(())
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_choice(
    spec: Option<&mut Spec>,
    name: Text,
    values: Array<Text>,
    count: usize,
    default: Text,
) {
    change(spec, |spec| {
        let name = name.words("a parameter's name")?;
        let words =
            values.read(count, "the list of choices").map_err(|_| format!("{name} has no choices"))?;
        let words: Result<_, String> =
            words.iter().map(|word| Ok(Value::Text(word.words("a choice")?.to_owned()))).collect();
        let default = Value::Text(default.words("the default")?.to_owned());
        spec.parameter(name, Domain::Categorical { values: words? }, default);
        Ok(())
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_choice_number(
    spec: Option<&mut Spec>,
    name: Text,
    values: Array<f64>,
    count: usize,
    default: f64,
) {
    change(spec, |spec| spec.numbers(&name, &values, count, default));
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_choice_integer(
    spec: Option<&mut Spec>,
    name: Text,
    values: Array<i64>,
    count: usize,
    default: i64,
) {
    change(spec, |spec| spec.numbers(&name, &values, count, default));
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_active_if(spec: Option<&mut Spec>, parameter: Text, value: Text) {
    change(spec, |spec| {
        let parameter = parameter.words("the condition's parameter")?;
        let value = spec.value_of(parameter, value.words("the condition's value")?)?;
        let last = spec.parameters.last_mut().ok_or("a condition needs a parameter that it is for")?;
        match &mut last.active_if {
            Some(condition) if condition.parameter == parameter => condition.any_of.push(value),
            Some(condition) => {
                return Err(format!("{} depends on {} already", last.name, condition.parameter));
            }
            unset => *unset = Some(Condition { parameter: parameter.to_owned(), any_of: vec![value] }),
        }
        Ok(())
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_setup(spec: Option<&mut Spec>) {
    change(spec, |spec| {
        spec.parameters.last_mut().ok_or("a set-up needs a parameter that it is for")?.setup = true;
        Ok(())
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_less_or_equal(spec: Option<&mut Spec>, lesser: Text, greater: Text) {
    change(spec, |spec| {
        let (lesser, greater) =
            (lesser.words("the lesser parameter")?, greater.words("the greater parameter")?);
        spec.constraints.push(Constraint::order(lesser, greater));
        Ok(())
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_step(spec: Option<&mut Spec>, step: i64) {
    change(spec, |spec| {
        let Some(Parameter { name, domain: Domain::Integer { min, .. }, .. }) = spec.parameters.last() else {
            return Err("a step belongs to a whole number; call it right after tw_spec_integer".to_owned());
        };
        spec.constraints.push(Constraint::step(name, *min, step));
        Ok(())
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_constraint(spec: Option<&mut Spec>, expression: Text) {
    change(spec, |spec| {
        let constraint = Constraint::parse(expression.words("the constraint")?);
        spec.constraints.push(constraint.map_err(|error| error.to_string())?);
        Ok(())
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_indicator(
    spec: Option<&mut Spec>,
    name: Text,
    min: f64,
    max: f64,
    scale: i32,
) {
    change(spec, |spec| {
        spec.indicator(name.words("an indicator's name")?, min, max, scale_of(scale)?);
        Ok(())
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_minimise(spec: Option<&mut Spec>, metric: Text, weight: f64) {
    take(spec, metric, "a metric's name", |spec, metric| {
        spec.define(move |study| study.minimise(&metric, weight));
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_maximise(spec: Option<&mut Spec>, metric: Text, weight: f64) {
    take(spec, metric, "a metric's name", |spec, metric| {
        spec.define(move |study| study.maximise(&metric, weight));
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_auxiliary(spec: Option<&mut Spec>, metric: Text) {
    take(spec, metric, "a metric's name", |spec, metric| spec.say(move |study| study.auxiliary(&metric)));
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_limit(spec: Option<&mut Spec>, metric: Text, at_least: f64, at_most: f64) {
    // Infinity, on its own side, is no limit.
    let at_least = Some(at_least).filter(|end| *end != f64::NEG_INFINITY);
    let at_most = Some(at_most).filter(|end| *end != f64::INFINITY);
    take(spec, metric, "a metric's name", |spec, metric| {
        spec.say(move |study| study.limit(&metric, at_least, at_most));
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_episode_frames(spec: Option<&mut Spec>, frames: u32) {
    set(spec, |spec| spec.say(move |study| study.episode_frames(frames)));
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_fidelity(spec: Option<&mut Spec>, name: Text, cost: f64) {
    take(spec, name, "a level's name", |spec, name| {
        spec.say(move |study| study.fidelity(name.as_str(), cost))
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_policy(spec: Option<&mut Spec>, field: Text, value: Text) {
    change(spec, |spec| {
        let (field, value) = (field.words("a policy field")?, value.words("its value")?);
        spec.policy.set_text(field, value).map_err(|error| error.to_string())
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_display_name(spec: Option<&mut Spec>, text: Text) {
    take(spec, text, "the display name", |spec, text| {
        spec.say(move |study| study.display_name(text.as_str()))
    });
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_state_tolerance(spec: Option<&mut Spec>, tolerance: f64) {
    set(spec, |spec| spec.say(move |study| study.state_tolerance(tolerance)));
}

#[unsafe(no_mangle)]
pub(crate) extern "C" fn tw_spec_seed(spec: Option<&mut Spec>, seed: u64) {
    set(spec, |spec| spec.say(move |study| study.seed(seed)));
}
