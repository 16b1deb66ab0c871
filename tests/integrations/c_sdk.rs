//! libtreewright: the header declares all exports, a C program and a C++ program work with it, and no memory
//! leaks.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

use treewright_client::Options;
use treewright_client::blocking::Client;
use treewright_tests::daemon::Daemon;
use treewright_tests::programs::workspace;

use crate::frozen::answers_what_ran;
use crate::support::{built, file, has, succeed};

/// Names and numbers of parameters of the functions that a text declares after `mark`.
fn functions(text: &str, mark: &str) -> BTreeMap<String, usize> {
    let mut found = BTreeMap::new();
    let begins = |(at, _): (usize, &str)| {
        let before = text[..at].chars().next_back();
        !before.is_some_and(|each| each.is_alphanumeric() || each == '_')
    };
    for (at, _) in text.match_indices(mark).filter(|found| begins(*found)) {
        let rest = &text[at + mark.len() - "tw_".len()..];
        let Some((name, rest)) = rest.split_once('(') else { continue };
        if !name.chars().all(|each| each.is_ascii_lowercase() || each == '_') {
            continue;
        }
        let ends = [");", ") ->", ") {"].iter().filter_map(|end| rest.find(end));
        let parameters = rest[..ends.min().expect("an end of the parameters")].trim().trim_end_matches(',');
        let count =
            if matches!(parameters, "" | "void") { 0 } else { parameters.matches([',', ';']).count() + 1 };
        found.insert(name.to_owned(), count);
    }
    found
}

fn without_comments(text: &str) -> String {
    let mut parts = text.split("/*");
    let mut kept = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        kept.push_str(part.split_once("*/").expect("an end of the comment").1);
    }
    kept
}

#[test]
fn the_header_declares_what_the_library_exports() {
    let header = std::fs::read_to_string(file("c/include/treewright.h")).expect("the header");
    let declared = functions(&without_comments(&header), "tw_");
    let mut exported = BTreeMap::new();
    for entry in std::fs::read_dir(file("c/src")).expect("the sources") {
        let text = std::fs::read_to_string(entry.expect("an entry").path()).expect("a source");
        exported.extend(functions(&text, "fn tw_"));
    }
    assert!(declared.len() > 60, "{declared:?}");
    assert_eq!(declared, exported);
    let version = env!("CARGO_PKG_VERSION").split('.').map(str::to_owned);
    for (name, number) in ["MAJOR", "MINOR", "PATCH"].iter().zip(version) {
        assert!(header.contains(&format!("#define TREEWRIGHT_VERSION_{name} {number}\n")), "{name}");
    }
    if has("nm", "the symbols of libtreewright.so") {
        let symbols =
            succeed(Command::new("nm").args(["-D", "--defined-only"]).arg(built().join("libtreewright.so")));
        for name in declared.keys() {
            assert!(symbols.lines().any(|line| line.ends_with(&format!(" T {name}"))), "there is no {name}");
        }
    }
}

/// libtreewright as it is installed, below a folder of the test.
fn install(prefix: &Path) {
    succeed(Command::new("bash").arg(file("c/install.sh")).arg(prefix).arg(built()));
}

/// Compiles a source against the installed library. The options stand after the source, where the linker
/// wants the names of further libraries.
fn compile(compiler: &str, options: &[&str], source: &Path, prefix: &Path, program: &str) -> PathBuf {
    let program = prefix.join(program);
    let library = prefix.join("lib");
    succeed(
        Command::new(compiler)
            .args(["-g", "-Wall", "-Wextra", "-Werror", "-I"])
            .args([prefix.join("include").as_os_str(), source.as_os_str(), OsStr::new("-o")])
            .args([program.as_os_str(), OsStr::new("-L"), library.as_os_str(), OsStr::new("-ltreewright")])
            .args([format!("-Wl,-rpath,{}", library.display()).as_str(), "-lpthread", "-lm"])
            .args(options),
    );
    program
}

