//! The specification of a study, put together call by call. Making the study returns the first mistake, so
//! that a program checks for errors once.

use treewright_client::{
    Condition, Constraint, Domain, Front, Parameter, Policy, Scale, Space, StudyBuilder, StudySpec, Value,
};

use crate::edge::{Array, Draft, ErrorOut, Text, guard};
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
        let space = Space::new(self.parameters.clone(), self.constraints.clone());
        space.map_err(|error| Failure::invalid(error.to_string()))
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
        Ok(if of_text { Value::Text(text.to_owned()) } else { domain.as_of(&Value::parse(text)) })
    }
}

impl Draft for Spec {
    fn mistake(&mut self) -> &mut Option<String> {
        &mut self.mistake
    }
}

fn scale_of(scale: i32) -> Result<Scale, String> {
    match scale {
        0 => Ok(Scale::Linear),
        1 => Ok(Scale::Log),
        other => Err(format!("{other} is no scale; use TW_LINEAR or TW_LOG")),
    }
}

exports! {
    fn tw_spec_new() -> Option<Box<Spec>> {
        guard(ErrorOut::nowhere(), || Ok(Box::default()))
    }

    fn tw_spec_free(spec: Spec);

    fn tw_spec_integer(mut spec: Spec, name: Text, min: i64, max: i64, default: i64, scale: i32) {
        let domain = Domain::Integer { min, max, scale: scale_of(scale)? };
        spec.parameter(name.words("a parameter's name")?, domain, Value::Integer(default));
    }

    fn tw_spec_float(mut spec: Spec, name: Text, min: f64, max: f64, default: f64, scale: i32) {
        let domain = Domain::Float { min, max, scale: scale_of(scale)? };
        spec.parameter(name.words("a parameter's name")?, domain, Value::Float(default));
    }

    fn tw_spec_boolean(mut spec: Spec, name: Text, default: bool) {
        spec.parameter(name.words("a parameter's name")?, Domain::Boolean, Value::Boolean(default));
    }

    fn tw_spec_choice(mut spec: Spec, name: Text, values: Array<Text>, count: usize, default: Text) {
        let name = name.words("a parameter's name")?;
        let words =
            values.read(count, "the list of choices").map_err(|_| format!("{name} has no choices"))?;
        let words: Result<_, String> =
            words.iter().map(|word| Ok(Value::Text(word.words("a choice")?.to_owned()))).collect();
        let default = Value::Text(default.words("the default")?.to_owned());
        spec.parameter(name, Domain::Categorical { values: words? }, default);
    }

    fn tw_spec_choice_number(mut spec: Spec, name: Text, values: Array<f64>, count: usize, default: f64) {
        spec.numbers(&name, &values, count, default)?;
    }

    fn tw_spec_choice_integer(mut spec: Spec, name: Text, values: Array<i64>, count: usize, default: i64) {
        spec.numbers(&name, &values, count, default)?;
    }

    fn tw_spec_active_if(mut spec: Spec, parameter: Text, value: Text) {
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
    }

    fn tw_spec_setup(mut spec: Spec) {
        spec.parameters.last_mut().ok_or("a set-up needs a parameter that it is for")?.setup = true;
    }

    fn tw_spec_less_or_equal(mut spec: Spec, lesser: Text, greater: Text) {
        let (lesser, greater) =
            (lesser.words("the lesser parameter")?, greater.words("the greater parameter")?);
        spec.constraints.push(Constraint::order(lesser, greater));
    }

    fn tw_spec_step(mut spec: Spec, step: i64) {
        let Some(Parameter { name, domain: Domain::Integer { min, .. }, .. }) = spec.parameters.last() else {
            return Err("a step belongs to a whole number; call it right after tw_spec_integer".to_owned());
        };
        spec.constraints.push(Constraint::step(name, *min, step));
    }

    fn tw_spec_constraint(mut spec: Spec, expression: Text) {
        let constraint = Constraint::parse(expression.words("the constraint")?);
        spec.constraints.push(constraint.map_err(|error| error.to_string())?);
    }

    fn tw_spec_indicator(mut spec: Spec, name: Text, min: f64, max: f64, scale: i32) {
        spec.indicator(name.words("an indicator's name")?, min, max, scale_of(scale)?);
    }

    fn tw_spec_minimise(mut spec: Spec, metric: Text, weight: f64) {
        let metric = metric.words("a metric's name")?.to_owned();
        spec.define(move |study| study.minimise(&metric, weight));
    }

    fn tw_spec_maximise(mut spec: Spec, metric: Text, weight: f64) {
        let metric = metric.words("a metric's name")?.to_owned();
        spec.define(move |study| study.maximise(&metric, weight));
    }

    fn tw_spec_auxiliary(mut spec: Spec, metric: Text) {
        let metric = metric.words("a metric's name")?.to_owned();
        spec.say(move |study| study.auxiliary(&metric));
    }

    fn tw_spec_limit(mut spec: Spec, metric: Text, at_least: f64, at_most: f64) {
        // Infinity, on its own side, is no limit.
        let at_least = Some(at_least).filter(|end| *end != f64::NEG_INFINITY);
        let at_most = Some(at_most).filter(|end| *end != f64::INFINITY);
        let metric = metric.words("a metric's name")?.to_owned();
        spec.say(move |study| study.limit(&metric, at_least, at_most));
    }

    fn tw_spec_episode_frames(mut spec: Spec, frames: u32) {
        spec.say(move |study| study.episode_frames(frames));
    }

    fn tw_spec_fidelity(mut spec: Spec, name: Text, cost: f64) {
        let name = name.words("a level's name")?.to_owned();
        spec.say(move |study| study.fidelity(name.as_str(), cost));
    }

    fn tw_spec_policy(mut spec: Spec, field: Text, value: Text) {
        let (field, value) = (field.words("a policy field")?, value.words("its value")?);
        spec.policy.set_text(field, value).map_err(|error| error.to_string())?;
    }

    fn tw_spec_display_name(mut spec: Spec, text: Text) {
        let text = text.words("the display name")?.to_owned();
        spec.say(move |study| study.display_name(text.as_str()));
    }

    fn tw_spec_state_tolerance(mut spec: Spec, tolerance: f64) {
        spec.say(move |study| study.state_tolerance(tolerance));
    }

    fn tw_spec_seed(mut spec: Spec, seed: u64) {
        spec.say(move |study| study.seed(seed));
    }
}
