//! The promises of a space: only valid configurations, from any point and from any list of values.

use std::collections::BTreeMap;

use proptest::prelude::*;

use super::*;
use crate::testing::{cases, domains, spaces};

fn plain(name: &str, domain: Domain, default: Value) -> Parameter {
    Parameter::new(name, domain, default)
}

fn integer(name: &str, min: i64, max: i64, scale: Scale, default: i64) -> Parameter {
    plain(name, Domain::Integer { min, max, scale }, Value::Integer(default))
}

fn float(name: &str, min: f64, max: f64, scale: Scale, default: f64) -> Parameter {
    plain(name, Domain::Float { min, max, scale }, Value::Float(default))
}

fn only_if(parameter: Parameter, other: &str, any_of: Vec<Value>) -> Parameter {
    let active_if = Some(Condition { parameter: other.into(), any_of });
    Parameter { active_if, ..parameter }
}

fn order(lesser: &str, greater: &str) -> Constraint {
    Constraint::order(lesser, greater)
}

/// Equal but for the last digits of floats.
fn nearly_equal(a: &Configuration, b: &Configuration) -> bool {
    let near = |(name, value): (&String, &Value)| match (value, b.get(name)) {
        (Value::Float(x), Some(Value::Float(y))) => (x - y).abs() <= 1e-9 * (1.0 + x.abs().max(1e4)),
        (value, other) => Some(value) == other,
    };
    a.values().len() == b.values().len() && a.values().iter().all(near)
}

proptest! {
    #![proptest_config(cases(256))]

    #[test]
    fn every_point_decodes_to_a_valid_configuration(
        space in spaces(), points in prop::collection::vec(prop::collection::vec(-0.5f64..1.5, 8), 8),
    ) {
        for point in points {
            let configuration = space.decode(&point[..space.dimension()]);
            prop_assert_eq!(space.configuration(configuration.to_raw()), Ok(configuration.clone()));
            let encoded = space.encode(&configuration);
            prop_assert!(encoded.iter().all(|x| (0.0..=1.0).contains(x)));
            prop_assert!(nearly_equal(&configuration, &space.decode(&encoded)), "{} {}", configuration, space.decode(&encoded));
        }
    }

    #[test]
    fn keys_are_equal_exactly_for_equal_configurations(
        space in spaces(), a in prop::collection::vec(0.0f64..1.0, 8), b in prop::collection::vec(0.0f64..1.0, 8),
    ) {
        let (a, b) = (space.decode(&a[..space.dimension()]), space.decode(&b[..space.dimension()]));
        prop_assert_eq!(a.key() == b.key(), a == b);
        prop_assert_eq!(a.cmp(&b).is_eq(), a == b);
        let text = serde_json::to_string(&a).expect("plain data");
        let raw: RawConfiguration = serde_json::from_str(&text).expect("own output");
        prop_assert_eq!(space.configuration(raw), Ok(a));
    }

    #[test]
    fn ends_and_defaults_of_every_domain_are_reached(domain in domains(), at in 0.0f64..1.0) {
        for value in [domain.decode(0.0), domain.decode(1.0), domain.decode(at), domain.decode(f64::NAN)] {
            prop_assert!(domain.contains(&value));
        }
        if let Some((low, high)) = domain.bounds() {
            prop_assert_eq!(domain.decode(0.0).as_number(), Some(low));
            prop_assert_eq!(domain.decode(1.0).as_number(), Some(high));
        }
    }
}

fn leaf_space() -> Space {
    let space = Space::builder().integer("min_leaf_size", 1..=32).default(1);
    let space = space.integer("max_leaf_size", 1..=32).default(32);
    space.less_or_equal("min_leaf_size", "max_leaf_size").build().expect("valid")
}

#[test]
fn folding_keeps_uniform_points_uniform() {
    let space = leaf_space();
    let mut counts = BTreeMap::new();
    for a in 0..96 {
        for b in 0..96 {
            let point = [(f64::from(a) + 0.5) / 96.0, (f64::from(b) + 0.5) / 96.0];
            *counts.entry(space.decode(&point).key()).or_insert(0) += 1;
        }
    }
    // All 528 pairs of the triangle: those off the diagonal twice as often, as they are met from both sides.
    assert_eq!(counts.len(), 32 * 33 / 2);
    assert_eq!(counts.values().filter(|&&count| count == 18).count(), 32 * 31 / 2);
    assert_eq!(counts.values().filter(|&&count| count == 9).count(), 32);
}

#[test]
fn chains_and_unequal_domains_are_repaired_by_narrowing() {
    let space = Space::builder().float("a", 0.0..=10.0).default(0.0).integer("b", 2..=6).default(3);
    let space = space.float("c", 1.0..=5.5).default(5.0).less_or_equal("a", "b").less_or_equal("b", "c");
    let space = space.build().expect("valid");
    let configuration = space.decode(&[1.0, 1.0, 0.0]);
    // c rises to b's lowest value, b falls to the most that c allows, a falls to b.
    assert_eq!(configuration.key(), "a=5.0;b=5;c=5.0");
}

