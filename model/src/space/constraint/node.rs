//! The tree of an expression, its one spelling, and its check against parameters.

use std::fmt;

use crate::space::{Domain, Parameter};
use crate::value::Value;

/// A part of an expression. `P` stands for a parameter: its name, or its place in the space.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::space) enum Node<P> {
    Literal(Value),
    Parameter(P),
    Negate(Box<Node<P>>),
    Not(Box<Node<P>>),
    Binary(Operator, Box<[Node<P>; 2]>),
    Call(Function, Vec<Node<P>>),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::space) enum Operator {
    Or,
    And,
    Equal,
    NotEqual,
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
    Add,
    Subtract,
    Multiply,
    Divide,
    Remainder,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::space) enum Function {
    Min,
    Max,
    Abs,
}

/// The type of a part of an expression.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Number,
    Text,
    Boolean,
}

/// Binding powers of the parts that are no binary operators.
const NOT: u8 = 3;
const NEGATE: u8 = 7;
const ATOM: u8 = 8;

/// Least likeness of two names, from 0 to 1, for one to be suggested in place of the other.
const NEAR: f64 = 0.5;

impl Operator {
    fn symbol(self) -> &'static str {
        match self {
            Operator::Or => "or",
            Operator::And => "and",
            Operator::Equal => "==",
            Operator::NotEqual => "!=",
            Operator::Less => "<",
            Operator::LessOrEqual => "<=",
            Operator::Greater => ">",
            Operator::GreaterOrEqual => ">=",
            Operator::Add => "+",
            Operator::Subtract => "-",
            Operator::Multiply => "*",
            Operator::Divide => "/",
            Operator::Remainder => "%",
        }
    }

    fn power(self) -> u8 {
        match self {
            Operator::Or => 1,
            Operator::And => 2,
            Operator::Add | Operator::Subtract => 5,
            Operator::Multiply | Operator::Divide | Operator::Remainder => 6,
            _ => 4,
        }
    }

    fn compares(self) -> bool {
        self.power() == 4
    }
}

impl Function {
    pub(super) fn named(name: &str) -> Option<Self> {
        [Function::Min, Function::Max, Function::Abs].into_iter().find(|one| one.name() == name)
    }

    fn name(self) -> &'static str {
        match self {
            Function::Min => "min",
            Function::Max => "max",
            Function::Abs => "abs",
        }
    }
}

