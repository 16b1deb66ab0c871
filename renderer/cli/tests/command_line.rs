//! The program as a user meets it: pictures, lists, and wrong input with its message and exit code.

#[path = "support/program.rs"]
mod program;

use std::process::{Command, Output, Stdio};
use std::{io::Write, path::Path};

use treewright_accel::NativeQuality;
use treewright_accel::recording::{RayClass, Recording};
use treewright_renderer::space::Choice;

use program::{FAILED, USAGE, fails, folder, succeeds};

const PROGRAM: &str = env!("CARGO_BIN_EXE_treewright-render");
/// The exit code where no daemon answers.
const UNREACHABLE: i32 = 3;
const SMALL: &str = "image --scene builtin:quick --detail 0.1 --size 24x16 --spp 2";

#[test]
fn a_picture_is_the_same_for_every_thread_count_and_structure() {
    let folder = folder();
    let path = folder.path();
    let picture = |name: &str, more: &str| {
        succeeds(path, &format!("{SMALL} {more} --out {name}.exr"));
        image::open(path.join(format!("{name}.exr"))).expect("the picture can be read").to_rgb32f()
    };
    let first = picture("first", "--threads 1");
    assert_eq!(first.dimensions(), (24, 16));
    assert_eq!(first, picture("threads", "--threads 3"));
    for (name, more) in [
        ("native", "--native high"),
        ("tree", "--config quality=3,branching_factor=8,max_leaf_size=8"),
        ("morton", "--config quality=1,branching_factor=4"),
        ("compact", "--config compact=true --space paper"),
        ("paths", "--config staged=false"),
    ] {
        let other = picture(name, more);
        let sum = |image: &image::Rgb32FImage| image.iter().map(|&value| f64::from(value)).sum::<f64>();
        let difference: f64 = first.iter().zip(other.iter()).map(|(a, b)| f64::from((a - b).abs())).sum();
        assert!(difference < 1e-3 * sum(&first), "{name} differs by {}", difference / sum(&first));
    }
    assert_ne!(first, picture("seed", "--seed 2"), "the seed does something");
    assert_ne!(first, picture("elsewhere", "--at 0.5"), "the camera moves");
}

#[test]
fn results_are_json_where_asked_for() {
    let folder = folder();
    let path = folder.path();
    let parsed = |text: String| serde_json::from_str::<serde_json::Value>(&text).expect("it is JSON");
    let image = parsed(succeeds(path, &format!("{SMALL} -o a.png --json")));
    assert_eq!((image["samples"].as_u64(), image["counts"]["bad_samples"].as_u64()), (Some(2), Some(0)));
    assert!(image["build_ms"].as_f64() > Some(0.0) && image["render_ms"]["median"].as_f64() > Some(0.0));
    let info = parsed(succeeds(path, "info --scene builtin:quick --detail 0.1 --json"));
    assert_eq!(info["indicators"].as_object().map(serde_json::Map::len), Some(17));
    let scenes = parsed(succeeds(path, "scenes --json"));
    assert!(scenes.as_array().is_some_and(|scenes| scenes.len() >= 6));
    let space = parsed(succeeds(path, "spaces --space paper --json"));
    assert_eq!(space["parameters"].as_array().map(Vec::len), Some(11));
    let space = parsed(succeeds(path, "spaces --json"));
    let parameters = space["parameters"].as_array().expect("a list");
    assert_eq!((parameters[0]["name"].as_str(), space["name"].as_str()), (Some("backend"), Some("full")));
    assert!(parameters.iter().all(|one| one["about"].as_str().is_some_and(|about| !about.is_empty())));
    assert_eq!(space["default"]["backend"], "tunable");
}

#[test]
fn a_reader_that_has_seen_enough_ends_the_program_quietly() {
    for arguments in [&["info", "--scene", "builtin:quick", "--json"][..], &["spaces"][..]] {
        let mut program = Command::new(PROGRAM)
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        drop(program.stdout.take());
        let output = program.wait_with_output().expect("it ends");
        assert_eq!(output.status.code(), Some(141), "{arguments:?}: {output:?}");
        assert!(output.stderr.is_empty(), "{arguments:?}: {output:?}");
    }
}

