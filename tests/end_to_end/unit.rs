//! The daemon behind the restrictions of the systemd unit that is shipped with it. The test reads
//! `server/deploy/treewrightd.service` and lets the kernel forbid those calls (`seccomp(2)`), as systemd
//! would do it. The process is killed at the first forbidden call, so that an ignored error hides nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};
use treewright_proto::v1 as pb;
use treewright_tests::daemon::Daemon;
use treewright_tests::programs::{program, stderr, workspace};

use crate::site::{assert_sound, path_text};
use crate::wire;

/// Filters for the [launcher], in JSON.
const FILTERS: &str = "TREEWRIGHT_TEST_FILTERS";
/// The program that the launcher becomes, with its arguments, in lines.
const COMMAND: &str = "TREEWRIGHT_TEST_COMMAND";

const EPERM: i32 = 1;
const ENOSYS: i32 = 38;
const EAFNOSUPPORT: i32 = 97;

/// The directives of the section [Service], in their order.
struct Unit(Vec<(String, String)>);

impl Unit {
    fn read() -> Self {
        let file = workspace().join("server/deploy/treewrightd.service");
        let text = std::fs::read_to_string(file).expect("the unit");
        let service = text.split_once("[Service]").expect("a service").1;
        let lines = service.lines().take_while(|line| !line.starts_with('['));
        let directive =
            |line: &str| line.split_once('=').map(|(name, value)| (name.to_owned(), value.to_owned()));
        Self(lines.filter(|line| !line.starts_with('#')).filter_map(directive).collect())
    }

    fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a str> {
        self.0.iter().filter(move |(own, _)| own == name).map(|(_, value)| value.as_str())
    }

    fn is_set(&self, name: &str) -> bool {
        self.all(name).last() == Some("yes")
    }

    /// The calls that are left by the lines of `SystemCallFilter`, of which the first allows, and those with
    /// a tilde take away.
    fn allowed_calls(&self) -> BTreeSet<String> {
        // Calls that no filter of systemd can take away.
        let mut allowed = BTreeSet::from_iter(calls("@default"));
        for line in self.all("SystemCallFilter") {
            let (takes_away, names) = line.strip_prefix('~').map_or((false, line), |names| (true, names));
            for name in names.split_whitespace().flat_map(calls) {
                let _ = if takes_away { allowed.remove(&name) } else { allowed.insert(name) };
            }
        }
        allowed
    }

    /// The kernel's filters, one for each answer that it gives.
    fn filters(&self, allowed: &BTreeSet<String>, refusal: &Value) -> Vec<Value> {
        let rules = allowed.iter().filter(|call| is_known(call)).map(call);
        let allow = json!({ "mismatch_action": refusal, "match_action": "allow", "filter": rules.collect::<Vec<_>>() });
        let mut all = vec![allow];
        if self.is_set("MemoryDenyWriteExecute") {
            let (executable, both) = (4, 6);
            let protection = |call, bits| json!({ "syscall": call, "args": [bit(2, bits)] });
            all.push(deny(
                refusal.clone(),
                vec![
                    protection("mmap", both),
                    protection("mprotect", executable),
                    protection("pkey_mprotect", executable),
                ],
            ));
        }
        if self.is_set("RestrictNamespaces") {
            // Its flags lie in memory, where no filter sees them. The C library falls back on the older call.
            all.push(deny(json!({ "errno": ENOSYS }), vec![call("clone3")]));
            let flags = [17, 25, 26, 27, 28, 29, 30].map(|place| 1u64 << place);
            let clone = |flag: u64| json!({ "syscall": "clone", "args": [bit(0, flag)] });
            all.push(deny(refusal.clone(), flags.map(clone).to_vec()));
        }
        if self.is_set("LockPersonality") {
            all.push(deny(refusal.clone(), vec![call("personality")]));
        }
        if let Some(families) = self.all("RestrictAddressFamilies").last() {
            let other = families.split_whitespace().map(|family| {
                let number = match family {
                    "AF_UNIX" => 1,
                    "AF_INET" => 2,
                    "AF_INET6" => 10,
                    other => panic!("{other} is not known to this test"),
                };
                json!({ "index": 0, "type": "dword", "op": "ne", "val": number })
            });
            let rule = json!({ "syscall": "socket", "args": other.collect::<Vec<_>>() });
            all.push(deny(json!({ "errno": EAFNOSUPPORT }), vec![rule]));
        }
        all
    }
}

/// A filter that takes some calls away from what others allow.
fn deny(action: Value, rules: Vec<Value>) -> Value {
    json!({ "mismatch_action": "allow", "match_action": action, "filter": rules })
}

/// A rule for all calls of a name.
fn call(name: impl AsRef<str>) -> Value {
    json!({ "syscall": name.as_ref() })
}

fn bit(argument: u8, bits: u64) -> Value {
    json!({ "index": argument, "type": "qword", "op": { "masked_eq": bits }, "val": bits })
}

