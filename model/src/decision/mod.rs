//! Decisions: why a client gets a configuration, as data.
//!
//! A [`Decision`] is stored with a trial, and later steps read it: they learn the trial or not, stop it at a
//! cap, and answer the search. Its [`mode`](Decision::mode), and the [`Reason`] and
//! [`Explanation`](crate::reason::Explanation) that people and clients see, are made from it
//! ([`Decision::reason`]) and never read back. The types exclude contradictions, such as exploiting by a rule
//! of exploring. [`recorded`] reads the rows of earlier versions.

pub mod recorded;
mod words;

use serde::{Deserialize, Serialize};

use crate::configuration::RawConfiguration;
use crate::plain::is_default;
use crate::policy::{PredictorMethod, SearchMethod};
use crate::reason::{Mode, Neighbour, Reason, Rule};
use crate::standing::Gain;
use crate::words::words;

/// Why a client gets a configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Decision {
    /// The choice, with its rule.
    pub choice: Choice,
    /// The cost of the trial is not learnt. An infeasible configuration is still learnt.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub silent: bool,
    /// An earlier version's text for people, if that version stored the decision.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub said: Option<String>,
    /// The origin of a trial that was carried over from another study or database.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<String>,
    /// The client's session at the last hand-out; 0 where it names none. If another session asks for the
    /// trial, this one ended without a report, or the two share a client id.
    #[serde(default, skip_serializing_if = "is_default")]
    pub session: u64,
    /// The number of leases of the configuration lost in the state without a report or any measurement of it.
    #[serde(default, skip_serializing_if = "is_default")]
    pub lost_leases: u32,
    /// Its client renewed the lease and so shows that it lives, which makes its silence significant.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub heartbeat: bool,
    /// An earlier session of its client ended without a report of it, and without giving it back.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub left_behind: bool,
    /// The earlier sessions of its client that held it, the latest last. If one of them asks again, it lives
    /// beside the others: programs share a client id.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub earlier_sessions: Vec<u64>,
    /// Too many sessions left it behind, so its client gets others in its place. It stays open until its
    /// lease ends, because each of them may live and report it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub put_aside: bool,
    /// The name of the cheaper level at which the trial runs; `None` at the full one. What is measured there
    /// is no cost of the configuration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fidelity: Option<String>,
    /// The choice by which a trial was handed out that is of an earlier space of the study, and is read in
    /// the present one as wanted. `None` for other trials. Never stored.
    #[serde(skip)]
    pub adopted: Option<Box<Choice>>,
}

/// The choice of a decision, with its rule.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Choice {
    /// The policy pins the configuration.
    Pinned,
    /// The client asked for the configuration.
    Wanted,
    /// The study answers the default and only observes.
    Shadow {
        /// The answer without shadow operation.
        instead_of: RawConfiguration,
        /// The share by which that is expected to be cheaper than the default.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        expected_gain: Option<f64>,
    },
    /// A configuration is measured to learn its cost.
    Explore(Explore),
    /// A configuration known to be good is run.
    Exploit(Exploit),
}

/// A configuration is measured to learn its cost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Explore {
    /// The explored point.
    pub point: ExploredPoint,
    /// Why the client explores.
    pub rule: ExploreRule,
    /// The expected gain and cost of exploring at the decision.
    #[serde(rename = "weighed", default, skip_serializing_if = "is_default")]
    pub estimate: ExplorationEstimate,
    /// The state of the client's regret budget.
    #[serde(rename = "means", default, skip_serializing_if = "is_default")]
    pub budget: BudgetStatus,
    /// The client is to stop the trial as soon as its cost exceeds this, in the objective's units.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub abort_above: Option<f64>,
}

