//! One word, one meaning: in a crate, no two types that are seen beyond their files have one name, and
//! verdicts have one wording on all surfaces.

use std::collections::BTreeMap;

use treewright_client::{StandingVerdict, Word as _};
use treewright_tests::programs::workspace;

use super::circles::CRATES;
use super::tidiness::rust_files;

/// Names of one thing in several forms: the blocking SDK beside the asynchronous one, vectors of each
/// instruction set, stand-ins for features that are left out, and the arguments of each command.
const FORMS: &[(&str, &[&str])] = &[
    ("client/src", &["Client", "PrefetchingTuner", "Study", "Tuner"]),
    ("renderer/accel/src", &["Eight", "Four", "Sixteen", "Two"]),
    ("server/src", &["Traces"]),
    ("renderer/cli/src", &["Arguments"]),
];

/// The types that a file declares for others to see: its items of the outermost level that are public in any
/// way.
fn declared(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter_map(|line| {
        let rest = line.strip_prefix("pub")?;
        let rest = rest.strip_prefix('(').map_or(Some(rest), |inner| Some(inner.split_once(')')?.1))?;
        let rest = rest.strip_prefix(' ')?;
        let (kind, name) = rest.split_once(' ')?;
        ["struct", "enum", "trait", "type", "union"].contains(&kind).then(|| {
            name.split(|character: char| !character.is_alphanumeric() && character != '_')
                .next()
                .unwrap_or(name)
        })
    })
}

#[test]
fn a_name_means_one_type_in_a_crate() {
    let all = "pub struct A;\npub(crate) enum B<T> {\npub(in crate::x) trait C: D {\nstruct E;\n    pub struct F;\npub fn g() {}\n";
    assert_eq!(declared(all).collect::<Vec<_>>(), ["A", "B", "C"]);
    let mut problems = Vec::new();
    // Each experiment of the laboratory has words of its own.
    for root in CRATES.split(' ').filter(|root| *root != "lab/src") {
        let forms = FORMS.iter().find(|(of, _)| *of == root).map_or(&[][..], |(_, names)| names);
        let mut places: BTreeMap<String, Vec<String>> = BTreeMap::new();
        let is_of = |path: &str| {
            let below = path.strip_prefix(root).is_some_and(|below| below.starts_with('/'));
            below && !path.contains("/tests") && !path.ends_with("tests.rs") && !path.ends_with("testing.rs")
        };
        for file in rust_files().filter(|file| is_of(&file.path)) {
            for name in declared(&file.text) {
                places.entry(name.to_owned()).or_default().push(file.path.clone());
            }
        }
        assert!(!places.is_empty(), "{root} declares nothing");
        places.retain(|name, places| places.len() > 1 && !forms.contains(&name.as_str()));
        problems.extend(places.into_iter().map(|(name, places)| format!("{name}: {}", places.join(", "))));
    }
    assert!(problems.is_empty(), "rename all but one, or say why not in FORMS: {problems:#?}");
}

/// Surfaces that cannot take the words from the model's table.
#[test]
fn verdicts_have_the_words_of_the_one_table() {
    for place in [
        "docs/concepts.md",
        "integrations/c/include/treewright.h",
        "integrations/javascript/src/index.d.ts",
        "integrations/javascript/src/wire.js",
    ] {
        let text = std::fs::read_to_string(workspace().join(place)).expect("a file of the workspace");
        for (verdict, _) in StandingVerdict::WORDS {
            assert!(text.contains(verdict.in_short()), "{place} lacks {:?}", verdict.in_short());
        }
    }
}
