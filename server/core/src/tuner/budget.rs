//! The account of one client in one session: the rest of its budget for exploring.
//!
//! A policy with a `regret_budget` of b promises that at every moment of a session
//!
//! > cost of exploring above the reference <= b x the cost of all frames that did not explore.
//!
//! The reference is the configuration that would run without exploring: the cheaper one of the study's
//! default and the best that was measured in the state. This client measures both in this stay, the default
//! once before it explores, because older measurements of a state may no longer hold. Reserving for the worst
//! case before each exploratory action is the idea of conservative bandits (Wu, Shariff, Lattimore and
//! Szepesvári, "Conservative bandits", ICML 2016). Here a cap bounds the costs of trials, and no distribution
//! of them is assumed.
//!
//! - A trial is handed out only if the budget left covers its whole cap, as if the reference cost nothing. A
//!   client that cannot stop in time is assumed to cost `worst_factor` times the reference.
//! - A run of an incumbent that does clearly worse than the best measured configuration counts as exploring,
//!   though it is never stopped. It is charged `worst_factor` times the reference at most: one that stalls
//!   keeps the client from exploring for no more than `worst_factor / regret_budget` frames of the reference.
//!   Runs of other incumbents are frames that did not explore.
//! - A reported trial is charged its whole cost until the next frame of the reference in that state. Then the
//!   charge falls to its cost above [`GUARD`] times the cheapest of the last few frames of the reference,
//!   before or after. So neither noise nor a change of the machine's speed hides regret.
//! - One frame that was read wrongly decides for few others. A frame that did not explore counts as ten usual
//!   ones at most. One far below the others is no reference, and where two contradict, a third is measured.
//! - One trial that was read wrongly costs no more than its reserve: of the dearest overstep of a session as
//!   much is charged as another trial has overstepped its own reserve by. So a client that keeps to its caps
//!   is charged in full, and one that does not from its second overstep on.
//! - A trial that is handed out again because its report never came may have been run each time. The reserved
//!   cost is charged and reserved once more. If too little is left, the client gets another answer.
//! - A trial that comes back without a cost, or never, stays charged with its worst case. Trials that did
//!   better than the reference earn nothing.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::limits::{CHARGES_MAX, OPEN_TRIALS_PER_CLIENT_MAX, REFERENCES_MAX};
use crate::policy::{ABORT_ABOVE_DEFAULT, Policy};
use crate::robust::{TORN, is_torn, lower_median};
use crate::session::SessionPolicy;
use crate::sum::Sum;

/// The share of the cheapest reference that counts, because frames vary by some percent.
pub const GUARD: f64 = 0.9;

/// Most exploring trials of a stay beside a single frame of the reference, which may have been read wrongly.
const BESIDE_ONE_MAX: usize = 4;

/// The limit of sums, so that many large costs do not make them infinite.
const SUM_MAX: f64 = 1e300;

/// Adds a cost to a sum that stays finite.
fn add(sum: &mut Sum, cost: f64) {
    sum.add(cost);
    if !sum.value().is_finite() || sum.value() > SUM_MAX {
        *sum = Sum::from(SUM_MAX);
    }
    assert!(sum.value() <= SUM_MAX, "a sum of {}", sum.value());
}

/// Whether a frame costs so much less than another that one of them was read wrongly.
fn is_far_below(cost: f64, other: f64) -> bool {
    cost < other && is_torn(cost, other)
}

/// An exploring trial that was reported and is not settled.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Charge {
    cost: f64,
    /// The cheapest reference before it.
    before: f64,
}

/// The costs beyond their reserves of the two trials of a session that went furthest. The dearest one is
/// charged as much of it as the second.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Oversteps {
    dearest: f64,
    second: f64,
}

impl Oversteps {
    fn is_none(&self) -> bool {
        *self == Oversteps::default()
    }

    /// Notes a trial's cost beyond its reserve. Returns the part of it that another trial bears out, and the
    /// part of the dearest one before that this one bears out.
    fn note(&mut self, beyond: f64) -> (f64, f64) {
        assert!(beyond > 0.0, "{beyond} is no overstep");
        let charged = beyond.min(self.dearest);
        let borne_out = (charged - self.second).max(0.0);
        *self = Oversteps { dearest: self.dearest.max(beyond), second: self.second.max(charged) };
        (charged, borne_out)
    }
}

