//! Wrong input to the renderer: a clear message that names the cause, the promised exit code, no panic.

use std::path::Path;
use std::process::Output;

use treewright_tests::daemon::Daemon;
use treewright_tests::programs::{run, stderr};

/// Exit codes that the programs promise in their help.
const FAILED: i32 = 1;
const USAGE: i32 = 2;
const UNREACHABLE: i32 = 3;

fn expect(output: &Output, code: i32, said: &[&str]) {
    let text = stderr(output);
    assert_eq!(output.status.code(), Some(code), "{text}");
    assert!(!text.contains("panicked"), "{text}");
    for phrase in said {
        assert!(text.to_lowercase().contains(&phrase.to_lowercase()), "{phrase:?} is not in: {text}");
    }
}

fn image(scene: &Path, more: &[&str]) -> Output {
    let out = std::env::temp_dir().join("treewright-never-written.png");
    let (scene, out) = (scene.to_string_lossy(), out.to_string_lossy());
    let mut arguments = vec!["image", "--scene", &scene, "--size", "16x12", "--out", &out];
    arguments.extend(more);
    run("treewright-render", &arguments)
}

fn scene(folder: &Path, name: &str, bytes: &[u8]) -> std::path::PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("a scratch file");
    path
}

#[test]
fn scenes_that_cannot_be_read() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let folder = folder.path();
    expect(&image(&folder.join("nowhere.glb"), &[]), FAILED, &["nowhere.glb"]);
    expect(&image(folder, &[]), FAILED, &[&folder.to_string_lossy()]);
    expect(&image(Path::new("builtin:atlantis"), &[]), FAILED, &["atlantis", "hall"]);
    let cut = scene(folder, "cut.glb", b"glTF\x02\x00\x00\x00\xff\xff\x00\x00\x10\x00\x00\x00JSON{");
    expect(&image(&cut, &[]), FAILED, &["cut.glb"]);
    let astray = scene(folder, "astray.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n");
    expect(&image(&astray, &[]), FAILED, &["astray.obj"]);
    let nothing = scene(folder, "nothing.obj", b"# no face at all\nv 0 0 0\n");
    expect(&image(&nothing, &[]), FAILED, &["nothing.obj", "no triangle"]);
    let stl = scene(folder, "part.stl", b"solid part\nendsolid part\n");
    expect(&image(&stl, &[]), FAILED, &["part.stl", "stl"]);
    let nan = scene(folder, "nan.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    expect(&image(&nan, &[]), FAILED, &["nan.obj"]);
}

#[test]
fn configurations_that_do_not_exist() {
    let quick = Path::new("builtin:quick");
    expect(&image(quick, &["--config", "colour=blue"]), USAGE, &["colour"]);
    expect(&image(quick, &["--config", "quality=9"]), USAGE, &["quality"]);
    expect(
        &image(quick, &["--config", "min_leaf_size=9,max_leaf_size=3"]),
        USAGE,
        &["min_leaf_size", "max_leaf_size"],
    );
    expect(&image(quick, &["--config", "quality"]), USAGE, &["quality"]);
}

#[test]
fn a_daemon_that_is_not_there() {
    let arguments =
        ["tune", "--server", "http://127.0.0.1:9", "--scene", "builtin:quick", "--iterations", "3"];
    expect(&run("treewright-render", &arguments), UNREACHABLE, &["127.0.0.1:9", "treewrightd"]);
    expect(&run("treewright", &["--server", "http://127.0.0.1:9", "studies"]), UNREACHABLE, &["127.0.0.1:9"]);
    let malformed = ["tune", "--server", "here", "--scene", "builtin:quick", "--iterations", "3"];
    expect(&run("treewright-render", &malformed), USAGE, &["here"]);
}

#[test]
fn command_lines_that_make_no_sense() {
    let tune = |more: &[&str]| {
        let mut arguments = vec!["tune", "--server", "http://127.0.0.1:9", "--scene", "builtin:quick"];
        arguments.extend(more);
        run("treewright-render", &arguments)
    };
    expect(&tune(&["--objective", "beauty"]), USAGE, &["beauty"]);
    expect(&tune(&["--size", "0x0"]), USAGE, &["size"]);
    expect(&tune(&["--size", "wide"]), USAGE, &["wide"]);
    expect(&tune(&["--iterations", "0"]), USAGE, &["iterations"]);
    expect(&tune(&["--iterations", "many"]), USAGE, &["iterations", "many"]);
}

#[tokio::test]
async fn an_indicator_that_is_no_number() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let daemon = Daemon::start(&folder.path().join("tuning.db"));
    let mut client = crate::wire::connect(daemon.url()).await;
    let study = crate::wire::create(&mut client, "strict").await;
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let refused =
            client.suggest(crate::wire::suggestion(&study, "one", bad)).await.expect_err("it is refused");
        assert_eq!(refused.code(), tonic::Code::InvalidArgument);
        assert!(refused.message().contains("near"), "{refused}");
    }
    let trial =
        client.suggest(crate::wire::suggestion(&study, "one", 0.5)).await.expect("a trial").into_inner();
    let mut report = crate::wire::report(&trial);
    report.measurements.insert("render_ms".into(), f64::NAN);
    let refused = client.report(report).await.expect_err("it is refused");
    assert_eq!(refused.code(), tonic::Code::InvalidArgument);
    assert!(refused.message().contains("render_ms"), "{refused}");
    client.report(crate::wire::report(&trial)).await.expect("a sound report is still taken");
}
