//! The specification of a study: what is tuned, what describes the input, what is minimised.

use std::ops::RangeInclusive;

use serde::Serialize;

use crate::numbers::check_name;
use crate::{ClientError, Indicators, Policy, Scale, Space, limits};

/// One number that describes the input.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Indicator {
    /// Its name, spelt like a parameter's.
    pub name: String,
    /// The value that is mapped to 0.
    pub min: f64,
    /// The value that is mapped to 1. Larger values are accepted and map above 1.
    pub max: f64,
    /// With [`Scale::Log`], `log(1 + value - min)` is mapped, which keeps 0 in range.
    pub scale: Scale,
}

/// A weighted metric of the objective.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ObjectiveTerm {
    /// Name of a measurement, e.g. `render_ms`.
    pub metric: String,
    /// Greater than 0.
    pub weight: f64,
}

/// Everything that defines a study. Made with [`StudyBuilder`].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StudySpec {
    pub(crate) display_name: String,
    pub(crate) space: Space,
    pub(crate) indicators: Vec<Indicator>,
    pub(crate) objective: Vec<ObjectiveTerm>,
    pub(crate) state_tolerance: Option<f64>,
    pub(crate) policy: Policy,
    pub(crate) seed: u64,
}

impl StudySpec {
    /// Begins a specification.
    #[must_use]
    pub fn builder(space: Space) -> StudyBuilder {
        StudyBuilder {
            spec: Self {
                display_name: String::new(),
                space,
                indicators: Vec::new(),
                objective: Vec::new(),
                state_tolerance: None,
                policy: Policy::default(),
                seed: 0,
            },
        }
    }

    /// A line for people; may be empty.
    #[must_use]
    pub fn display_name(&self) -> &str {
        &self.display_name
    }

    /// What is tuned.
    #[must_use]
    pub fn space(&self) -> &Space {
        &self.space
    }

    /// What describes the input, in order.
    #[must_use]
    pub fn indicators(&self) -> &[Indicator] {
        &self.indicators
    }

    /// What is minimised: the sum of weight times metric.
    #[must_use]
    pub fn objective(&self) -> &[ObjectiveTerm] {
        &self.objective
    }

    /// How far two normalised states may lie apart and still be the same, 0 to 1.
    #[must_use]
    pub fn state_tolerance(&self) -> f64 {
        self.state_tolerance.unwrap_or(0.01)
    }

    /// How the service decides, as far as the study says.
    #[must_use]
    pub fn policy(&self) -> &Policy {
        &self.policy
    }

    /// Checks that the numbers are those of the study: each indicator there, no other, all finite.
    ///
    /// Errors: [`ClientError::Invalid`] naming the indicator.
    pub fn check_indicators(&self, indicators: &Indicators) -> Result<(), ClientError> {
        for indicator in &self.indicators {
            let what = || format!("indicator `{}`", indicator.name);
            match indicators.get(&indicator.name) {
                None => {
                    return Err(ClientError::invalid(
                        what(),
                        "it is missing; give a value for each indicator of the study",
                    ));
                }
                Some(value) if !value.is_finite() => {
                    return Err(ClientError::invalid(what(), format!("{value} is not a finite number")));
                }
                Some(_) => {}
            }
        }
        match indicators.iter().find(|(name, _)| self.indicators.iter().all(|known| known.name != *name)) {
            Some((name, _)) => {
                Err(ClientError::invalid(format!("indicator `{name}`"), "the study has no such indicator"))
            }
            None => Ok(()),
        }
    }

    /// Whether the service takes both for the same state: every normalised indicator within the tolerance.
    pub(crate) fn same_state(&self, a: &Indicators, b: &Indicators) -> bool {
        let tolerance = self.state_tolerance();
        self.indicators.iter().all(|indicator| match (a.get(&indicator.name), b.get(&indicator.name)) {
            (Some(a), Some(b)) => (indicator.normalised(a) - indicator.normalised(b)).abs() <= tolerance,
            _ => false,
        })
    }
}