/// The kind of explored point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExploredPoint {
    /// The default configuration, with which a search begins.
    Baseline(SearchMethod),
    /// The default configuration, by which a machine is compared with others.
    BaselineOfMachine,
    /// The client's own default where that is not the study's: its start.
    Start,
    /// A point of the state's search.
    Search {
        /// The search of the policy.
        search: SearchMethod,
        /// The step that asked for it; not [`Step::Default`].
        step: Step,
        /// The number of earlier measurements of the configuration in the state.
        measurements: u64,
        /// The states that gave the point, nearest first.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        neighbours: Vec<Neighbour>,
    },
    /// A predictor's proposal to begin a state with.
    Proposal(Predicted),
    /// The best configuration of other machines.
    ByMachines(ByMachines),
    /// Drawn at random, because the search met known configurations only.
    Random,
    /// A challenger, in a round of the state's confirmation.
    Confirming {
        /// The round, from 1.
        round: u64,
        /// The most rounds.
        rounds_max: u64,
    },
    /// The incumbent, once more.
    Incumbent {
        /// It is the default configuration.
        is_default: bool,
        /// The round of the state's confirmation, from 1; `None` while others are explored, where it shows
        /// the speed of the machine.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        round: Option<u64>,
    },
}

/// A configuration known to be good is run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Exploit {
    /// The source of the choice.
    pub source: ExploitSource,
    /// Why the client does not explore.
    pub rule: ExploitRule,
    /// The expected gain and cost of exploring at the decision.
    #[serde(rename = "weighed", default, skip_serializing_if = "is_default")]
    pub estimate: ExplorationEstimate,
    /// The state of the client's regret budget.
    #[serde(rename = "means", default, skip_serializing_if = "is_default")]
    pub budget: BudgetStatus,
}

/// The source of an exploited configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExploitSource {
    /// The default configuration, without any source.
    Default,
    /// The state's own measurements.
    BestKnown {
        /// The number of configurations with a verdict there.
        tried: u64,
        /// The number of measurements of this one.
        measurements: u64,
        /// The state, and the cost.
        state: Neighbour,
        /// Its gain over the default configuration.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        gain: Option<Gain>,
        /// One metric is maximised and nothing else counts: the gain is a gain of it.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        is_maximised: bool,
        /// The client's start has the place of the default.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        beside_start: bool,
    },
    /// The state's own measurements, by which no configuration is proven to be better than the default.
    Incumbent {
        /// The number of configurations with a verdict there.
        tried: u64,
        /// The most that any configuration may gain, with a probability of 95 %, as a share; `None` where
        /// that was not computed.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        gain_at_most: Option<f64>,
        /// As for [`BestKnown`](Self::BestKnown).
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        is_maximised: bool,
        /// As for [`BestKnown`](Self::BestKnown).
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        beside_start: bool,
    },
    /// The configuration that serves the known states best, where nothing was measured yet.
    Portfolio {
        /// The number of states that it was chosen for.
        states: u64,
        /// The nearest of these states.
        neighbours: Vec<Neighbour>,
    },
    /// A predictor.
    Predictor(Predicted),
    /// Other machines with this input.
    Machines(ByMachines),
}

/// The answer of a predictor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Predicted {
    /// The predictor.
    pub predictor: PredictorMethod,
    /// The cost that it expects, and one standard deviation of a measurement from it.
    pub expected: (f64, f64),
    /// The known states behind the answer, nearest first, at most 5.
    pub neighbours: Vec<Neighbour>,
}

/// The measurements of other machines in a state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ByMachines {
    /// The level of the machines whose measurements count most.
    pub level: MachineLevel,
    /// The number of machines that measured it.
    pub machines: u64,
    /// The number of their measurements.
    pub measurements: u64,
    /// The change of the asking machine's software since its last states, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub software_change: Option<String>,
    /// Their states.
    pub neighbours: Vec<Neighbour>,
}

/// Why a client explores.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExploreRule {
    /// The dice decided.
    Dice,
    /// No known configuration could be exploited.
    NothingKnown,
}

