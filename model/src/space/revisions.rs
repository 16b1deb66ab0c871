//! The spaces that a study had, and their configurations in the space that it has by now.
//!
//! Stored trials keep the values that they ran with. They are read in the present space each time, and what
//! was outside after one change may be inside again after the next. So nothing is checked on the way: only
//! the present space decides, and a change that is undone brings every trial back.

use std::collections::BTreeMap;
use std::mem::discriminant;

use serde::{Deserialize, Serialize};

use crate::configuration::{Configuration, RawConfiguration};
use crate::limits::{INTEGER_MAGNITUDE_MAX, SPACE_REVISIONS_MAX};
use crate::space::{Domain, Parameter, Space, SpaceError};
use crate::value::Value;

/// A space that a study had before a change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EarlierSpace {
    /// The space.
    pub space: Space,
    /// The last trial that was handed out before the change.
    pub last_trial: u64,
    /// Values of parameters that the change added or removed, other than their defaults. An added one has
    /// that value in all trials before, a removed one in all trials after.
    pub fixed: RawConfiguration,
}

/// The spaces that a study had before its present one, oldest first. Revisions are counted from 1.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct EarlierSpaces(Vec<EarlierSpace>);

impl EarlierSpaces {
    /// The revision of the present space.
    pub fn revision(&self) -> u32 {
        self.0.len() as u32 + 1
    }

    /// Whether the space was never changed.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The revision that held when a trial was handed out.
    pub fn revision_of(&self, trial: u64) -> u32 {
        self.0.partition_point(|earlier| earlier.last_trial < trial) as u32 + 1
    }

    /// The spaces, oldest first.
    pub fn spaces(&self) -> impl Iterator<Item = &Space> {
        self.0.iter().map(|earlier| &earlier.space)
    }

    /// The space of a revision before the present one.
    pub fn space(&self, revision: u32) -> Option<&Space> {
        self.0.get((revision as usize).checked_sub(1)?).map(|earlier| &earlier.space)
    }

    /// The revision that a space is, if the study has or had it; the latest of several.
    pub fn find(&self, space: &Space, present: &Space) -> Option<u32> {
        if space == present {
            return Some(self.revision());
        }
        self.0.iter().rposition(|earlier| earlier.space == *space).map(|place| place as u32 + 1)
    }

    /// The spaces before after a change of the present space `from` into `to`. `last_trial` was the last to
    /// be handed out, and `fixed` is as in [`EarlierSpace`]. A parameter that comes again, without a value
    /// there, had what it kept when it went, if its new domain has that.
    ///
    /// # Errors
    /// [`SpaceError`] when a fixed value is of no parameter that the change adds or removes or not of its
    /// domain, or when there are [`SPACE_REVISIONS_MAX`] revisions.
    pub fn changed(
        &self,
        from: &Space,
        to: &Space,
        last_trial: u64,
        fixed: RawConfiguration,
    ) -> Result<Self, SpaceError> {
        let count = self.0.len() + 2;
        if count > SPACE_REVISIONS_MAX {
            return Err(SpaceError::of_count("revisions", count, 1, SPACE_REVISIONS_MAX));
        }
        let fixed = fixed.into_iter().map(|(name, value)| {
            let parameter = match (from.parameter(&name), to.parameter(&name)) {
                (Some(parameter), None) | (None, Some(parameter)) => parameter,
                _ => {
                    return Err(SpaceError(format!(
                        "earlier value of {name:?}: the change neither adds nor removes this parameter; leave it out"
                    )));
                }
            };
            let value = in_kind(&parameter.domain, &value);
            let fits = parameter.domain.contains(&value);
            if fits { Ok((name, value)) } else { Err(SpaceError::of_value(parameter, &value)) }
        });
        let mut fixed = fixed.collect::<Result<RawConfiguration, _>>()?;
        let changes = self.changes_from(1, from);
        for Parameter { name, domain, default, .. } in to.parameters() {
            if from.parameter(name).is_none()
                && !fixed.contains_key(name)
                && let Some((_, kept)) = changes.removed.get(name.as_str())
            {
                let kept = in_kind(domain, kept);
                if kept != *default && domain.contains(&kept) {
                    fixed.insert(name.clone(), kept);
                }
            }
        }
        let mut changed = self.clone();
        changed.0.push(EarlierSpace { space: from.clone(), last_trial, fixed });
        Ok(changed)
    }

