//! The grammar of constraints.

use winnow::ascii::{digit1, multispace0};
use winnow::combinator::{
    Infix, Prefix, alt, cut_err, delimited, expression as pratt, opt, preceded, repeat, separated, terminated,
};
use winnow::error::{ContextError, ErrMode, StrContext};
use winnow::prelude::*;
use winnow::stream::Stateful;
use winnow::token::{one_of, take_while};

use super::node::{Function, Node, Operator, is_bare};
use crate::limits::{CONSTRAINT_CHARACTERS_MAX, CONSTRAINT_DEPTH_MAX, CONSTRAINT_NODES_MAX};
use crate::value::Value;

/// The rest of the text, and its depth in parentheses.
type Input<'a> = Stateful<&'a str, usize>;
type Failed = ErrMode<ContextError>;
type Parsed = Result<Node<String>, Failed>;

const TOO_DEEP: &str = "parentheses and signs are nested too deeply";

/// Reads a whole expression. The error gives the place and a remedy.
pub(super) fn expression(text: &str) -> Result<Node<String>, String> {
    if text.chars().count() > CONSTRAINT_CHARACTERS_MAX {
        return Err(format!(
            "a constraint has at most {CONSTRAINT_CHARACTERS_MAX} characters; write it as several"
        ));
    }
    let input = Stateful { input: text, state: 0 };
    let root = preceded(multispace0, whole).parse(input).map_err(|error| {
        let label = error.inner().context().find_map(|context| match context {
            StrContext::Label(label) => Some(*label),
            _ => None,
        });
        problem(text, error.offset(), label)
    })?;
    let nodes = root.count();
    if nodes > CONSTRAINT_NODES_MAX {
        return Err(format!(
            "{nodes} names, values and operators; {CONSTRAINT_NODES_MAX} are allowed, write it as several"
        ));
    }
    Ok(root)
}

/// The beginning of a text, for messages.
pub(super) fn excerpt(text: &str) -> String {
    const SHOWN: usize = 120;
    let shown: String = text.chars().take(SHOWN).collect();
    if shown.len() < text.len() { shown + "…" } else { shown }
}

/// The mistake at a place, in words.
fn problem(text: &str, offset: usize, label: Option<&str>) -> String {
    let rest = text[offset..].trim_start();
    let place = text[..text.len() - rest.len()].chars().count() + 1;
    let begins = |words: &[&str]| words.iter().any(|word| rest.starts_with(word));
    let remedy = match label {
        Some(label) => label.to_owned(),
        None if rest.is_empty() => "a name, a value or `(` is missing at the end".to_owned(),
        None if begins(&["==", "!=", "<", ">"]) => {
            "comparisons do not follow each other; write `a < b and b < c`".to_owned()
        }
        None if begins(&["="]) => "write `==` to compare".to_owned(),
        None if begins(&["&", "|"]) => "write `and` and `or`".to_owned(),
        None if begins(&["\"", "'", "`"]) => "the quotes do not end here; close them".to_owned(),
        None => format!(
            "`{}` does not fit; a name, a value, an operator or a parenthesis is expected",
            excerpt(rest.split_whitespace().next().unwrap_or(rest))
        ),
    };
    format!("at character {place}: {remedy}")
}

fn refused(label: &'static str) -> Failed {
    let mut error = ContextError::new();
    error.push(StrContext::Label(label));
    ErrMode::Cut(error)
}

/// A token and the blanks behind it.
fn token<'a, O>(parser: impl Parser<Input<'a>, O, Failed>) -> impl Parser<Input<'a>, O, Failed> {
    terminated(parser, multispace0)
}

fn bare<'a>(input: &mut Input<'a>) -> Result<&'a str, Failed> {
    let mut name = (one_of(|c: char| is_bare(c) && !c.is_numeric()), take_while(0.., is_bare)).take();
    name.parse_next(input)
}

fn keyword<'a>(word: &'static str) -> impl Parser<Input<'a>, &'a str, Failed> {
    token(bare.verify(move |name: &str| name == word))
}

/// Enters a parenthesis, or a sign.
fn deeper(input: &mut Input<'_>) -> Result<(), Failed> {
    input.state += 1;
    if input.state > CONSTRAINT_DEPTH_MAX { Err(refused(TOO_DEEP)) } else { Ok(()) }
}

fn whole(input: &mut Input<'_>) -> Parsed {
    pratt(operand).prefix(prefix).infix(infix).parse_next(input)
}

