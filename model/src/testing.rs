//! Shared by property tests: their settings, arbitrary spaces, and arbitrary specifications of studies. Tests
//! of other crates include this file by its path.

use proptest::collection::{btree_set, vec};
use proptest::prelude::*;
use proptest::sample::{Index, select, subsequence};
use proptest::test_runner::{Config, RngSeed};
use treewright_model::fidelity::Fidelity;
use treewright_model::indicator::{Indicator, IndicatorSchema};
use treewright_model::limits::EPISODE_FRAMES_MAX;
use treewright_model::objective::{MeasurementLimit, Objective, ObjectiveTerm};
use treewright_model::policy::{PolicyField, PolicySettings, Range, RawPolicy};
use treewright_model::space::{Condition, Constraint, Domain, Parameter, Scale, Space};
use treewright_model::study::StudySpec;
use treewright_model::value::Value;

/// The library's own number of cases.
const CASES_USUAL: u32 = 256;

/// Beginnings of parameters' names.
const NAMES: &[&str] = &["p", "größe", "_x-", "block.", "層"];

/// Beginnings of choices. Some alone read as a number, a switch, or a part of some language.
const TEXTS: &[&str] =
    &["choice ", "", "7", "true", "1e3", "nan", "a\"b\\", "it's", "'''", "\n\r\t", "ä=,;#[]", "\0"];

/// Constraints on parameters `A` and `B`, whose default is `V`. Most hold for any values.
const EXPRESSIONS: &[&str] = &[
    "A % 1 == 0",
    "(A - -3) % 4 != 1 or A < B",
    "A <= B + 1e9 and B >= -1e300",
    "max(A, -B, .5) >= -(A + B) or 9007199254740993 != A",
    "not (A > 7 and B > 7) or abs(A) < 1e-5",
    "A or not A",
    "(not A) == B or A",
    "B == V or A == A",
];

/// A configuration of `cases` cases with a fixed seed, so that failures are reproducible. The library's
/// variables `PROPTEST_CASES` and `PROPTEST_RNG_SEED` widen the search by hand.
pub(crate) fn cases(cases: u32) -> Config {
    let given = Config::default();
    let rng_seed = match given.rng_seed {
        RngSeed::Random => RngSeed::Fixed(1),
        fixed => fixed,
    };
    let cases = if given.cases == CASES_USUAL { cases } else { given.cases };
    Config { cases, rng_seed, failure_persistence: None, ..given }
}

fn scales() -> impl Strategy<Value = Scale> {
    prop_oneof![Just(Scale::Linear), Just(Scale::Log)]
}

/// Domains of all kinds; lists of numbers are not in order.
pub(crate) fn domains() -> impl Strategy<Value = Domain> {
    let floats = vec![0.5, -2.0, 1e300, 3.0, 0.1 + 0.2, 5e-324];
    prop_oneof![
        2 => (-1000i64..1000, 0i64..5000, scales()).prop_map(|(min, width, scale)| {
            let min = if scale == Scale::Log { min.abs() + 1 } else { min };
            Domain::Integer { min, max: min + width, scale }
        }),
        2 => (-1e3f64..1e3, 0.0f64..1e4, scales()).prop_map(|(min, width, scale)| {
            let min = if scale == Scale::Log { min.abs() + 1e-3 } else { min };
            Domain::Float { min, max: min + width, scale }
        }),
        1 => (select(TEXTS), 0..8).prop_map(|(text, more)| {
            let more = (0..more).map(|number| format!("{text}{number}"));
            let all = std::iter::once(text.to_owned()).chain(more);
            Domain::Categorical { values: all.map(Value::Text).collect() }
        }),
        1 => subsequence(vec![64i64, 16, -3, 32, 1 << 53, 0], 1..6)
            .prop_map(|all| Domain::Categorical { values: all.into_iter().map(Value::Integer).collect() }),
        1 => subsequence(floats, 1..6)
            .prop_map(|all| Domain::Categorical { values: all.into_iter().map(Value::Float).collect() }),
        2 => Just(Domain::Boolean),
    ]
}