    /// A configuration of a revision in the present space: `None` where it is outside.
    ///
    /// A parameter without a value has the one that all trials had before it was added. A value of a
    /// parameter that was removed must be the one that all trials have since then, be it named or that of all
    /// trials before the parameter was added. Where a parameter of another kind has got the name since, it is
    /// another parameter.
    pub fn adopt(
        &self,
        revision: u32,
        mut values: RawConfiguration,
        present: &Space,
    ) -> Option<Configuration> {
        let changes = self.changes_from(revision, present);
        if !self.had_what_is_gone(revision, &values, present, &changes) {
            return None;
        }
        let mut adopted = RawConfiguration::new();
        for parameter in present.parameters() {
            let name = &parameter.name;
            let is_its = |value: &Value| is_of_kind(parameter, value) || !changes.is_kept(name, value);
            let value = values.remove(name).filter(is_its);
            match (parameter.is_active(&adopted), value) {
                (true, value) => {
                    let value = value.as_ref().unwrap_or_else(|| changes.before(parameter));
                    adopted.insert(parameter.name.clone(), in_kind(&parameter.domain, value));
                }
                // It has no effect any more; what it had must be what is usual.
                (false, Some(value)) if in_kind(&parameter.domain, &value) != parameter.default => {
                    return None;
                }
                (false, _) => {}
            }
        }
        if !values.iter().all(|(name, value)| changes.is_kept(name, value)) {
            return None;
        }
        present.configuration(adopted).ok()
    }

    /// A configuration of the present space in the space of an earlier revision: the one that
    /// [`adopt`](Self::adopt) takes back to it. `None` where there is no such.
    pub fn express(
        &self,
        revision: u32,
        configuration: &Configuration,
        present: &Space,
    ) -> Option<Configuration> {
        let (expressed, adopted) = self.like(revision, configuration, present)?;
        (adopted == *configuration).then_some(expressed)
    }

    /// The configuration of the present space that has the values of another one as far as an earlier
    /// revision has them, and can be [expressed](Self::express) in it. `None` where there is no such.
    pub fn nearest(
        &self,
        revision: u32,
        configuration: &Configuration,
        present: &Space,
    ) -> Option<Configuration> {
        self.like(revision, configuration, present).map(|(_, adopted)| adopted)
    }

    /// The configuration of an earlier revision that is most like one of the present space, and that one in
    /// the present space.
    fn like(
        &self,
        revision: u32,
        configuration: &Configuration,
        present: &Space,
    ) -> Option<(Configuration, Configuration)> {
        let (space, changes) = (self.space(revision)?, self.changes_from(revision, present));
        let mut values = RawConfiguration::new();
        for parameter in space.parameters() {
            if parameter.is_active(&values) {
                let default = present.parameter(&parameter.name).map(|here| &here.default);
                let value = configuration.get(&parameter.name).or(default);
                let value = value.filter(|value| is_of_kind(parameter, value));
                let kept = || changes.removed.get(parameter.name.as_str()).map(|(_, kept)| *kept);
                let value = value.or_else(kept).unwrap_or(&parameter.default);
                let value = in_kind(&parameter.domain, value);
                let is_there = parameter.domain.contains(&value);
                values
                    .insert(parameter.name.clone(), if is_there { value } else { parameter.default.clone() });
            }
        }
        let expressed = space.configuration(values).ok()?;
        let adopted = self.adopt(revision, expressed.to_raw(), present)?;
        Some((expressed, adopted))
    }