#[test]
fn a_c_program_gets_along_with_it() {
    let folder = tempfile::tempdir().expect("a folder");
    install(folder.path());
    let strict = ["-std=c99", "-pedantic", "-D_POSIX_C_SOURCE=200809L"];
    let program = compile("cc", &strict, &file("c/tests/sdk.c"), folder.path(), "sdk");
    let daemon = Daemon::start(&folder.path().join("tuning.db"));
    assert_eq!(succeed(Command::new(&program).arg(daemon.url())), "ok\n");
    let sanitised = [&strict[..], &["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]].concat();
    let sanitised = compile("cc", &sanitised, &file("c/tests/sdk.c"), folder.path(), "sanitised");
    let second = Daemon::start(&folder.path().join("second.db"));
    // Leaks are valgrind's to find: the sanitiser's search for them needs rights that containers seldom give.
    let mut sanitised = Command::new(sanitised);
    assert_eq!(succeed(sanitised.env("ASAN_OPTIONS", "detect_leaks=0").arg(second.url())), "ok\n");
    let again = Daemon::start(&folder.path().join("again.db"));
    if has("valgrind", "libtreewright under valgrind") {
        let valgrind = [
            "--quiet",
            "--error-exitcode=9",
            "--leak-check=full",
            "--errors-for-leak-kinds=definite,indirect",
            "--show-leak-kinds=definite,indirect",
        ];
        let known = format!("--suppressions={}", file("c/tests/valgrind.supp").display());
        // The installed library has no symbols, which suppressions need.
        let symbols = folder.path().join("symbols");
        std::fs::create_dir(&symbols).expect("a folder");
        let loaded = symbols.join(format!("libtreewright.so.{}", fitting_versions()));
        std::os::unix::fs::symlink(built().join("libtreewright.so"), loaded).expect("a link");
        let mut valgrind_of = Command::new("valgrind");
        valgrind_of.env("LD_LIBRARY_PATH", &symbols).args(valgrind).arg(known);
        let checked = succeed(valgrind_of.arg(&program).arg(again.url()));
        assert_eq!(checked, "ok\n");
    }
}

#[test]
fn a_c_program_gets_what_ran_of_a_frozen_study() {
    let folder = tempfile::tempdir().expect("a folder");
    install(folder.path());
    let strict = ["-std=c99", "-pedantic", "-D_POSIX_C_SOURCE=200809L"];
    let program = compile("cc", &strict, &file("c/tests/frames.c"), folder.path(), "frames");
    let daemon = Daemon::start(&folder.path().join("tuning.db"));
    answers_what_ran(daemon.url(), &|| Command::new(&program));
}

/// The header promises that libraries of one major version fit each other, and before 1.0 of one minor
/// version: these numbers are part of the name that a program asks the loader for.
fn fitting_versions() -> String {
    let version: Vec<&str> = env!("CARGO_PKG_VERSION").split('.').collect();
    if version[0] == "0" { version[..2].join(".") } else { version[0].to_owned() }
}

#[test]
fn the_programs_of_the_page_are_whole() {
    if !has("c++", "the programs of the page for C and C++") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    install(folder.path());
    let page = std::fs::read_to_string(file("c/README.md")).expect("the page");
    for (language, compiler, options) in
        [("c", "cc", &["-std=c99", "-pedantic"][..]), ("cpp", "c++", &["-std=c++17"])]
    {
        let (_, code) = page.split_once(&format!("```{language}\n")).expect("a program");
        let (code, _) = code.split_once("```").expect("its end");
        let daemon = Daemon::start(&folder.path().join(format!("{language}.db")));
        let source = folder.path().join(format!("first.{language}"));
        std::fs::write(&source, code.replace("http://127.0.0.1:50611", daemon.url())).expect("a source");
        let program = compile(compiler, options, &source, folder.path(), &format!("first_{language}"));
        succeed(&mut Command::new(program));
        let client = Client::connect(daemon.url(), Options::new()).expect("a client");
        client.get_study("my-renderer").expect("the program's study");
    }
}

#[test]
fn the_loader_is_asked_for_what_fits() {
    let folder = tempfile::tempdir().expect("a folder");
    install(folder.path());
    let fits = fitting_versions();
    let library = folder.path().join("lib").join(format!("libtreewright.so.{fits}"));
    assert!(library.exists(), "{} is not installed", library.display());
    if has("readelf", "the name for the loader") {
        let said = succeed(Command::new("readelf").arg("-d").arg(&library));
        assert!(said.contains(&format!("Library soname: [libtreewright.so.{fits}]")), "{said}");
    }
    if has("strip", "the size of libtreewright") {
        let size = |path: &Path| std::fs::metadata(path).expect("the library").len();
        let (built, installed) = (size(&built().join("libtreewright.so")), size(&library));
        assert!(installed < built, "{installed} of {built} bytes are left");
    }
}

#[test]
fn pkg_config_finds_it() {
    if !has("pkg-config", "the pkg-config file") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    install(folder.path());
    let path = folder.path().join("lib/pkgconfig");
    let ask = |options: &[&str]| {
        succeed(Command::new("pkg-config").env("PKG_CONFIG_PATH", &path).args(options).arg("treewright"))
    };
    let (flags, version) = (ask(&["--cflags", "--libs"]), ask(&["--modversion"]));
    let include = format!("-I{}", folder.path().join("include").display());
    assert!(flags.contains(&include) && flags.contains("-ltreewright"), "{flags}");
    assert_eq!(version.trim(), env!("CARGO_PKG_VERSION"));
}

/// Folder of Embree's headers, which come with the crate that binds them.
fn embree_headers() -> PathBuf {
    let metadata = succeed(
        Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
            .current_dir(workspace())
            .args(["metadata", "--format-version", "1", "--locked", "--offline"]),
    );
    let metadata: serde_json::Value = serde_json::from_str(&metadata).expect("JSON");
    let packages = metadata["packages"].as_array().expect("packages");
    let found = packages.iter().find(|one| one["name"] == "embree4-sys").expect("embree4-sys");
    let manifest = Path::new(found["manifest_path"].as_str().expect("a path"));
    manifest.parent().expect("a folder").join("lib")
}

/// Compiles the example on Embree into a folder, and returns its path.
pub(crate) fn embree_example(folder: &Path) -> PathBuf {
    install(folder);
    let library = workspace().join("target/native/embree/lib").canonicalize().expect("Embree, by make setup");
    let headers = format!("-isystem{}", embree_headers().display());
    let (link, run_path) = (format!("-L{}", library.display()), format!("-Wl,-rpath,{}", library.display()));
    let options = ["-std=c++17", "-O2", &headers, &link, &run_path, "-lembree4"];
    compile("c++", &options, &file("c/examples/embree_tuned.cpp"), folder, "embree_tuned")
}

#[test]
fn a_renderer_on_embree_is_tuned() {
    if !has("c++", "the C++ example on Embree") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let program = embree_example(folder.path());
    let daemon = Daemon::start(&folder.path().join("tuning.db"));
    // A long deadline, because this test does not measure the speed of the daemon.
    let few = ["--frames", "12", "--size", "16", "--rounds", "1", "--deadline", "20000", "--url"];
    let said = succeed(Command::new(&program).args(few).arg(daemon.url()));
    let lines: Vec<serde_json::Value> =
        said.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(lines.len(), 3, "{said}");
    for line in &lines {
        assert!(["field", "needles", "boxes"].iter().any(|name| line["scene"] == *name), "{line}");
        assert_eq!(line["fixed"].as_array().map(Vec::len), Some(7), "{line}");
        assert_eq!(line["trial_costs"].as_array().map(Vec::len), Some(12), "{line}");
        assert!(line["tuned"]["quality"].is_string(), "{line}");
        assert!(line["tuned_costs"][0].as_f64() > Some(0.0), "{line}");
    }
    assert!(lines.iter().any(|line| line["from_daemon"].as_f64() > Some(0.0)), "{said}");
}
