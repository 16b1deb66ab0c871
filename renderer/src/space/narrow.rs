//! Narrower spaces: parameters fixed, or held to a part of their range (paper, section 5).
//!
//! Every configuration of a narrower space is one of the whole space, with equal values. The recommendations
//! of `treewright analyze` are written this way, and so are the paper's own for its two objectives (section
//! 4.4).

use std::{fmt, str::FromStr};

use treewright_client::{Condition, Configuration, Domain, Parameter, Value};

use super::{ConfigurationError, GREATER, LESSER, TuningSpace, space_of};

/// The narrowing of one parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum Narrowing {
    /// It has this value.
    Fix {
        /// The parameter.
        name: String,
        /// Its value.
        value: Value,
    },
    /// It stays between these, both included.
    Range {
        /// The parameter, a number.
        name: String,
        /// Least.
        low: f64,
        /// Most.
        high: f64,
    },
}

impl Narrowing {
    /// Reads `NAME=VALUE`.
    ///
    /// # Errors
    /// In words, where it is not of that form.
    pub fn fix(text: &str) -> Result<Self, String> {
        let (name, value) = pair(text, "NAME=VALUE, for example sah_block_size=4")?;
        Ok(Self::Fix { name, value: Value::parse(value) })
    }

    /// Reads `NAME=LOW..HIGH`.
    ///
    /// # Errors
    /// In words, where it is not of that form.
    pub fn range(text: &str) -> Result<Self, String> {
        let form = "NAME=LOW..HIGH, for example max_leaf_size=4..10";
        let (name, range) = pair(text, form)?;
        let wrong = || format!("a range is written {form}");
        let (low, high) = range.split_once("..").ok_or_else(wrong)?;
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
        match (number(low), number(high)) {
            (Some(low), Some(high)) if low <= high => Ok(Self::Range { name, low, high }),
            _ => Err(wrong()),
        }
    }

    /// Which parameter.
    pub fn name(&self) -> &str {
        match self {
            Self::Fix { name, .. } | Self::Range { name, .. } => name,
        }
    }
}

impl fmt::Display for Narrowing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fix { name, value } => write!(f, "{name}={value}"),
            Self::Range { name, low, high } => write!(f, "{name}={low}..{high}"),
        }
    }
}

/// The paper's own recommendations (section 4.4), by the parameters that both spaces have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recommendation {
    /// Only rendering time counts: split triangles or build carefully, small leaves, blocks of the
    /// processor's vectors.
    Render,
    /// Builds count as well: no splitting, since it more than doubles the build, and leaves up to 30.
    Total,
}

impl FromStr for Recommendation {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "paper-render" => Ok(Self::Render),
            "paper-total" => Ok(Self::Total),
            _ => Err("there are paper-render and paper-total".to_owned()),
        }
    }
}

impl Recommendation {
    /// As narrowings; those of parameters that a space lacks are to be left out.
    pub fn narrowings(self) -> Vec<Narrowing> {
        let texts: &[(&str, &str)] = match self {
            Self::Render => &[
                ("quality", "2..3"),
                ("sah_block_size", "4..8"),
                ("min_leaf_size", "1..8"),
                ("max_leaf_size", "4..10"),
            ],
            Self::Total => &[
                ("quality", "1..2"),
                ("sah_block_size", "4..16"),
                ("min_leaf_size", "4..30"),
                ("max_leaf_size", "8..30"),
            ],
        };
        let ranges =
            texts.iter().filter_map(|(name, range)| Narrowing::range(&format!("{name}={range}")).ok());
        let off = Narrowing::Fix { name: "compact".to_owned(), value: Value::Boolean(false) };
        ranges.chain([off]).collect()
    }
}