/// One client's account. Opaque to the store, exact through serde.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Account {
    session: u64,
    /// The session's own policy.
    #[serde(default, skip_serializing_if = "SessionPolicy::is_empty")]
    pub(super) policy: SessionPolicy,
    /// Trials from this number on are of this session.
    first_trial: u64,
    /// The number of trials handed out in this session.
    handed_out: u64,
    /// Cost of all frames that did not explore.
    kept: Sum,
    /// Settled costs of exploring.
    charged: Sum,
    /// Reserved costs of exploring trials that are out, by trial.
    out: BTreeMap<u64, f64>,
    /// Trials that are charged in full until the next frame of the reference.
    unsettled: Vec<Charge>,
    /// The costs of the trials that went furthest beyond their reserves.
    #[serde(default, skip_serializing_if = "Oversteps::is_none")]
    oversteps: Oversteps,
    /// The state the client is in, and the last frames there that did not explore.
    state_id: u64,
    references: Vec<f64>,
    /// The median of such frames in the state before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    usual: Option<f64>,
    /// The cheapest frame of the default in this stay that cost anything.
    default: Option<f64>,
}

/// The terms on which a trial may be handed out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Leave {
    /// The budget left before the trial.
    pub(super) left: f64,
    /// The most that the trial can cost above the reference.
    pub(super) set_aside: f64,
    /// The cost at which the trial is stopped.
    pub(super) abort_above: f64,
    /// The reference's cost.
    pub(super) reference: f64,
}

/// Why no trial may be handed out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Denied {
    /// The reference has not been measured in this stay, or its frames contradict each other.
    NoReference,
    /// Too little of the budget is left.
    TooLittle(Leave),
}

/// The three terms of the policy that an account keeps. Exploring may cost one share of the frames' cost.
/// Trials are stopped at one factor of the reference's cost. A trial that cannot be stopped is assumed to
/// cost another factor at worst.
#[derive(Clone, Copy, Debug)]
pub(super) struct Terms {
    pub(super) budget: f64,
    pub(super) abort_above: f64,
    pub(super) worst_factor: f64,
}

impl Terms {
    /// The terms of a policy, if it keeps a budget.
    pub(super) fn of(policy: &Policy) -> Option<Self> {
        let abort_above = policy.abort_above.unwrap_or(ABORT_ABOVE_DEFAULT);
        policy.regret_budget.map(|budget| Terms { budget, abort_above, worst_factor: policy.worst_factor })
    }

    /// The cost that is assumed of a trial that nobody stops.
    pub(super) fn worst(self, reference: f64) -> f64 {
        (self.worst_factor * reference).min(SUM_MAX)
    }
}

impl Account {
    /// The account of a session, whose trials are those from `first_trial` on.
    pub(super) fn open(session: u64, first_trial: u64) -> Self {
        Account { session, first_trial, ..Account::default() }
    }

    /// Whether this is the account of a session.
    pub(super) fn is_of(&self, session: u64) -> bool {
        self.session == session
    }

    /// Notes the client's state, or 0 for none: it is then new when the client asks again. Unsettled trials
    /// of other states stay charged in full.
    pub(super) fn enter(&mut self, state_id: u64) {
        if self.state_id != state_id {
            self.state_id = state_id;
            self.usual = lower_median(&self.references).or(self.usual);
            self.references.clear();
            self.default = None;
            for charge in std::mem::take(&mut self.unsettled) {
                add(&mut self.charged, charge.cost);
            }
        }
    }

    /// Counts a trial that is handed out, and returns the number of those before it.
    pub(super) fn count(&mut self) -> u64 {
        self.handed_out += 1;
        self.handed_out - 1
    }

    /// Forgets a trial that was handed out and that its client never hears of.
    pub(super) fn forgo(&mut self, trial: u64) {
        self.handed_out = self.handed_out.saturating_sub(1);
        self.out.remove(&trial);
    }

    /// The rest of the budget, less all reserved costs. Negative where a client overstepped a cap.
    pub(super) fn left(&self, budget: f64) -> f64 {
        let unsettled: f64 = self.unsettled.iter().map(|charge| charge.cost).sum();
        let out: f64 = self.out.values().sum();
        budget * self.kept.value() - self.charged.value() - unsettled - out
    }

