//! Spaces with expressions among their constraints: only valid configurations, near the wanted ones, and
//! correct counts.

use proptest::prelude::*;

use super::*;

/// Expressions over `a` to `d` that hold where all are 4, `e` is 0.5, `on` is true and `kind` is "plain".
const EXPRESSIONS: [&str; 12] = [
    "a * b <= 24",
    "a % b == 0",
    "a + b + c + d == 16",
    "a + b + c + d <= 16 or on",
    "max(a, b) - min(c, d) < 3",
    "e * a <= 2",
    "e <= a / 8 and e >= abs(b - 4)",
    "on or kind == 'plain'",
    "not (kind != 'plain' and a > 3)",
    "c <= d",
    "(a - 4) * (b - 4) == 0",
    "e + d > 4 and e < 0.75 or d == c",
];

fn number(name: &str, is_small: bool) -> Parameter {
    let max = if is_small { 6 } else { 5000 };
    let domain = Domain::Integer { min: 1, max, scale: Scale::Linear };
    Parameter::new(name, domain, 4)
}

/// Six parameters of all kinds, some of them conditional or large, and some of the expressions.
fn arbitrary_space() -> impl Strategy<Value = Space> {
    let expressions = prop::sample::subsequence(EXPRESSIONS.to_vec(), 1..5);
    let drawn = (any::<[bool; 4]>(), any::<bool>(), any::<bool>(), expressions);
    drawn.prop_map(|(are_small, has_float, is_conditional, expressions)| {
        let range = if has_float { 0.0..=1.0 } else { 0.5..=0.5 };
        let first = Space::builder().boolean("on").default(true);
        let first = first.categorical("kind", ["plain", "fancy", "odd"]).default("plain");
        let first = first.float("e", range).default(0.5).build().expect("valid");
        let mut parameters = first.parameters().to_vec();
        parameters
            .extend(["a", "b", "c", "d"].iter().zip(are_small).map(|(name, small)| number(name, small)));
        if is_conditional {
            let when =
                |parameter: &str, value| Condition { parameter: parameter.into(), any_of: vec![value] };
            parameters[1].active_if = Some(when("on", Value::Boolean(true)));
            parameters[3].active_if = Some(when("kind", Value::from("plain")));
        }
        let constraints = expressions.iter().map(|text| Constraint::parse(text).expect("it reads"));
        Space::new(parameters, constraints.collect()).expect("the defaults fulfil all")
    })
}

/// The sum of squared distances of the values that both have.
fn distance(space: &Space, one: &[Value], other: &Configuration) -> f64 {
    let of = |(parameter, value): (&Parameter, &Value)| {
        other.get(&parameter.name).map_or(0.0, |other| parameter.domain.distance(value, other))
    };
    space.parameters().iter().zip(one).map(of).sum()
}

proptest! {
    #![proptest_config(crate::testing::cases(64))]

    #[test]
    fn what_is_repaired_is_valid_settled_and_the_same_each_time(
        space in arbitrary_space(), points in prop::collection::vec(prop::collection::vec(0.0f64..=1.0, 7), 6),
    ) {
        let text = serde_json::to_string(&space).expect("plain data");
        let read: Space = serde_json::from_str(&text).expect("own output");
        prop_assert_eq!(&read, &space);
        for point in points {
            let configuration = space.decode(&point);
            prop_assert_eq!(space.configuration(configuration.to_raw()), Ok(configuration.clone()));
            prop_assert_eq!(&read.decode(&point), &configuration, "another process finds it, too");
            let mut canonical = point.clone();
            let active = space.canonical(&mut canonical);
            prop_assert_eq!(&canonical, &space.encode(&configuration));
            for (parameter, is_active) in space.parameters().iter().zip(active) {
                prop_assert_eq!(configuration.get(&parameter.name).is_some(), is_active);
            }
            let again = space.decode(&canonical);
            let moved = space.canonical(&mut canonical.clone());
            prop_assert_eq!(moved.len(), 7);
            for (name, value) in configuration.values() {
                let (value, again) = (value.as_number(), again.get(name).and_then(Value::as_number));
                prop_assert!(value.zip(again).is_none_or(|(a, b)| (a - b).abs() < 1e-9), "{}", name);
            }
        }
    }

    #[test]
    fn small_spaces_are_counted_exactly_and_repaired_to_the_nearest(
        picked in prop::sample::subsequence(EXPRESSIONS.to_vec(), 1..5),
        points in prop::collection::vec(prop::collection::vec(0.0f64..=1.0, 6), 6),
    ) {
        let constraints = |picked: &[&str]| -> Vec<Constraint> {
            let usable = picked.iter().filter(|text| !text.contains("kind"));
            usable.map(|text| Constraint::parse(text).expect("it reads")).collect()
        };
        let e = Domain::Categorical { values: [0.25, 0.5, 1.0].map(Value::Float).to_vec() };
        let mut parameters =
            vec![Parameter::new("on", Domain::Boolean, true), Parameter::new("e", e, 0.5)];
        parameters.extend(["a", "b", "c", "d"].map(|name| number(name, true)));
        let all = Space::new(parameters.clone(), Vec::new()).expect("valid");
        let space = Space::new(parameters, constraints(&picked)).expect("the defaults fulfil all");
        let mut feasible = Vec::new();
        let cells = [2usize, 3, 6, 6, 6, 6];
        for index in 0..cells.iter().product() {
            let mut left = index;
            let point: Vec<f64> = cells.iter().map(|&count| {
                let cell = left % count;
                left /= count;
                (cell as f64 + 0.5) / count as f64
            }).collect();
            let configuration = all.decode(&point);
            if space.configuration(configuration.to_raw()).is_ok() {
                feasible.push(configuration);
            }
        }
        match space.enumerate() {
            Some(mut found) => {
                found.sort();
                feasible.sort();
                prop_assert_eq!(found, feasible.clone());
            }
            None => prop_assert!(feasible.len() > crate::limits::ENUMERATED_MAX),
        }
        for point in points.iter().filter(|_| space.has_expressions()) {
            let wanted = all.decode(point);
            let values: Vec<Value> = all.parameters().iter().map(|one| wanted.values()[&one.name].clone()).collect();
            let nearest = feasible.iter().map(|one| distance(&all, &values, one)).fold(f64::INFINITY, f64::min);
            let own = distance(&all, &values, &space.decode(point));
            // Orders are folded first, which may move values further than the nearest.
            let folds = space.constraints().iter().any(|one| one.as_order().is_some());
            prop_assert!(folds || (own - nearest).abs() < 1e-12, "{} against {}", own, nearest);
        }
    }
}

