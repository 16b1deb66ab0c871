//! The specification of a study: the parts that are fixed at its creation, its space, and its policy.

use std::collections::BTreeSet;
use std::ops::RangeInclusive;

use serde::{Deserialize, Deserializer, Serialize, de};
use thiserror::Error;

use crate::fidelity::Fidelity;
use crate::front::Front;
use crate::indicator::{Indicator, IndicatorError, IndicatorSchema};
use crate::limits::{DISPLAY_NAME_CHARACTERS_MAX, NOTE_BYTES_MAX, TAG_CHARACTERS_MAX, TAGS_MAX};
use crate::objective::{MeasurementLimit, Objective, ObjectiveError, ObjectiveTerm};
use crate::policy::{Policy, PolicyError, PolicySettings, RawPolicy};
use crate::space::{Constraint, Scale, Space};

/// State tolerance of a study that gives none.
pub const STATE_TOLERANCE_DEFAULT: f64 = 0.01;

/// A tuning problem. All but `space`, `policy` and the texts for people (`display_name`, `note`, `tags`) is
/// fixed. Trials measured under one schema and one objective are not comparable with trials measured under
/// another. `P` is [`Policy`] once decided, and [`PolicySettings`] as given by clients.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StudySpec<P = Policy> {
    /// A line for people, at most 200 characters.
    pub display_name: String,
    /// A text for people of several lines, at most 4096 bytes.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
    /// Words by which people group studies, at most 16: 1 to 32 letters and digits of any script, `_`, `-`
    /// and `.`.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub tags: BTreeSet<String>,
    /// The tunables.
    pub space: Space,
    /// The numbers that describe an input. May be empty: the study then has one state.
    pub indicators: IndicatorSchema,
    /// The objective that is minimised.
    pub objective: Objective,
    /// Two inputs are one state when every normalised indicator differs by at most this much, 0 to 1.
    pub state_tolerance: f64,
    /// The policy.
    pub policy: P,
    /// Seed of every random decision.
    pub seed: u64,
}

/// Why a specification is refused. Spaces, schemas and objectives have errors of their own.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum StudyError {
    /// A text for people or the tolerance is not acceptable: the field, the mistake and its remedy.
    #[error("{0}")]
    Field(String),
    /// The policy is not acceptable.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// The indicators are not acceptable.
    #[error(transparent)]
    Indicators(#[from] IndicatorError),
    /// The objective is not acceptable.
    #[error(transparent)]
    Objective(#[from] ObjectiveError),
}

/// A policy whose configuration is checked has no form of its own: its space decides.
impl<'de> Deserialize<'de> for StudySpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let raw = StudySpec::<RawPolicy>::deserialize(deserializer)?;
        let policy = raw.policy.clone().check(&raw.space).map_err(de::Error::custom)?;
        let spec = raw.with_policy(policy);
        spec.validate().map_err(de::Error::custom)?;
        Ok(spec)
    }
}

impl<P> StudySpec<P> {
    fn check_texts_and_tolerance(&self) -> Result<(), StudyError> {
        let refuse = |problem: String| Err(StudyError::Field(problem));
        let name = &self.display_name;
        if name.chars().count() > DISPLAY_NAME_CHARACTERS_MAX || name.chars().any(char::is_control) {
            return refuse(format!(
                "display_name must be at most {DISPLAY_NAME_CHARACTERS_MAX} characters without control characters"
            ));
        }
        let is_mark = |c: char| c.is_control() && !matches!(c, '\n' | '\t');
        if self.note.len() > NOTE_BYTES_MAX || self.note.chars().any(is_mark) {
            return refuse(format!(
                "note must be at most {NOTE_BYTES_MAX} bytes without control characters but tabs and \\n (not \\r\\n)"
            ));
        }
        if self.tags.len() > TAGS_MAX {
            return refuse(format!("tags has {}; give at most {TAGS_MAX}", self.tags.len()));
        }
        if let Some(tag) = self.tags.iter().find(|tag| !is_tag(tag)) {
            return refuse(format!(
                "tags: {tag:?} must be 1 to {TAG_CHARACTERS_MAX} letters, digits, _, - and ., without blanks and quotes"
            ));
        }
        if !(0.0..=1.0).contains(&self.state_tolerance) {
            let tolerance = self.state_tolerance;
            return refuse(format!("state_tolerance is {tolerance}; it must be between 0 and 1"));
        }
        Ok(())
    }

