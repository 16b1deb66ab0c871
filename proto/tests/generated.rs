//! The Rust code of the messages and services, and their descriptors, are made from `treewright/v1/*.proto` and kept beside the
//! sources, so that who builds the crate needs neither a compiler of protocol buffers nor the time that one takes. This test makes
//! them again; where they differ it writes them anew and fails, so that a change of the contract is: edit, run this, commit.

use std::path::Path;

use prost::Message as _;

#[test]
fn generated_code_is_that_of_the_proto_files() {
    let crate_folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let kept = crate_folder.join("src/generated");
    let files = protox::compile([crate_folder.join("treewright/v1/tuning.proto")], [crate_folder])
        .expect("the .proto files are well formed");
    let fresh = tempfile::tempdir().expect("a folder");
    std::fs::write(fresh.path().join("descriptor.bin"), files.encode_to_vec()).expect("a file");
    tonic_prost_build::configure()
        .btree_map(".")
        .out_dir(fresh.path())
        .compile_fds(files)
        .expect("code is generated");
    let mut changed = Vec::new();
    for name in ["treewright.v1.rs", "descriptor.bin"] {
        let made = std::fs::read(fresh.path().join(name)).expect("a generated file");
        if std::fs::read(kept.join(name)).ok().as_ref() != Some(&made) {
            std::fs::write(kept.join(name), made).expect("the sources can be written");
            changed.push(name);
        }
    }
    assert!(
        changed.is_empty(),
        "{changed:?} in proto/src/generated were not those of the .proto files and have been written anew: \
         build again, and commit them with the change"
    );
}