#[test]
fn the_order_of_a_range_and_a_list_of_numbers_is_repaired_to_the_nearest() {
    let space = Space::builder().integer("level", 1..=100).default(8);
    let space = space.categorical("tile", [16, 64, 32]).default(32).less_or_equal("level", "tile");
    let space = space.build().expect("valid");
    assert_eq!(space.decode(&[0.495, 0.1]).key(), "level=16;tile=16");
}

#[test]
fn a_space_whose_constraint_cannot_hold_falls_back_to_the_default() {
    let space = Space::builder().boolean("narrow").default(false).integer("low", 5..=9).default(5);
    let space = space.integer("high", 0..=3).default(0).active_if("narrow", [true]);
    let space = space.less_or_equal("low", "high").build().expect("the default leaves `high` out");
    assert_eq!(space.decode(&[0.9, 0.5, 0.5]), space.default_configuration());
    assert_eq!(space.decode(&[0.1, 0.9, 0.5]).key(), "low=9;narrow=false");
}

#[test]
fn inactive_parameters_are_left_out_all_the_way_down() {
    let space = Space::builder().integer("quality", 1..=3).default(2);
    let space = space.integer("block", 1..=32).log().default(4).active_if("quality", [2, 3]);
    let space = space.float("cost", 0.0..=10.0).default(1.0).active_if("block", [4]);
    let space = space.build().expect("valid");
    let fast = space.decode(&[0.0, 0.4, 0.9]);
    assert_eq!(fast.key(), "quality=1");
    assert_eq!(space.encode(&fast)[1..], space.encode(&space.default_configuration())[1..]);
    let raw = |pairs: &[(&str, Value)]| {
        pairs.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect()
    };
    let values = raw(&[("quality", Value::Integer(1)), ("block", Value::Integer(4))]);
    let problem = |values| space.configuration(values).expect_err("refused").to_string();
    assert!(
        problem(values).starts_with("parameter \"block\" is not active here: it needs quality = 2 or 3;")
    );
    let values = raw(&[("quality", Value::Integer(2)), ("block", Value::Integer(4))]);
    assert!(problem(values).starts_with("parameter \"cost\" is active here and has no value;"));
}

#[test]
fn values_that_do_not_fit_are_named() {
    let refuse = |pairs: &[(&str, Value)]| {
        let mut raw = leaf_space().default_configuration().to_raw();
        raw.extend(pairs.iter().map(|(name, value)| ((*name).to_owned(), value.clone())));
        leaf_space().configuration(raw).expect_err("must be refused").to_string()
    };
    assert!(
        refuse(&[("leaf", Value::Integer(1))])
            .contains("\"leaf\" is unknown; the space has min_leaf_size, max")
    );
    assert!(refuse(&[("min_leaf_size", Value::Integer(0))]).contains("a whole number from 1 to 32"));
    assert!(refuse(&[("min_leaf_size", Value::Float(2.0))]).contains("\"min_leaf_size\" is 2.0"));
    let order = refuse(&[("min_leaf_size", Value::Integer(9)), ("max_leaf_size", Value::Integer(8))]);
    assert!(order.contains(
        "min_leaf_size = 9, max_leaf_size = 8 break the constraint `min_leaf_size <= max_leaf_size`"
    ));
}

