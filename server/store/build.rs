//! Rebuilds the store when a migration is added, because the compiler does not see new files in a folder.

fn main() {
    println!("cargo::rerun-if-changed=../../migrations");
}