impl TuningSpace {
    /// The space with each narrowing applied, the later ones to what the earlier ones left. Fixed parameters
    /// leave the space and are [held](TuningSpace::with_held); the others keep their recommended value where
    /// it is still allowed, and take the nearest one otherwise. A parameter that no value can bring to life
    /// is gone.
    ///
    /// # Errors
    /// [`ConfigurationError::Narrowing`] for a parameter that there is not, and for one that would have no
    /// value left.
    pub fn narrowed(&self, narrowings: &[Narrowing]) -> Result<Self, ConfigurationError> {
        let mut all: Vec<Narrow> = self
            .explained()
            .map(|one| Narrow { parameter: one.parameter, about: one.about, is_held: false })
            .collect();
        for narrowing in narrowings {
            let refused =
                |problem: String| ConfigurationError::Narrowing { narrowing: narrowing.to_string(), problem };
            let known = all.iter_mut().find(|one| one.parameter.name == narrowing.name());
            let one = known
                .ok_or_else(|| refused(format!("the space {} has no such parameter", self.preset.name())))?;
            one.apply(narrowing).ok_or_else(|| refused("no value of its range is left".to_owned()))?;
        }
        keep_order(&mut all).map_err(|name| ConfigurationError::Narrowing {
            narrowing: name.to_owned(),
            problem: "no value of its range is left beside the other leaf size".to_owned(),
        })?;
        let mut kept: Vec<Narrow> = Vec::new();
        for mut one in all {
            if one.find_condition(&kept) {
                kept.push(one);
            }
        }
        align(&mut kept);
        let (held, mut free): (Vec<Narrow>, Vec<Narrow>) = kept.into_iter().partition(|one| one.is_held);
        for one in &mut free {
            // Fulfilled for good: the parameter that it asks for is held to a value that it names.
            let asks_held =
                |condition: &Condition| held.iter().any(|held| held.parameter.name == condition.parameter);
            one.parameter.active_if =
                one.parameter.active_if.take().filter(|condition| !asks_held(condition));
        }
        let space = space_of(free.iter().map(|one| one.parameter.clone()).collect())
            .map_err(|problem| ConfigurationError::Space { space: self.preset.name(), problem })?;
        let about = free.iter().map(|one| one.about).collect();
        let held = self.held.iter().cloned().chain(held.into_iter().map(|one| one.parameter)).collect();
        Ok(Self { space, about, held, ..self.clone() })
    }

    /// A configuration of a narrower space as one of the whole: with the held values, as far as they count.
    #[must_use]
    pub fn with_held(&self, configuration: &Configuration) -> Configuration {
        let mut whole = configuration.clone();
        for held in &self.held {
            let counts = held.active_if.as_ref().is_none_or(|condition| {
                whole.get(&condition.parameter).is_some_and(|value| condition.any_of.contains(value))
            });
            if counts {
                whole.set(&held.name, held.default.clone());
            }
        }
        whole
    }

    /// The reverse.
    pub(super) fn without_held(&self, configuration: &Configuration) -> Configuration {
        let is_held = |name: &str, value: &Value| {
            self.held.iter().any(|held| held.name == name && held.default == *value)
        };
        let raw = configuration.as_raw().iter();
        raw.filter(|(name, value)| !is_held(name, value))
            .map(|(name, value)| (name.clone(), value.clone()))
            .collect()
    }
}

/// A parameter on its way into a narrower space.
struct Narrow {
    parameter: Parameter,
    about: &'static str,
    is_held: bool,
}

impl Narrow {
    /// `None` where no value is left.
    fn apply(&mut self, narrowing: &Narrowing) -> Option<()> {
        match narrowing {
            Narrowing::Fix { value, .. } => {
                let value = match (&self.parameter.domain, value) {
                    (Domain::Float { .. }, Value::Integer(whole)) => Value::Float(*whole as f64),
                    _ => value.clone(),
                };
                let allowed = self.parameter.domain.contains(&value);
                (self.parameter.default, self.is_held) = (value, true);
                allowed.then_some(())
            }
            Narrowing::Range { low, high, .. } => {
                self.parameter.domain = ranged(&self.parameter.domain, *low, *high)?;
                self.parameter.default = nearest(&self.parameter.domain, &self.parameter.default);
                Some(())
            }
        }
    }

    /// Whether the parameter can be active beside earlier ones; impossible values leave its condition.
    fn find_condition(&mut self, kept: &[Narrow]) -> bool {
        let Some(Condition { parameter: parent, any_of }) = self.parameter.active_if.take() else {
            return true;
        };
        let Some(parent) = kept.iter().find(|one| one.parameter.name == parent) else { return false };
        let possible = |value: &Value| match parent.is_held {
            true => parent.parameter.default == *value,
            false => parent.parameter.domain.contains(value),
        };
        let any_of: Vec<Value> = any_of.into_iter().filter(possible).collect();
        let can = !any_of.is_empty();
        // A condition on a held parent may still depend on the parent's own condition.
        let condition = match (parent.is_held, &parent.parameter.active_if) {
            (true, above) if can => above.clone(),
            _ => Some(Condition { parameter: parent.parameter.name.clone(), any_of }),
        };
        self.parameter.active_if = condition;
        can
    }
}

