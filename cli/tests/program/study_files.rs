//! Studies as data, over the wire of the stand-in: created from files, shown as files, copied.

use std::path::Path;

use super::{Fake, answer, run, with_trials};

const STUDY: &str = "\
[[parameters]]
name = \"level\"
type = \"integer\"
min = 1
max = 19
default = 3

[[objective]]
metric = \"render_ms\"

[policy]
epsilon = 0.25
";

fn write(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    std::fs::write(&path, text).expect("a file");
    path.to_str().expect("a path of text").to_owned()
}

#[test]
fn what_is_shown_can_be_fed_back() {
    let (fake, folder) = (Fake::start(), tempfile::tempdir().expect("a folder"));
    let file = write(folder.path(), "zstd.toml", STUDY);
    assert_eq!(answer(&fake, &["study", "create", &file]), "studies/zstd is ready\n");
    assert_eq!(answer(&fake, &["study", "create", &file]), "studies/zstd is ready\n", "it may be repeated");
    for format in ["toml", "json"] {
        let shown = answer(&fake, &["study", "show", "zstd", "--format", format]);
        let again = write(folder.path(), &format!("again.{format}"), &shown);
        let id = format!("zstd-{format}");
        answer(&fake, &["study", "create", &again, "--id", &id]);
        let book = fake.book();
        let (one, other) = (&book.studies["studies/zstd"], &book.studies[&format!("studies/{id}")]);
        assert_eq!(
            (&one.space, &one.objective, &one.policy),
            (&other.space, &other.objective, &other.policy)
        );
    }
}

#[test]
fn mistakes_in_files_are_named() {
    let (fake, folder) = (Fake::start(), tempfile::tempdir().expect("a folder"));
    let problem = |text: &str, said: &[&str]| {
        let file = write(folder.path(), "bad.toml", text);
        let output = run(&fake, &["study", "create", &file]);
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && said.iter().all(|part| words.contains(part)), "{words}");
    };
    problem(&STUDY.replace("default = 3", "default = 30"), &["level", "1 to 19"]);
    problem(&STUDY.replace("min = 1", "mini = 1"), &["bad.toml", "mini"]);
    problem(&STUDY.replace("epsilon = 0.25", "epsilon = 2"), &["epsilon", "between 0 and 1"]);
    problem("", &["parameters"]);
    assert!(fake.book().studies.is_empty());
}

#[test]
fn a_change_is_shown_and_made_once_it_is_confirmed() {
    let (fake, folder) = (Fake::start(), tempfile::tempdir().expect("a folder"));
    let file = write(folder.path(), "zstd.toml", STUDY);
    answer(&fake, &["study", "create", &file]);
    let long = "[[parameters]]\nname = \"long\"\ntype = \"boolean\"\ndefault = false\n\n[[objective]]";
    let more = STUDY.replace("max = 19", "max = 22").replace("[[objective]]", long);
    let more = write(folder.path(), "more.toml", &more);
    let revision = |fake: &Fake| fake.book().studies["studies/zstd"].space_revision;
    let shown = answer(&fake, &["study", "edit", "zstd", &more]);
    assert!(shown.contains("~ level: a whole number from 1 to 19, default 3 -> "), "{shown}");
    assert!(shown.contains("+ long: ") && shown.contains("add --yes"), "{shown}");
    assert_eq!(revision(&fake), 1);
    let done = answer(&fake, &["study", "edit", "zstd", &more, "--fixed", "long=true", "--yes"]);
    assert!(done.contains("count with true") && done.contains("has revision 2 of its space"), "{done}");
    assert_eq!(revision(&fake), 2);
    answer(&fake, &["suggest", "zstd"]);
    assert_eq!(fake.book().revisions, [2], "it is answered in the space whose names it prints");
    assert!(answer(&fake, &["study", "edit", "zstd", &more]).contains("has this space already"));
    let words_of = |text: &str| {
        let output = run(&fake, &["study", "edit", "zstd", &write(folder.path(), "kept.toml", text)]);
        assert!(output.status.success());
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let words = words_of(&format!("note = \"x\"\n{}", STUDY.replace("epsilon = 0.25", "epsilon = 0.5")));
    assert!(words.contains("policy.epsilon, note: not as in studies/zstd"), "{words}");
    assert!(words.contains("`treewright policy zstd`") && words.contains("--note"), "{words}");
    assert_eq!(words_of(STUDY), "");
    assert_eq!(words_of(&STUDY.replace("epsilon = 0.25", "")), "", "what a file leaves out stays");
    let other = STUDY.replace("render_ms", "bytes");
    let output = run(&fake, &["study", "edit", "zstd", &write(folder.path(), "other.toml", &other)]);
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && words.contains("objective: not as in studies/zstd"), "{words}");
}

