//! Gives the shared library its name for the loader: `libtreewright.so.0`, whose number changes with the ABI.

fn main() {
    if std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "linux") {
        println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libtreewright.so.0");
    }
    println!("cargo::rerun-if-changed=build.rs");
}