impl Indicator {
    /// The value on the indicator's scale from 0 to 1, as the wire contract defines it.
    fn normalised(&self, value: f64) -> f64 {
        let (above, span) = (value - self.min, self.max - self.min);
        match self.scale {
            Scale::Linear => above / span,
            // Below the range the logarithm is continued as its mirror image.
            Scale::Log => above.signum() * above.abs().ln_1p() / span.ln_1p(),
        }
    }
}

/// Builds a [`StudySpec`].
///
/// ```
/// use treewright_client::{Policy, Scale, Space, StudySpec};
/// let space = Space::builder().integer("quality", 0..=2).default(1).build()?;
/// let spec = StudySpec::builder(space)
///     .indicator("triangles", 0.0..=1e8, Scale::Log)
///     .minimise("render_ms", 1.0)
///     .policy(Policy::new().epsilon(0.1))
///     .build()?;
/// # let _ = spec;
/// # Ok::<(), treewright_client::ClientError>(())
/// ```
#[derive(Debug, Clone)]
pub struct StudyBuilder {
    spec: StudySpec,
}

impl StudyBuilder {
    /// A line for people, at most 200 characters.
    #[must_use]
    pub fn display_name(mut self, text: impl Into<String>) -> Self {
        self.spec.display_name = text.into();
        self
    }

    /// A number that describes the input, with the range that is mapped to 0..1. Values outside are accepted.
    #[must_use]
    pub fn indicator(mut self, name: &str, range: RangeInclusive<f64>, scale: Scale) -> Self {
        self.spec.indicators.push(Indicator {
            name: name.to_owned(),
            min: *range.start(),
            max: *range.end(),
            scale,
        });
        self
    }

    /// Adds a metric to what is minimised. Render time alone: `render_ms` with weight 1. A tree that
    /// serves 30 frames: `build_ms` with weight 1/30 and `render_ms` with weight 1.
    #[must_use]
    pub fn minimise(mut self, metric: &str, weight: f64) -> Self {
        self.spec.objective.push(ObjectiveTerm { metric: metric.to_owned(), weight });
        self
    }

    /// Two states are the same when every normalised indicator differs by at most this, 0 to 1. Unset: 0.01.
    #[must_use]
    pub fn state_tolerance(mut self, tolerance: f64) -> Self {
        self.spec.state_tolerance = Some(tolerance);
        self
    }

    /// How the service decides.
    #[must_use]
    pub fn policy(mut self, policy: Policy) -> Self {
        self.spec.policy = policy;
        self
    }

    /// Seed of every random decision taken for the study. Unset: 0.
    #[must_use]
    pub fn seed(mut self, seed: u64) -> Self {
        self.spec.seed = seed;
        self
    }

    /// Checks the whole and finishes it.
    ///
    /// Errors: [`ClientError::Invalid`] names what the service would refuse.
    pub fn build(self) -> Result<StudySpec, ClientError> {
        let spec = self.spec;
        if spec.display_name.chars().count() > limits::DISPLAY_NAME_CHARACTERS {
            let problem = format!("it has more than {} characters", limits::DISPLAY_NAME_CHARACTERS);
            return Err(ClientError::invalid("display name", problem));
        }
        check_indicator_schema(&spec.indicators)?;
        check_objective(&spec.objective)?;
        if let Some(tolerance) = spec.state_tolerance
            && !(0.0..=1.0).contains(&tolerance)
        {
            return Err(ClientError::invalid("state tolerance", format!("{tolerance} is not within 0 to 1")));
        }
        spec.policy.check()?;
        Ok(spec)
    }
}

