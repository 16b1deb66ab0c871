//! The meaning of filters, and the place that each kind of mistake points at.

use super::super::Operator;
use super::*;

fn error(text: &str) -> (usize, String) {
    let error = Filter::parse(text).expect_err("the filter is wrong");
    (error.position, error.problem)
}

fn compared(field: Field, operator: Operator, literal: Literal) -> FieldComparison {
    FieldComparison { field, operator, literal }
}

fn text(text: &str) -> Literal {
    Literal::Text(text.to_owned())
}

#[test]
fn blank_text_matches_everything() {
    assert_eq!(Filter::parse("").unwrap(), Filter::default());
    assert_eq!(Filter::parse("  \n ").unwrap(), Filter::default());
}

#[test]
fn the_example_of_the_contract_parses() {
    let filter = Filter::parse("state = COMPLETED AND cost < 12.5 AND config.quality = 2").unwrap();
    assert_eq!(
        filter.comparisons,
        [
            compared(Field::State, Operator::Equal, text("COMPLETED")),
            compared(Field::Cost, Operator::Less, Literal::Number(12.5)),
            compared(Field::Configuration("quality".into()), Operator::Equal, Literal::Number(2.0)),
        ]
    );
}

#[test]
fn every_field_and_operator_parses() {
    let filter = Filter::parse(
        r#"mode!=PINNED AND outcome=ABORTED AND late = false AND excluded!=true AND client_id>="a\"b\\" AND state_id<=-3
           AND number>7 AND measurement.build_ms<1e3 AND indicator.x != -.5 AND config.flag = true
           AND config.kind = "sah""#,
    )
    .unwrap();
    assert_eq!(
        filter.comparisons,
        [
            compared(Field::Mode, Operator::NotEqual, text("PINNED")),
            compared(Field::Outcome, Operator::Equal, text("ABORTED")),
            compared(Field::Late, Operator::Equal, Literal::Boolean(false)),
            compared(Field::Excluded, Operator::NotEqual, Literal::Boolean(true)),
            compared(Field::ClientId, Operator::GreaterOrEqual, text("a\"b\\")),
            compared(Field::StateId, Operator::LessOrEqual, Literal::Whole(-3)),
            compared(Field::Number, Operator::Greater, Literal::Whole(7)),
            compared(Field::Measurement("build_ms".into()), Operator::Less, Literal::Number(1000.0)),
            compared(Field::Indicator("x".into()), Operator::NotEqual, Literal::Number(-0.5)),
            compared(Field::Configuration("flag".into()), Operator::Equal, Literal::Boolean(true)),
            compared(Field::Configuration("kind".into()), Operator::Equal, text("sah")),
        ]
    );
}

#[test]
fn errors_name_the_place_and_what_was_expected() {
    let cases = [
        ("staet = OPEN", 1, "found `staet` instead of a field"),
        ("state OPEN", 7, "found `OPEN` instead of an operator"),
        ("state = CLOSED", 9, "instead of a state: OPEN, COMPLETED"),
        ("state < OPEN", 7, "state is compared with = or != only"),
        ("cost < 1 cost > 2", 10, "found `cost` instead of `AND`"),
        ("cost < 1 and cost > 2", 10, "found `and` instead of `AND`"),
        ("cost < 1 AND", 13, "the filter ends before a field"),
        ("cost <", 7, "the filter ends before a number"),
        ("cost < 1e999", 8, "`1e999` is not a finite number"),
        ("cost < 1.2.3", 8, "`1.2.3` is not a finite number"),
        ("cost < \"1\"", 8, "found quoted text instead of a number"),
        ("number = 1.5", 10, "found `1.5` instead of a whole number"),
        ("number = 99999999999999999999", 10, "instead of a whole number"),
        ("client_id = \"open", 13, "not closed"),
        (r#"client_id = "a\n""#, 15, "a backslash stands only before"),
        ("client_id = \"a\0\"", 15, "the character NUL"),
        ("client_id = renderer", 13, "found `renderer` instead of text"),
        ("config.9 = 1", 8, "`9` is not a name"),
        ("config. = 1", 8, "`` is not a name"),
        ("config.-a = 1", 8, "`-a` is not a name"),
        ("config.x' OR 1 = 1", 9, "`'` has no meaning here"),
        ("config.x < true", 10, "a boolean parameter is compared with = or !="),
        ("late = maybe", 8, "instead of a truth value: true, false"),
        ("price.x = 1", 1, "found `price.x` instead of a field"),
        ("cost ! 1", 6, "`!` has no meaning here"),
        ("é = 1", 1, "found `é` instead of a field"),
    ];
    for (text, position, fragment) in cases {
        let (at, problem) = error(text);
        assert_eq!(at, position, "{text}: {problem}");
        assert!(problem.contains(fragment), "{text}: {problem}");
    }
}

#[test]
fn parameters_are_named_as_programs_name_them() {
    for name in ["blockSize", "learning-rate", "größe", "_x", "block.x"] {
        let filter = Filter::parse(&format!("config.{name}>=3 AND cost < 2")).unwrap();
        assert_eq!(filter.comparisons[0].field, Field::Configuration(name.to_owned()));
        assert!(Filter::parse(&format!("measurement.{name} = 3")).is_err(), "metrics keep their rule");
    }
}

#[test]
fn limits_are_kept() {
    let long = format!("client_id = \"{}\"", "x".repeat(limits::FILTER_CHARACTERS));
    assert!(error(&long).1.contains("at most 2000 characters"));

    let most = vec!["cost<1"; limits::FILTER_COMPARISONS].join(" AND ");
    assert_eq!(Filter::parse(&most).unwrap().comparisons.len(), limits::FILTER_COMPARISONS);
    let more = format!("{most} AND cost<1");
    assert!(error(&more).1.contains("at most 32 comparisons"));

    let name = "n".repeat(64);
    assert!(Filter::parse(&format!("config.{name} = 1")).is_ok());
    assert!(Filter::parse(&format!("config.{name}n = 1")).is_err());
}