fn prefix<'a>(input: &mut Input<'a>) -> Result<Prefix<Input<'a>, Node<String>, Failed>, Failed> {
    let not = alt((keyword("not"), token("!")));
    let sign = alt((
        not.map(|_| Prefix(5, |_: &mut Input<'a>, of| Ok(Node::Not(Box::new(of))))),
        token("-").map(|_| Prefix(13, |_: &mut Input<'a>, of: Node<String>| Ok(of.negated()))),
    ))
    .parse_next(input)?;
    deeper(input)?;
    Ok(sign)
}

macro_rules! left {
    ($power:literal, $operator:ident) => {
        Infix::Left($power, |_, a, b| Ok(Node::Binary(Operator::$operator, Box::new([a, b]))))
    };
}

macro_rules! compare {
    ($operator:ident) => {
        Infix::Neither(7, |_, a, b| Ok(Node::Binary(Operator::$operator, Box::new([a, b]))))
    };
}

fn infix<'a>(input: &mut Input<'a>) -> Result<Infix<Input<'a>, Node<String>, Failed>, Failed> {
    let logic = alt((
        alt((keyword("or"), token("||"))).map(|_| left!(1, Or)),
        alt((keyword("and"), token("&&"))).map(|_| left!(3, And)),
    ));
    let comparison = alt((
        token("==").map(|_| compare!(Equal)),
        token("!=").map(|_| compare!(NotEqual)),
        token("<=").map(|_| compare!(LessOrEqual)),
        token(">=").map(|_| compare!(GreaterOrEqual)),
        token("<").map(|_| compare!(Less)),
        token(">").map(|_| compare!(Greater)),
    ));
    let arithmetic = alt((
        token("+").map(|_| left!(9, Add)),
        token("-").map(|_| left!(9, Subtract)),
        token("*").map(|_| left!(11, Multiply)),
        token("/").map(|_| left!(11, Divide)),
        token("%").map(|_| left!(11, Remainder)),
    ));
    alt((logic, comparison, arithmetic)).parse_next(input)
}

fn operand(input: &mut Input<'_>) -> Parsed {
    alt((
        number,
        text.map(|text| Node::Literal(Value::Text(text))),
        delimited((token("("), deeper), cut_err(whole), cut_err(closing)),
        quoted_name.map(Node::Parameter),
        named,
    ))
    .parse_next(input)
}

/// The end of a parenthesis.
fn closing(input: &mut Input<'_>) -> Result<(), Failed> {
    token(")").context(StrContext::Label("`)` is missing")).parse_next(input)?;
    input.state -= 1;
    Ok(())
}

fn number(input: &mut Input<'_>) -> Parsed {
    let fraction = alt(((".", digit1).void(), ".".void()));
    let exponent = (one_of(['e', 'E']), opt(one_of(['+', '-'])), digit1).void();
    let whole = alt(((digit1, opt(fraction)).void(), (".", digit1).void()));
    let number = (whole, opt(exponent)).take().verify_map(|digits: &str| {
        let integer = digits.parse::<i64>().ok().map(Value::Integer);
        let float = || digits.parse().ok().filter(|float: &f64| float.is_finite()).map(Value::Float);
        integer.or_else(float).map(Node::Literal)
    });
    token(number).parse_next(input)
}

/// Text between quotes of either kind; `\` makes the next character literal.
fn text(input: &mut Input<'_>) -> Result<String, Failed> {
    let between = |quote: char| {
        let plain = move |c: char| c != quote && c != '\\';
        let character = alt((one_of(plain), preceded('\\', one_of(|_: char| true))));
        delimited(quote, repeat(0.., character), quote)
    };
    token(alt((between('"'), between('\'')))).parse_next(input)
}

fn quoted_name(input: &mut Input<'_>) -> Result<String, Failed> {
    let name = take_while(1.., |c: char| c != '`').map(str::to_owned);
    token(delimited('`', name, '`')).parse_next(input)
}

/// A function, a switch, or a parameter.
fn named(input: &mut Input<'_>) -> Parsed {
    let name = token(bare).verify(|name: &&str| !["and", "or", "not"].contains(name)).parse_next(input)?;
    if opt(token("(")).parse_next(input)?.is_none() {
        return Ok(match name {
            "true" => Node::Literal(Value::Boolean(true)),
            "false" => Node::Literal(Value::Boolean(false)),
            name => Node::Parameter(name.to_owned()),
        });
    }
    let Some(function) = Function::named(name) else {
        return Err(refused("there is no such function; there are min, max and abs"));
    };
    deeper(input)?;
    let values: Vec<Node<String>> = cut_err(separated(1.., whole, token(","))).parse_next(input)?;
    cut_err(closing).parse_next(input)?;
    Ok(Node::Call(function, values))
}
