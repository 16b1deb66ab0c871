//! What a search or a predictor is, is said in two places: the model, from which help is made, and the wire contract. Both
//! begin with the same words.

use std::collections::BTreeMap;

use treewright_tests::programs::workspace;

/// The beginning of a comment, up to the first full stop or semicolon.
fn beginning(comment: &[&str]) -> String {
    let text = comment.join(" ");
    let end = ["; ", ". "].iter().filter_map(|mark| text.find(mark)).min().unwrap_or(text.len());
    text[..end].trim_end_matches('.').to_owned()
}

/// The comments of the values of an enum: what stands before each line that `value` reads a name from.
fn comments(
    text: &str,
    from: &str,
    mark: &str,
    value: impl Fn(&str) -> Option<String>,
) -> BTreeMap<String, String> {
    let body = &text[text.find(from).unwrap_or_else(|| panic!("{from} is not there"))..];
    let body = &body[body.find('{').expect("a body")..];
    let (mut said, mut found) = (Vec::new(), BTreeMap::new());
    for line in body.lines().skip(1).map(str::trim).take_while(|line| *line != "}") {
        if let Some(comment) = line.strip_prefix(mark) {
            said.push(comment.trim());
        } else if let Some(name) = value(line) {
            found.insert(name, beginning(&std::mem::take(&mut said)));
        }
    }
    found
}

#[test]
fn the_wire_contract_says_of_each_method_what_the_model_says() {
    let read = |path: &str| std::fs::read_to_string(workspace().join(path)).expect("a source file");
    let (proto, model) = (read("proto/treewright/v1/study.proto"), read("model/src/policy/methods.rs"));
    for (name, prefix) in [("SearchMethod", "SEARCH_METHOD_"), ("PredictorMethod", "PREDICTOR_METHOD_")] {
        let of_proto = comments(&proto, &format!("enum {name} "), "//", |line| {
            let value = line.strip_prefix(prefix)?.split(' ').next()?.to_lowercase();
            (value != "unspecified").then_some(value)
        });
        let of_model = comments(&model, &format!("enum {name} "), "///", |line| {
            Some(line.split_once(" = \"")?.1.trim_end_matches(['"', ',']).to_owned())
        });
        assert!(of_model.len() > 4 && of_model.values().all(|said| !said.is_empty()), "{of_model:?}");
        assert_eq!(of_proto, of_model, "{name}");
    }
}