/// Spaces whose conditions and orders are drawn too; orders that do not hold for the defaults fall.
pub(crate) fn spaces() -> impl Strategy<Value = Space> {
    let switches = any::<[bool; 2]>();
    let parameter = (select(NAMES), domains(), 0.0f64..1.0, switches, any::<Index>(), 0.0f64..1.0);
    (vec(parameter, 1..9), vec(any::<[Index; 2]>(), 0..6)).prop_map(|(drawn, pairs)| {
        let mut parameters: Vec<Parameter> = Vec::new();
        for (index, drawn) in drawn.into_iter().enumerate() {
            let (name, domain, default, [is_conditional, setup], other, wanted) = drawn;
            let active_if = (is_conditional && index > 0).then(|| {
                let other = other.get(&parameters);
                let any_of = vec![other.domain.decode(wanted), other.default.clone()];
                Condition { parameter: other.name.clone(), any_of }
            });
            let (name, default) = (format!("{name}{index}"), domain.decode(default));
            parameters.push(Parameter { name, domain, default, active_if, setup });
        }
        let name = |index: &Index| index.get(&parameters).name.as_str();
        let orders = pairs.iter().map(|[lesser, greater]| Constraint::order(name(lesser), name(greater)));
        let orders = orders.collect();
        constrained(parameters, Vec::new(), orders)
    })
}

/// Spaces with expressions, too.
fn spaces_with_expressions() -> impl Strategy<Value = Space> {
    let drawn = vec((select(EXPRESSIONS), any::<[Index; 2]>()), 0..4);
    (spaces(), drawn).prop_map(|(space, drawn)| {
        let expression = |(text, of): (&str, [Index; 2])| {
            let [one, other] = of.map(|index| index.get(space.parameters()).clone());
            let default = match &other.default {
                Value::Text(text) => format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\"")),
                other => other.to_string(),
            };
            let text = text.replace('V', &default).replace('A', &format!("`{}`", one.name));
            Constraint::parse(&text.replace('B', &format!("`{}`", other.name))).expect("it reads")
        };
        let expressions = drawn.into_iter().map(expression).collect();
        constrained(space.parameters().to_vec(), space.constraints().to_vec(), expressions)
    })
}

/// A space with those further constraints that fit its parameters and hold for their defaults.
fn constrained(
    parameters: Vec<Parameter>,
    mut constraints: Vec<Constraint>,
    further: Vec<Constraint>,
) -> Space {
    for constraint in further {
        constraints.push(constraint);
        if Space::new(parameters.clone(), constraints.clone()).is_err() {
            constraints.pop();
        }
    }
    Space::new(parameters, constraints).expect("made of valid parts")
}

fn indicators() -> impl Strategy<Value = IndicatorSchema> {
    vec((-1e6f64..1e6, 1e-3f64..1e9, scales()), 0..4).prop_map(|drawn| {
        let indicator = |(index, (min, width, scale)): (usize, (f64, f64, Scale))| {
            let name = format!("indicator_{index}");
            Indicator { name, min, max: min + width, scale }
        };
        let indicators = drawn.into_iter().enumerate().map(indicator).collect();
        IndicatorSchema::new(indicators).expect("valid")
    })
}