    /// The specification with another policy.
    pub fn with_policy<Q>(self, policy: Q) -> StudySpec<Q> {
        StudySpec {
            display_name: self.display_name,
            note: self.note,
            tags: self.tags,
            space: self.space,
            indicators: self.indicators,
            objective: self.objective,
            state_tolerance: self.state_tolerance,
            policy,
            seed: self.seed,
        }
    }
}

impl StudySpec {
    /// The front that the study was made for, as its display name says; `None` where it was made for none.
    pub fn front(&self) -> Option<Front> {
        let is_direction = self.indicators.indicators().iter().any(|one| one.name == Front::DIRECTION);
        let is_cost = self.objective.terms().iter().any(|term| term.metric == Front::COST);
        Front::of_study(&self.display_name).filter(|_| is_direction && is_cost)
    }

    /// Checks the rules beyond the types of the parts.
    pub fn validate(&self) -> Result<(), StudyError> {
        self.check_texts_and_tolerance()?;
        self.policy.validate(&self.space)?;
        Ok(())
    }

    /// The first difference of two specifications in words, leaving out `policy` and the texts for people.
    /// `None` when they are equal.
    pub fn first_difference(&self, other: &StudySpec) -> Option<String> {
        let (mine, theirs) = (self, other);
        macro_rules! lists {
            ($($what:literal: $part:ident.$list:ident by $name:expr;)+) => {
                $(
                    let (a, b) = (mine.$part.$list(), theirs.$part.$list());
                    if let Some(found) = list_difference($what, a, b, $name) {
                        return Some(found);
                    }
                )+
            };
        }
        lists! {
            "parameter": space.parameters by |parameter| parameter.name.clone();
            "constraint": space.constraints by Constraint::to_string;
            "indicator": indicators.indicators by |indicator| indicator.name.clone();
            "objective term": objective.terms by |term| term.metric.clone();
            "auxiliary metric": objective.auxiliary by String::clone;
            "limit": objective.limits by ToString::to_string;
            "maximised metric": objective.maximised by String::clone;
            "cheaper level": objective.fidelities by |level| level.name.clone();
        }
        let (mine, theirs) = (self.objective.episode_frames(), other.objective.episode_frames());
        if mine != theirs {
            return Some(format!("episode_frames is {mine} against {theirs}"));
        }
        if self.state_tolerance != other.state_tolerance {
            return Some(format!(
                "state_tolerance is {} against {}",
                self.state_tolerance, other.state_tolerance
            ));
        }
        if self.seed != other.seed {
            return Some(format!("seed is {} against {}", self.seed, other.seed));
        }
        None
    }
}

fn is_tag(tag: &str) -> bool {
    (1..=TAG_CHARACTERS_MAX).contains(&tag.chars().count())
        && tag.chars().all(|c| c.is_alphanumeric() || matches!(c, '_' | '-' | '.'))
}

fn list_difference<T: PartialEq + Serialize>(
    what: &str,
    mine: &[T],
    theirs: &[T],
    name: impl Fn(&T) -> String,
) -> Option<String> {
    let text = |item: &T| serde_json::to_string(item).unwrap_or_else(|_| name(item));
    for (index, (a, b)) in mine.iter().zip(theirs).enumerate() {
        if name(a) != name(b) {
            return Some(format!("{what} {} is {:?} against {:?}", index + 1, name(a), name(b)));
        }
        if a != b {
            return Some(format!("{what} {:?} is {} against {}", name(a), text(a), text(b)));
        }
    }
    if mine.len() != theirs.len() {
        return Some(format!("the number of {what}s is {} against {}", mine.len(), theirs.len()));
    }
    None
}

impl StudySpec<PolicySettings> {
    /// Begins a specification.
    pub fn builder(space: Space) -> StudyBuilder {
        StudyBuilder(StudySpec {
            display_name: String::new(),
            note: String::new(),
            tags: BTreeSet::new(),
            space,
            indicators: IndicatorSchema::default(),
            objective: Objective::empty(),
            state_tolerance: STATE_TOLERANCE_DEFAULT,
            policy: PolicySettings::new(),
            seed: 0,
        })
    }
}

