//! Tells the linker where Embree is, and dependents where the loader will find it.
//!
//! `make setup` leaves `target/native/embree/lib/libembree4.so`; `EMBREE_DIR` names another
//! installation. The run path is that of the real file behind the link, since the loader asks for the
//! library by its own name (SONAME), which lies beside the real file. A build script can set a run path
//! only for its own package, so the folder is handed on as `DEP_TREEWRIGHT_EMBREE_LIB_DIR`.

use std::env;
use std::path::{Path, PathBuf};

fn main() {
    println!("cargo::rerun-if-env-changed=EMBREE_DIR");
    let candidates = candidates();
    let Some(library) =
        candidates.iter().map(|folder| folder.join("libembree4.so")).find(|file| file.exists())
    else {
        println!(
            "cargo::error=no libembree4.so in {}: run `make setup` in the repository's root",
            list(&candidates)
        );
        return;
    };
    println!("cargo::rerun-if-changed={}", library.display());
    let real = match library.canonicalize() {
        Ok(real) => real,
        Err(error) => {
            println!(
                "cargo::error={} cannot be followed ({error}): run `make setup` in the repository's root",
                library.display()
            );
            return;
        }
    };
    let (Some(link_folder), Some(run_folder)) = (library.parent(), real.parent()) else {
        return;
    };
    println!("cargo::rustc-link-search=native={}", link_folder.display());
    println!("cargo::rustc-link-arg=-Wl,-rpath,{}", run_folder.display());
    println!("cargo::metadata=LIB_DIR={}", run_folder.display());
}

/// Folders that may hold the library, best first.
fn candidates() -> Vec<PathBuf> {
    if let Some(root) = env::var_os("EMBREE_DIR").filter(|root| !root.is_empty()) {
        return ["lib", "lib64", "lib/x86_64-linux-gnu", "lib/aarch64-linux-gnu"]
            .map(|sub| Path::new(&root).join(sub))
            .into();
    }
    let package = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR"));
    let root = package.join("../..");
    let root = root.canonicalize().unwrap_or(root);
    vec![root.join("target/native/embree/lib")]
}

fn list(folders: &[PathBuf]) -> String {
    folders.iter().map(|folder| folder.display().to_string()).collect::<Vec<_>>().join(", ")
}
