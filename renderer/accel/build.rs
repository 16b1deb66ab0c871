//! Gives the linker the folder of Embree, and dependents the folder where the loader will find it.
//!
//! `make setup` leaves `target/native/embree/lib/libembree4.so`; `EMBREE_DIR` names another installation. The
//! loader asks for the library by its SONAME, beside the real file. The folder is handed on as
//! `DEP_TREEWRIGHT_EMBREE_LIB_DIR`.
//!
//! `TREEWRIGHT_KERNELS=native` compiles the queries for this machine's instruction set alone, in a third of
//! the time (`make demo`); `present` for each that this machine has; by default for all.

use std::env;
use std::path::{Path, PathBuf};

fn main() {
    choose_kernels();
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
    let (Some(link_folder), Some(run_folder)) = (library.parent(), real.parent()) else { return };
    println!("cargo::rustc-link-search=native={}", link_folder.display());
    println!("cargo::rustc-link-arg=-Wl,-rpath,{}", run_folder.display());
    println!("cargo::metadata=LIB_DIR={}", run_folder.display());
}

/// Sets `kernels_NAME` for each compiled instruction set, and `fewer_kernels` where some are left out.
fn choose_kernels() {
    println!("cargo::rerun-if-env-changed=TREEWRIGHT_KERNELS");
    println!("cargo::rustc-check-cfg=cfg(fewer_kernels)");
    let here = env::var_os("HOST") == env::var_os("TARGET");
    let all = ["scalar", "avx2", "avx512"];
    let best = || all.iter().position(|name| *name == best()).unwrap_or(0);
    let compiled = match env::var("TREEWRIGHT_KERNELS").as_deref() {
        Ok("native") if here => best()..=best(),
        Ok("present") if here => 0..=best(),
        Ok("" | "all" | "native" | "present") | Err(_) => 0..=all.len() - 1,
        Ok(text) => {
            println!("cargo::error=TREEWRIGHT_KERNELS is {text:?}; it is `native`, `present` or `all`");
            return;
        }
    };
    if compiled.clone().count() < all.len() {
        println!("cargo::rustc-cfg=fewer_kernels");
    }
    for (number, name) in all.into_iter().enumerate() {
        println!("cargo::rustc-check-cfg=cfg(kernels_{name})");
        if compiled.contains(&number) {
            println!("cargo::rustc-cfg=kernels_{name}");
        }
    }
}

/// The best instruction set of this machine, as `Isa::detect` finds it.
fn best() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        macro_rules! has {
            ($($feature:tt)*) => { true $(&& is_x86_feature_detected!($feature))* };
        }
        if has!("avx2" "fma" "bmi1" "bmi2" "lzcnt" "popcnt") {
            return if has!("avx512f" "avx512vl" "avx512dq" "avx512bw") { "avx512" } else { "avx2" };
        }
    }
    "scalar"
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
