//! Evaluation, where parameters have a value or only a domain.

use crate::space::Domain;
use crate::space::constraint::Node;
use crate::space::constraint::node::{Function, Operator};
use crate::value::Value;

/// What a part of an expression may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::space) enum Range<'a> {
    /// From the first to the second, both included.
    Number(f64, f64),
    /// This text; any where there is none.
    Text(Option<&'a str>),
    /// Whether it may be true, and whether it may be false.
    Truth(bool, bool),
    /// Nothing: a division by zero, or a number that is not finite.
    Nothing,
}

impl<'a> Range<'a> {
    /// What a value is.
    pub(in crate::space) fn of_value(value: &'a Value) -> Self {
        match value {
            Value::Text(text) => Range::Text(Some(text)),
            Value::Boolean(boolean) => Range::Truth(*boolean, !*boolean),
            Value::Integer(integer) => Range::Number(*integer as f64, *integer as f64),
            Value::Float(float) => Range::Number(*float, *float),
        }
    }

    /// What the values of a domain are.
    pub(in crate::space) fn of_domain(domain: &Domain) -> Self {
        match domain {
            Domain::Integer { min, max, .. } => Range::Number(*min as f64, *max as f64),
            Domain::Float { min, max, .. } => Range::Number(*min, *max),
            Domain::Boolean => Range::Truth(true, true),
            Domain::Categorical { values } => {
                let numbers = values.iter().filter_map(Value::as_number);
                let span = (numbers.clone().reduce(f64::min), numbers.reduce(f64::max));
                match span {
                    (Some(min), Some(max)) => Range::Number(min, max),
                    _ => Range::Text(None),
                }
            }
        }
    }

    fn is_nothing(self) -> bool {
        self == Range::Nothing
    }

    fn numbers(self) -> (f64, f64) {
        match self {
            Range::Number(low, high) => (low, high),
            _ => (f64::NEG_INFINITY, f64::INFINITY),
        }
    }

    fn truth(self) -> (bool, bool) {
        match self {
            Range::Truth(yes, no) => (yes, no),
            Range::Nothing => (false, false),
            _ => (true, true),
        }
    }
}

impl Node<usize> {
    /// Whether the expression may be true. Where every parameter has one value, whether it is.
    pub(in crate::space) fn may_hold<'a>(&'a self, of: &impl Fn(usize) -> Range<'a>) -> bool {
        self.range(of).truth().0
    }

    fn range<'a>(&'a self, of: &impl Fn(usize) -> Range<'a>) -> Range<'a> {
        match self {
            Node::Literal(value) => Range::of_value(value),
            Node::Parameter(place) => of(*place),
            Node::Not(part) => {
                let (yes, no) = part.range(of).truth();
                Range::Truth(no, yes)
            }
            Node::Negate(part) => match part.range(of) {
                Range::Number(low, high) => Range::Number(-high, -low),
                other => other,
            },
            Node::Binary(Operator::And, sides) => {
                let (left, right) = (sides[0].range(of).truth(), sides[1].range(of).truth());
                Range::Truth(left.0 && right.0, left.1 || (left.0 && right.1))
            }
            Node::Binary(Operator::Or, sides) => {
                let (left, right) = (sides[0].range(of).truth(), sides[1].range(of).truth());
                Range::Truth(left.0 || (left.1 && right.0), left.1 && right.1)
            }
            Node::Binary(operator, sides) => combined(*operator, sides[0].range(of), sides[1].range(of)),
            Node::Call(Function::Abs, parts) => {
                parts.first().map_or(Range::Nothing, |part| match part.range(of) {
                    Range::Number(low, high) if low <= 0.0 && high >= 0.0 => {
                        Range::Number(0.0, high.max(-low))
                    }
                    Range::Number(low, high) => {
                        Range::Number(low.abs().min(high.abs()), low.abs().max(high.abs()))
                    }
                    other => other,
                })
            }
            Node::Call(function, parts) => {
                let pick = if *function == Function::Min { f64::min } else { f64::max };
                let both = |a: Range<'a>, b: Range<'a>| match (a, b) {
                    (Range::Number(a, b), Range::Number(c, d)) => Range::Number(pick(a, c), pick(b, d)),
                    _ => Range::Nothing,
                };
                parts.iter().map(|part| part.range(of)).reduce(both).unwrap_or(Range::Nothing)
            }
        }
    }
}

fn combined<'a>(operator: Operator, left: Range<'a>, right: Range<'a>) -> Range<'a> {
    if left.is_nothing() || right.is_nothing() {
        return Range::Nothing;
    }
    match operator {
        Operator::Equal => equal(left, right),
        Operator::NotEqual => {
            let (yes, no) = equal(left, right).truth();
            Range::Truth(no, yes)
        }
        Operator::Less => below(left, right),
        Operator::Greater => below(right, left),
        Operator::LessOrEqual => at_most(left, right),
        Operator::GreaterOrEqual => at_most(right, left),
        _ => arithmetic(operator, left.numbers(), right.numbers()),
    }
}

fn equal<'a>(left: Range<'a>, right: Range<'a>) -> Range<'a> {
    match (left, right) {
        (Range::Number(a, b), Range::Number(c, d)) => {
            let is_one = a == b && c == d && a == c;
            Range::Truth(a <= d && c <= b, !is_one)
        }
        (Range::Text(Some(left)), Range::Text(Some(right))) => Range::Truth(left == right, left != right),
        (Range::Truth(yes, no), Range::Truth(also, neither)) => {
            Range::Truth((yes && also) || (no && neither), (yes && neither) || (no && also))
        }
        _ => Range::Truth(true, true),
    }
}

fn below<'a>(left: Range<'a>, right: Range<'a>) -> Range<'a> {
    let ((a, b), (c, d)) = (left.numbers(), right.numbers());
    Range::Truth(a < d, b >= c)
}

fn at_most<'a>(left: Range<'a>, right: Range<'a>) -> Range<'a> {
    let ((a, b), (c, d)) = (left.numbers(), right.numbers());
    Range::Truth(a <= d, b > c)
}

/// Rounding keeps the order of numbers, so that results of the ends are the ends of the results.
fn arithmetic<'a>(operator: Operator, (a, b): (f64, f64), (c, d): (f64, f64)) -> Range<'a> {
    if a == b && c == d {
        let number = match operator {
            Operator::Add => a + c,
            Operator::Subtract => a - c,
            Operator::Multiply => a * c,
            Operator::Divide => a / c,
            _ => a % c,
        };
        return if number.is_finite() { Range::Number(number, number) } else { Range::Nothing };
    }
    let holds_zero = c <= 0.0 && d >= 0.0;
    let corners = match operator {
        Operator::Add => [a + c, b + d, a + c, b + d],
        Operator::Subtract => [a - d, b - c, a - d, b - c],
        Operator::Multiply => [a * c, a * d, b * c, b * d],
        Operator::Divide if !holds_zero => [a / c, a / d, b / c, b / d],
        // A remainder has the dividend's sign, and is smaller than the divisor and no larger than it.
        Operator::Remainder => {
            let most = c.abs().max(d.abs());
            [a.min(0.0).max(-most), b.max(0.0).min(most), 0.0, 0.0]
        }
        _ => [f64::NAN; 4],
    };
    if corners.iter().any(|corner| corner.is_nan()) {
        return Range::Number(f64::NEG_INFINITY, f64::INFINITY);
    }
    Range::Number(
        corners.into_iter().fold(f64::INFINITY, f64::min),
        corners.into_iter().fold(f64::NEG_INFINITY, f64::max),
    )
}