#[test]
fn notes_and_tags_are_edited_and_find_studies() {
    let (fake, folder) = (with_trials(), tempfile::tempdir().expect("a folder"));
    let edited = answer(&fake, &["study", "edit", "sponza", "--note", "at\nnight", "--tag", "gpu,b"]);
    assert_eq!(edited, "studies/sponza  a scene\n  at\n  night\ntagged b, gpu\n");
    let edited = answer(&fake, &["study", "edit", "sponza", "--tag", "c", "--untag", "b", "--untag", "d"]);
    assert!(edited.ends_with("night\ntagged c, gpu\n"), "{edited}");
    let edited = answer(&fake, &["study", "edit", "sponza", "--display-name", "a hall"]);
    assert!(edited.starts_with("studies/sponza  a hall\n  at\n") && edited.contains("c, gpu"), "{edited}");
    let shown = answer(&fake, &["study", "show", "sponza"]);
    assert!(shown.starts_with(&edited), "{shown}");
    answer(&fake, &["study", "clone", "sponza", "copy"]);
    assert_eq!(fake.book().studies["studies/copy"].note, "at\nnight");
    assert_eq!(fake.book().studies["studies/copy"].tags, ["c", "gpu"]);
    answer(&fake, &["study", "delete", "copy", "--yes"]);
    let file = write(folder.path(), "zstd.toml", STUDY);
    answer(&fake, &["study", "create", &file]);
    let listed = |tags: &str| answer(&fake, &["studies", "--tag", tags]);
    assert!(listed("gpu,c").contains("c, gpu") && !listed("gpu").contains("zstd"));
    assert_eq!(listed("gpu,b"), "no study is tagged gpu, b\n");
    assert_eq!(answer(&fake, &["studies", "--tag", "b", "--json"]).trim(), "[]");
    for wrong in [&["--note", "x", &file][..], &["--tag", "x", "--yes"], &[]] {
        let output = run(&fake, &[&["study", "edit", "sponza"][..], wrong].concat());
        assert_eq!(output.status.code(), Some(2), "{wrong:?}");
    }
}

#[test]
fn a_copy_has_the_trials_and_the_rest_of_what_was_learnt() {
    let fake = with_trials();
    let cloned = answer(&fake, &["study", "clone", "sponza", "copy"]);
    assert_eq!(cloned, "copy: 5 trial(s) added, 0 already known\n");
    assert_eq!(fake.book().studies.len(), 2);
    let there = run(&fake, &["study", "clone", "sponza", "copy"]);
    assert!(String::from_utf8_lossy(&there.stderr).contains("already exists"));
    let spec = answer(&fake, &["study", "show", "sponza", "--format", "toml"]);
    let folder = tempfile::tempdir().expect("a folder");
    let more = spec.replacen(
        "[[objective]]",
        "[[indicators]]\nname = \"lights\"\nmin = 0\nmax = 9\n\n[[objective]]",
        1,
    );
    let file = write(folder.path(), "more.toml", &more);
    let without = answer(&fake, &["study", "clone", "sponza", "more", "--spec", &file]);
    assert!(without.contains("do not fit") && without.contains("--indicator lights="), "{without}");
}

#[test]
fn the_schema_is_printed_without_a_daemon() {
    let output = super::treewright().args(["study", "schema"]).output().expect("the program starts");
    let schema: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert!(schema["properties"]["parameters"].is_object());
}