/// Holds one leaf size to what the other leaves possible. The error names the one with nothing left.
fn keep_order(all: &mut [Narrow]) -> Result<(), &'static str> {
    for (fixed, other, is_lesser) in [(LESSER, GREATER, true), (GREATER, LESSER, false)] {
        let held = all.iter().find(|one| one.parameter.name == fixed && one.is_held);
        let Some(bound) = held.and_then(|one| one.parameter.default.as_number()) else { continue };
        let (low, high) = if is_lesser { (bound, f64::MAX) } else { (f64::MIN, bound) };
        if let Some(one) = all.iter_mut().find(|one| one.parameter.name == other) {
            let domain = ranged(&one.parameter.domain, low, high).ok_or(other)?;
            if one.is_held && !domain.contains(&one.parameter.default) {
                return Err(other);
            }
            one.parameter.default = nearest(&domain, &one.parameter.default);
            one.parameter.domain = domain;
        }
    }
    Ok(())
}

/// Brings the recommended leaf sizes into order.
fn align(parameters: &mut [Narrow]) {
    let default = |parameters: &[Narrow], name: &str| {
        parameters.iter().find(|one| one.parameter.name == name).map(|one| one.parameter.default.clone())
    };
    let (Some(low), Some(high)) = (default(parameters, LESSER), default(parameters, GREATER)) else { return };
    if low.as_number() <= high.as_number() {
        return;
    }
    for one in parameters.iter_mut().filter(|one| !one.is_held) {
        match one.parameter.name.as_str() {
            LESSER => one.parameter.default = nearest(&one.parameter.domain, &high),
            GREATER => one.parameter.default = nearest(&one.parameter.domain, &low),
            _ => {}
        }
    }
}

fn pair<'a>(text: &'a str, form: &str) -> Result<(String, &'a str), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() && !value.trim().is_empty() => {
            Ok((name.trim().to_owned(), value.trim()))
        }
        _ => Err(format!("it is written {form}")),
    }
}

fn ranged(domain: &Domain, low: f64, high: f64) -> Option<Domain> {
    match domain {
        Domain::Integer { min, max, scale } => {
            let (min, max) = ((*min).max(low.ceil() as i64), (*max).min(high.floor() as i64));
            (min <= max).then_some(Domain::Integer { min, max, scale: *scale })
        }
        Domain::Float { min, max, scale } => {
            let (min, max) = (min.max(low), max.min(high));
            (min <= max).then_some(Domain::Float { min, max, scale: *scale })
        }
        Domain::Categorical { values } => {
            let inside =
                |value: &&Value| value.as_number().is_some_and(|number| (low..=high).contains(&number));
            let values: Vec<Value> = values.iter().filter(inside).cloned().collect();
            (!values.is_empty()).then_some(Domain::Categorical { values })
        }
        Domain::Boolean => None,
    }
}