/// Builds a [`StudySpec`].
///
/// ```
/// use treewright_model::policy::PolicySettings;
/// use treewright_model::space::{Scale, Space};
/// use treewright_model::study::StudySpec;
/// let space = Space::builder().integer("quality", 0..=2).default(1).build()?;
/// let spec = StudySpec::builder(space)
///     .indicator("triangles", 0.0..=1e8, Scale::Log)
///     .minimise("render_ms", 1.0)
///     .policy(PolicySettings::new().epsilon(0.1))
///     .build()?;
/// # let _ = spec;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct StudyBuilder(StudySpec<PolicySettings>);

impl StudyBuilder {
    /// A line for people, at most 200 characters.
    #[must_use]
    pub fn display_name(mut self, text: impl Into<String>) -> Self {
        self.0.display_name = text.into();
        self
    }

    /// A text for people of several lines, at most 4096 bytes.
    #[must_use]
    pub fn note(mut self, text: impl Into<String>) -> Self {
        self.0.note = text.into();
        self
    }

    /// Words by which people group studies, at most 16, each of 1 to 32 letters and digits of any script,
    /// `_`, `-` and `.`.
    #[must_use]
    pub fn tags(mut self, tags: impl IntoIterator<Item = impl Into<String>>) -> Self {
        self.0.tags.extend(tags.into_iter().map(Into::into));
        self
    }

    /// A number that describes the input, with the range that is mapped to 0..1. Values outside are accepted.
    #[must_use]
    pub fn indicator(mut self, name: &str, range: RangeInclusive<f64>, scale: Scale) -> Self {
        let (min, max) = (*range.start(), *range.end());
        self.0.indicators.indicators.push(Indicator { name: name.to_owned(), min, max, scale });
        self
    }

    /// Adds a metric to minimise. Render time alone: `render_ms` with weight 1. A tree that serves 30 frames:
    /// `build_ms` with weight 1/30 and `render_ms` with weight 1.
    #[must_use]
    pub fn minimise(mut self, metric: &str, weight: f64) -> Self {
        self.0.objective.terms.push(ObjectiveTerm { metric: metric.to_owned(), weight });
        self
    }

    /// Adds a metric to maximise, such as frames a second, requests a second or a share of hits. Its
    /// reciprocal is the cost: `weight` over the measurement, which must be above 0. With other terms the
    /// weight brings both to one unit: `fps` with weight 1000 counts in milliseconds.
    #[must_use]
    pub fn maximise(mut self, metric: &str, weight: f64) -> Self {
        self.0.objective.maximised.push(metric.to_owned());
        self.minimise(metric, weight)
    }

    /// Names a metric beside the objective that explains a cost, such as the processor time of a frame. The
    /// noise that it explains is removed before costs are compared. At most 8.
    #[must_use]
    pub fn auxiliary(mut self, metric: &str) -> Self {
        self.0.objective.auxiliary.push(metric.to_owned());
        self
    }

    /// Limits a measurement, which every report of a completed trial then needs. A configuration beyond the
    /// limit is infeasible, and the search learns to avoid it. `None` is no limit on that side. At most 16.
    #[must_use]
    pub fn limit(mut self, metric: &str, at_least: Option<f64>, at_most: Option<f64>) -> Self {
        self.0.objective.limits.push(MeasurementLimit { metric: metric.to_owned(), at_least, at_most });
        self
    }

    /// Makes a trial last several frames, 1 to 64, for costs that rise or fall while a configuration is in
    /// use. Its measurements are the means of its frames. Unset: 1.
    #[must_use]
    pub fn episode_frames(mut self, frames: u32) -> Self {
        self.0.objective.episode_frames = frames;
        self
    }

    /// Adds a cheaper level, such as fewer samples or a shorter input: its name, and the cost of a trial
    /// there as a share of a full one. The cheapest comes first; at most 4. Clients that know them may be
    /// given trials at these levels.
    #[must_use]
    pub fn fidelity(mut self, name: impl Into<String>, cost: f64) -> Self {
        self.0.objective.fidelities.push(Fidelity { name: name.into(), cost });
        self
    }

    /// Two inputs are one state when every normalised indicator differs by at most this, 0 to 1. Unset: 0.01.
    #[must_use]
    pub fn state_tolerance(mut self, tolerance: f64) -> Self {
        self.0.state_tolerance = tolerance;
        self
    }

    /// Sets the policy.
    #[must_use]
    pub fn policy(mut self, policy: PolicySettings) -> Self {
        self.0.policy = policy;
        self
    }