/// The first values of a sequence that looks random.
fn scattered(count: usize, seed: u64) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..count).map(|_| next()).collect()
}

/// Whole numbers from 0 to `max`, the first with another default than 0.
fn integers(count: usize, max: i64, first: i64) -> SpaceBuilder {
    (0..count).fold(Space::builder(), |builder, index| {
        let domain = Domain::Integer { min: 0, max, scale: Scale::Linear };
        let default = if index == 0 { first } else { 0 };
        builder.with_parameter(Parameter::new(format!("p{index}"), domain, default))
    })
}

#[test]
fn one_in_a_million_is_found() {
    let sum = (0..8).map(|index| format!("p{index}")).collect::<Vec<_>>().join(" + ");
    let space = integers(8, 9, 1).constraint(&format!("{sum} == 3 or {sum} == 1")).build().expect("a space");
    let all = space.enumerate().expect("they are few");
    assert_eq!(all.len(), 120 + 8, "of 10^8");
    let found: std::collections::BTreeSet<_> =
        (0..500).map(|seed| space.decode(&scattered(8, seed)).key()).collect();
    assert!(found.len() > 80, "{}: points lead to most of them", found.len());
}

#[test]
fn sparse_spaces_that_are_too_large_to_list_are_repaired_nearby() {
    // About one in 10,000 combinations; far too many to list.
    let space = integers(10, 1_000_000, 0)
        .constraint("p0 + p1 + p2 + p3 + p4 <= 1000000")
        .constraint("p5 + p6 + p7 + p8 + p9 <= 1000000")
        .constraint("p0 % 8 == 0")
        .build()
        .expect("a space");
    let mut is_default = 0;
    for seed in 1..200 {
        let configuration = space.decode(&scattered(10, seed));
        assert_eq!(space.configuration(configuration.to_raw()).as_ref(), Ok(&configuration));
        is_default += usize::from(configuration == space.default_configuration());
        let sum: i64 = (0..5).filter_map(|index| configuration.integer(&format!("p{index}")).ok()).sum();
        assert!(sum > 500_000, "{configuration} could come closer");
    }
    assert_eq!(is_default, 0);
}

#[test]
fn continuous_spaces_are_repaired_to_the_edge() {
    let space = Space::builder().float("x", 0.0..=1.0).default(0.25).float("y", 0.0..=1.0).default(0.25);
    let space =
        space.float("free", 0.0..=1.0).default(0.5).constraint("x + y <= 1").build().expect("a space");
    assert_eq!(space.decode(&[0.25, 0.75, 0.3]).key(), "free=0.3;x=0.25;y=0.75", "nothing is broken");
    for seed in 1..100 {
        let point = scattered(3, seed);
        let configuration = space.decode(&point);
        let number = |name: &str| configuration.float(name).expect("a number");
        let (x, y) = (number("x"), number("y"));
        assert!((number("free") - point[2]).abs() < 1e-9);
        assert!(x + y <= 1.0);
        if point[0] + point[1] > 1.0 {
            let nearest = (point[0] + point[1] - 1.0) / 2.0f64.sqrt();
            let own = ((x - point[0]).powi(2) + (y - point[1]).powi(2)).sqrt();
            assert!(x + y > 1.0 - 1e-9 && own <= 1.2 * nearest + 0.02, "{configuration} for {point:?}");
        }
    }
}

#[test]
fn an_inactive_parameter_makes_a_constraint_hold() {
    let space = Space::builder()
        .boolean("tiled")
        .default(true)
        .integer("tile", 1..=64)
        .default(8)
        .active_if("tiled", [true]);
    let space =
        space.integer("width", 1..=64).default(8).constraint("tile * width <= 64").build().expect("a space");
    assert_eq!(space.decode(&[0.0, 1.0, 1.0]).key(), "tiled=false;width=64");
    let repaired = space.decode(&[1.0, 1.0, 1.0]);
    assert!(repaired == space.decode(&[1.0, 1.0, 1.0]) && repaired.key() != "tiled=true;tile=64;width=64");
    let expected = 64 + (1..=64).map(|tile| 64 / tile).sum::<usize>();
    assert_eq!(space.enumerate().map(|all| all.len()), Some(expected));
}
