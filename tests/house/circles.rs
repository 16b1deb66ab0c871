//! Modules of a crate import in one direction: no two modules side by side, with everything below them, need
//! each other.
//!
//! Imports between a module and those above it do not count: a folder's `mod.rs` may name its parts, and the
//! parts may use its items.

use std::collections::{BTreeMap, BTreeSet};

use super::tidiness::rust_files;

/// The sources of programs and libraries.
pub(crate) const CRATES: &str = "model/src proto/src server/core/src server/store/src server/src client/src \
    cli/src server/figures/src renderer/accel/src renderer/indicators/src renderer/scene/src renderer/src \
    renderer/cli/src lab/src tests/simulation/src";

/// A module's path below the root of its crate.
type Module = Vec<String>;

/// Which module each file holds; `None` for tests.
fn module_of(path: &str) -> Option<Module> {
    let mut parts: Module = path.trim_end_matches(".rs").split('/').map(str::to_owned).collect();
    let is_test = |part: &String| part == "tests" || part.ends_with("_tests") || part == "testing";
    if parts.iter().any(is_test) {
        return None;
    }
    if parts.last().is_some_and(|last| last == "mod")
        || parts.len() == 1 && ["lib", "main"].contains(&&*parts[0])
    {
        parts.pop();
    }
    Some(parts)
}

/// The code without comments and without the unit tests at its end.
fn code(text: &str) -> String {
    let text =
        text.find("#[cfg(test)]\nmod ").or(text.find("#[cfg(test)]\npub")).map_or(text, |at| &text[..at]);
    text.lines().map(|line| line.find("//").map_or(line, |at| &line[..at])).collect::<Vec<_>>().join("\n")
}

/// The paths that a tree of `use` names, each as its words.
fn expand(prefix: &[String], tree: &str, found: &mut Vec<Module>) {
    let tree = tree.trim();
    let words = |text: &str| -> Module {
        text.split("::").map(|word| word.trim().to_owned()).filter(|word| !word.is_empty()).collect()
    };
    let Some((base, inner)) = tree.split_once('{') else {
        let path = tree.split(" as ").next().unwrap_or(tree);
        found.push([prefix, &words(path)].concat());
        return;
    };
    let prefix = [prefix, &words(base)].concat();
    let (mut depth, mut begin) = (0, 0);
    let inner = inner.strip_suffix('}').unwrap_or(inner);
    for (at, character) in inner.char_indices() {
        match character {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                expand(&prefix, &inner[begin..at], found);
                begin = at + 1;
            }
            _ => {}
        }
    }
    if !inner[begin..].trim().is_empty() {
        expand(&prefix, &inner[begin..], found);
    }
}

/// Every path that a module's code names: in `use`, and in full.
fn paths(code: &str) -> Vec<Module> {
    let mut found = Vec::new();
    let mut rest = code;
    while let Some(at) = rest.find("use ") {
        let is_word = rest[..at].chars().next_back().is_none_or(|before| before.is_whitespace());
        let end = rest[at..].find(';').map_or(rest.len(), |end| at + end);
        if is_word {
            expand(&[], &rest[at + 4..end], &mut found);
        }
        rest = &rest[if is_word { end } else { at + 4 }..];
    }
    for start in ["crate::", "super::", "self::"] {
        for (at, _) in code.match_indices(start) {
            let path: String =
                code[at..].chars().take_while(|c| c.is_alphanumeric() || "_:".contains(*c)).collect();
            expand(&[], &path, &mut found);
        }
    }
    found
}

/// The module that a path leads into, as seen from `own`: the longest that there is.
fn resolve(own: &Module, path: &[String], modules: &BTreeSet<Module>) -> Option<Module> {
    let (mut base, mut path) = (own.clone(), path);
    match path.first()?.as_str() {
        "crate" => (base, path) = (Module::new(), &path[1..]),
        "self" => path = &path[1..],
        "super" => {
            while path.first().is_some_and(|word| word == "super") {
                base.pop();
                path = &path[1..];
            }
        }
        first => {
            base.push(first.to_owned());
            if !modules.contains(&base) {
                return None;
            }
            base.pop();
        }
    }
    let full = [base, path.to_vec()].concat();
    (0..=full.len()).rev().map(|length| full[..length].to_vec()).find(|module| modules.contains(module))
}

