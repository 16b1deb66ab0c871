//! The language of constraints: its syntax, its meaning, and its refusals.

use proptest::prelude::*;

use super::*;
use crate::space::{Space, SpaceBuilder};
use crate::value::Value;

fn spelling(text: &str) -> String {
    Constraint::parse(text).unwrap_or_else(|problem| panic!("{problem}")).to_string()
}

fn problem(text: &str) -> String {
    Constraint::parse(text).expect_err(text).problem
}

#[test]
fn every_spelling_becomes_one() {
    for (written, kept) in [
        ("block_x*block_y<=1024", "block_x * block_y <= 1024"),
        (" a %b== 0 ", "a % b == 0"),
        ("(a + b) * c > -3", "(a + b) * c > -3"),
        ("a - (b - c) < a - b - c", "a - (b - c) < a - b - c"),
        ("((a)) + ((b * c)) != .5e3", "a + b * c != 500.0"),
        ("a<b&&!c||d", "a < b and not c or d"),
        ("not (a < b and c)", "not (a < b and c)"),
        ("(not a) == b", "(not a) == b"),
        ("a and (b or c)", "a and (b or c)"),
        ("-a * 2 >= - (b + 1)", "-a * 2 >= -(b + 1)"),
        ("max(a, b , 3) == abs( -a )", "max(a, b, 3) == abs(-a)"),
        ("layout == 'soa' or layout != \"a\\\"b\"", "layout == \"soa\" or layout != \"a\\\"b\""),
        ("`learning-rate` < `and` + größe", "`learning-rate` < `and` + größe"),
        ("min <= max and orderly", "min <= max and orderly"),
        ("flag == true", "flag == true"),
    ] {
        assert_eq!(spelling(written), kept, "{written}");
        assert_eq!(spelling(kept), kept);
    }
    assert_eq!(Constraint::parse("a<=b"), Ok(Constraint::order("a", "b")));
    assert_eq!(Constraint::step("a", 16, 8).to_string(), "a % 8 == 0");
    assert_eq!(Constraint::step("a", -3, 4), Constraint::parse("(a - -3) % 4 == 0").expect("reads"));
    assert_eq!(Constraint::order("a", "b").as_order(), Some(("a", "b")));
    assert_eq!(Constraint::parse("a <= b + 0").expect("reads").as_order(), None);
}

#[test]
fn mistakes_are_placed() {
    for (text, message) in [
        ("", "at character 1: a name, a value or `(` is missing at the end"),
        ("a *", "at character 4: a name, a value or `(` is missing at the end"),
        ("größe = 3", "at character 7: write `==` to compare"),
        ("a < b < c", "at character 7: comparisons do not follow each other"),
        ("a & b", "at character 3: write `and` and `or`"),
        ("(a + b", "at character 7: `)` is missing"),
        ("a == 'b", "at character 6: the quotes do not end here"),
        ("a + ) > 1", "at character 5: `)` does not fit"),
        ("3x < 2", "at character 2: `x` does not fit"),
        ("sqrt(a) < 2", "there is no such function; there are min, max and abs"),
        ("a ? b : c", "at character 3: `?` does not fit"),
        ("a < 1e999", "at character 5: `1e999` does not fit"),
    ] {
        assert!(problem(text).starts_with(message) || problem(text).ends_with(message), "{}", problem(text));
    }
    assert!(problem(&"(".repeat(200)).contains("nested too deeply"));
    assert!(problem(&"-".repeat(200)).contains("nested too deeply"));
    assert!(problem(&"!".repeat(900)).contains("nested too deeply"));
    assert!(problem(&format!("a < 1{}", " + 1".repeat(200))).contains("256 are allowed"));
    assert!(problem(&"a".repeat(1001)).contains("at most 1000 characters"));
    // What cannot be read in its common spelling could be stored, and not be read again.
    let product = format!("{} < 1", ["abcdef"; 120].join("*"));
    assert!(problem(&product).contains("as `abcdef * abcdef") && problem(&product).contains("1000 char"));
    assert!(problem(&format!("{}a < 1", "-".repeat(20))).contains("as `-(-(-"));
}

fn parameters() -> SpaceBuilder {
    let space = Space::builder().integer("a", -100..=100).default(7).integer("b", -100..=100).default(2);
    let space = space.float("x", -10.0..=10.0).default(0.5).boolean("flag").default(true);
    space
        .categorical("layout", ["soa", "aos"])
        .default("soa")
        .categorical("width", [4, 8, 16])
        .default(8)
        .constraint("a == a")
}

fn holds(text: &str) -> bool {
    match parameters().constraint(text).build() {
        Ok(_) => true,
        Err(problem) if problem.to_string().contains("the defaults do not fulfil it") => false,
        Err(problem) => panic!("{text}: {problem}"),
    }
}

#[test]
fn expressions_mean_what_they_say() {
    for text in [
        "a / b == 3.5",
        "a % b == 1",
        "-a % 4 == -3",
        "a % -4 == 3",
        "a * b - 4 == 10 and x + x == 1",
        "min(a, b, x) == x and max(a, b) == a and abs(-a) == a",
        "layout == \"soa\" and layout != 'aos'",
        "flag and not (flag == false)",
        "not flag or width * 2 == 16",
        "!(a < b) && (a >= b || false)",
        "a + 9007199254740985 == 9007199254740992",
        "(a - 7) == 0 or a / (a - 7) > 1",
        "flag != (a < b)",
    ] {
        assert!(holds(text), "{text}");
    }
    for text in [
        "a < b",
        // An undefined expression does not hold, and neither does its opposite.
        "a / (a - 7) > 1",
        "not (a / (a - 7) > 1)",
        "a % (b - 2) == 0",
        "a / (a - 7) == a / (a - 7)",
        "a * 1e308 * 1e308 > 0",
        "a / (a - 7) > 1 or a == 7",
        "flag and a == b",
    ] {
        assert!(!holds(text), "{text}");
    }
}