    /// Makes it the study of a front: a run's direction is its indicator and the cost there its objective,
    /// and its display name lists the metrics. Nothing is confirmed, unless the policy says so, which is to
    /// be set before: that race would be one of a single direction.
    #[must_use]
    pub fn front(mut self, front: &Front) -> Self {
        self.0.policy.confirm_rounds.get_or_insert(0);
        self.indicator(Front::DIRECTION, front.range(), Scale::Linear)
            .minimise(Front::COST, 1.0)
            .display_name(front.study_name())
    }

    /// Seed of every random decision of the study. Unset: 0.
    #[must_use]
    pub fn seed(mut self, seed: u64) -> Self {
        self.0.seed = seed;
        self
    }

    /// Checks the whole and finishes it.
    ///
    /// # Errors
    /// [`StudyError`] with the part that the service would refuse.
    pub fn build(self) -> Result<StudySpec<PolicySettings>, StudyError> {
        let StudyBuilder(spec) = self;
        let indicators = IndicatorSchema::new(spec.indicators.indicators)?;
        let spec = StudySpec { indicators, objective: spec.objective.checked()?, ..spec };
        spec.check_texts_and_tolerance()?;
        spec.policy.check()?;
        Ok(spec)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::testing::{cases, decided, studies};
    use crate::value::Value;

    fn spec() -> StudySpec {
        let space = Space::builder().integer("a", 1..=9).default(3).integer("b", 1..=9).default(3);
        let spec = StudySpec::builder(space.less_or_equal("a", "b").build().expect("valid"));
        let spec = spec.display_name("a study").indicator("x", 0.0..=1.0, Scale::Linear);
        spec.minimise("render_ms", 1.0).build().expect("valid").with_policy(Policy::default())
    }

    #[test]
    fn a_front_is_found_by_its_name_and_confirms_only_where_that_is_wished() {
        let space = || Space::builder().integer("a", 1..=9).default(3).build().expect("valid");
        let front = Front::new(&["ms", "1/rate"]).expect("metrics");
        let spec = StudySpec::builder(space()).front(&front).build().expect("valid");
        assert_eq!(Front::of_study(&spec.display_name), Some(front.clone()));
        assert_eq!((spec.indicators.indicators.len(), spec.policy.confirm_rounds), (1, Some(0)));
        let wished =
            StudySpec::builder(space()).policy(PolicySettings::new().confirm_rounds(9)).front(&front);
        assert_eq!(wished.build().expect("valid").policy.confirm_rounds, Some(9));
    }

    #[test]
    fn the_first_difference_is_named_and_policy_and_texts_do_not_count() {
        let base = spec();
        let policy = Policy { epsilon: 0.9, ..Policy::default() };
        let (display_name, note, tags) = ("other".into(), "a\nb".into(), BTreeSet::from(["a".to_owned()]));
        let renamed = StudySpec { display_name, note, tags, policy, ..spec() };
        assert_eq!(base.first_difference(&renamed), None);
        let mut parameters = base.space.parameters().to_vec();
        parameters[1].default = Value::Integer(4);
        let space = Space::new(parameters, base.space.constraints().to_vec()).expect("valid");
        let other = base.first_difference(&StudySpec { space, ..spec() }).expect("differs");
        assert!(other.starts_with("parameter \"b\" is {"), "{other}");
        let space = Space::new(base.space.parameters().to_vec(), vec![]).expect("valid");
        let other = base.first_difference(&StudySpec { space, ..spec() });
        assert_eq!(other.as_deref(), Some("the number of constraints is 1 against 0"));
        let other = base.first_difference(&StudySpec { indicators: IndicatorSchema::default(), ..spec() });
        assert_eq!(other.as_deref(), Some("the number of indicators is 1 against 0"));
        let objective = base.objective.clone().with_episode_frames(24).expect("valid");
        let other = base.first_difference(&StudySpec { objective, ..spec() });
        assert_eq!(other.as_deref(), Some("episode_frames is 1 against 24"));
        let levels = vec![Fidelity { name: "16".into(), cost: 0.1 }];
        let objective = base.objective.clone().with_fidelities(levels).expect("valid");
        let other = base.first_difference(&StudySpec { objective, ..spec() });
        assert_eq!(other.as_deref(), Some("the number of cheaper levels is 0 against 1"));
        let other = base.first_difference(&StudySpec { seed: 7, ..spec() });
        assert_eq!(other.as_deref(), Some("seed is 0 against 7"));
    }

    proptest! {
        #![proptest_config(cases(128))]

        #[test]
        fn every_specification_is_stored_and_read_back(spec in studies()) {
            let spec = decided(spec);
            let policy = spec.policy.clone().check(&spec.space).expect("valid");
            let spec = spec.with_policy(policy);
            let text = serde_json::to_string(&spec).expect("plain data");
            prop_assert_eq!(serde_json::from_str::<StudySpec>(&text).expect("own output"), spec);
        }
    }

    #[test]
    fn specifications_are_checked_on_the_way_in() {
        let text = serde_json::to_string(&spec()).expect("plain data");
        let pinned = r#""pinned":{"a":{"integer":5},"b":{"integer":4}}"#;
        for (good, bad) in [
            (r#""state_tolerance":0.01"#, r#""state_tolerance":1.5"#),
            (r#""epsilon":0.2"#, r#""epsilon":-0.2"#),
            (r#""replicates":1"#, r#""replicates":0"#),
            (r#""lease_s":60"#, r#""lease_s":86401"#),
            (r#""display_name":"a study""#, r#""display_name":"a\nstudy""#),
            (r#""display_name":"a study""#, r#""display_name":"a study","note":"a\rb""#),
            (r#""display_name":"a study""#, r#""display_name":"a study","tags":["a","a b"]"#),
            (r#""pinned":null"#, pinned),
        ] {
            assert!(text.contains(good), "{good}");
            assert!(serde_json::from_str::<StudySpec>(&text.replace(good, bad)).is_err(), "{bad}");
        }
        let order = serde_json::from_str::<StudySpec>(&text.replace(r#""pinned":null"#, pinned));
        assert!(order.expect_err("a > b").to_string().contains("a = 5, b = 4 break the constraint `a <= b`"));
        assert!(StudySpec { state_tolerance: f64::NAN, ..spec() }.validate().is_err());
    }

    #[test]
    fn notes_and_tags_have_limits_and_are_left_out_where_there_are_none() {
        let text = serde_json::to_string(&spec()).expect("plain data");
        assert!(text.starts_with(r#"{"display_name":"a study","space":"#), "{text}");
        let with = |note: &str, tags: &[&str]| {
            let tags = tags.iter().map(|tag| (*tag).to_owned()).collect();
            StudySpec { note: note.to_owned(), tags, ..spec() }
        };
        let full = with(&"é".repeat(NOTE_BYTES_MAX / 2), &["b", "2.1_x-y", "層", "b"]);
        assert_eq!(full.validate(), Ok(()));
        let text = serde_json::to_string(&full).expect("plain data");
        assert!(text.contains(r#""tags":["2.1_x-y","b","層"],"#), "{text}");
        let long = "a".repeat(NOTE_BYTES_MAX + 1);
        let refused = |spec: StudySpec| spec.validate().expect_err("beyond a limit").to_string();
        for note in [&*long, "a\0b"] {
            assert!(refused(with(note, &[])).starts_with("note must be at most 4096 bytes"), "{note}");
        }
        for bad in ["", "a b", "a,b", "a\nb", "<b>", &"ä".repeat(TAG_CHARACTERS_MAX + 1)] {
            let problem = refused(with("", &[bad]));
            assert!(problem.starts_with(&format!("tags: {bad:?} must be 1 to 32")), "{problem}");
        }
        let tags = (0..=TAGS_MAX).map(|number| number.to_string()).collect();
        assert_eq!(refused(StudySpec { tags, ..spec() }), "tags has 17; give at most 16");
    }

    #[test]
    fn mistakes_are_named_where_they_are_made() {
        let builder = || {
            StudySpec::builder(Space::builder().boolean("compact").default(false).build().expect("a space"))
        };
        let problem = |builder: StudyBuilder| builder.build().expect_err("not a study").to_string();
        assert!(problem(builder()).contains("objective"));
        assert!(problem(builder().minimise("render_ms", 0.0)).contains("weight 0"));
        assert!(problem(builder().minimise("render_ms", 1.0).state_tolerance(2.0)).contains("tolerance"));
        assert!(problem(builder().minimise("render_ms", 1.0).episode_frames(0)).contains("1 to 64"));
        let flat = builder().minimise("render_ms", 1.0).indicator("a", 1.0..=1.0, Scale::Linear);
        assert!(problem(flat).contains("less than max"));
        let policy = PolicySettings::new().epsilon(1.5);
        assert!(problem(builder().minimise("render_ms", 1.0).policy(policy)).contains("epsilon"));
    }
}