/// Why a client does not explore.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExploitRule {
    /// The question runs no trial.
    Asked,
    /// The dice decided.
    Dice,
    /// The state's search is over.
    Finished,
    /// It explores, but the search waits for other clients' measurements.
    Waiting,
    /// The regret budget does not allow it yet.
    Budget,
    /// The expected gain does not pay for it, or is below the noise.
    Gain,
    /// The exploited configuration did clearly worse here than this one.
    RolledBack,
    /// The study is frozen.
    Frozen,
}

/// The expected gain and cost of exploring at the decision whether to explore. Rows call it `weighed`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ExplorationEstimate {
    /// The probability of exploring at the throw of the dice.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub epsilon: Option<f64>,
    /// The share by which exploring is expected to lower the cost of each later frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_gain: Option<f64>,
    /// The number of frames that are expected to profit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_frames: Option<f64>,
    /// The expected cost of exploring in all, in frames of the reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exploring_cost: Option<f64>,
    /// The number of configurations with a verdict in the state at the next estimate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub until: Option<u64>,
}

/// The state of a client's regret budget before an answer; costs in the objective's units. Rows call it
/// `means`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct BudgetStatus {
    /// The rest of the client's budget, in the objective's units.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub budget_left: Option<f64>,
    /// The part of it that the trial needs as a reserve: the most that the trial can cost above the
    /// reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub set_aside: Option<f64>,
    /// The cost of the reference, which would run without exploring.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_cost: Option<f64>,
}

words! {
    /// The steps of the searches, with their names in reasons.
    pub enum Step {
        /// The default configuration: the first point of every search.
        Default = "default",
        /// A point of a Latin hypercube design.
        LatinHypercube = "latin_hypercube",
        /// A configuration that did well in other states of the study.
        Elsewhere = "elsewhere",
        /// The best point so far, one step along one axis: the design of a continuous space.
        Coordinate = "coordinate",
        /// The worst vertex of a simplex mirrored at the centre of the others.
        Reflect = "reflect",
        /// Further in the direction of a reflection that paid off.
        Expand = "expand",
        /// Between the centre and the worst or the reflected vertex.
        Contract = "contract",
        /// The best point with another value of one choice.
        Switch = "switch",
        /// A random point, near the best or anywhere.
        RandomSearch = "random_search",
        /// A vertex of a new simplex around the best point.
        Restart = "restart",
        /// The most promising point of a model.
        Model = "model",
        /// The most promising point of a model of the measurements around the best.
        Local = "local",
        /// Another measurement of the seemingly best configuration, to separate luck from merit.
        Replicate = "replicate",
    }
}

words! {
    /// The level of the machine of a measurement, relative to one machine, with its name in reasons.
    #[derive(PartialOrd, Ord)]
    pub enum MachineLevel {
        /// The machine itself: processor, instruction set, threads and software are equal.
        Machine = "machine",
        /// Its group: machines with equal processor and software.
        Group = "group",
        /// All other machines.
        Fleet = "fleet",
    }
}

impl Choice {
    /// A decision for it, whose trial is learnt.
    pub fn decided(self) -> Decision {
        Decision {
            choice: self,
            silent: false,
            said: None,
            origin: None,
            session: 0,
            lost_leases: 0,
            heartbeat: false,
            left_behind: false,
            earlier_sessions: Vec::new(),
            put_aside: false,
            fidelity: None,
            adopted: None,
        }
    }
}

impl Decision {
    /// The decision as it is stored: that of a trial of an earlier space has its own choice again.
    pub fn stored(&self) -> Self {
        let mut stored = self.clone();
        if let Some(own) = stored.adopted.take() {
            stored.choice = *own;
        }
        stored
    }