#[test]
fn what_does_not_fit_the_parameters_is_refused() {
    let refused = |text: &str| parameters().constraint(text).build().expect_err(text).to_string();
    for (text, message) in [
        ("layuot == 'soa'", "there is no parameter \"layuot\"; did you mean \"layout\"?"),
        ("zzzzzz > 3", "there are a, b, x, flag, layout, width"),
        ("layout < 3", "`layout` is text, and `<` needs a number"),
        ("a == 'soa'", "`\"soa\"` is text, and `==` needs a number"),
        ("layout == 'soaa'", "`layout` is never \"soaa\"; did you mean \"soa\"?"),
        ("a + b", "it is a number; compare it with something"),
        ("1 < 2", "it names no parameter"),
        ("not a", "`a` is a number, and `not` needs true or false"),
        ("flag + 1 > 2", "`flag` is true or false, and `+` needs a number"),
        ("a and flag", "`a` is a number, and `and` needs true or false"),
        ("abs(a, b) > 1", "abs takes one"),
        ("a <", "missing at the end"),
    ] {
        assert!(refused(text).contains(message), "{}", refused(text));
    }
}

fn expression() -> impl Strategy<Value = Node<String>> {
    let name = prop::sample::select(vec!["a", "and", "min", "learning-rate", "größe", "x2"]);
    let leaf = prop_oneof![
        (-9i64..99).prop_map(|integer| Node::Literal(Value::Integer(integer))),
        (-9.0f64..1e20).prop_map(|float| Node::Literal(Value::Float(float))),
        "[a-c\"'\\\\]{0,4}".prop_map(|text| Node::Literal(Value::Text(text))),
        any::<bool>().prop_map(|boolean| Node::Literal(Value::Boolean(boolean))),
        name.prop_map(|name| Node::Parameter(name.to_owned())),
    ];
    let operator = prop::sample::select(vec![
        Operator::Or,
        Operator::And,
        Operator::Equal,
        Operator::Less,
        Operator::GreaterOrEqual,
        Operator::Add,
        Operator::Subtract,
        Operator::Multiply,
        Operator::Divide,
        Operator::Remainder,
    ]);
    leaf.prop_recursive(5, 24, 3, move |inner| {
        let two = [inner.clone(), inner.clone()];
        prop_oneof![
            (operator.clone(), two).prop_map(|(operator, sides)| Node::Binary(operator, Box::new(sides))),
            inner.clone().prop_map(|of| Node::Not(Box::new(of))),
            inner.clone().prop_map(Node::negated),
            prop::collection::vec(inner, 1..4).prop_map(|of| Node::Call(node::Function::Max, of)),
        ]
    })
}

proptest! {
    #![proptest_config(crate::testing::cases(512))]

    #[test]
    fn what_is_written_is_read_back(root in expression()) {
        let constraint = Constraint { root };
        prop_assert_eq!(Constraint::parse(&constraint.to_string()), Ok(constraint.clone()), "{}", constraint);
        let json = serde_json::to_string(&constraint).expect("plain data");
        prop_assert_eq!(serde_json::from_str::<Constraint>(&json).expect("own output"), constraint);
    }

    #[test]
    fn nothing_that_is_read_panics(text in "[ab1.()<=&|!+*%/,'\"`\\\\ä -]{0,40}") {
        if let Ok(constraint) = Constraint::parse(&text) {
            prop_assert_eq!(Constraint::parse(&constraint.to_string()), Ok(constraint));
        }
    }

    #[test]
    fn ranges_hold_what_comes_true(
        root in expression(), low in -6i64..6, width in 0i64..6, at in 0i64..6, other in -3.0f64..3.0,
    ) {
        // The type does not matter to a range; names become two parameters.
        let root = numbered(&root);
        let value = Value::Integer(low + at.min(width));
        let other = Value::Float(other);
        let exact = |place: usize| Extent::of_value(if place == 0 { &value } else { &other });
        let ranges = |place: usize| match place {
            0 => Extent::Number(low as f64, (low + width) as f64),
            _ => Extent::of_value(&other),
        };
        prop_assert!(!root.may_hold(&exact) || root.may_hold(&ranges));
    }
}

fn numbered(node: &Node<String>) -> Node<usize> {
    match node {
        Node::Literal(value) => Node::Literal(value.clone()),
        Node::Parameter(name) => Node::Parameter(usize::from(name != "a" && name != "x2")),
        Node::Negate(of) => Node::Negate(Box::new(numbered(of))),
        Node::Not(of) => Node::Not(Box::new(numbered(of))),
        Node::Binary(operator, sides) => {
            let [left, right] = sides.as_ref();
            Node::Binary(*operator, Box::new([numbered(left), numbered(right)]))
        }
        Node::Call(function, of) => Node::Call(*function, of.iter().map(numbered).collect()),
    }
}

#[test]
fn stored_constraints_are_read() {
    let read = |text: &str| serde_json::from_str::<Constraint>(text);
    assert_eq!(read(r#"{"lesser":"a","greater":"b"}"#).expect("as ever"), Constraint::order("a", "b"));
    assert_eq!(
        serde_json::to_string(&Constraint::order("a", "b")).expect("plain data"),
        r#"{"lesser":"a","greater":"b"}"#,
        "earlier versions read it"
    );
    assert_eq!(
        serde_json::to_string(&Constraint::parse("a<b").expect("reads")).expect("plain data"),
        r#"{"expression":"a < b"}"#
    );
    assert!(read(r#"{"expression":"a <"}"#).expect_err("a mistake").to_string().contains("at character 4"));
}
