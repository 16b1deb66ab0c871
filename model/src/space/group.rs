//! Parameters that constraints tie together.
//!
//! Constraints that share a parameter hang together, and so do a parameter and the one that decides whether it
//! is active. Groups that share nothing are repaired each for itself, which makes the work a sum instead of a
//! product, and parameters that no constraint names stay where they are.

use std::collections::BTreeSet;
use std::sync::OnceLock;

use crate::limits::{LISTED_MAX, LISTING_STEPS_MAX};
use crate::space::Space;
use crate::space::constraint::Range;
use crate::space::listing::Listing;
use crate::value::Value;

/// Parameters that hang together.
#[derive(Debug)]
pub(super) struct Group {
    /// Indices of the parameters, rising.
    pub(super) members: Vec<usize>,
    /// Indices of the constraints.
    rules: Vec<usize>,
    /// All ways to fulfil them, where they are few. Made when it is first asked for.
    listing: OnceLock<Option<Listing>>,
}

/// Values of some parameters, set one after the other.
pub(super) struct Partial<'a> {
    pub(super) space: &'a Space,
    /// Those that are not set yet have any value.
    pub(super) values: Vec<Value>,
    active: Vec<bool>,
    is_set: Vec<bool>,
    /// How many more values may be set.
    pub(super) steps: usize,
}

impl Space {
    /// The groups of parameters; none where all constraints are orders, which are repaired otherwise.
    pub(super) fn grouped(&self) -> Vec<Group> {
        if self.rules.iter().all(|rule| rule.order.is_some()) {
            return Vec::new();
        }
        let mut groups: Vec<(BTreeSet<usize>, Vec<usize>)> = Vec::new();
        for (index, rule) in self.rules.iter().enumerate() {
            let mut members = BTreeSet::new();
            for &mentioned in &rule.mentions {
                let needed = std::iter::successors(Some(mentioned), |&member| self.condition_of[member]);
                members.extend(needed);
            }
            let mut rules = vec![index];
            let (tied, apart) = groups.into_iter().partition(|(other, _)| !other.is_disjoint(&members));
            groups = apart;
            for (other, of) in tied {
                members.extend(other);
                rules.extend(of);
            }
            groups.push((members, rules));
        }
        let group = |(members, rules): (BTreeSet<usize>, _)| Group {
            members: members.into_iter().collect(),
            rules,
            listing: OnceLock::new(),
        };
        groups.into_iter().map(group).collect()
    }
}

impl Group {
    /// All ways to fulfil its constraints, where they are few.
    pub(super) fn listing(&self, space: &Space) -> Option<&Listing> {
        let listing = || Listing::of(space, &self.members, LISTED_MAX, LISTING_STEPS_MAX);
        self.listing.get_or_init(listing).as_ref()
    }

    /// Whether values of all parameters break one of its constraints.
    pub(super) fn is_broken(&self, space: &Space, values: &[Value], active: &[bool]) -> bool {
        self.rules
            .iter()
            .map(|&rule| &space.rules[rule])
            .any(|rule| rule.mentions.iter().all(|&index| active[index]) && !rule.is_fulfilled(values))
    }
}

impl<'a> Partial<'a> {
    /// Nothing is set yet.
    pub(super) fn new(space: &'a Space, steps: usize) -> Self {
        let count = space.dimension();
        let values = space.defaults().cloned().collect();
        Partial { space, values, active: vec![true; count], is_set: vec![false; count], steps }
    }

    /// Whether a parameter is active, as far as those that decide it are set.
    pub(super) fn is_active(&self, index: usize) -> bool {
        self.space.is_active(index, &self.values, &self.active)
    }

    /// Sets a value. `false` where no values of the others make the constraints hold that name it.
    pub(super) fn set(&mut self, index: usize, value: &Value, is_active: bool) -> bool {
        self.steps = self.steps.saturating_sub(1);
        self.values[index].clone_from(value);
        (self.active[index], self.is_set[index]) = (is_active, true);
        let naming = self.space.rules.iter().filter(|rule| rule.mentions.contains(&index));
        naming.filter(|rule| self.counts(&rule.mentions)).all(|rule| {
            rule.root.may_hold(&|other| match self.is_set[other] {
                true => Range::of_value(&self.values[other]),
                false => self.space.ranges[other],
            })
        })
    }

    /// Takes a value back.
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