    /// The terms of another exploring trial, or the reason why none may be handed out. Where the default
    /// cannot be run in the state, the frames that did not explore are the only reference.
    pub(super) fn leave(&self, terms: Terms, can_abort: bool, default_runs: bool) -> Result<Leave, Denied> {
        let reference = self.reference(default_runs).ok_or(Denied::NoReference)?;
        let abort_above = (terms.abort_above * reference).min(SUM_MAX);
        let set_aside = if can_abort { abort_above } else { terms.worst(reference) };
        assert!(abort_above > 0.0 && set_aside > 0.0, "{set_aside} for a trial up to {abort_above}");
        let leave = Leave { left: self.left(terms.budget), set_aside, abort_above, reference };
        if leave.left >= set_aside { Ok(leave) } else { Err(Denied::TooLittle(leave)) }
    }

    /// The cost of the reference; `None` where the frames of this stay do not say it.
    fn reference(&self, default_runs: bool) -> Option<f64> {
        let is_doubtful = match self.references[..] {
            [_] => self.unsettled.len() >= BESIDE_ONE_MAX,
            [first, second] => is_torn(first, second),
            _ => false,
        };
        let kept = lower_median(&self.references).filter(|_| !is_doubtful)?;
        let default = self.default.or((!default_runs).then_some(kept))?;
        let reference = if is_far_below(default, kept) { kept } else { default.min(kept) };
        Some(reference).filter(|&reference| reference > 0.0)
    }

    /// The cheapest frame of the reference, but one that lies far below the others. Infinite without any.
    fn cheapest(&self) -> f64 {
        let kept = lower_median(&self.references).unwrap_or(0.0);
        let frames = self.references.iter().copied().chain(self.default);
        frames.filter(|&cost| !is_far_below(cost, kept)).fold(f64::INFINITY, f64::min)
    }

    /// Counts a frame that did not explore, as at most [`TORN`] usual ones: one that was read wrongly would
    /// pay for any exploring. The first of a session counts as soon as there is another.
    fn keep(&mut self, cost: f64) {
        if let [first] = self.references[..]
            && self.kept.value() == 0.0
        {
            add(&mut self.kept, first.min(TORN * cost));
        }
        let usual = lower_median(&self.references).or(self.usual);
        add(&mut self.kept, usual.map_or(0.0, |usual| cost.min(TORN * usual)));
    }

    /// Reserves the worst cost of a trial.
    pub(super) fn set_aside(&mut self, trial: u64, worst: f64) {
        assert!(worst >= 0.0, "{worst} is set aside");
        self.out.insert(trial, worst);
        // A trial that never comes back is charged its reserved cost.
        while self.out.len() > OPEN_TRIALS_PER_CLIENT_MAX {
            if let Some((_, lost)) = self.out.pop_first() {
                add(&mut self.charged, lost);
            }
        }
        assert!(self.out.len() <= OPEN_TRIALS_PER_CLIENT_MAX, "{} trials are out", self.out.len());
    }

    /// Whether a trial that is out may be handed out again: something is set aside for it, and as much is
    /// left.
    pub(super) fn covers_again(&self, trial: u64, budget: f64) -> bool {
        self.out.get(&trial).is_some_and(|&worst| self.left(budget) >= worst)
    }

    /// Hands a trial out again whose report never came. The client may have run it, so the reserved cost is
    /// charged and stays reserved as well.
    pub(super) fn again(&mut self, trial: u64) {
        if let Some(&worst) = self.out.get(&trial) {
            add(&mut self.charged, worst);
        }
    }

    /// The cost that a trial is charged: all of it up to its reserve, and of the rest what another trial
    /// bears out. What this one bears out of another is charged now.
    fn believed(&mut self, cost: f64, reserve: f64) -> f64 {
        let beyond = cost - reserve;
        if beyond <= 0.0 {
            return cost;
        }
        let (charged, borne_out) = self.oversteps.note(beyond);
        add(&mut self.charged, borne_out);
        reserve + charged
    }

