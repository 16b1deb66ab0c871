//! Groups of parameters that constraints connect.
//!
//! Constraints that share a parameter are connected, and so are a parameter and the one that decides whether
//! it is active. Each group is repaired separately, which makes the work a sum instead of a product.
//! Parameters without a constraint are not moved.

use std::collections::BTreeSet;
use std::sync::OnceLock;

use crate::limits::{LISTED_MAX, LISTING_STEPS_MAX};
use crate::space::Space;
use crate::space::listing::Listing;
use crate::value::Value;

/// Connected parameters.
#[derive(Debug)]
pub(super) struct Group {
    /// Indices of the parameters, rising.
    pub(super) members: Vec<usize>,
    /// Indices of the constraints.
    rules: Vec<usize>,
    /// All solutions of the constraints, where they are few. Made at its first use.
    listing: OnceLock<Option<Listing>>,
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
    /// All solutions of its constraints, where they are few.
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