#[test]
fn accelerators_are_measured() {
    let folder = folder();
    let path = folder.path();
    std::fs::write(path.join("best.json"), r#"{"branching_factor": 4, "tile": 32, "staged": true}"#)
        .expect("it can be written");
    let table = succeeds(
        path,
        "bench --scene builtin:quick --detail 0.1 --rounds 2 --size 24x16 --config quality=1 --contender mine=full:best.json --json b.json",
    );
    assert!(table.contains("native Embree default") && table.contains("quality=1"));
    let bench: serde_json::Value =
        serde_json::from_slice(&std::fs::read(path.join("b.json")).expect("it was written"))
            .expect("it is JSON");
    assert_eq!(bench["render"].as_array().map(Vec::len), Some(9));
    assert_eq!(bench["render"][8]["name"], "mine");
    for objective in ["render", "total"] {
        let used_well = &bench[objective][4];
        assert_eq!(used_well["name"], "native used well");
        let ways = ["low", "medium", "high", "medium path by path"];
        assert!(ways.iter().any(|way| used_well["variant"] == *way));
    }
    assert_eq!(bench["builds"].as_array().map(Vec::len), Some(11), "each native use and each best fixed one");
    assert!(bench["builds"][10]["build_cpu_ms"].as_f64().is_some_and(|cpu_ms| cpu_ms > 0.0));
    assert!(table.contains("threads idle"));
    assert_eq!(bench["render"][5]["name"], "best fixed configuration");
    assert_eq!(bench["total"][6]["name"], "best fixed configuration");
    assert!(table.contains("over native used well") && table.contains("over best fixed"));
    let frame = |objective: &str| bench[objective][7]["frame_ms"]["median"].as_f64();
    assert!(frame("total") > frame("render"));
    assert_eq!(bench["total"][7]["rounds_ms"].as_array().map(Vec::len), Some(2));
    let bytes: Vec<_> = (0..9).map(|one| bench["render"][one]["structure_bytes"].as_u64()).collect();
    assert!(bytes.iter().all(|bytes| bytes.is_some_and(|bytes| bytes > 0)), "{bytes:?}");
    assert_eq!(bench["rounds"].as_u64(), Some(2), "the first, which warms up, is none");
    let few = succeeds(
        path,
        "bench --scene builtin:quick --detail 0.1 --rounds 1 --size 8x8 --only quality=2 --config quality=2",
    );
    assert!(few.contains("quality=2") && !few.contains("native"));
}

#[test]
fn scenes_are_made_to_move_or_refused() {
    let path = folder();
    let made = |scene: &str| succeeds(path.path(), &format!("info --detail 0.02 --time 0.3 --scene {scene}"));
    assert!(made("builtin:quick --motion swarm").contains("quick-swarm"));
    assert!(made("builtin:forest --motion crowd").contains("forest-crowd"));
    let still = "play --rounds 1 --scene builtin:quick";
    fails(still, USAGE, &["nothing moves", "builtin:sea", "--motion", "explode"]);
    fails("info --scene builtin:forest --detail 0.02 --motion sway", FAILED, &["crowd", "--flatten"]);
    fails("info --scene builtin:quick --motion fly", USAGE, &["fly", "ripple"]);
    fails("info --scene builtin:quick --motion sway --animation 0", USAGE, &["--animation", "sway"]);
    fails("info --scene builtin:quick --motion file", FAILED, &["no animation"]);
    fails("info --scene builtin:sea --detail 0.02 --animation Walk", FAILED, &["no animation", "Walk"]);
}

#[test]
fn a_configuration_can_come_from_a_file() {
    let folder = folder();
    let path = folder.path();
    fails(&format!("{SMALL} -o a.png --config-file missing.json"), FAILED, &["missing.json"]);
    // Parameters that are gone.
    let kept = r#"{"quality": 1, "bounce": "single", "sort": "none"}"#;
    std::fs::write(path.join("kept.json"), kept).expect("it can be written");
    let json = succeeds(path, &format!("{SMALL} -o a.png --config-file kept.json --json"));
    assert!(json.contains("\"morton\""), "{json}");
    fails(&format!("{SMALL} -o a.png --config sort=octant"), USAGE, &["sort=octant", "leave sort out"]);
}

#[test]
fn wrong_scenes_are_named() {
    fails("image --scene nowhere.glb -o a.png", FAILED, &["nowhere.glb"]);
    fails("image --scene builtin:atlantis -o a.png", FAILED, &["atlantis", "hall"]);
    fails("info --scene part.stl", FAILED, &["part.stl"]);
    fails("image --scene builtin:quick --detail 99 -o a.png", FAILED, &["detail"]);
    let folder = folder();
    let here = folder.path().display();
    fails(&format!("image --scene {here} -o a.png"), FAILED, &[&format!("{here} is a folder")]);
    std::fs::write(folder.path().join("no_face.obj"), "v 0 0 0\n").expect("it can be written");
    fails(&format!("image --scene {here}/no_face.obj -o a.png"), FAILED, &["no_face.obj", "no triangle"]);
}

#[test]
fn wrong_command_lines_are_explained() {
    for (more, said) in [
        ("--size 0x0", "WIDTHxHEIGHT"),
        ("--size wide", "WIDTHxHEIGHT"),
        ("--spp 0", "--spp"),
        ("--config colour=blue", "colour"),
        ("--config quality=9", "1 to 3"),
        ("--config backend=native,quality=2", "it needs backend = tunable"),
        ("--config compact=true", "--space full"),
        ("--space paper --robust", "--config robust=true"),
        ("--config quality", "name=value"),
        ("--config min_leaf_size=9,max_leaf_size=3", "min_leaf_size"),
        ("--native fastest", "low, medium, high"),
        ("--native low --config quality=1", "cannot be used with"),
        ("--at 1.5", "0 to 1"),
        ("--camera 1000", "no camera 1000"),
        ("--threads 99999", "1024"),
    ] {
        fails(&format!("image --scene builtin:quick --detail 0.1 -o a.png {more}"), USAGE, &[said]);
    }
    fails("", USAGE, &["Usage"]);
    fails("dance", USAGE, &["dance"]);
}

#[test]
fn places_that_cannot_be_written_are_named_before_rendering() {
    fails(&format!("{SMALL} -o nowhere/a.png"), FAILED, &["nowhere", "does not exist"]);
    fails(&format!("{SMALL} -o a.gif"), FAILED, &[".png or .exr"]);
    fails("tune --scene builtin:quick --json nowhere/a.json", FAILED, &["nowhere", "does not exist"]);
}

#[test]
fn an_absent_daemon_is_told_with_the_remedy() {
    // Port 9 is "discard"; no daemon listens there.
    let server = "--server http://127.0.0.1:9 --scene builtin:quick --detail 0.1";
    fails(&format!("tune {server} --iterations 2"), UNREACHABLE, &["127.0.0.1:9", "treewrightd serve"]);
    fails(&format!("play {server} --frames 2"), UNREACHABLE, &["127.0.0.1:9", "treewrightd serve"]);
    fails("tune --server here --scene builtin:quick", USAGE, &["here"]);
    fails("tune --scene builtin:quick --objective beauty", USAGE, &["beauty", "render", "total"]);
    fails("tune --scene builtin:quick --iterations -4", USAGE, &["iterations"]);
    fails("tune --scene builtin:quick --iterations 0", USAGE, &["iterations"]);
    fails("tune --scene builtin:quick --epsilon 2", USAGE, &["0 to 1"]);
    fails("tune --scene builtin:quick --patience-s 0", USAGE, &["patience-s", "86400"]);
    // What a trial would ignore is not taken.
    for (objective, option) in
        [("error", "--frames 3"), ("error", "--abort-above 2"), ("motion", "--frames 3")]
    {
        let name = option.split(' ').next().unwrap_or_default();
        fails(
            &format!("tune --scene builtin:quick --objective {objective} {option}"),
            USAGE,
            &[&format!("--objective {objective}"), &format!("leave {name} out")],
        );
    }
}

#[test]
fn help_shows_examples_and_exit_codes() {
    let help = succeeds(folder().path(), "--help");
    assert!(help.contains("Examples:") && help.contains("Exit codes:"));
    for command in ["image", "info", "scenes", "spaces", "tune", "play", "bench", "converge"] {
        assert!(help.contains(command), "{command}");
    }
    for command in ["image", "info", "scenes", "spaces", "tune", "play", "bench", "rays"] {
        succeeds(folder().path(), &format!("{command} --help"));
    }
}

#[test]
fn the_laboratory_is_looked_for_beside_the_program() {
    let program = Path::new(PROGRAM);
    let beside = program.parent().expect("a program lies in a folder");
    let folder = tempfile::tempdir_in(beside).expect("a scratch folder on that disk");
    // Links: a program just written may still be open for writing in a process that a test forks.
    let render = folder.path().join("treewright-render");
    std::fs::hard_link(program, &render).expect("the program can be linked");
    let converge = || {
        let arguments = ["converge", "--scene", "a b.ply", "--json"];
        Command::new(&render).current_dir(folder.path()).args(arguments).output().expect("the program starts")
    };
    let alone = converge();
    let errors = String::from_utf8_lossy(&alone.stderr).into_owned();
    assert_eq!(alone.status.code(), Some(FAILED), "{errors}");
    assert!(errors.contains("treewright-lab") && errors.contains("make build"), "{errors}");
    // A shell in the laboratory's place takes the command's name for a script.
    std::os::unix::fs::symlink("/bin/sh", folder.path().join("treewright-lab")).expect("a link can be made");
    std::fs::write(folder.path().join("converge"), "printf '[%s]' \"$@\"\nexit 5\n")
        .expect("it can be written");
    let handed_on = converge();
    assert_eq!(String::from_utf8_lossy(&handed_on.stdout), "[--scene][a b.ply][--json]");
    assert_eq!(handed_on.status.code(), Some(5), "its exit code is the program's");
}

#[test]
fn rounds_run_for_another_process_as_long_as_it_waits() {
    let folder = folder();
    let ask = |rounds: u32, waits: bool| -> Output {
        let choice = Choice::native(NativeQuality::Low);
        let order = serde_json::json!({"rounds": rounds, "choices": [choice, choice]});
        let mut command = Command::new(PROGRAM);
        let arguments = "rounds --scene builtin:quick --detail 0.1 --size 24x16";
        command.current_dir(folder.path()).args(arguments.split(' '));
        let piped = command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = piped.spawn().expect("the program starts");
        let mut input = child.stdin.take().expect("it is a pipe");
        writeln!(input, "{order}").expect("it is read");
        let input = waits.then_some(input);
        let output = child.wait_with_output().expect("it ends");
        drop(input);
        output
    };
    let answer = ask(2, true);
    assert!(answer.status.success(), "{}", answer.status);
    let measured: serde_json::Value = serde_json::from_slice(&answer.stdout).expect("it is JSON");
    assert_eq!(measured.as_array().map(Vec::len), Some(2));
    assert_eq!(measured[1]["frames"].as_array().map(Vec::len), Some(2));
    assert!(!ask(10_000, false).status.success(), "who asked is gone");
    fails("rounds --scene builtin:quick", USAGE, &["`tune` starts"]);
}

#[test]
fn an_older_instruction_set_gives_the_same_picture() {
    let folder = folder();
    let path = folder.path();
    let run = |isa: &str, more: &str| {
        let arguments = format!("{SMALL} {more}");
        let mut command = Command::new(PROGRAM);
        command.args(arguments.split(' ')).current_dir(path).env("TREEWRIGHT_ISA", isa);
        command.output().expect("the program starts")
    };
    let refused = run("mmx", "--out none.exr");
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("it is one of sse2, avx2, avx512"));
    let plain = run("sse2", "--out plain.exr");
    assert!(plain.status.success(), "{}", String::from_utf8_lossy(&plain.stderr));
    succeeds(path, &format!("{SMALL} --out best.exr"));
    let sum = |name: &str| {
        let picture = image::open(path.join(name)).expect("the picture can be read").to_rgb32f();
        picture.iter().map(|&value| f64::from(value)).sum::<f64>()
    };
    let (plain, best) = (sum("plain.exr"), sum("best.exr"));
    assert!((plain - best).abs() < 1e-2 * best, "{plain} {best}");
}

#[test]
fn the_rays_of_a_frame_are_recorded() {
    let folder = folder();
    let path = folder.path();
    let printed = succeeds(path, "rays --scene builtin:quick --detail 0.1 --size 24x16 --out quick.rays");
    assert!(printed.contains("384 primary") && printed.contains("quick.rays"), "{printed}");
    let file = std::fs::File::open(path.join("quick.rays")).expect("it was written");
    let reader = std::io::BufReader::new(file);
    let recording: Recording = serde_json::from_reader(reader).expect("it can be read");
    let rays = |class| recording.sets.iter().find(|set| set.class == class).map_or(0, |set| set.rays.len());
    assert_eq!(rays(RayClass::Primary), 384);
    assert!(rays(RayClass::FirstBounce) > 0 && rays(RayClass::FirstShadow) > 0);
    fails("rays --scene builtin:quick --out nowhere/quick.rays", FAILED, &["nowhere/quick.rays"]);
}