/// The calls that a word of `SystemCallFilter` stands for: one, or a group.
fn calls(word: &str) -> Vec<String> {
    if !word.starts_with('@') {
        assert!(word.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_'), "what is {word}?");
        return vec![word.to_owned()];
    }
    let mut groups: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    let mut current = "";
    for line in include_str!("syscall_groups.txt").lines().filter(|line| !line.starts_with('#')) {
        match line.strip_prefix("  ") {
            None => current = line,
            Some(names) => groups.entry(current).or_default().extend(names.split_whitespace()),
        }
    }
    let group = groups.get(word).unwrap_or_else(|| panic!("no group {word}"));
    group.iter().flat_map(|name| calls(name)).collect()
}

/// Whether this kind of processor has a call of this name.
fn is_known(call: &str) -> bool {
    let alone = json!({ "mismatch_action": "log", "match_action": "allow", "filter": [{ "syscall": call }] });
    compiled(&alone).is_ok()
}

fn compiled(filter: &Value) -> Result<seccompiler::BpfProgram, seccompiler::Error> {
    let processor = std::env::consts::ARCH.try_into().expect("a processor that has such filters");
    let text = json!({ "filter": filter }).to_string();
    let mut programs = seccompiler::compile_from_json(text.as_bytes(), processor)?;
    Ok(programs.remove("filter").expect("the one that was asked for"))
}

/// The tests below start this as a process of its own: it puts itself behind filters and becomes another
/// program, whose standard output is descriptor 3. Among the other tests it does nothing.
#[test]
fn launcher() {
    let (Ok(filters), Ok(command)) = (std::env::var(FILTERS), std::env::var(COMMAND)) else { return };
    let filters: Vec<Value> = serde_json::from_str(&filters).expect("JSON");
    let filters: Vec<_> = filters.iter().map(|filter| compiled(filter).expect("a filter")).collect();
    let output = File::options().write(true).open("/proc/self/fd/3").expect("a standard output");
    let mut words = command.lines();
    let mut command = Command::new(words.next().expect("a program"));
    command.args(words).stdout(output).env_remove(FILTERS).env_remove(COMMAND);
    // The last is applied first: the first forbids to apply others.
    for filter in filters.iter().rev() {
        seccompiler::apply_filter(filter).expect("the kernel takes it");
    }
    panic!("{}", command.exec());
}

/// A program behind filters. Arguments that are added later are its own.
fn behind(filters: &[Value], program: &Path) -> Command {
    let script = format!(
        "export {COMMAND}=\"$(printf '%s\\n' \"$@\")\"; exec 3>&1 >/dev/null \"$0\" --exact unit::launcher --nocapture"
    );
    let mut shell = Command::new("sh");
    shell.arg("-c").arg(script).arg(std::env::current_exe().expect("this program")).arg(program);
    shell.env(FILTERS, json!(filters).to_string());
    shell
}

/// Frames of the default policy: it explores, learns and predicts, on threads of their own.
async fn frames(daemon: &Daemon) {
    let mut client = wire::connect(daemon.url().split(',').next().expect("an address")).await;
    let study = pb::Study { policy: None, ..wire::study() };
    let request = pb::CreateStudyRequest { study_id: "frames".into(), study: Some(study) };
    let study = client.create_study(request).await.expect("the study is taken").into_inner().name;
    for number in 0..60 {
        let near = f64::from(number / 4 % 5) / 5.0;
        let asked = client.suggest(wire::suggestion(&study, "one", near)).await;
        let trial = asked.unwrap_or_else(|status| panic!("frame {number}: {status}")).into_inner();
        client.report(wire::report(&trial)).await.expect("reported");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn frames_run_behind_the_units_own_filter() {
    let unit = Unit::read();
    let mut allowed = unit.allowed_calls();
    // For root alone SQLite sets the owner of the files beside its own. The unit's user is another, and tests
    // may be root's.
    let of_root = calls("@chown");
    assert!(!of_root.iter().any(|call| allowed.contains(call)));
    allowed.extend(of_root.iter().cloned());
    let mut filters = unit.filters(&allowed, &json!("kill_process"));
    filters.push(deny(
        json!({ "errno": EPERM }),
        of_root.iter().filter(|call| is_known(call)).map(call).collect(),
    ));
    let folder = tempfile::tempdir().expect("a scratch folder");
    let database = folder.path().join("tuning.db");
    let socket = folder.path().join("daemon.sock");
    let mut command = behind(&filters, &program("treewrightd"));
    // All settings that a unit may have in its variables.
    for (name, value) in [
        ("TREEWRIGHT_METRICS", "127.0.0.1:0"),
        ("TREEWRIGHT_DASHBOARD", "127.0.0.1:0"),
        ("TREEWRIGHT_KEEP_TRIALS", "20000"),
        ("TREEWRIGHT_SOCKET", path_text(&socket)),
        ("TREEWRIGHT_OTLP", "http://localhost:9"),
        ("TREEWRIGHT_LOG", "info,treewright_server=debug"),
    ] {
        command.env(name, value);
    }
    let daemon = Daemon::start_by(command, &database);
    frames(&daemon).await;
    let copy = folder.path().join("copy.db");
    let arguments = ["backup", "--database", path_text(&database), "--to", path_text(&copy)];
    let backed_up = behind(&filters, &program("treewrightd")).args(arguments).output().expect("it runs");
    assert!(backed_up.status.success(), "{}", stderr(&backed_up));
    daemon.signal("HUP");
    assert!(daemon.terminate().success());
    assert_sound(&copy);
}

/// A stricter system than ours, or an earlier systemd with other groups: the daemon gets an error and goes
/// on.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_forbidden_priority_is_an_error_and_no_death() {
    let unit = Unit::read();
    assert_eq!(unit.all("SystemCallErrorNumber").last(), Some("EPERM"), "a forbidden call does not kill");
    let mut allowed = unit.allowed_calls();
    assert!(allowed.remove("setpriority"), "long computations give way to those that answer");
    let filters = unit.filters(&allowed, &json!({ "errno": EPERM }));
    let folder = tempfile::tempdir().expect("a scratch folder");
    let daemon =
        Daemon::start_by(behind(&filters, &program("treewrightd")), &folder.path().join("tuning.db"));
    frames(&daemon).await;
    assert!(daemon.terminate().success());
}
