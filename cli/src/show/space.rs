//! The difference of two spaces in words, and the effect of a change.

use treewright_client::{ChangedSpace, Configuration, Parameter, Space};

/// The differences of two spaces, a line for each: what comes (`+`), what goes (`-`), what changes (`~`).
/// `fixed` has the values that differ from the defaults for parameters that come or go.
pub(crate) fn differences(from: &Space, to: &Space, fixed: &Configuration) -> Vec<String> {
    let held = |parameter: &Parameter| fixed.get(&parameter.name).unwrap_or(&parameter.default).to_string();
    let mut lines = Vec::new();
    for parameter in to.parameters() {
        let name = &parameter.name;
        match from.parameter(name) {
            None => lines.push(format!(
                "+ {name}: {}; earlier trials count with {}",
                described(parameter),
                held(parameter)
            )),
            Some(before) if before != parameter => {
                lines.push(format!("~ {name}: {} -> {}", described(before), described(parameter)));
            }
            Some(_) => {}
        }
    }
    let gone = from.parameters().iter().filter(|parameter| to.parameter(&parameter.name).is_none());
    lines.extend(gone.map(|parameter| {
        format!("- {}: trials with another value than {} are left out", parameter.name, held(parameter))
    }));
    let added = to.constraints().iter().filter(|constraint| !from.constraints().contains(constraint));
    lines.extend(added.map(|constraint| format!("+ always {constraint}")));
    let removed = from.constraints().iter().filter(|constraint| !to.constraints().contains(constraint));
    lines.extend(removed.map(|constraint| format!("- always {constraint}")));
    if lines.is_empty() && from != to {
        lines.push("~ equal parameters and constraints, in another order".to_owned());
    }
    lines
}

fn described(parameter: &Parameter) -> String {
    let condition = parameter.active_if.as_ref().map(|condition| format!(", only if {condition}"));
    let setup = if parameter.setup { ", needs a set-up" } else { "" };
    format!("{}, default {}{}{setup}", parameter.domain, parameter.default, condition.unwrap_or_default())
}

/// The effect of a change, or of one that is only tried.
pub(crate) fn changed(differences: &[String], changed: &ChangedSpace, is_done: bool) -> String {
    let ChangedSpace { study, kept_trials, outside_trials, given_back_trials } = changed;
    let effect = format!(
        "{kept_trials} completed trial(s) stay, {outside_trials} are left out, {given_back_trials} running are \
         given back"
    );
    let end = match (differences.is_empty(), is_done) {
        (true, _) => format!("{} has this space already", study.name),
        (false, true) => format!("{} has revision {} of its space", study.name, study.space_revision),
        (false, false) => "nothing is changed yet; add --yes to change it".to_owned(),
    };
    let lines = differences.iter().map(String::as_str);
    lines.chain([effect.as_str(), end.as_str()]).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_goes_and_changes_is_named() {
        let before = Space::builder().integer("level", 1..=19).default(3).boolean("long").default(false);
        let before = before.constraint("level <= 19 or long").build().expect("a space");
        let after = Space::builder().integer("level", 1..=22).default(3).integer("threads", 1..=8).default(1);
        let after = after.build().expect("a space");
        let found = differences(&before, &after, &Configuration::new().with("long", true));
        assert_eq!(
            found,
            [
                "~ level: a whole number from 1 to 19, default 3 -> a whole number from 1 to 22, default 3",
                "+ threads: a whole number from 1 to 8, default 1; earlier trials count with 1",
                "- long: trials with another value than true are left out",
                "- always level <= 19 or long",
            ]
        );
        assert!(differences(&after, &after, &Configuration::new()).is_empty());
        let turned =
            Space::builder().integer("threads", 1..=8).default(1).integer("level", 1..=22).default(3);
        let turned = turned.build().expect("a space");
        // It is another space to programs, and to the study's searches.
        assert_eq!(differences(&after, &turned, &Configuration::new()).len(), 1);
    }
}
