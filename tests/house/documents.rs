//! The documentation: the summary names every page, every link leads somewhere, the programs know every
//! command that is shown, and the API's reference agrees with the comments of the contract.

use std::collections::BTreeSet;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use treewright_tests::programs::{program, workspace};

/// Largest sizes of the front page and of a page of measurements, in bytes.
const README_BYTES: usize = 9_000;
const MEASUREMENT_BYTES: usize = 4_096;

/// The pages of the book, in `docs` and `docs/measurements`.
fn pages() -> Vec<PathBuf> {
    let folders = ["docs", "docs/measurements"].map(|folder| workspace().join(folder));
    let entries = folders.iter().flat_map(|folder| std::fs::read_dir(folder).expect("the documentation"));
    let mut found: Vec<_> = entries.map(|entry| entry.expect("an entry").path()).collect();
    found.retain(|path| path.extension().is_some_and(|extension| extension == "md"));
    found.sort();
    found
}

#[test]
fn the_front_page_and_the_measurements_are_short() {
    let mut limits = vec![(workspace().join("README.md"), README_BYTES)];
    let measurements = pages()
        .into_iter()
        .filter(|page| page.parent().is_some_and(|folder| folder.ends_with("measurements")));
    limits.extend(measurements.map(|page| (page, MEASUREMENT_BYTES)));
    let long = limits.iter().filter(|(page, most)| read(page).len() > *most).collect::<Vec<_>>();
    assert!(limits.len() > 1, "the pages were not found");
    assert!(long.is_empty(), "longer than they may be: {long:#?}");
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|problem| panic!("{}: {problem}", path.display()))
}

/// The text outside of code.
fn prose(text: &str) -> String {
    let mut inside = false;
    let lines = text.lines().filter(|line| {
        let fence = line.trim_start().starts_with("```");
        inside ^= fence;
        !inside && !fence
    });
    // Every second part between backticks is code.
    let lines: Vec<String> =
        lines.map(|line| line.split('`').step_by(2).collect::<Vec<_>>().join("code")).collect();
    lines.join("\n")
}

/// The targets of links in Markdown.
fn links(text: &str) -> Vec<String> {
    let parts = text.split("](").skip(1);
    parts.filter_map(|part| part.split_once(')')).map(|(target, _)| target.to_owned()).collect()
}

/// The anchor of a heading in links.
fn anchor(heading: &str) -> String {
    let letters = heading.trim().to_lowercase();
    let kept = letters.chars().filter(|each| each.is_alphanumeric() || matches!(each, ' ' | '-' | '_'));
    kept.map(|each| if each == ' ' { '-' } else { each }).collect()
}

fn anchors(text: &str) -> BTreeSet<String> {
    text.lines()
        .filter(|line| line.starts_with('#'))
        .map(|line| anchor(line.trim_start_matches('#')))
        .collect()
}

#[test]
fn every_page_stands_in_the_summary() {
    let summary = links(&read(&workspace().join("docs/SUMMARY.md")));
    let listed: BTreeSet<_> = summary.iter().map(String::as_str).collect();
    assert_eq!(listed.len(), summary.len(), "a page stands there twice");
    let there: BTreeSet<String> = pages()
        .iter()
        .filter_map(|path| path.strip_prefix(workspace().join("docs")).ok()?.to_str().map(str::to_owned))
        .filter(|name| name != "SUMMARY.md")
        .collect();
    let there: BTreeSet<&str> = there.iter().map(String::as_str).collect();
    assert_eq!(listed, there);
}

#[test]
fn every_link_leads_somewhere() {
    let top = workspace();
    let mut files = pages();
    let outside = "README.md ARCHITECTURE.md CONTRIBUTING.md CHANGELOG.md integrations/README.md \
                   integrations/probe/README.md tests/peers/README.md";
    files.extend(outside.split(' ').map(|name| top.join(name)));
    let mut dead = Vec::new();
    for file in files {
        let text = read(&file);
        for link in links(&prose(&text)) {
            if link.contains("://") || link.starts_with("mailto:") {
                continue;
            }
            let (path, part) = link.split_once('#').unwrap_or((&link, ""));
            let target = match path {
                "" => file.clone(),
                path => file.parent().expect("a folder").join(path),
            };
            let is_there = target.exists()
                && (part.is_empty() || target.is_dir() || anchors(&read(&target)).contains(part));
            if !is_there {
                dead.push(format!("{}: {link}", file.display()));
            }
        }
    }
    assert!(dead.is_empty(), "{dead:#?}");
}