    /// Whether a configuration of a revision had what all have since then of each parameter that came after
    /// it and is gone again.
    fn had_what_is_gone<'a>(
        &'a self,
        revision: u32,
        values: &RawConfiguration,
        present: &'a Space,
        changes: &Changes<'a>,
    ) -> bool {
        let Some(own) = self.space(revision) else { return true };
        let (own, present_ones) = (by_name(own), by_name(present));
        let stays = |name: &str| own.contains_key(name) || present_ones.contains_key(name);
        if changes.removed.keys().all(|&name| stays(name)) {
            return true;
        }
        self.changes(revision, present).skip(1).all(|(then, ..)| {
            let mut held = RawConfiguration::new();
            then.parameters().iter().all(|parameter| {
                let name = parameter.name.as_str();
                let unnamed = present_ones.get(name).copied();
                let unnamed = unnamed.or((!own.contains_key(name)).then_some(parameter));
                let before = || unnamed.map(|unnamed| changes.before(unnamed));
                let value = values.get(name).or_else(before).filter(|_| parameter.is_active(&held));
                let Some(value) = value else { return true };
                let is_kept = stays(name) || changes.is_kept(name, value);
                held.insert(name.to_owned(), in_kind(&parameter.domain, value));
                is_kept
            })
        })
    }

    /// The changes from a revision on, each as the space before, the space after, and its fixed values.
    fn changes<'a>(
        &'a self,
        revision: u32,
        present: &'a Space,
    ) -> impl Iterator<Item = (&'a Space, &'a Space, &'a RawConfiguration)> {
        let from = (revision.max(1) as usize - 1).min(self.0.len());
        (from..self.0.len()).map(move |place| {
            let EarlierSpace { space, fixed, .. } = &self.0[place];
            (space, self.0.get(place + 1).map_or(present, |next| &next.space), fixed)
        })
    }

    /// The parameters that the changes from a revision on added and removed.
    fn changes_from<'a>(&'a self, revision: u32, present: &'a Space) -> Changes<'a> {
        let mut changes = Changes::default();
        for (before, after, fixed) in self.changes(revision, present) {
            let (earlier, later) = (by_name(before), by_name(after));
            for (&name, &added) in later.iter().filter(|(name, _)| !earlier.contains_key(**name)) {
                changes.added.entry(name).or_insert(fixed.get(name).unwrap_or(&added.default));
            }
            for (&name, &removed) in earlier.iter().filter(|(name, _)| !later.contains_key(**name)) {
                changes.removed.insert(name, (removed, fixed.get(name).unwrap_or(&removed.default)));
            }
        }
        changes
    }
}

/// The parameters that the changes from a revision on added and removed, by name.
#[derive(Default)]
struct Changes<'a> {
    /// The value of an added parameter in all trials before the first change that added it.
    added: BTreeMap<&'a str, &'a Value>,
    /// A parameter as the last change that removed it found it, and its value since then.
    removed: BTreeMap<&'a str, (&'a Parameter, &'a Value)>,
}

