//! Sets the run path of binaries and tests that link Embree. Every crate above `treewright-accel` names this
//! file: a run path counts for one package alone. `TREEWRIGHT_RUN_PATH` names another one, such as
//! `$ORIGIN/../lib` (tools/dist.py).

fn main() {
    println!("cargo::rerun-if-env-changed=DEP_TREEWRIGHT_EMBREE_LIB_DIR");
    println!("cargo::rerun-if-env-changed=TREEWRIGHT_RUN_PATH");
    if let Ok(folder) = std::env::var("TREEWRIGHT_RUN_PATH") {
        println!("cargo::rustc-link-arg=-Wl,-rpath,{folder}");
        return;
    }
    match std::env::var("DEP_TREEWRIGHT_EMBREE_LIB_DIR") {
        Ok(folder) => println!("cargo::rustc-link-arg=-Wl,-rpath,{folder}"),
        Err(error) => {
            println!("cargo::error=treewright-accel did not say where Embree is ({error})")
        }
    }
}