#[test]
fn links_out_of_the_book_become_names_of_files() {
    let book = r#"[{}, {"items": [
        {"Chapter": {"content": "[a](../X.md#b), [`Y`](../Y), [c](d.md)", "sub_items": []}},
        {"Chapter": {"content": "[e](../f.md#g), [h](../../i/J.md)", "path": "k/l.md", "sub_items": []}}]}]"#;
    let mut script = Command::new("python3")
        .arg(workspace().join("tools/book_links.py"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("Python is installed");
    script.stdin.take().expect("it is piped").write_all(book.as_bytes()).expect("it reads");
    let output = script.wait_with_output().expect("it ends");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains(r#""a (`X.md`), `Y`, [c](d.md)""#), "{text}");
    assert!(text.contains(r#""[e](../f.md#g), h (`i/J.md`)""#), "{text}");
}

/// The lines of a page's shell blocks, continued ones joined.
fn shell_lines(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut inside = false;
    let mut line = String::new();
    for each in text.lines() {
        if each.trim_start().starts_with("```") {
            inside = !inside && each.trim() == "```sh";
            continue;
        }
        if !inside {
            continue;
        }
        match each.strip_suffix('\\') {
            Some(begun) => line += begun,
            None => {
                line += each;
                found.push(std::mem::take(&mut line));
            }
        }
    }
    found
}

/// The program called, with its words and long options, up to `--`, a pipe, or the line's end.
fn call(line: &str) -> Option<(&'static str, Vec<String>, Vec<String>)> {
    let line = line.split(" # ").next().unwrap_or_default();
    let mut words =
        line.split(|c: char| c.is_whitespace() || "\"$()".contains(c)).filter(|word| !word.is_empty());
    let first = words.find(|word| !word.contains('=') || word.contains('/'))?;
    let known = ["treewright-render", "treewright-lab", "treewrightd", "treewright"];
    let named = known.into_iter().find(|name| first.rsplit('/').next() == Some(name))?;
    let (mut path, mut options, mut in_path) = (Vec::new(), Vec::new(), true);
    for word in words.take_while(|word| !["--", "|", "&&", ";", ">", "<", "&"].contains(word)) {
        if let Some(option) = word.strip_prefix("--") {
            let name = option.split('=').next().unwrap_or_default();
            if !name.is_empty() && name.chars().all(|c| c.is_ascii_lowercase() || c == '-') {
                options.push(name.to_owned());
            }
            in_path &= word.starts_with("--server");
        } else if in_path && word.chars().all(|c| c.is_ascii_lowercase() || c == '-') && path.len() < 2 {
            path.push(word.to_owned());
        } else if !word.contains("://") {
            in_path = false;
        }
    }
    Some((named, path, options))
}

#[test]
fn every_command_that_is_shown_is_known() {
    let help = |name: &str, path: &[String]| {
        let output = Command::new(program(name)).args(path).arg("--help").output().expect("it starts");
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
    };
    let mut problems = Vec::new();
    let mut calls = 0;
    let mut files = pages();
    files.push(workspace().join("README.md"));
    for file in files {
        for line in shell_lines(&read(&file)) {
            let Some((name, path, options)) = call(&line) else { continue };
            calls += 1;
            // The second word may be a subcommand, or something that is named.
            let text = help(name, &path).or_else(|| help(name, &path[..path.len().min(1)]));
            let Some(text) = text else {
                problems.push(format!("{}: {line}: no such command", file.display()));
                continue;
            };
            for option in options.iter().filter(|option| *option != "help" && *option != "version") {
                if !text.contains(&format!("--{option}")) {
                    problems.push(format!("{}: {line}: no --{option}", file.display()));
                }
            }
        }
    }
    assert!(calls > 20, "the commands were not found");
    assert!(problems.is_empty(), "{problems:#?}");
}

#[test]
fn every_program_writes_its_completions_and_its_manual() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().to_str().expect("a path of text");
    for name in ["treewrightd", "treewright", "treewright-render", "treewright-lab"] {
        for arguments in [["completions", "bash"], ["man", path]] {
            let output = Command::new(program(name)).args(arguments).output().expect("it starts");
            let said = String::from_utf8_lossy(&output.stdout);
            assert!(output.status.success() && said.contains(name), "{name} {arguments:?}: {said}");
        }
        assert!(folder.path().join(format!("{name}.1")).is_file(), "{name} has no manual");
    }
}

#[test]
fn the_rust_that_is_shown_is_compiled() {
    let examples =
        ["integrate", "first"].map(|name| read(&workspace().join(format!("client/examples/{name}.rs"))));
    for page in ["README.md", "client/README.md", "docs/renderer.md"] {
        let text = read(&workspace().join(page));
        let blocks: Vec<&str> =
            text.split("```rust\n").skip(1).filter_map(|rest| rest.split("```").next()).collect();
        assert!(!blocks.is_empty(), "{page} shows no Rust");
        for block in blocks {
            assert!(
                examples.iter().any(|example| example.contains(block)),
                "{page} shows other words than client/examples:\n{block}"
            );
        }
    }
}

/// The reference: what each file of the contract says of itself, its calls and its messages.
fn reference() -> String {
    let mut text = String::from(
        "# API reference\n\nMade from the comments of `proto/treewright/v1`, which are the contract; a test holds this page equal to \
         them, and\n`TREEWRIGHT_WRITE_DOCS=1 cargo test --workspace --test house reference` writes it again. The daemon serves gRPC \
         reflection, too, so\nthat `grpcurl` finds its way without any file.\n",
    );
    for name in ["tuning", "trial", "study"] {
        let proto = read(&workspace().join(format!("proto/treewright/v1/{name}.proto")));
        text += &format!("\n## {name}.proto\n");
        text += &of_file(&proto);
    }
    text
}

fn of_file(proto: &str) -> String {
    let (mut text, mut comment) = (String::new(), Vec::new());
    let mut fields: Vec<String> = Vec::new();
    for line in proto.lines().map(str::trim) {
        let words: Vec<&str> = line.split_whitespace().collect();
        if let Some(said) = line.strip_prefix("//") {
            comment.push(said.strip_prefix(' ').unwrap_or(said).to_owned());
            continue;
        }
        let said = std::mem::take(&mut comment);
        match words.as_slice() {
            [] if !said.is_empty() && text.is_empty() => text += &paragraph(&said),
            ["syntax", ..] => text += &paragraph(&said),
            [kind @ ("message" | "enum" | "service"), name, ..] => {
                text += &format!("\n### {name}\n\n*{kind}*\n{}", paragraph(&said));
                // `message Name {}` has no fields.
            }
            ["rpc", ..] => {
                let call = line.trim_start_matches("rpc ").trim_end_matches(';');
                text += &format!(
                    "\n#### {}\n\n`{call}`\n{}",
                    call.split('(').next().unwrap_or_default(),
                    paragraph(&said)
                );
            }
            ["oneof", name, ..] => fields.push(format!("| one of `{name}` | | {} |", cell(&said))),
            ["}", ..] if !fields.is_empty() => {
                text += "\n| field | number | |\n|---|---|---|\n";
                text += &(std::mem::take(&mut fields).join("\n") + "\n");
            }
            _ => {
                if let Some((field, number)) = line.split_once(" = ")
                    && let Some((number, _)) = number.split_once(';')
                    && !line.starts_with("option ")
                {
                    let number = number.split_whitespace().next().unwrap_or_default();
                    fields.push(format!("| `{field}` | {number} | {} |", cell(&said)));
                }
            }
        }
    }
    text
}

fn paragraph(said: &[String]) -> String {
    if said.is_empty() { String::new() } else { format!("\n{}\n", said.join("\n")) }
}

/// A comment in one cell of a table.
fn cell(said: &[String]) -> String {
    said.join(" ").replace('|', "\\|")
}

#[test]
fn the_reference_is_what_the_contract_says() {
    let page = workspace().join("docs/api.md");
    let reference = reference();
    for words in ["#### Suggest", "### Standing", "| `double cost_low` | 2 |", "one of `domain`"] {
        assert!(reference.contains(words), "{words}");
    }
    if std::env::var_os("TREEWRIGHT_WRITE_DOCS").is_some() {
        std::fs::write(&page, &reference).expect("it is written");
    }
    assert!(
        read(&page) == reference,
        "docs/api.md is old: TREEWRIGHT_WRITE_DOCS=1 cargo test --workspace --test house reference"
    );
}

#[test]
fn the_figures_of_the_documents_are_those_of_their_records() {
    let scripts = [
        "tools/record_tables.py",
        "tools/evaluation_tables.py",
        "tests/peers/tables.py",
        "integrations/summary.py",
    ];
    for script in scripts {
        let checked = Command::new("python3").arg(workspace().join(script)).arg("--check").output();
        let checked = checked.expect("Python is installed");
        assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
    }
}