    /// The kind of answer, for clients and filters.
    pub fn mode(&self) -> Mode {
        match &self.choice {
            Choice::Pinned | Choice::Wanted => Mode::Pinned,
            Choice::Shadow { .. } => Mode::Default,
            Choice::Explore(Explore {
                point: ExploredPoint::Baseline(_) | ExploredPoint::BaselineOfMachine | ExploredPoint::Start,
                ..
            }) => Mode::Default,
            Choice::Explore(Explore { point: ExploredPoint::Incumbent { is_default, .. }, .. }) => {
                if *is_default {
                    Mode::Default
                } else {
                    Mode::Exploit
                }
            }
            Choice::Explore(_) => Mode::Explore,
            Choice::Exploit(Exploit {
                source: ExploitSource::Default | ExploitSource::Incumbent { .. },
                ..
            }) => Mode::Default,
            Choice::Exploit(_) => Mode::Exploit,
        }
    }

    /// The rule of the policy that it follows; `None` for a question that runs no trial.
    pub fn rule(&self) -> Option<Rule> {
        Some(match &self.choice {
            Choice::Pinned => Rule::Pinned,
            Choice::Wanted => Rule::Wanted,
            Choice::Shadow { .. } => Rule::Shadow,
            Choice::Explore(Explore {
                point: ExploredPoint::Confirming { .. } | ExploredPoint::Incumbent { round: Some(_), .. },
                ..
            }) => Rule::Confirming,
            Choice::Explore(Explore { point: ExploredPoint::Incumbent { round: None, .. }, .. }) => {
                Rule::Incumbent
            }
            Choice::Explore(Explore { rule, .. }) => match rule {
                ExploreRule::Dice => Rule::Explore,
                ExploreRule::NothingKnown => Rule::NothingKnown,
            },
            Choice::Exploit(Exploit { rule, .. }) => match rule {
                ExploitRule::Asked => return None,
                ExploitRule::Dice => Rule::Exploit,
                ExploitRule::Finished => Rule::Finished,
                ExploitRule::Waiting => Rule::Waiting,
                ExploitRule::Budget => Rule::Budget,
                ExploitRule::Gain => Rule::Gain,
                ExploitRule::RolledBack => Rule::RolledBack,
                ExploitRule::Frozen => Rule::Frozen,
            },
        })
    }

    /// Whether a configuration other than the default is measured to learn its cost.
    pub fn explores(&self) -> bool {
        self.mode() == Mode::Explore
    }

    /// Whether the trial explores its state with any configuration but a client's start, outside a
    /// confirmation: it then counts towards the budget of the search.
    pub fn is_run_of_search(&self) -> bool {
        let confirms = self.rule() == Some(Rule::Confirming);
        matches!(self.choice, Choice::Explore(_)) && !confirms && !self.measures_start()
    }

    /// The step of the state's search that the trial is a point of, if it is one.
    pub fn search_step(&self) -> Option<Step> {
        match &self.choice {
            Choice::Explore(Explore { point: ExploredPoint::Search { step, .. }, .. }) => Some(*step),
            Choice::Explore(Explore { point: ExploredPoint::Baseline(_), .. }) => Some(Step::Default),
            _ => None,
        }
    }

    /// Whether the start of a client is measured, so that its other answers can be told beside it.
    pub fn measures_start(&self) -> bool {
        matches!(&self.choice, Choice::Explore(Explore { point: ExploredPoint::Start, .. }))
    }

    /// Whether no search asked for it: it was carried over, ran in an earlier space, or measures a start.
    pub fn is_unasked(&self) -> bool {
        self.origin.is_some() || self.adopted.is_some() || self.measures_start()
    }

    /// Whether its configuration was taken over from other machines or is its client's start, or its result
    /// was carried over from elsewhere: the state's search did not ask for it.
    pub fn is_from_elsewhere(&self) -> bool {
        self.origin.is_some()
            || self.measures_start()
            || matches!(&self.choice, Choice::Explore(Explore { point: ExploredPoint::ByMachines(_), .. }))
    }

    /// The client is to stop the trial as soon as its cost exceeds this, in the objective's units.
    pub fn abort_above(&self) -> Option<f64> {
        match &self.choice {
            Choice::Explore(explore) => explore.abort_above,
            _ => None,
        }
    }

    /// The decision in words, for people, clients and logs.
    pub fn reason(&self) -> Reason {
        words::reason(self)
    }
}