fn check_indicator_schema(indicators: &[Indicator]) -> Result<(), ClientError> {
    if indicators.len() > limits::INDICATORS {
        let problem = format!("{} of them; the limit is {}", indicators.len(), limits::INDICATORS);
        return Err(ClientError::invalid("indicators", problem));
    }
    for (index, indicator) in indicators.iter().enumerate() {
        let what = format!("indicator `{}`", indicator.name);
        check_name(&what, &indicator.name)?;
        if indicators[..index].iter().any(|other| other.name == indicator.name) {
            return Err(ClientError::invalid(what, "it is listed twice"));
        }
        if !(indicator.min.is_finite() && indicator.max.is_finite() && indicator.min < indicator.max) {
            let problem = format!("{}..={} is not a finite range that rises", indicator.min, indicator.max);
            return Err(ClientError::invalid(what, problem));
        }
    }
    Ok(())
}

fn check_objective(objective: &[ObjectiveTerm]) -> Result<(), ClientError> {
    if objective.is_empty() || objective.len() > limits::OBJECTIVE_TERMS {
        let problem = format!(
            "{} terms; say 1 to {} times what to `.minimise(…)`",
            objective.len(),
            limits::OBJECTIVE_TERMS
        );
        return Err(ClientError::invalid("objective", problem));
    }
    for (index, term) in objective.iter().enumerate() {
        let what = format!("objective term `{}`", term.metric);
        check_name(&what, &term.metric)?;
        if objective[..index].iter().any(|other| other.metric == term.metric) {
            return Err(ClientError::invalid(what, "it is listed twice"));
        }
        if !(term.weight.is_finite() && term.weight > 0.0) {
            return Err(ClientError::invalid(
                what,
                format!("the weight {} is not a finite number above 0", term.weight),
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn builder() -> StudyBuilder {
        StudySpec::builder(Space::builder().boolean("compact").default(false).build().unwrap())
    }

    #[test]
    fn indicators_are_checked_by_name_and_value() {
        let spec = builder()
            .indicator("triangles", 0.0..=1e6, Scale::Log)
            .minimise("render_ms", 1.0)
            .build()
            .unwrap();
        assert!(spec.check_indicators(&Indicators::from([("triangles", 1e9)])).is_ok());
        let problem = |indicators: Indicators| spec.check_indicators(&indicators).unwrap_err().to_string();
        assert!(problem(Indicators::new()).contains("`triangles`: it is missing"));
        assert!(problem(Indicators::from([("triangles", f64::NAN)])).contains("NaN"));
        assert!(problem(Indicators::from([("triangles", 1.0), ("lights", 2.0)])).contains("`lights`"));
    }

    #[test]
    fn states_are_the_same_within_the_tolerance_of_the_scale() {
        let spec = builder()
            .indicator("distance", 0.0..=100.0, Scale::Linear)
            .indicator("triangles", 0.0..=1e6, Scale::Log)
            .minimise("render_ms", 1.0)
            .state_tolerance(0.02)
            .build()
            .unwrap();
        let at = |distance: f64, triangles: f64| {
            Indicators::from([("distance", distance), ("triangles", triangles)])
        };
        assert!(spec.same_state(&at(10.0, 1000.0), &at(11.5, 1100.0)));
        assert!(!spec.same_state(&at(10.0, 1000.0), &at(12.5, 1000.0)));
        assert!(!spec.same_state(&at(10.0, 1000.0), &at(10.0, 2000.0)));
    }

    #[test]
    fn mistakes_are_named() {
        let problem = |builder: StudyBuilder| builder.build().unwrap_err().to_string();
        assert!(problem(builder()).contains("objective"));
        assert!(problem(builder().minimise("render_ms", 0.0)).contains("weight 0"));
        assert!(problem(builder().minimise("render_ms", 1.0).state_tolerance(2.0)).contains("tolerance"));
        assert!(
            problem(builder().minimise("render_ms", 1.0).indicator("a", 1.0..=1.0, Scale::Linear))
                .contains("rises")
        );
        assert!(
            problem(builder().minimise("render_ms", 1.0).policy(Policy::new().epsilon(1.5)))
                .contains("epsilon")
        );
    }
}
