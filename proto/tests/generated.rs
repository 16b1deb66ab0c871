//! The Rust code of the messages and services, and their descriptors, are made from `treewright/v1/*.proto`
//! and kept beside the sources, so that building the crate needs no compiler of protocol buffers. This test
//! makes them again. Where they differ it rewrites them and fails. So a change of the contract is: edit, run
//! this test, commit.
//!
//! The values of the two enums of searches and predictors are written in this way as well, from the registry
//! of the model.

use std::path::Path;

use prost::Message as _;
use treewright_model::policy::{Method, PredictorMethod, SearchMethod};

/// Lines of the contract are no longer than this.
const WIDTH: usize = 120;

/// An enum of the contract, from the registry: `SEARCH_METHOD_NELDER_MEAD` for the word `nelder_mead`.
fn declaration<T: Method>(name: &str, prefix: &str) -> String {
    let mut rows: Vec<_> = T::REGISTERED.iter().collect();
    rows.sort_by_key(|row| row.number);
    let mut text = format!("enum {name} {{\n  {prefix}_UNSPECIFIED = 0;\n");
    for row in rows {
        let mut line = "  //".to_owned();
        for word in row.about().split(' ') {
            if line.len() + 1 + word.len() > WIDTH {
                text.push_str(&line);
                line = "\n  //".to_owned();
            }
            line.push(' ');
            line.push_str(word);
        }
        text.push_str(&format!(
            "{line}\n  {prefix}_{} = {};\n",
            row.method.word().to_uppercase(),
            row.number
        ));
    }
    if !T::RETIRED.is_empty() {
        let numbers: Vec<String> = T::RETIRED.iter().map(|(number, _)| number.to_string()).collect();
        let name = |word: &str| format!("\"{prefix}_{}\"", word.to_uppercase());
        let names: Vec<String> = T::RETIRED.iter().map(|(_, word)| name(word)).collect();
        text.push_str("  // Of earlier versions. Where they are still sent they stand for AUTO.\n");
        text.push_str(&format!("  reserved {};\n", numbers.join(", ")));
        text.push_str(&format!("  reserved\n    {};\n", names.join(",\n    ")));
    }
    text + "}\n"
}

/// The contract with an enum rewritten.
fn with_enum(contract: &str, name: &str, declaration: &str) -> String {
    let begin =
        contract.find(&format!("enum {name} {{\n")).unwrap_or_else(|| panic!("enum {name} is not there"));
    let end = begin + contract[begin..].find("\n}\n").expect("the enum ends") + 3;
    format!("{}{declaration}{}", &contract[..begin], &contract[end..])
}

#[test]
fn generated_code_is_that_of_the_proto_files() {
    let crate_folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let kept = crate_folder.join("src/generated");
    let mut changed = Vec::new();
    let contract_file = crate_folder.join("treewright/v1/study.proto");
    let contract = std::fs::read_to_string(&contract_file).expect("the contract");
    let searches = declaration::<SearchMethod>("SearchMethod", "SEARCH_METHOD");
    let predictors = declaration::<PredictorMethod>("PredictorMethod", "PREDICTOR_METHOD");
    let registered = with_enum(&contract, "SearchMethod", &searches);
    let registered = with_enum(&registered, "PredictorMethod", &predictors);
    if registered != contract {
        std::fs::write(&contract_file, registered).expect("the sources can be written");
        changed.push("treewright/v1/study.proto");
    }
    let files = protox::compile([crate_folder.join("treewright/v1/tuning.proto")], [crate_folder])
        .expect("the .proto files are well formed");
    let fresh = tempfile::tempdir().expect("a folder");
    std::fs::write(fresh.path().join("descriptor.bin"), files.encode_to_vec()).expect("a file");
    tonic_prost_build::configure()
        .btree_map(".")
        .out_dir(fresh.path())
        .compile_fds(files)
        .expect("code is generated");
    for name in ["treewright.v1.rs", "descriptor.bin"] {
        let made = std::fs::read(fresh.path().join(name)).expect("a generated file");
        if std::fs::read(kept.join(name)).ok().as_ref() != Some(&made) {
            std::fs::write(kept.join(name), made).expect("the sources can be written");
            changed.push(name);
        }
    }
    assert!(
        changed.is_empty(),
        "{changed:?} were not those of the registry and of the .proto files and have been written again: build again, \
         and commit them with the change"
    );
}