impl<'a> Changes<'a> {
    /// The value of a parameter that configurations of the revision have without naming it.
    fn before(&self, parameter: &'a Parameter) -> &'a Value {
        self.added.get(parameter.name.as_str()).copied().unwrap_or(&parameter.default)
    }

    /// Whether a value of a parameter is the one that all have since the parameter was removed.
    fn is_kept(&self, name: &str, value: &Value) -> bool {
        let removed = self.removed.get(name);
        removed.is_some_and(|(removed, kept)| in_kind(&removed.domain, value) == **kept)
    }
}

fn by_name(space: &Space) -> BTreeMap<&str, &Parameter> {
    space.parameters().iter().map(|parameter| (parameter.name.as_str(), parameter)).collect()
}

/// A value in the kind of a domain, in which a whole number may be either.
fn in_kind(domain: &Domain, value: &Value) -> Value {
    let are_integers = match domain {
        Domain::Integer { .. } => true,
        Domain::Categorical { values } => matches!(values.first(), Some(Value::Integer(_))),
        Domain::Float { .. } | Domain::Boolean => false,
    };
    match value {
        Value::Float(float)
            if are_integers && float.fract() == 0.0 && float.abs() <= INTEGER_MAGNITUDE_MAX as f64 =>
        {
            Value::Integer(*float as i64)
        }
        value => domain.as_of(value).canonical(),
    }
}

/// Whether a value is of the kind of a parameter's values.
fn is_of_kind(parameter: &Parameter, value: &Value) -> bool {
    discriminant(&in_kind(&parameter.domain, value)) == discriminant(&parameter.default)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::assignment::Assignment;
    use crate::limits::PARAMETERS_MAX;
    use crate::space::{Constraint, Scale};
    use crate::testing::{cases, spaces};

    fn raw(values: &[(&str, i64)]) -> RawConfiguration {
        values.iter().map(|(name, value)| ((*name).to_owned(), Value::Integer(*value))).collect()
    }

    fn space(parameters: &[(&str, i64, i64)]) -> Space {
        let parameter = |(name, max, default): &(&str, i64, i64)| {
            Parameter::new(*name, Domain::Integer { min: 0, max: *max, scale: Scale::Linear }, *default)
        };
        Space::new(parameters.iter().map(parameter).collect(), Vec::new()).expect("a space")
    }

    /// The earlier spaces after all changes, and the present one.
    fn history<'a>(changes: &[(&'a Space, RawConfiguration)]) -> (EarlierSpaces, &'a Space) {
        let (mut earlier, mut present) = (EarlierSpaces::default(), changes[0].0);
        for (to, fixed) in &changes[1..] {
            earlier = earlier.changed(present, to, 9, fixed.clone()).expect("a change");
            present = to;
        }
        (earlier, present)
    }

    /// The values of a trial of the first revision by now; `None` where it is outside.
    fn adopted(changes: &[(&Space, RawConfiguration)], values: RawConfiguration) -> Option<String> {
        let (earlier, present) = history(changes);
        let adopted = earlier.adopt(1, values, present)?;
        assert!(present.owns(&adopted));
        Some(Assignment::from(adopted).to_string())
    }

    #[test]
    fn trials_have_the_default_of_what_was_added_then() {
        let none = RawConfiguration::new;
        let (one, two) = (space(&[("a", 9, 3)]), space(&[("a", 9, 3), ("b", 5, 2)]));
        let other_default = space(&[("a", 9, 3), ("b", 5, 4)]);
        let first = [(&one, none()), (&two, none())];
        assert_eq!(adopted(&first, raw(&[("a", 7)])).as_deref(), Some("a=7 b=2"));
        let later = [(&one, none()), (&two, none()), (&other_default, none())];
        assert_eq!(adopted(&later, raw(&[("a", 7)])).as_deref(), Some("a=7 b=2"), "not what is default now");
        let given = [(&one, none()), (&two, raw(&[("b", 1)])), (&other_default, none())];
        assert_eq!(adopted(&given, raw(&[("a", 7)])).as_deref(), Some("a=7 b=1"));
    }

    #[test]
    fn what_was_removed_must_have_had_its_fixed_value_and_comes_back_with_the_parameter() {
        let none = RawConfiguration::new;
        let (two, one) = (space(&[("a", 9, 3), ("b", 5, 2)]), space(&[("a", 9, 3)]));
        let removed = [(&two, none()), (&one, none())];
        assert_eq!(adopted(&removed, raw(&[("a", 7), ("b", 2)])).as_deref(), Some("a=7"));
        assert_eq!(adopted(&removed, raw(&[("a", 7), ("b", 5)])), None);
        let fixed = [(&two, none()), (&one, raw(&[("b", 5)]))];
        assert_eq!(adopted(&fixed, raw(&[("a", 7), ("b", 5)])).as_deref(), Some("a=7"));
        let undone = [(&two, none()), (&one, none()), (&two, none())];
        assert_eq!(adopted(&undone, raw(&[("a", 7), ("b", 5)])).as_deref(), Some("a=7 b=5"));
        let (narrow, wide) = (space(&[("a", 4, 3)]), space(&[("a", 9, 3)]));
        assert_eq!(adopted(&[(&wide, none()), (&narrow, none())], raw(&[("a", 7)])), None);
        let undone = [(&wide, none()), (&narrow, none()), (&wide, none())];
        assert_eq!(adopted(&undone, raw(&[("a", 7)])).as_deref(), Some("a=7"));
    }

    #[test]
    fn what_came_and_went_must_have_had_its_fixed_value_too() {
        let none = RawConfiguration::new;
        let (one, two) = (space(&[("a", 9, 3)]), space(&[("a", 9, 3), ("b", 9, 1)]));
        // All trials of `one` ran with `b=1`, and those of the last revision run with `b=8`.
        let went = [(&one, none()), (&two, none()), (&one, raw(&[("b", 8)]))];
        assert_eq!(adopted(&went, raw(&[("a", 7)])), None);
        let given = [(&one, none()), (&two, raw(&[("b", 8)])), (&one, raw(&[("b", 8)]))];
        assert_eq!(adopted(&given, raw(&[("a", 7)])).as_deref(), Some("a=7"));
        // Where `b` has no effect, it matters to nobody.
        let mut parameters = two.parameters().to_vec();
        let any_of = vec![Value::Integer(5)];
        parameters[1].active_if = Some(crate::space::Condition { parameter: "a".into(), any_of });
        let gated = Space::new(parameters, Vec::new()).expect("a space");
        let went = [(&one, none()), (&gated, none()), (&one, raw(&[("b", 8)]))];
        assert_eq!(adopted(&went, raw(&[("a", 7)])).as_deref(), Some("a=7"));
        assert_eq!(adopted(&went, raw(&[("a", 5)])), None);
        // What comes again had what it kept meanwhile, and before it came first what it had then.
        let (earlier, present) = history(&[(&two, none()), (&one, raw(&[("b", 8)])), (&two, none())]);
        let between = earlier.adopt(2, raw(&[("a", 7)]), present).expect("inside");
        assert_eq!(between.to_raw(), raw(&[("a", 7), ("b", 8)]));
        let twice = [(&one, none()), (&two, none()), (&one, raw(&[("b", 8)])), (&two, none())];
        assert_eq!(adopted(&twice, raw(&[("a", 7)])).as_deref(), Some("a=7 b=1"));
    }

    /// As many changes as there may be, each of all parameters but one.
    #[test]
    fn trials_are_read_through_the_longest_history() {
        let parameter = |name: String| Parameter::new(name, Domain::Boolean, false);
        let space = |revision: usize| {
            let names = (1..PARAMETERS_MAX).map(|place| format!("of_{revision}_{place}"));
            let parameters = ["a".to_owned()].into_iter().chain(names).map(parameter).collect();
            Space::new(parameters, Vec::new()).expect("a space")
        };
        let (mut earlier, mut present) = (EarlierSpaces::default(), space(1));
        for revision in 2..=SPACE_REVISIONS_MAX {
            let to = space(revision);
            earlier = earlier.changed(&present, &to, 9, RawConfiguration::new()).expect("a change");
            present = to;
        }
        let mut values = RawConfiguration::from([("a".to_owned(), Value::Boolean(true))]);
        let adopted = earlier.adopt(1, values.clone(), &present).expect("all else is as it was");
        assert_eq!(adopted.get("a"), Some(&Value::Boolean(true)));
        values.insert("of_1_5".to_owned(), Value::Boolean(true));
        assert_eq!(earlier.adopt(1, values, &present), None, "it had another value");
    }

    #[test]
    fn a_name_may_go_to_a_parameter_of_another_kind() {
        let none = RawConfiguration::new;
        let (whole, other) = (space(&[("a", 9, 3), ("b", 9, 2)]), space(&[("b", 9, 2)]));
        let boolean = Space::builder().integer("b", 0..=9).default(2).boolean("a").default(true);
        let boolean = boolean.build().expect("a space");
        let changes = [(&whole, none()), (&other, none()), (&boolean, none())];
        assert_eq!(adopted(&changes, raw(&[("a", 3), ("b", 1)])).as_deref(), Some("a=true b=1"));
        assert_eq!(adopted(&changes, raw(&[("a", 4), ("b", 1)])), None, "it was outside meanwhile");
        assert_eq!(adopted(&[(&whole, none()), (&boolean, none())], raw(&[("a", 3), ("b", 1)])), None);
        let (earlier, present) = history(&changes);
        let expressed = earlier.express(1, &present.default_configuration(), present);
        let expressed = expressed.expect("it has what `a` kept");
        assert_eq!(expressed.to_raw(), raw(&[("a", 3), ("b", 2)]));
        // A whole number that became real keeps its value when it goes.
        let real = Space::builder().integer("b", 0..=9).default(2).float("a", 0.0..=9.0).default(3.0);
        let real = real.build().expect("a space");
        let changes = [(&whole, none()), (&real, none()), (&other, none())];
        assert_eq!(adopted(&changes, raw(&[("a", 3), ("b", 1)])).as_deref(), Some("b=1"));
    }

    #[test]
    fn a_number_may_become_a_number_of_the_other_kind() {
        let whole = space(&[("a", 9, 3)]);
        let real = Space::builder().float("a", 0.0..=9.5).default(2.5).build().expect("a space");
        let (earlier, _) = history(&[(&whole, RawConfiguration::new()), (&real, RawConfiguration::new())]);
        let four = earlier.adopt(1, raw(&[("a", 4)]), &real).expect("inside");
        assert_eq!(Assignment::from(four.clone()).to_string(), "a=4.0");
        assert_eq!(earlier.express(1, &four, &real).map(|four| four.to_raw()), Some(raw(&[("a", 4)])));
        assert_eq!(earlier.express(1, &real.default_configuration(), &real), None, "2.5 is not whole");
    }

    #[test]
    fn the_nearest_has_what_both_spaces_have() {
        let (one, wide) = (space(&[("a", 9, 3)]), space(&[("a", 20, 3), ("b", 9, 1)]));
        let (earlier, _) = history(&[(&one, RawConfiguration::new()), (&wide, RawConfiguration::new())]);
        let nearest = |a, b| {
            let here = wide.configuration(raw(&[("a", a), ("b", b)])).expect("valid");
            earlier.nearest(1, &here, &wide).map(|nearest| nearest.to_raw())
        };
        assert_eq!(nearest(7, 1), Some(raw(&[("a", 7), ("b", 1)])), "itself");
        assert_eq!(nearest(7, 5), Some(raw(&[("a", 7), ("b", 1)])), "all before had `b=1`");
        assert_eq!(nearest(15, 5), Some(raw(&[("a", 3), ("b", 1)])), "the default where 15 is none");
    }

    #[test]
    fn constraints_of_the_present_space_decide_and_words_name_the_mistake() {
        let free = space(&[("a", 9, 3), ("b", 5, 4)]);
        let order = vec![Constraint::order("a", "b")];
        let ordered = Space::new(free.parameters().to_vec(), order).expect("a space");
        let change = [(&free, RawConfiguration::new()), (&ordered, RawConfiguration::new())];
        assert!(adopted(&change, raw(&[("a", 2), ("b", 2)])).is_some());
        assert!(adopted(&change, raw(&[("a", 3), ("b", 2)])).is_none());
        let change = |fixed| EarlierSpaces::default().changed(&free, &space(&[("a", 9, 3)]), 0, fixed);
        let refused = |fixed| change(fixed).expect_err("refused").to_string();
        assert!(refused(raw(&[("a", 1)])).contains("neither adds nor removes"));
        assert!(refused(raw(&[("b", 6)])).contains("a whole number from 0 to 5"));
        assert!(change(raw(&[("b", 5)])).is_ok());
    }

    #[test]
    fn revisions_follow_from_the_numbers_of_trials_and_are_limited() {
        let (one, two) = (space(&[("a", 9, 3)]), space(&[("a", 8, 3)]));
        let mut earlier = EarlierSpaces::default();
        for last_trial in [4, 4, 7] {
            let (from, to) = if earlier.revision() % 2 == 1 { (&one, &two) } else { (&two, &one) };
            earlier = earlier.changed(from, to, last_trial, RawConfiguration::new()).expect("a change");
        }
        let revisions = [1, 4, 5, 7, 8].map(|trial| earlier.revision_of(trial));
        assert_eq!((revisions, earlier.revision()), ([1, 1, 3, 3, 4], 4));
        assert_eq!((earlier.find(&two, &two), earlier.find(&one, &two)), (Some(4), Some(3)));
        while (earlier.revision() as usize) < SPACE_REVISIONS_MAX {
            earlier = earlier.changed(&one, &two, 9, RawConfiguration::new()).expect("a change");
        }
        let full = earlier.changed(&one, &two, 9, RawConfiguration::new()).expect_err("full").to_string();
        assert!(full.contains("33 revisions"), "{full}");
    }

    /// Values of a space at a point that is drawn.
    fn at(space: &Space, point: &[f64]) -> Configuration {
        space.decode(&point.iter().copied().cycle().take(space.dimension()).collect::<Vec<_>>())
    }

    proptest! {
        #![proptest_config(cases(256))]

        #[test]
        fn every_configuration_is_adopted_or_outside_and_what_is_expressed_comes_back(
            spaces in prop::collection::vec(spaces(), 3),
            keeps in 0usize..9,
            point in prop::collection::vec(0.0f64..1.0, 8),
        ) {
            let mut spaces = spaces;
            // Often the later spaces are the first with parameters at its end left out.
            let all = spaces[0].parameters();
            let fewer = Space::new(all[..keeps.clamp(1, all.len())].to_vec(), Vec::new()).expect("a space");
            if keeps % 2 == 0 {
                spaces[2] = fewer.clone();
            }
            if keeps % 3 == 0 {
                spaces[1] = fewer;
            }
            let mut earlier = EarlierSpaces::default();
            for pair in spaces.windows(2) {
                earlier = earlier.changed(&pair[0], &pair[1], 1, RawConfiguration::new()).expect("a change");
            }
            let present = &spaces[2];
            for (revision, space) in (1..).zip(&spaces) {
                let own = at(space, &point);
                if let Some(adopted) = earlier.adopt(revision, own.to_raw(), present) {
                    prop_assert!(present.owns(&adopted));
                    // A row that is written again has the values of the present space.
                    prop_assert_eq!(earlier.adopt(revision, adopted.to_raw(), present), Some(adopted));
                }
                let here = at(present, &point);
                if let Some(nearest) = earlier.nearest(revision, &here, present) {
                    let expressed = earlier.express(revision, &nearest, present);
                    prop_assert!(expressed.is_some_and(|expressed| space.owns(&expressed)));
                }
                if let Some(expressed) = earlier.express(revision, &here, present) {
                    prop_assert!(space.owns(&expressed));
                    prop_assert_eq!(earlier.adopt(revision, expressed.to_raw(), present), Some(here));
                }
            }
        }

        #[test]
        fn what_does_not_change_stays(space in spaces(), point in prop::collection::vec(0.0f64..1.0, 8)) {
            let none = RawConfiguration::new();
            let earlier = EarlierSpaces::default().changed(&space, &space, 1, none).expect("a change");
            let own = at(&space, &point);
            prop_assert_eq!(earlier.adopt(1, own.to_raw(), &space), Some(own.clone()));
            prop_assert_eq!(earlier.express(1, &own, &space), Some(own));
        }
    }
}
