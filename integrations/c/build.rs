//! Gives the shared library its name for the loader, as in `libtreewright.so.0.1`. The number in it changes
//! when programs have to be compiled again: with the major version, and before 1.0 with the minor one, as the
//! header promises.

fn main() {
    if std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "linux") {
        let part = |name: &str| std::env::var(name).expect("cargo says the version");
        let (major, minor) = (part("CARGO_PKG_VERSION_MAJOR"), part("CARGO_PKG_VERSION_MINOR"));
        let number = if major == "0" { format!("0.{minor}") } else { major };
        println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libtreewright.so.{number}");
    }
    println!("cargo::rerun-if-changed=build.rs");
}
