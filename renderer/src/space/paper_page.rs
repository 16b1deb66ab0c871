//! The tables of `docs/paper.md` on paper and project, written from the code and compared with it.

use std::fmt::Write as _;

use treewright_client::Policy;
use treewright_scene::indicators::{IndicatorScale, SCHEMA};

use super::{Recommendation, TuningSpace};

/// The paper's Table 1 and section 3.1: name, range, recommended value.
const TABLE_1: [(&str, &str, &str); 11] = [
    ("compact", "switch", "false"),
    ("robust", "switch", "false"),
    ("quality", "1 to 3", "2"),
    ("branching_factor", "2, 4, 8", "2"),
    ("max_depth", "–", "32"),
    ("sah_block_size", "1 to 32", "1"),
    ("min_leaf_size", "to 64 in Figure 5", "1"),
    ("max_leaf_size", "to 64 in Figure 5", "32"),
    ("traversal_cost", "0 to 10", "1.0"),
    ("intersection_cost", "0 to 10", "1.0"),
    ("static", "switch", "false"),
];

/// The paper's Table 2, in the order of the schema.
const TABLE_2: [&str; 17] = [
    "0 to 1e5",
    "0 to 1e7",
    "0 to 1e5",
    "-10 to 10",
    "-10 to 10",
    "-10 to 10",
    "-10 to 10",
    "-10 to 10",
    "-10 to 10",
    "0 to 180",
    "0 to 1",
    "0 to 1e5",
    "0 to 10",
    "0 to 10",
    "0 to 10",
    "0 to 1e-2",
    "0 to 1e-2",
];

fn narrowed(recommendation: Recommendation, name: &str) -> String {
    let all = recommendation.narrowings();
    let found = all.iter().find(|one| one.name() == name);
    found.map_or(String::new(), |one| one.to_string().replace("..", " to ").replace(&format!("{name}="), ""))
}

fn tables() -> String {
    let space = TuningSpace::paper();
    let mut text = String::from(
        "\n| parameter | paper | recommended | `--space paper` | exists while | `paper-render` | `paper-total` |\n\
         |---|---|---|---|---|---|---|\n",
    );
    for (one, (name, range, default)) in space.explained().zip(TABLE_1) {
        let parameter = &one.parameter;
        assert_eq!((parameter.name.as_str(), parameter.default.to_string().as_str()), (name, default));
        let condition = parameter.active_if.as_ref().map_or(String::new(), ToString::to_string);
        let render = narrowed(Recommendation::Render, name);
        let total = narrowed(Recommendation::Total, name);
        let domain = &parameter.domain;
        writeln!(text, "| `{name}` | {range} | {default} | {domain} | {condition} | {render} | {total} |")
            .expect("text");
    }
    text += "\n| indicator | paper | here | scale |\n|---|---|---|---|\n";
    for (spec, paper) in SCHEMA.iter().zip(TABLE_2) {
        let scale = if matches!(spec.scale, IndicatorScale::Log) { "logarithmic" } else { "linear" };
        let (least, most) = (spec.min, spec.max);
        let most = if most >= 1e5 { format!("{most:e}") } else { most.to_string() };
        writeln!(text, "| `{}` | {paper} | {least} to {most} | {scale} |", spec.name).expect("text");
    }
    text += "\n| policy | `--preset paper` | default |\n|---|---|---|\n";
    let paper = Policy::paper();
    for field in Policy::FIELDS {
        if let Some(value) = paper.show(field.name) {
            writeln!(text, "| `{}` | {value} | {} |", field.name, field.unset).expect("text");
        }
    }
    text + "\n"
}

#[test]
fn the_page_on_the_paper_tells_what_the_code_has() {
    const BEGIN: &str = "<!-- from the code -->\n";
    const END: &str = "<!-- end of what is from the code -->\n";
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/paper.md");
    let page = std::fs::read_to_string(path).expect("the page");
    let (before, rest) = page.split_once(BEGIN).expect("the begin of the tables");
    let (on_page, after) = rest.split_once(END).expect("the end of the tables");
    let tables = tables();
    if std::env::var_os("TREEWRIGHT_WRITE_DOCS").is_some() {
        std::fs::write(path, format!("{before}{BEGIN}{tables}{END}{after}")).expect("written");
        return;
    }
    assert!(
        on_page == tables,
        "docs/paper.md is old: TREEWRIGHT_WRITE_DOCS=1 cargo test --workspace --lib page_on_the_paper writes it"
    );
}
