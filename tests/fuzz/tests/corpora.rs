//! Runs every kept input without a fuzzer: none of them may find a defect any more.

use std::path::Path;

use prost::Message as _;
use treewright_fuzz::{TARGETS, seeds, target};
use treewright_store::filter::{Filter, Order};

#[test]
fn nothing_that_is_kept_finds_anything() {
    for name in TARGETS {
        let run = target(name).expect("a target");
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(name);
        let mut inputs = 0;
        for entry in std::fs::read_dir(&folder).expect("the corpus is kept") {
            let path = entry.expect("a file").path();
            println!("{}", path.display());
            run(&std::fs::read(&path).expect("a file"));
            inputs += 1;
        }
        assert!(inputs > 0, "{name} has no corpus");
    }
}

#[test]
fn seeds_are_taken_as_they_are_meant() {
    for (name, seed, bytes) in seeds::all() {
        target(name).expect("a target")(&bytes);
        if name == "filters" {
            let text = std::str::from_utf8(&bytes).expect("text");
            assert!(Filter::parse(text).is_ok() || Order::parse(text).is_ok(), "{seed}: {text}");
        }
        if name == "studies" {
            let study = treewright_proto::v1::Study::decode(&bytes[8..]).expect("a message");
            treewright_server::convert::from_proto::study(study).expect("a valid specification");
        }
        if name == "scenes" {
            let ending = [".glb", ".gltf", ".ply", ".obj"][usize::from(bytes[0])];
            let file = tempfile::Builder::new().suffix(ending).tempfile().expect("a scratch file");
            std::fs::write(file.path(), &bytes[1..]).expect("room");
            treewright_scene::load(file.path()).expect("a scene");
        }
    }
}

#[test]
fn a_seed_in_the_corpus_is_the_one_in_the_code() {
    for (name, seed, bytes) in seeds::all() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(name);
        let kept = std::fs::read(folder.join(format!("seed-{seed}"))).unwrap_or_default();
        assert_eq!(kept, bytes, "{name}/seed-{seed}: run the example `seeds`");
    }
}
