//! A command with places for parameters: `zstd -{level} {long?--long=27}`.
//!
//! | written | becomes |
//! |---|---|
//! | `{name}` | the parameter's value |
//! | `{name?yes}`, `{name?yes:no}` | `yes` where a boolean parameter is true, else `no` |
//! | `{fidelity}`, `{fidelity:256}` | the cheaper level of the run; in full `full`, `256` |
//! | `{{name}}` | the text `{name}` |
//!
//! The level has a place only where the study has cheaper levels, and no parameter of that name.
//!
//! An argument that asks for an inactive parameter is left out, and so is one that a choice leaves empty. All
//! other braces stay as written, so that programs of awk or JSON need no escapes.

use std::collections::BTreeSet;

use treewright_client::{Configuration, Fidelity, StudySpec, Value};

/// The place of the level.
const LEVEL: &str = "fidelity";

/// A command whose arguments hold places for parameters.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Template {
    arguments: Vec<Vec<Piece>>,
}

#[derive(Clone, Debug, PartialEq)]
enum Piece {
    Text(String),
    Value(String),
    Choice { name: String, yes: String, no: String },
    // The name of a cheaper level, or else this text.
    Level(String),
}

impl Template {
    /// Reads a command for a study. The error names a place for a parameter that the study does not have.
    pub(crate) fn read(command: &[String], spec: &StudySpec) -> Result<Self, String> {
        let names: Vec<&str> =
            spec.space.parameters().iter().map(|parameter| parameter.name.as_str()).collect();
        let has_levels = !spec.objective.fidelities().is_empty();
        let arguments: Vec<Vec<Piece>> =
            command.iter().map(|argument| pieces(argument, &names, has_levels)).collect();
        for name in arguments.iter().flatten().filter_map(Piece::name) {
            if name == LEVEL && !names.contains(&name) {
                return Err(format!(
                    "the command uses {{{LEVEL}}}, but the study has no cheaper levels; create it with some \
                     (--fidelity NAME=COST), by a daemon that knows them"
                ));
            }
            if !names.contains(&name) {
                return Err(format!(
                    "the command uses {{{name}}}, but the study tunes {}; write {{{{{name}}}}} for the literal \
                     text",
                    names.join(", ")
                ));
            }
        }
        Ok(Self { arguments })
    }

    /// Parameters that the command does not mention.
    pub(crate) fn unused(&self, spec: &StudySpec) -> Vec<String> {
        let used: BTreeSet<&str> = self.arguments.iter().flatten().filter_map(Piece::name).collect();
        let names = spec.space.parameters().iter().map(|parameter| parameter.name.clone());
        names.filter(|name| !used.contains(name.as_str())).collect()
    }

    pub(crate) fn has_level(&self) -> bool {
        self.arguments.iter().flatten().any(|piece| matches!(piece, Piece::Level(_)))
    }

    /// The command for a configuration, at a cheaper level where one is named.
    pub(crate) fn fill(&self, configuration: &Configuration, level: Option<&str>) -> Vec<String> {
        self.arguments.iter().filter_map(|pieces| fill(pieces, configuration, level)).collect()
    }
}

impl Piece {
    fn name(&self) -> Option<&str> {
        match self {
            Self::Text(_) | Self::Level(_) => None,
            Self::Value(name) | Self::Choice { name, .. } => Some(name),
        }
    }
}

/// An argument with its places filled; `None` where it is left out.
fn fill(pieces: &[Piece], configuration: &Configuration, level: Option<&str>) -> Option<String> {
    let mut text = String::new();
    for piece in pieces {
        match piece {
            Piece::Text(piece) => text.push_str(piece),
            Piece::Level(full) => text.push_str(level.unwrap_or(full)),
            Piece::Value(name) => text.push_str(&configuration.get(name)?.to_string()),
            Piece::Choice { name, yes, no } => match configuration.get(name)? {
                Value::Boolean(true) => text.push_str(yes),
                _ => text.push_str(no),
            },
        }
    }
    let has_choice = pieces.iter().any(|piece| matches!(piece, Piece::Choice { .. }));
    (!has_choice || !text.is_empty()).then_some(text)
}

fn pieces(argument: &str, names: &[&str], has_levels: bool) -> Vec<Piece> {
    let mut found = Vec::new();
    let mut text = String::new();
    let mut rest = argument;
    while let Some(open) = rest.find('{') {
        text.push_str(&rest[..open]);
        let after = &rest[open + 1..];
        if let Some((literal, end)) = after.strip_prefix('{').and_then(|after| literal(after, names)) {
            text.push_str(&format!("{{{literal}}}"));
            rest = end;
        } else if let Some((piece, end)) = place(after, names, has_levels) {
            if !text.is_empty() {
                found.push(Piece::Text(std::mem::take(&mut text)));
            }
            found.push(piece);
            rest = end;
        } else {
            text.push('{');
            rest = after;
        }
    }
    text.push_str(rest);
    if !text.is_empty() || found.is_empty() {
        found.push(Piece::Text(text));
    }
    found
}

/// The name in `name}}`, and what follows.
fn literal<'a>(after: &'a str, names: &[&str]) -> Option<(&'a str, &'a str)> {
    let end = after.find("}}")?;
    is_name(&after[..end], names).then(|| (&after[..end], &after[end + 2..]))
}