/// The value of a domain nearest to another; its first where there is no order.
fn nearest(domain: &Domain, value: &Value) -> Value {
    if domain.contains(value) {
        return value.clone();
    }
    let number = value.as_number();
    match domain {
        Domain::Integer { min, max, .. } => {
            Value::Integer(number.map_or(*min, |number| (number as i64).clamp(*min, *max)))
        }
        Domain::Float { min, max, .. } => {
            Value::Float(number.map_or(*min, |number| number.clamp(*min, *max)))
        }
        Domain::Categorical { values } => {
            let distance = |one: &Value| match (one.as_number(), number) {
                (Some(one), Some(number)) => (one - number).abs(),
                _ => 0.0,
            };
            let best = values.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
            best.cloned().unwrap_or_else(|| value.clone())
        }
        Domain::Boolean => value.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::{Premises, Preset, parse};

    fn narrowings(texts: &[&str]) -> Vec<Narrowing> {
        let read = |text: &&str| match text.contains("..") {
            true => Narrowing::range(text),
            false => Narrowing::fix(text),
        };
        texts.iter().map(read).collect::<Result<_, _>>().expect("they are well written")
    }

    #[test]
    fn configurations_of_a_narrower_space_are_configurations_of_the_whole() {
        let whole = TuningSpace::paper();
        let narrow = whole
            .narrowed(&narrowings(&[
                "compact=false",
                "quality=2",
                "min_leaf_size=4..8",
                "max_leaf_size=4..10",
                "sah_block_size=4..8",
            ]))
            .expect("it is sound");
        for seed in 0..200_u32 {
            let point: Vec<f64> = (0..narrow.space().dimension())
                .map(|axis| {
                    f64::from(seed.wrapping_mul(2_654_435_761).rotate_left(axis as u32 * 5) % 1000) / 999.0
                })
                .collect();
            let free: Configuration = narrow.space().decode(&point).to_raw().into();
            let found = narrow.with_held(&free);
            assert_eq!(whole.complete(&found).as_ref(), Ok(&found), "canonical in the whole");
            assert_eq!(narrow.complete(&found), Ok(free), "and in the part");
            assert_eq!(narrow.choice(&found), whole.choice(&found));
            assert!((4..=8).contains(&found.integer("min_leaf_size").expect("there is one")));
            assert!([4, 8].contains(&found.integer("sah_block_size").expect("there is one")));
            assert_eq!(
                (found.get("quality"), found.get("compact")),
                (Some(&Value::Integer(2)), Some(&Value::Boolean(false)))
            );
        }
        assert_eq!(narrow.default_configuration().integer("max_leaf_size"), Ok(10), "the nearest to 32");
    }

    #[test]
    fn what_cannot_come_to_life_is_gone() {
        let narrow = TuningSpace::paper().narrowed(&narrowings(&["quality=1"])).expect("it is sound");
        assert!(narrow.explained().all(|one| one.parameter.name != "traversal_cost"));
        let full = TuningSpace::new(Preset::Full, &Premises::all());
        let native = full.narrowed(&narrowings(&["backend=native"])).expect("it is sound");
        assert!(
            native
                .explained()
                .all(|one| one.parameter.name != "quality" && one.parameter.name != "node_width")
        );
        assert!(native.choice(&parse("native_quality=low").expect("it reads")).is_ok());
    }

    #[test]
    fn what_is_held_counts_only_where_it_can() {
        let narrow = TuningSpace::paper()
            .narrowed(&narrowings(&["sah_block_size=4", "robust=true"]))
            .expect("it is sound");
        let held =
            |text: &str| narrow.with_held(&narrow.complete(&parse(text).expect("it reads")).expect("sound"));
        assert_eq!(held("quality=3").integer("sah_block_size"), Ok(4));
        assert_eq!(held("quality=1").get("sah_block_size"), None);
        assert_eq!(held("compact=true").get("robust"), Some(&Value::Boolean(true)));
        assert!(
            narrow.complete(&parse("quality=3,sah_block_size=8").expect("it reads")).is_err(),
            "held to another"
        );
    }

    #[test]
    fn one_leaf_size_that_is_fixed_bounds_the_other() {
        let paper = TuningSpace::paper();
        let narrow = paper.narrowed(&narrowings(&["min_leaf_size=20"])).expect("it is sound");
        for x in [0.0, 0.3, 1.0] {
            let point = vec![x; narrow.space().dimension()];
            let found = narrow.with_held(&narrow.space().decode(&point).to_raw().into());
            assert!(paper.complete(&found).is_ok(), "{found}");
        }
        for other in ["max_leaf_size=4..10", "max_leaf_size=8"] {
            assert!(paper.narrowed(&narrowings(&["min_leaf_size=20", other])).is_err(), "{other}");
        }
    }

    #[test]
    fn what_makes_no_sense_is_refused_by_name() {
        let paper = TuningSpace::paper();
        for (text, words) in [
            ("colour=3", "no such parameter"),
            ("quality=9", "no value"),
            ("max_leaf_size=40..50", "no value"),
            ("compact=1..2", "no value"),
        ] {
            let message = paper.narrowed(&narrowings(&[text])).expect_err(text).to_string();
            assert!(
                message.contains(words) && message.contains(text.split('=').next().unwrap_or_default()),
                "{message}"
            );
        }
        for text in ["quality", "quality=", "=3", "quality=3..", "quality=5..2", "quality=a..b"] {
            assert!(Narrowing::range(text).is_err(), "{text}");
        }
    }

    #[test]
    fn the_papers_recommendations_fit_its_space() {
        for (name, qualities) in [("paper-render", [2, 3]), ("paper-total", [1, 2])] {
            let recommended: Recommendation = name.parse().expect("it is known");
            let space = TuningSpace::paper().narrowed(&recommended.narrowings()).expect("it is sound");
            let quality =
                space.explained().find(|one| one.parameter.name == "quality").expect("there is one");
            assert!(
                qualities.map(Value::Integer).iter().all(|value| quality.parameter.domain.contains(value))
            );
            assert!(space.choice(&space.default_configuration()).is_ok());
        }
    }
}
