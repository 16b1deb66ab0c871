//! Sets the run path of the renderer's binaries and tests, so that they find Embree from any folder.

fn main() {
    println!("cargo::rerun-if-env-changed=DEP_TREEWRIGHT_EMBREE_LIB_DIR");
    match std::env::var("DEP_TREEWRIGHT_EMBREE_LIB_DIR") {
        Ok(folder) => println!("cargo::rustc-link-arg=-Wl,-rpath,{folder}"),
        Err(error) => {
            println!("cargo::error=treewright-accel did not say where Embree is ({error})")
        }
    }
}