/// `name}`, `name?yes:no}` or the level, and what follows.
fn place<'a>(after: &'a str, names: &[&str], has_levels: bool) -> Option<(Piece, &'a str)> {
    let end = after.find('}')?;
    let (inner, rest) = (&after[..end], &after[end + 1..]);
    let (word, full) = inner.split_once(':').unwrap_or((inner, Fidelity::FULL));
    if word == LEVEL && !names.contains(&LEVEL) {
        // Without levels it is a mistake, like the place of an unknown parameter.
        let piece = if has_levels { Piece::Level(full.to_owned()) } else { Piece::Value(word.to_owned()) };
        return Some((piece, rest));
    }
    let piece = match inner.split_once('?') {
        None if is_name(inner, names) => Piece::Value(inner.to_owned()),
        Some((name, choice)) if is_name(name, names) => {
            let (yes, no) = choice.split_once(':').unwrap_or((choice, ""));
            Piece::Choice { name: name.to_owned(), yes: yes.to_owned(), no: no.to_owned() }
        }
        _ => return None,
    };
    Some((piece, rest))
}

/// Whether it is a parameter, or meant for one: `${HOME}` and `{.Name}` are other programs' own.
fn is_name(text: &str, names: &[&str]) -> bool {
    let is_plain = |each: char| each.is_ascii_lowercase() || each.is_ascii_digit() || each == '_';
    names.contains(&text)
        || text.starts_with(|first: char| first.is_ascii_lowercase()) && text.chars().all(is_plain)
}

#[cfg(test)]
mod tests {
    use super::*;
    use treewright_client::Space;

    fn spec() -> StudySpec {
        let space = Space::builder().integer("level", 1..=19).default(3).boolean("long").default(false);
        let space =
            space.integer("window", 10..=27).default(20).active_if("long", [true]).build().expect("a space");
        StudySpec::builder(space).minimise("wall_ms", 1.0).build().expect("a study")
    }

    fn filled(command: &[&str], configuration: Configuration) -> Vec<String> {
        let command: Vec<String> = command.iter().map(|&text| text.to_owned()).collect();
        Template::read(&command, &spec()).expect("a command").fill(&configuration, None)
    }

    #[test]
    fn places_are_filled_and_what_has_no_meaning_is_left_out() {
        let command =
            ["zstd", "-{level}", "{long?--long}", "{long?:--short}", "--window={window}", "", "a b"];
        let short = Configuration::new().with("level", 5).with("long", false);
        assert_eq!(filled(&command, short), ["zstd", "-5", "--short", "", "a b"]);
        let long = Configuration::new().with("level", 5).with("long", true).with("window", 22);
        assert_eq!(filled(&command, long), ["zstd", "-5", "--long", "--window=22", "", "a b"]);
    }

    #[test]
    fn other_braces_are_what_they_are() {
        let some = Configuration::new().with("level", 5);
        let awk = ["awk", "{print $1}", "{\"a\":{\"b\":1}}", "${HOME}", "{", "}", "{{level}}{level}"];
        let want = ["awk", "{print $1}", "{\"a\":{\"b\":1}}", "${HOME}", "{", "}", "{level}5"];
        assert_eq!(filled(&awk, some), want);
        let space = Space::builder().integer("learning-rate", 1..=9).default(3).build().expect("a space");
        let spec = StudySpec::builder(space).minimise("wall_ms", 1.0).build().expect("a study");
        let command = ["{learning-rate} {learning-date}".to_owned()];
        let template = Template::read(&command, &spec).expect("a command");
        let filled = template.fill(&Configuration::new().with("learning-rate", 5), None);
        assert_eq!(filled, ["5 {learning-date}"]);
        assert_eq!(super::super::program::variable("P_", "learning-rate.ä"), "P_LEARNING_RATE__");
    }

    #[test]
    fn the_level_has_its_place_where_there_are_some() {
        let command = ["render", "--spp={fidelity:256}", "{fidelity}", "{{fidelity}}"].map(str::to_owned);
        let studies = |name: &str| {
            let space = Space::builder().integer(name, 1..=9).default(3).build().expect("a space");
            StudySpec::builder(space).minimise("wall_ms", 1.0)
        };
        let configuration = Configuration::new().with("level", 5).with("fidelity", 7);
        let filled = |spec: &StudySpec, level: Option<&str>| {
            let template = Template::read(&command, spec).expect("a command");
            (template.has_level(), template.fill(&configuration, level)[1..].join(" "))
        };
        let some = studies("level").fidelity("16", 0.1).build().expect("a study");
        assert_eq!(filled(&some, Some("16")), (true, "--spp=16 16 {fidelity}".to_owned()));
        assert_eq!(filled(&some, None), (true, "--spp=256 full {fidelity}".to_owned()));
        let taken = studies("fidelity").fidelity("16", 0.1).build().expect("a study");
        assert_eq!(filled(&taken, Some("16")), (false, "--spp={fidelity:256} 7 {fidelity}".to_owned()));
        let none = studies("level").build().expect("a study");
        assert!(Template::read(&command, &none).expect_err("no levels").contains("no cheaper levels"));
        let with_text = Template::read(&["x".into(), "{fidelity:256}".into()], &none);
        assert!(with_text.expect_err("no levels").contains("no cheaper levels"));
    }

    #[test]
    fn unknown_and_unused_parameters_are_named() {
        let command = ["zstd".to_owned(), "-{depth}".to_owned()];
        let problem = Template::read(&command, &spec()).expect_err("no such parameter");
        assert!(problem.contains("{depth}") && problem.contains("level, long, window"), "{problem}");
        let template = Template::read(&["zstd".into(), "-{level}".into()], &spec()).expect("a command");
        assert_eq!(template.unused(&spec()), ["long", "window"]);
    }
}