/// The modules of the crate that each module needs, without those above it.
fn needs(root: &str) -> BTreeMap<Module, BTreeSet<Module>> {
    let files: BTreeMap<Module, String> = rust_files()
        .filter_map(|file| {
            let below = file.path.strip_prefix(root)?.strip_prefix('/')?.to_owned();
            Some((module_of(&below)?, code(&file.text)))
        })
        .collect();
    assert!(!files.is_empty(), "{root} has no sources");
    let modules: BTreeSet<Module> = files.keys().cloned().collect();
    let needs = files.iter().map(|(own, code)| {
        let named = paths(code).into_iter().filter_map(|path| resolve(own, &path, &modules));
        (own.clone(), named.filter(|other| !own.starts_with(other)).collect())
    });
    needs.collect()
}

fn reached(from: &Module, needs: &BTreeMap<Module, BTreeSet<Module>>) -> BTreeSet<Module> {
    let (mut reached, mut open) = (BTreeSet::new(), vec![from]);
    while let Some(module) = open.pop() {
        for next in &needs[module] {
            if reached.insert(next.clone()) {
                open.push(next);
            }
        }
    }
    reached
}

/// The circles of a crate, each as the modules in it.
fn circles(root: &str) -> BTreeSet<Vec<String>> {
    let needs = needs(root);
    let all: BTreeMap<&Module, BTreeSet<Module>> =
        needs.keys().map(|module| (module, reached(module, &needs))).collect();
    let of = |module: &&Module| {
        let together = all[*module].iter().filter(|other| all[other].contains(*module));
        let names: BTreeSet<String> = together.map(|other| other.join("::")).collect();
        names.into_iter().collect::<Vec<_>>()
    };
    all.keys().map(of).filter(|circle| circle.len() > 1).collect()
}

#[test]
fn trees_of_use_are_read_rightly() {
    let of = |text| paths(text).iter().map(|path| path.join("::")).collect::<Vec<_>>();
    assert_eq!(of("use a::{b, c::{d as e, self}};"), ["a::b", "a::c::d", "a::c::self"]);
    assert_eq!(of("pub(crate) use super::x;\nfn reuse (y: z) {}"), ["super::x", "super::x"]);
    assert_eq!(of("fn f() { crate::g::h(1) }"), ["crate::g::h"]);
    let modules: BTreeSet<Module> =
        ["", "a", "a/b", "c"].map(|path| module_of(&format!("{path}/mod.rs")).expect("no test")).into();
    let modules = modules.into_iter().map(|mut module| {
        module.retain(|word| !word.is_empty());
        module
    });
    let modules: BTreeSet<Module> = modules.collect();
    let to = |from: &[&str], path: &[&str]| {
        let words = |path: &[&str]| path.iter().map(|word| (*word).to_owned()).collect::<Module>();
        resolve(&words(from), &words(path), &modules).map(|module| module.join("::"))
    };
    assert_eq!(to(&["a", "b"], &["super", "super", "c", "Type"]).as_deref(), Some("c"));
    assert_eq!(to(&["a"], &["b", "Type"]).as_deref(), Some("a::b"));
    assert_eq!(to(&["c"], &["crate", "a", "b"]).as_deref(), Some("a::b"));
    assert_eq!(to(&["c"], &["std", "fmt"]), None);
}

#[test]
fn modules_beside_each_other_do_not_need_each_other() {
    for root in CRATES.split(' ') {
        let found = circles(root);
        assert!(found.is_empty(), "{root} has circles: {found:#?}");
    }
}
