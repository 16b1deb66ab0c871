//! Rebuilds the store when a migration is added: the compiler cannot see that the list of files in a folder
//! has changed.

fn main() {
    println!("cargo::rerun-if-changed=../../migrations");
}
