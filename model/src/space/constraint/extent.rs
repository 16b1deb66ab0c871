//! Evaluation, where parameters have a value or only a domain.

use crate::space::Domain;
use crate::space::constraint::Node;
use crate::space::constraint::node::{Function, Operator};
use crate::value::Value;

/// The possible values of a part of an expression.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::space) enum Extent<'a> {
    /// From the first to the second, both included.
    Number(f64, f64),
    /// This text, or any text for `None`.
    Text(Option<&'a str>),
    /// Whether it may be true, and whether it may be false.
    Truth(bool, bool),
    /// No value: a division by zero, or a number that is not finite.
    Nothing,
}

impl<'a> Extent<'a> {
    pub(in crate::space) fn of_value(value: &'a Value) -> Self {
        match value {
            Value::Text(text) => Extent::Text(Some(text)),
            Value::Boolean(boolean) => Extent::Truth(*boolean, !*boolean),
            Value::Integer(integer) => Extent::Number(*integer as f64, *integer as f64),
            Value::Float(float) => Extent::Number(*float, *float),
        }
    }

    pub(in crate::space) fn of_domain(domain: &Domain) -> Self {
        match domain {
            Domain::Integer { min, max, .. } => Extent::Number(*min as f64, *max as f64),
            Domain::Float { min, max, .. } => Extent::Number(*min, *max),
            Domain::Boolean => Extent::Truth(true, true),
            Domain::Categorical { values } => {
                let numbers = values.iter().filter_map(Value::as_number);
                let span = (numbers.clone().reduce(f64::min), numbers.reduce(f64::max));
                match span {
                    (Some(min), Some(max)) => Extent::Number(min, max),
                    _ => Extent::Text(None),
                }
            }
        }
    }

    fn is_nothing(self) -> bool {
        self == Extent::Nothing
    }

    fn numbers(self) -> (f64, f64) {
        match self {
            Extent::Number(low, high) => (low, high),
            _ => (f64::NEG_INFINITY, f64::INFINITY),
        }
    }

    fn truth(self) -> (bool, bool) {
        match self {
            Extent::Truth(yes, no) => (yes, no),
            Extent::Nothing => (false, false),
            _ => (true, true),
        }
    }
}

impl Node<usize> {
    /// Whether the expression may be true. Where every parameter has one value, whether it is.
    pub(in crate::space) fn may_hold<'a>(&'a self, of: &impl Fn(usize) -> Extent<'a>) -> bool {
        self.extent(of).truth().0
    }

    fn extent<'a>(&'a self, of: &impl Fn(usize) -> Extent<'a>) -> Extent<'a> {
        match self {
            Node::Literal(value) => Extent::of_value(value),
            Node::Parameter(place) => of(*place),
            Node::Not(part) => {
                let (yes, no) = part.extent(of).truth();
                Extent::Truth(no, yes)
            }
            Node::Negate(part) => match part.extent(of) {
                Extent::Number(low, high) => Extent::Number(-high, -low),
                other => other,
            },
            Node::Binary(Operator::And, sides) => {
                let (left, right) = (sides[0].extent(of).truth(), sides[1].extent(of).truth());
                Extent::Truth(left.0 && right.0, left.1 || (left.0 && right.1))
            }
            Node::Binary(Operator::Or, sides) => {
                let (left, right) = (sides[0].extent(of).truth(), sides[1].extent(of).truth());
                Extent::Truth(left.0 || (left.1 && right.0), left.1 && right.1)
            }
            Node::Binary(operator, sides) => combined(*operator, sides[0].extent(of), sides[1].extent(of)),
            Node::Call(Function::Abs, parts) => {
                parts.first().map_or(Extent::Nothing, |part| match part.extent(of) {
                    Extent::Number(low, high) if low <= 0.0 && high >= 0.0 => {
                        Extent::Number(0.0, high.max(-low))
                    }
                    Extent::Number(low, high) => {
                        Extent::Number(low.abs().min(high.abs()), low.abs().max(high.abs()))
                    }
                    other => other,
                })
            }
            Node::Call(function, parts) => {
                let pick = if *function == Function::Min { f64::min } else { f64::max };
                let both = |a: Extent<'a>, b: Extent<'a>| match (a, b) {
                    (Extent::Number(a, b), Extent::Number(c, d)) => Extent::Number(pick(a, c), pick(b, d)),
                    _ => Extent::Nothing,
                };
                parts.iter().map(|part| part.extent(of)).reduce(both).unwrap_or(Extent::Nothing)
            }
        }
    }
}

fn combined<'a>(operator: Operator, left: Extent<'a>, right: Extent<'a>) -> Extent<'a> {
    if left.is_nothing() || right.is_nothing() {
        return Extent::Nothing;
    }
    match operator {
        Operator::Equal => equal(left, right),
        Operator::NotEqual => {
            let (yes, no) = equal(left, right).truth();
            Extent::Truth(no, yes)
        }
        Operator::Less => below(left, right),
        Operator::Greater => below(right, left),
        Operator::LessOrEqual => at_most(left, right),
        Operator::GreaterOrEqual => at_most(right, left),
        _ => arithmetic(operator, left.numbers(), right.numbers()),
    }
}

fn equal<'a>(left: Extent<'a>, right: Extent<'a>) -> Extent<'a> {
    match (left, right) {
        (Extent::Number(a, b), Extent::Number(c, d)) => {
            let is_one = a == b && c == d && a == c;
            Extent::Truth(a <= d && c <= b, !is_one)
        }
        (Extent::Text(Some(left)), Extent::Text(Some(right))) => Extent::Truth(left == right, left != right),
        (Extent::Truth(yes, no), Extent::Truth(also, neither)) => {
            Extent::Truth((yes && also) || (no && neither), (yes && neither) || (no && also))
        }
        _ => Extent::Truth(true, true),
    }
}

fn below<'a>(left: Extent<'a>, right: Extent<'a>) -> Extent<'a> {
    let ((a, b), (c, d)) = (left.numbers(), right.numbers());
    Extent::Truth(a < d, b >= c)
}

fn at_most<'a>(left: Extent<'a>, right: Extent<'a>) -> Extent<'a> {
    let ((a, b), (c, d)) = (left.numbers(), right.numbers());
    Extent::Truth(a <= d, b > c)
}

/// Rounding keeps the order of numbers, so that results of the ends are the ends of the results.
fn arithmetic<'a>(operator: Operator, (a, b): (f64, f64), (c, d): (f64, f64)) -> Extent<'a> {
    if a == b && c == d {
        let number = match operator {
            Operator::Add => a + c,
            Operator::Subtract => a - c,
            Operator::Multiply => a * c,
            Operator::Divide => a / c,
            _ => a % c,
        };
        return if number.is_finite() { Extent::Number(number, number) } else { Extent::Nothing };
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
        return Extent::Number(f64::NEG_INFINITY, f64::INFINITY);
    }
    Extent::Number(
        corners.into_iter().fold(f64::INFINITY, f64::min),
        corners.into_iter().fold(f64::NEG_INFINITY, f64::max),
    )
}
