//! Values of some parameters, which a walk over all of them sets one after the other.

use crate::space::Space;
use crate::space::constraint::Extent;
use crate::value::Value;

/// Values of some parameters, set one after the other.
pub(super) struct Partial<'a> {
    pub(super) space: &'a Space,
    /// Values that are not set yet are arbitrary.
    pub(super) values: Vec<Value>,
    active: Vec<bool>,
    is_set: Vec<bool>,
    /// The number of values that may still be set.
    pub(super) steps: usize,
}

impl<'a> Partial<'a> {
    pub(super) fn new(space: &'a Space, steps: usize) -> Self {
        let count = space.dimension();
        let values = space.defaults().cloned().collect();
        Partial { space, values, active: vec![true; count], is_set: vec![false; count], steps }
    }

    /// Whether a parameter is active, as far as those that decide it are set.
    pub(super) fn is_active(&self, index: usize) -> bool {
        self.space.is_active(index, &self.values, &self.active)
    }

    /// Sets a value. `false` where its constraints cannot hold for any values of the others.
    pub(super) fn set(&mut self, index: usize, value: &Value, is_active: bool) -> bool {
        self.steps = self.steps.saturating_sub(1);
        self.values[index].clone_from(value);
        (self.active[index], self.is_set[index]) = (is_active, true);
        let naming = self.space.rules.iter().filter(|rule| rule.mentions.contains(&index));
        naming.filter(|rule| self.counts(&rule.mentions)).all(|rule| {
            rule.root.may_hold(&|other| match self.is_set[other] {
                true => Extent::of_value(&self.values[other]),
                false => self.space.ranges[other],
            })
        })
    }

    pub(super) fn unset(&mut self, index: usize) {
        (self.active[index], self.is_set[index]) = (true, false);
    }

    /// Whether all of these parameters are known to be active.
    fn counts(&self, mentions: &[usize]) -> bool {
        let is_known = |&index: &usize| match self.is_set[index] {
            true => self.active[index],
            false => self.space.condition_of[index].is_none(),
        };
        mentions.iter().all(is_known)
    }
}