/// Objectives with every part. The maximised metrics are named in another order than the terms.
fn objectives() -> impl Strategy<Value = Objective> {
    let terms = vec((1e-6f64..1e6, any::<bool>()), 1..5);
    let limits = vec((0..3, -1e9f64..1e9, -1e9f64..1e9), 0..4);
    let episodes = prop_oneof![Just(1u32), 1..=EPISODE_FRAMES_MAX];
    let fidelities = vec(0.001f64..0.2, 0..5);
    let parts = (terms, 0..4, limits, episodes, fidelities);
    parts.prop_map(|(terms, auxiliary, limits, episode_frames, steps)| {
        let name = |index: usize| format!("metric_{index}");
        let maximised = (0..terms.len()).rev().filter(|&index| terms[index].1).map(name).collect();
        let term = |(index, (weight, _)): (usize, (f64, bool))| ObjectiveTerm { metric: name(index), weight };
        let auxiliary = (0..auxiliary).map(|index| format!("auxiliary_{index}")).collect();
        let limit = |(index, (sides, a, b)): (usize, (i32, f64, f64))| MeasurementLimit {
            metric: name(2 * index),
            at_least: (sides != 0).then_some(a.min(b)),
            at_most: (sides != 1).then_some(a.max(b)),
        };
        let mut share = 0.0;
        let fidelities = steps.into_iter().enumerate().map(|(index, step)| {
            share += step;
            Fidelity { name: format!("{index}.level"), cost: share }
        });
        let fidelities = fidelities.collect();
        Objective::new(terms.into_iter().enumerate().map(term).collect())
            .and_then(|terms| terms.with_auxiliary(auxiliary))
            .and_then(|terms| terms.with_limits(limits.into_iter().enumerate().map(limit).collect()))
            .and_then(|terms| terms.with_maximised(maximised))
            .and_then(|terms| terms.with_episode_frames(episode_frames))
            .and_then(|terms| terms.with_fidelities(fidelities))
            .expect("valid")
    })
}

/// Policies with each field of the table set or not, but for `pinned`.
fn policies() -> impl Strategy<Value = PolicySettings> {
    let shares = vec(prop::option::of(0.001f64..1.0), PolicySettings::FIELDS.len());
    shares.prop_map(|shares| {
        let mut policy = PolicySettings::new();
        for (field, share) in PolicySettings::FIELDS.iter().zip(shares) {
            let Some(share) = share.filter(|_| field.name != "pinned") else { continue };
            let is_set = texts_of(field, share).iter().any(|text| policy.set_text(field.name, text).is_ok());
            assert!(is_set, "{}", field.name);
        }
        policy
    })
}

/// A value of a field, `share` of the way through its range. Whole numbers are tried after others.
fn texts_of(field: &PolicyField, share: f64) -> Vec<String> {
    let words = (field.words)();
    match field.range {
        Range::Any if words.is_empty() => vec![(share < 0.5).to_string()],
        Range::Any => vec![words[(share * words.len() as f64) as usize].to_owned()],
        Range::Within(least, most) | Range::Above(least, most) => {
            let number = least + share * (most - least);
            vec![number.to_string(), number.round().to_string()]
        }
    }
}

/// Specifications with all that one can say.
pub(crate) fn studies() -> impl Strategy<Value = StudySpec<PolicySettings>> {
    let seeds = prop_oneof![any::<u64>(), Just(0u64), Just(u64::MAX)];
    let texts = ("\\PC{0,40}", "(\\PC|\n|\t){0,40}", btree_set("[a-zé層0-9_.-]{1,8}", 0..4));
    let parts = (spaces_with_expressions(), indicators(), objectives(), policies());
    (texts, parts, 0.0f64..=1.0, any::<bool>(), seeds).prop_map(
        |(texts, (space, indicators, objective, mut policy), state_tolerance, is_pinned, seed)| {
            policy.pinned = is_pinned.then(|| space.default_configuration().into());
            let (display_name, note, tags) = texts;
            StudySpec {
                display_name,
                note,
                tags,
                space,
                indicators,
                objective,
                state_tolerance,
                policy,
                seed,
            }
        },
    )
}

/// The specification with the daemon's defaults for what is unset: a form may leave out a default.
pub(crate) fn decided(spec: StudySpec<PolicySettings>) -> StudySpec<RawPolicy> {
    let policy = spec.policy.clone().decide().expect("known words");
    spec.with_policy(policy)
}
