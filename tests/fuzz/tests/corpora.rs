//! Runs every kept input without a fuzzer: none of them may find a defect any more.

use std::path::Path;

use prost::Message as _;
use treewright_fuzz::{TARGETS, target};
use treewright_store::filter::{Filter, Order};

#[test]
fn nothing_that_is_kept_finds_anything() {
    for name in TARGETS {
        let run = target(name).expect("a target");
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(name);
        let mut inputs = 0;
        for entry in std::fs::read_dir(&folder).expect("the corpus is kept") {
            let entry = entry.expect("a file");
            println!("{}", entry.path().display());
            let bytes = std::fs::read(entry.path()).expect("a file");
            run(&bytes);
            if entry.file_name().to_string_lossy().starts_with("seed-") {
                assert_valid(name, &bytes);
            }
            inputs += 1;
        }
        assert!(inputs > 0, "{name} has no corpus");
    }
}

/// A seed is taken as it is meant.
fn assert_valid(target: &str, bytes: &[u8]) {
    match target {
        "filters" => {
            let text = std::str::from_utf8(bytes).expect("text");
            assert!(Filter::parse(text).is_ok() || Order::parse(text).is_ok(), "{text}");
        }
        "studies" => {
            let study = treewright_proto::v1::Study::decode(&bytes[8..]).expect("a message");
            treewright_server::convert::from_proto::study(study).expect("a valid specification");
        }
        "scenes" => {
            let ending = [".glb", ".gltf", ".ply", ".obj"][usize::from(bytes[0])];
            let file = tempfile::Builder::new().suffix(ending).tempfile().expect("a scratch file");
            std::fs::write(file.path(), &bytes[1..]).expect("room");
            treewright_scene::load(file.path()).expect("a scene");
        }
        _ => {}
    }
}