#[test]
fn malformed_spaces_are_refused_with_their_reason() {
    let ok = || integer("a", 1, 5, Scale::Linear, 1);
    let switch = plain("s", Domain::Boolean, Value::Boolean(false));
    let texts = |texts: &[&str]| Domain::Categorical {
        values: texts.iter().map(|text| Value::Text((*text).into())).collect(),
    };
    let mixed = Domain::Categorical { values: vec![Value::Integer(1), Value::Text("b".into())] };
    let many = (0..129).map(|index| integer(&format!("p{index}"), 0, 1, Scale::Linear, 0)).collect();
    let cases: Vec<(Vec<Parameter>, Vec<Constraint>, &str)> = vec![
        (vec![], vec![], "0 parameters; 1 to 128"),
        (many, vec![], "129 parameters"),
        (vec![integer("a b", 0, 1, Scale::Linear, 0)], vec![], "is not a name"),
        (vec![ok(), ok()], vec![], "listed twice"),
        (vec![integer("a", 2, 1, Scale::Linear, 2)], vec![], "is empty"),
        (vec![integer("a", 0, (1 << 53) + 1, Scale::Linear, 0)], vec![], "2^53"),
        (vec![integer("a", 0, 9, Scale::Log, 1)], vec![], "positive lower bound"),
        (vec![float("a", 0.0, 1.0, Scale::Log, 1.0)], vec![], "positive lower bound"),
        (vec![float("a", 0.0, f64::NAN, Scale::Linear, 0.0)], vec![], "must be finite"),
        (
            vec![float("a", 0.0, 1.0, Scale::Linear, f64::NAN)],
            vec![],
            "the default NaN is not a number from 0 to 1",
        ),
        (
            vec![integer("a", 0, 1, Scale::Linear, 2)],
            vec![],
            "the default 2 is not a whole number from 0 to 1",
        ),
        (vec![plain("a", texts(&[]), Value::Text("x".into()))], vec![], "0 values"),
        (vec![plain("a", texts(&["x", "x"]), Value::Text("x".into()))], vec![], "listed twice"),
        (vec![plain("a", mixed, Value::Integer(1))], vec![], "of one kind"),
        (vec![only_if(ok(), "s", vec![Value::Boolean(true)]), switch.clone()], vec![], "not listed earlier"),
        (vec![switch.clone(), only_if(ok(), "s", vec![])], vec![], "0 values"),
        (vec![switch.clone(), only_if(ok(), "s", vec![Value::Integer(1)])], vec![], "asks for 1"),
        (vec![ok()], vec![order("a", "b")], "no parameter \"b\""),
        (vec![ok(), switch], vec![order("a", "s")], "`s` is true or false, and `<=` needs a number"),
        (
            vec![ok(), integer("b", 0, 3, Scale::Linear, 0)],
            vec![order("a", "b")],
            "the defaults do not fulfil",
        ),
        (vec![ok()], vec![order("a", "b"); 65], "65 constraints"),
    ];
    for (parameters, constraints, message) in cases {
        let refused = Space::new(parameters, constraints).expect_err(message).to_string();
        assert!(refused.contains(message), "{refused:?} should say {message:?}");
    }
}

#[test]
fn very_wide_domains_keep_their_values() {
    let wide = 1i64 << 40;
    for scale in [Scale::Linear, Scale::Log] {
        let domain = Domain::Integer { min: 1, max: wide, scale };
        for value in [1, 2, 3, 1000, wide / 3, wide - 1, wide] {
            let coordinate = domain.encode(&Value::Integer(value));
            assert_eq!(domain.decode(coordinate), Value::Integer(value), "{scale:?}");
        }
    }
    let domain = Domain::Float { min: -1.7e308, max: 1.7e308, scale: Scale::Linear };
    assert!(domain.contains(&domain.decode(0.3)));
    assert!((domain.encode(&Value::Float(0.0)) - 0.5).abs() < 1e-12);
    assert_eq!(Domain::Float { min: 2.0, max: 2.0, scale: Scale::Log }.decode(0.9), Value::Float(2.0));
}

#[test]
fn few_configurations_are_counted_as_they_are() {
    let choice = |name: &str, values: &[i64]| {
        let values: Vec<Value> = values.iter().map(|value| Value::Integer(*value)).collect();
        plain(name, Domain::Categorical { values: values.clone() }, values[0].clone())
    };
    let count = |parameters, constraints| {
        let space = Space::new(parameters, constraints).expect("a valid space");
        space.enumerate().map(|all| all.len())
    };
    let level = || integer("level", 1, 19, Scale::Linear, 3);
    assert_eq!(count(vec![level()], vec![]), Some(19));
    assert_eq!(count(vec![integer("level", 1, 19, Scale::Log, 3)], vec![]), Some(19));
    assert_eq!(count(vec![float("one", 2.0, 2.0, Scale::Linear, 2.0)], vec![]), Some(1));
    assert_eq!(count(vec![level(), float("x", 0.0, 1.0, Scale::Linear, 0.0)], vec![]), None);
    // An inactive parameter has no values of its own.
    let only = only_if(level(), "kind", vec![Value::Integer(7)]);
    assert_eq!(count(vec![choice("kind", &[5, 6, 7]), only], vec![]), Some(2 + 19));
    let (small, large) = (integer("a", 1, 4, Scale::Linear, 1), integer("b", 1, 4, Scale::Linear, 4));
    assert_eq!(count(vec![small, large], vec![order("a", "b")]), Some(10));
    assert_eq!(count(vec![integer("a", 0, 1023, Scale::Linear, 0)], vec![]), Some(1024));
    assert_eq!(count(vec![integer("a", 0, 1024, Scale::Linear, 0)], vec![]), None);
    assert_eq!(
        count(
            (0..64).map(|n| plain(&format!("p{n}"), Domain::Boolean, Value::Boolean(true))).collect(),
            vec![]
        ),
        None
    );
}

proptest! {
    #![proptest_config(cases(64))]

    #[test]
    fn what_is_counted_is_valid_and_whole(space in spaces(), points in prop::collection::vec(0.0f64..1.0, 9 * 20)) {
        if let Some(all) = space.enumerate() {
            let distinct: std::collections::HashSet<_> = all.iter().collect();
            prop_assert_eq!(distinct.len(), all.len());
            prop_assert!(all.iter().all(|one| space.owns(one)));
            for point in points.chunks_exact(space.dimension()) {
                prop_assert!(distinct.contains(&space.decode(point)));
            }
        }
    }
}