    /// Takes a report. `cost` is the frame's cost, if it is known. Trials of other sessions are ignored.
    pub(super) fn report(&mut self, trial: u64, state_id: u64, cost: Option<f64>, is_default: bool) {
        if trial < self.first_trial {
            return;
        }
        if let Some(worst) = self.out.remove(&trial) {
            let before = self.cheapest();
            // A trial without a cost is charged its reserved cost.
            let charge = Charge { cost: cost.map_or(worst, |cost| self.believed(cost, worst)), before };
            if cost.is_none() || !before.is_finite() || self.state_id != state_id {
                add(&mut self.charged, charge.cost);
            } else {
                self.unsettled.push(charge);
                if self.unsettled.len() > CHARGES_MAX {
                    let oldest = self.unsettled.remove(0);
                    add(&mut self.charged, oldest.cost);
                }
            }
            return;
        }
        let Some(cost) = cost else { return };
        self.keep(cost);
        if self.state_id == state_id {
            let charges = std::mem::take(&mut self.unsettled).into_iter();
            // Beside a frame that was read far too low, all of a trial would be regret.
            let (waiting, settled): (Vec<_>, Vec<_>) =
                charges.partition(|charge| is_far_below(cost, charge.before));
            self.unsettled = waiting;
            for charge in settled {
                add(&mut self.charged, (charge.cost - GUARD * charge.before.min(cost)).max(0.0));
            }
            // Of nothing no trial may cost a multiple, and the least would stay.
            if is_default && cost > 0.0 {
                self.default = Some(self.default.map_or(cost, |least| least.min(cost)));
            }
            self.references.push(cost);
            if self.references.len() > REFERENCES_MAX {
                self.references.remove(0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TERMS: Terms = Terms { budget: 0.1, abort_above: 2.0, worst_factor: 50.0 };

    fn with_frames(count: u64) -> Account {
        let mut account = Account::open(7, 1);
        account.enter(1);
        (0..count).for_each(|number| account.report(number + 1, 1, Some(10.0), number == 0));
        account
    }

    #[test]
    fn nothing_is_explored_before_it_is_earned() {
        assert_eq!(with_frames(0).leave(TERMS, true, true), Err(Denied::NoReference));
        assert!(matches!(with_frames(19).leave(TERMS, true, true), Err(Denied::TooLittle(_))));
        let leave = with_frames(20).leave(TERMS, true, true).expect("twenty frames earn two");
        assert_eq!((leave.set_aside, leave.abort_above, leave.reference), (20.0, 20.0, 10.0));
        // A client that cannot stop must have earned the worst case.
        assert!(with_frames(499).leave(TERMS, false, true).is_err());
        assert_eq!(with_frames(500).leave(TERMS, false, true).expect("earned").set_aside, 500.0);
    }

    #[test]
    fn a_frame_that_was_read_as_nothing_does_not_end_exploring() {
        let mut account = Account::open(7, 1);
        account.enter(1);
        account.report(1, 1, Some(0.0), true);
        assert_eq!(account.leave(TERMS, true, true), Err(Denied::NoReference));
        (2..42).for_each(|number| account.report(number, 1, Some(10.0), true));
        assert_eq!(account.leave(TERMS, true, true).expect("forty frames earn four").reference, 10.0);
    }

    #[test]
    fn a_frame_that_was_read_wrongly_is_no_reference_and_pays_for_nothing() {
        for wild in [1e-300, 1e300] {
            let mut account = Account::open(7, 1);
            account.enter(1);
            account.report(1, 1, Some(wild), true);
            assert!(account.leave(TERMS, true, true).is_err(), "nothing is earned");
            account.report(2, 1, Some(10.0), true);
            assert_eq!(account.leave(TERMS, true, true), Err(Denied::NoReference), "one of two is wrong");
            (3..43).for_each(|number| account.report(number, 1, Some(10.0), true));
            assert_eq!(account.leave(TERMS, true, true).expect("forty frames earn four").reference, 10.0);
            assert!(account.left(0.1) <= 0.1 * (42.0 * 10.0 + TORN * 10.0), "{}", account.left(0.1));
        }
        // The first frame of another state is measured by those of the state before.
        let mut account = with_frames(40);
        account.enter(2);
        account.report(50, 2, Some(1e300), true);
        assert!((account.left(0.1) - (40.0 + 0.1 * TORN * 10.0)).abs() < 1e-9);
    }

    #[test]
    fn a_single_frame_of_the_reference_stands_beside_few_trials() {
        let mut account = with_frames(400);
        account.enter(2);
        account.report(500, 2, Some(1e-6), true);
        for trial in 600..600 + BESIDE_ONE_MAX as u64 {
            let leave = account.leave(TERMS, true, true).expect("four hundred frames earn as much");
            account.set_aside(trial, leave.set_aside);
            account.report(trial, 2, Some(leave.set_aside), false);
        }
        assert_eq!(account.leave(TERMS, true, true), Err(Denied::NoReference));
        (700..702).for_each(|number| account.report(number, 2, Some(10.0), true));
        assert_eq!(account.leave(TERMS, true, true).expect("two of three agree").reference, 10.0);
    }

    #[test]
    fn a_charge_is_not_settled_by_a_frame_that_was_read_far_too_low() {
        let mut account = with_frames(40);
        account.set_aside(100, 20.0);
        account.report(100, 1, Some(15.0), false);
        account.report(101, 1, Some(1e-6), false);
        assert!((account.left(0.1) - 25.0).abs() < 1e-6, "it stays charged in full");
        account.report(102, 1, Some(10.0), false);
        assert!((account.left(0.1) - 35.0).abs() < 1e-6);
    }

    #[test]
    fn one_absurd_trial_is_charged_its_reserve_and_a_second_bears_it_out() {
        let after = |costs: &[f64]| {
            let mut account = with_frames(400);
            for (trial, &cost) in (1000..).zip(costs) {
                account.set_aside(trial, 20.0);
                account.report(trial, 1, Some(cost), false);
            }
            account.left(0.1)
        };
        let close = |costs: &[f64], charged: f64| {
            let left = after(costs);
            assert!((left - (400.0 - charged)).abs() < 1e-9, "{left} after {costs:?}");
        };
        for wild in [1e15, f64::MAX] {
            close(&[wild], 20.0);
            close(&[wild, 15.0], 35.0);
            // A second one says how much of the first is believed.
            close(&[wild, 25.0], 50.0);
            close(&[25.0, wild], 50.0);
            close(&[wild, 25.0, 30.0], 85.0);
            close(&[30.0, wild, 25.0], 85.0);
            assert!(after(&[wild, wild]) < -1e14, "two are charged in full");
        }
        // Who oversteps again and again is charged all but what the dearest cost more than the second.
        close(&[22.0; 10], 220.0);
        close(&[22.0, 24.0, 23.0], 68.0);
    }

    #[test]
    fn a_charge_falls_to_the_regret_once_the_reference_is_seen_again() {
        let mut account = with_frames(40);
        account.set_aside(100, 20.0);
        assert_eq!(account.left(0.1), 20.0);
        account.report(100, 1, Some(15.0), false);
        assert_eq!(account.left(0.1), 25.0);
        account.report(101, 1, Some(10.0), false);
        // 41 frames earn 41, and 15 were 6 above nine tenths of 10.
        assert!((account.left(0.1) - 35.0).abs() < 1e-12);
        // A machine that became faster meanwhile raises the trial's charge.
        let mut faster = with_frames(40);
        faster.set_aside(100, 20.0);
        faster.report(100, 1, Some(15.0), false);
        faster.report(101, 1, Some(5.0), false);
        assert!((faster.left(0.1) - (40.5 - 10.5)).abs() < 1e-12);
        // Better than the reference earns nothing.
        let mut better = with_frames(40);
        better.set_aside(100, 20.0);
        better.report(100, 1, Some(1.0), false);
        better.report(101, 1, Some(10.0), false);
        assert!((better.left(0.1) - 41.0).abs() < 1e-12);
    }

    #[test]
    fn what_never_comes_back_stays_charged() {
        let mut account = with_frames(1000);
        let left = account.left(0.1);
        for trial in 0..200 {
            account.set_aside(2000 + trial, 1.0);
        }
        assert!(account.out.len() <= OPEN_TRIALS_PER_CLIENT_MAX);
        assert!((account.left(0.1) - (left - 200.0)).abs() < 1e-9);
        account.set_aside(3000, 5.0);
        account.report(3000, 1, None, false);
        assert!((account.left(0.1) - (left - 205.0)).abs() < 1e-9);
        account.enter(2);
        account.set_aside(3001, 5.0);
        account.report(3001, 2, Some(4.0), false);
        // No reference was seen in the new state, so all of it counts.
        assert!((account.left(0.1) - (left - 209.0)).abs() < 1e-9);
    }

    #[test]
    fn sums_keep_every_charge_and_stay_finite() {
        let mut sum = Sum::from(1e16);
        (0..1000).for_each(|_| add(&mut sum, 0.25));
        assert_eq!(sum.value(), 1e16 + 250.0);
        (0..3).for_each(|_| add(&mut sum, f64::MAX));
        assert_eq!(sum.value(), SUM_MAX);
        let mut account = Account::open(0, 0);
        account.enter(1);
        for number in 0..8 {
            account.report(2 * number, 1, Some(f64::MAX), true);
            account.set_aside(2 * number + 1, f64::MAX);
            account.report(2 * number + 1, 1, Some(f64::MAX), false);
        }
        assert!(!account.left(1.0).is_nan());
        assert!(account.leave(TERMS, true, true).is_err());
        let text = serde_json::to_string(&account).expect("plain data");
        assert_eq!(serde_json::from_str::<Account>(&text).expect("own text"), account);
    }
}