/// Whether a character stands in names without backticks; digits do behind the first.
pub(super) fn is_bare(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// A name in the spelling of expressions: in backticks where it would be read as another token.
fn spelt(name: &str) -> String {
    let is_word = ["and", "or", "not", "true", "false"].contains(&name);
    let is_plain = name.chars().all(is_bare) && name.starts_with(|c: char| !c.is_numeric());
    if is_plain && !is_word { name.to_owned() } else { format!("`{name}`") }
}

/// Text in double quotes.
fn in_quotes(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

impl<P> Node<P> {
    /// The number of names, values and operators.
    pub(super) fn count(&self) -> usize {
        1 + self.parts().iter().map(Node::count).sum::<usize>()
    }

    fn parts(&self) -> &[Node<P>] {
        match self {
            Node::Literal(_) | Node::Parameter(_) => &[],
            Node::Negate(of) | Node::Not(of) => std::slice::from_ref(of),
            Node::Binary(_, sides) => sides.as_slice(),
            Node::Call(_, of) => of,
        }
    }

    fn power(&self) -> u8 {
        match self {
            Node::Not(_) => NOT,
            Node::Negate(_) => NEGATE,
            Node::Binary(operator, _) => operator.power(),
            // A negative number is read as one with a sign.
            Node::Literal(value) if value.as_number().is_some_and(|number| number < 0.0) => NEGATE,
            Node::Literal(_) | Node::Parameter(_) | Node::Call(..) => ATOM,
        }
    }

    /// With a minus in front.
    pub(super) fn negated(self) -> Self {
        match self {
            Node::Literal(Value::Integer(integer)) => Node::Literal(Value::Integer(-integer)),
            Node::Literal(Value::Float(float)) => Node::Literal(Value::Float(-float)),
            other => Node::Negate(Box::new(other)),
        }
    }
}

impl Node<usize> {
    /// Adds the places of the parameters.
    pub(in crate::space) fn mentions(&self, into: &mut Vec<usize>) {
        if let Node::Parameter(place) = self
            && !into.contains(place)
        {
            into.push(*place);
        }
        self.parts().iter().for_each(|part| part.mentions(into));
    }
}

impl Node<String> {
    /// The expression over the places of parameters. The error names the part that does not fit.
    pub(in crate::space) fn placed(&self, parameters: &[Parameter]) -> Result<Node<usize>, String> {
        let (node, kind) = self.typed(parameters)?;
        let mut mentions = Vec::new();
        node.mentions(&mut mentions);
        match kind {
            _ if mentions.is_empty() => Err("it names no parameter".to_owned()),
            Kind::Boolean => Ok(node),
            other => Err(format!("it is {}; compare it with something", other.words())),
        }
    }

    fn typed(&self, parameters: &[Parameter]) -> Result<(Node<usize>, Kind), String> {
        let of_kind = |part: &Node<String>, wanted: Kind, by: &str| match part.typed(parameters)? {
            (node, kind) if kind == wanted => Ok(node),
            (_, kind) => Err(format!("`{part}` is {}, and {by} needs {}", kind.words(), wanted.words())),
        };
        Ok(match self {
            Node::Literal(value) => (Node::Literal(value.clone()), Kind::of(value)),
            Node::Parameter(name) => {
                let place = place_of(name, parameters)?;
                (Node::Parameter(place), Kind::of(&parameters[place].default))
            }
            Node::Negate(of) => (Node::Negate(Box::new(of_kind(of, Kind::Number, "`-`")?)), Kind::Number),
            Node::Not(of) => (Node::Not(Box::new(of_kind(of, Kind::Boolean, "`not`")?)), Kind::Boolean),
            Node::Call(Function::Abs, of) if of.len() != 1 => {
                return Err(format!("`{self}` has {} values; abs takes one", of.len()));
            }
            Node::Call(function, of) => {
                let by = function.name();
                let of = of.iter().map(|part| of_kind(part, Kind::Number, by)).collect::<Result<_, _>>()?;
                (Node::Call(*function, of), Kind::Number)
            }
            Node::Binary(operator, sides) => {
                let [left, right] = sides.as_ref();
                let by = format!("`{}`", operator.symbol());
                let (wanted, kind) = match operator {
                    Operator::Or | Operator::And => (Kind::Boolean, Kind::Boolean),
                    Operator::Equal | Operator::NotEqual => (left.typed(parameters)?.1, Kind::Boolean),
                    operator if operator.compares() => (Kind::Number, Kind::Boolean),
                    _ => (Kind::Number, Kind::Number),
                };
                let sides = [of_kind(left, wanted, &by)?, of_kind(right, wanted, &by)?];
                check_choice(left, right, parameters)?;
                check_choice(right, left, parameters)?;
                (Node::Binary(*operator, Box::new(sides)), kind)
            }
        })
    }
}

/// Refuses text that is no value of the compared parameter.
fn check_choice(one: &Node<String>, other: &Node<String>, parameters: &[Parameter]) -> Result<(), String> {
    let (Node::Parameter(name), Node::Literal(value @ Value::Text(text))) = (one, other) else {
        return Ok(());
    };
    let domain = parameters.iter().find(|parameter| parameter.name == *name).map(|found| &found.domain);
    match domain {
        Some(Domain::Categorical { values }) if !values.contains(value) => {
            let texts = values.iter().filter_map(|value| match value {
                Value::Text(text) => Some(text.as_str()),
                _ => None,
            });
            Err(format!("`{}` is never {}; {}", spelt(name), in_quotes(text), nearest(text, texts)))
        }
        _ => Ok(()),
    }
}

fn place_of(name: &str, parameters: &[Parameter]) -> Result<usize, String> {
    let names = || parameters.iter().map(|parameter| parameter.name.as_str());
    names().position(|own| own == name).ok_or_else(|| {
        format!("there is no parameter {name:?}; {}; text stands in quotes", nearest(name, names()))
    })
}

/// The nearest of some words, or all where none is near.
fn nearest<'a>(wanted: &str, words: impl Iterator<Item = &'a str> + Clone) -> String {
    let likeness = |word: &str| strsim::normalized_damerau_levenshtein(wanted, word);
    let near = words.clone().map(|word| (likeness(word), word)).filter(|(likeness, _)| *likeness >= NEAR);
    match near.max_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((_, word)) => format!("did you mean {word:?}?"),
        None => format!("there are {}", words.collect::<Vec<_>>().join(", ")),
    }
}

impl Kind {
    fn of(value: &Value) -> Self {
        match value {
            Value::Integer(_) | Value::Float(_) => Kind::Number,
            Value::Text(_) => Kind::Text,
            Value::Boolean(_) => Kind::Boolean,
        }
    }

    fn words(self) -> &'static str {
        match self {
            Kind::Number => "a number",
            Kind::Text => "text",
            Kind::Boolean => "true or false",
        }
    }
}

impl fmt::Display for Node<String> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let within = |f: &mut fmt::Formatter<'_>, part: &Node<String>, least: u8| {
            if part.power() < least { write!(f, "({part})") } else { write!(f, "{part}") }
        };
        match self {
            Node::Literal(Value::Text(text)) => f.write_str(&in_quotes(text)),
            Node::Literal(value) => write!(f, "{value}"),
            Node::Parameter(name) => f.write_str(&spelt(name)),
            Node::Negate(of) => {
                f.write_str("-")?;
                within(f, of, ATOM)
            }
            Node::Not(of) => {
                f.write_str("not ")?;
                within(f, of, NOT)
            }
            Node::Binary(operator, sides) => {
                let power = operator.power();
                let [left, right] = sides.as_ref();
                within(f, left, if operator.compares() { power + 1 } else { power })?;
                write!(f, " {} ", operator.symbol())?;
                within(f, right, power + 1)
            }
            Node::Call(function, of) => {
                write!(f, "{}(", function.name())?;
                for (index, part) in of.iter().enumerate() {
                    write!(f, "{}{part}", if index == 0 { "" } else { ", " })?;
                }
                f.write_str(")")
            }
        }
    }
}
