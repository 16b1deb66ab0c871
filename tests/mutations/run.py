#!/usr/bin/env python3
"""Mutation tests of core, store, server and client: changes the code in small ways and looks whether a test notices.

The changes are those of `cargo mutants --list` (cargo-mutants 27), of which a sample with a stated seed is taken. They are not
compiled one at a time: the sources are copied below target/mutations, each changed function gets all its changed bodies
beside its own, and a variable of the environment says which one runs ("mutant schemata"; Untch, Offutt, Harrold, 1993). So
the crates are built once, and each change costs a run of the tests only: of those programs that came to the changed function
in a first run without any change.

    tests/mutations/run.py --per-package 120 --seed 1 treewright-client treewright-store

prints a line for each change and a table. A change that does not compile is left out; one at which the tests do not end
counts as noticed.
"""

import argparse
import collections
import json
import math
import os
import pathlib
import random
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
COPY = ROOT / "target" / "mutations" / "source"
BUILD = ROOT / "target" / "mutations" / "build"
VARIABLE = "TREEWRIGHT_MUTATION"
# Names a folder: each change whose place is come to leaves a file there.
REACHED = "TREEWRIGHT_MUTATIONS_REACHED"
# Appended to each crate.
SWITCH = f"""
pub(crate) mod mutation {{
    use std::sync::{{Mutex, OnceLock}};

    pub(crate) fn on(number: u32) -> bool {{
        static ACTIVE: OnceLock<u32> = OnceLock::new();
        static REACHED: OnceLock<Option<(String, Mutex<std::collections::BTreeSet<u32>>)>> = OnceLock::new();
        let read = || std::env::var("{VARIABLE}").ok().and_then(|text| text.parse().ok()).unwrap_or(0);
        let reached = || Some((std::env::var("{REACHED}").ok()?, Mutex::default()));
        if let Some((folder, seen)) = REACHED.get_or_init(reached) {{
            if seen.lock().unwrap().insert(number) {{
                std::fs::write(format!("{{folder}}/{{number}}"), "").unwrap();
            }}
        }}
        *ACTIVE.get_or_init(read) == number
    }}
}}
"""
FOLDERS = {
    "treewright-client": "client",
    "treewright-core": "server/core",
    "treewright-server": "server",
    "treewright-store": "server/store",
}


def listed(packages):
    """What cargo-mutants would change."""
    names = [word for package in packages for word in ("-p", package)]
    out = subprocess.run(["cargo", "mutants", "--list", "--json", *names], cwd=ROOT, check=True, capture_output=True)
    return json.loads(out.stdout)


def copy_sources(without):
    """What git knows, with its times; what differs in the copy is put back. A file that is written again is compiled again."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(command, cwd=ROOT, check=True, capture_output=True).stdout
    for name in set(filter(None, names.decode().split("\0"))) - without:
        source, target = ROOT / name, COPY / name
        if source.is_file() and not (target.is_file() and target.read_bytes() == source.read_bytes()):
            target.parent.mkdir(parents=True, exist_ok=True)
            (shutil.copyfile if target.is_file() else shutil.copy2)(source, target)


class Source:
    """A file, and where its lines begin."""

    def __init__(self, name):
        self.text = (ROOT / name).read_text()
        self.lines = [0]
        for line in self.text.splitlines(keepends=True):
            self.lines.append(self.lines[-1] + len(line))

    def at(self, place):
        return self.lines[place["line"] - 1] + place["column"] - 1

    def body(self, function):
        """From behind the brace that opens a function's body to the one that closes it; None where it is not plain."""
        begin, end = self.at(function["span"]["start"]), self.at(function["span"]["end"]) - 1
        name = function["function_name"].split("::")[-1]
        head = re.search(rf"\bfn\s+{re.escape(name)}\b", self.text[begin:end])
        if not head or self.text[end] != "}":
            return None
        place, depth = begin + head.end(), 0
        if re.search(r"\bconst\s+(async\s+)?$", self.text[begin : begin + head.start()]):
            return None
        while self.text[place] != "{" or depth:
            depth += {"(": 1, ")": -1, "[": 1, "]": -1}.get(self.text[place], 0)
            place += 1
        return place + 1, end


def planted(mutants):
    """Writes the copies of the files with all changes in; where in them each change stands."""
    roots = {f"{folder}/src/lib.rs" for folder in FOLDERS.values()}
    copy_sources({mutant["file"] for mutant in mutants.values()} | roots)
    places = {}
    by_file = collections.defaultdict(list)
    for number, mutant in mutants.items():
        by_file[mutant["file"]].append((number, mutant))
    for name, ours in by_file.items():
        source = Source(name)
        by_body = collections.defaultdict(list)
        for number, mutant in ours:
            body = mutant["function"] and source.body(mutant["function"])
            if body and "impl " not in mutant["function"]["return_type"]:
                by_body[body].append((number, mutant))
        text, last = [], 0
        for (begin, end), changes in sorted(by_body.items()):
            if begin < last:
                continue  # A function in another one.
            text.append(source.text[last:begin])
            for number, mutant in changes:
                start, stop = source.at(mutant["span"]["start"]), source.at(mutant["span"]["end"])
                changed = source.text[begin:start] + mutant["replacement"] + source.text[stop:end]
                first = "".join(text).count("\n") + 2
                text.append(f"\nif crate::mutation::on({number}) {{\n{changed}\n}} else ")
                places[number] = (name, first, "".join(text).count("\n") + 1)
            text.append("{\n" + source.text[begin:end] + "\n}\n")
            last = end
        text.append(source.text[last:])
        write(COPY / name, "".join(text) + (SWITCH if name in roots else ""))
    for name in roots - set(by_file):
        write(COPY / name, (ROOT / name).read_text() + SWITCH)
    return places


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.is_file() or path.read_text() != text:
        path.write_text(text)


def cargo(command, packages, messages):
    """Runs cargo in the copy; its messages of a kind."""
    names = [word for package in packages for word in ("-p", package)]
    line = ["cargo", *command, "--quiet", "--locked", "--message-format=json", *names, "--target-dir", str(BUILD)]
    out = subprocess.run(line, cwd=COPY, stdout=subprocess.PIPE, text=True)
    found = (json.loads(line) for line in out.stdout.splitlines() if line.startswith("{"))
    return out.returncode, [one for one in found if one["reason"] == messages]


def viable(mutants, packages):
    """Leaves out what does not compile, and what did not in an earlier run."""
    kept = BUILD / "does-not-compile.json"
    known = set(json.loads(kept.read_text())) if kept.is_file() else set()
    for number in [number for number, mutant in mutants.items() if mutant["name"] in known]:
        del mutants[number]
    while True:
        places = planted(mutants)
        for number in [number for number in mutants if number not in places]:
            del mutants[number]
        code, messages = cargo(["build", "--lib"], packages, "compiler-message")
        bad = set()
        for one in messages:
            for span in one["message"]["spans"] if one["message"]["level"] == "error" else []:
                for number, (name, first, last) in places.items():
                    if span["file_name"] == name and first <= span["line_start"] <= last:
                        bad.add(number)
        print(f"{len(mutants)} changes planted, {len(bad)} do not compile", flush=True)
        if not bad:
            if code:
                sys.exit("".join(one["message"]["rendered"] for one in messages if one["message"]["level"] == "error"))
            return
        known |= {mutants.pop(number)["name"] for number in bad}
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(sorted(known), indent=1))


def programs(packages):
    """The test programs of each package, the one inside the library first."""
    code, messages = cargo(["test", "--no-run", "--lib", "--tests"], packages, "compiler-artifact")
    if code:
        sys.exit("the tests do not build")
    found = collections.defaultdict(list)
    for one in messages:
        if one["profile"]["test"] and one["executable"]:
            package = one["package_id"].split("#")[-1].split("@")[0]
            folder = pathlib.Path(one["manifest_path"]).parent
            package = next((p for p, f in FOLDERS.items() if folder == COPY / f), package)
            found[package].append((0 if "lib" in one["target"]["kind"] else 1, one["target"]["name"], one["executable"], folder))
    return {package: sorted(all_of) for package, all_of in found.items()}


def run_program(test, limit_s, **variables):
    """How a test program ended: None where it did not in time. It is stopped at the first test that fails."""
    _, _, program, folder = test
    environment = {**os.environ, **variables}
    running = subprocess.Popen(
        [program], cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    stopped = threading.Event()

    def stop():
        stopped.set()
        running.kill()

    clock = threading.Timer(limit_s or 86_400, stop)
    clock.start()
    try:
        for line in running.stdout:
            if line.rstrip().endswith("... FAILED"):
                running.kill()
                return 101
        code = running.wait()
        return None if stopped.is_set() else code
    finally:
        clock.cancel()
        running.wait()


def unchanged(tests):
    """Each test program's limit of time, and the changes that it comes to."""
    looked_at = []
    for test in tests:
        begin = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            if run_program(test, None, **{REACHED: folder}):
                sys.exit(f"{test[1]} fails without any change")
            reached = {int(name) for name in os.listdir(folder)}
        taken_s = time.monotonic() - begin
        print(f"{test[1]}: {taken_s:.0f} s, comes to {len(reached)} changes", flush=True)
        looked_at.append((taken_s, test, reached))
    return sorted(looked_at, key=lambda one: one[0])


def noticed(number, looked_at):
    """The first test program that does not end well with this change, the shortest first."""
    for taken_s, test, reached in looked_at:
        if number in reached:
            code = run_program(test, 20 + 2 * taken_s, **{VARIABLE: str(number)})
            if code != 0:
                return test[1] if code else f"{test[1]} does not end"
    return None


def sample(given):
    """The changes that are to be made, by number."""
    everything = json.loads(given.list.read_text()) if given.list else listed(given.packages)
    everything.sort(key=lambda mutant: mutant["name"])
    chosen = []
    for package in given.packages:
        ours = [mutant for mutant in everything if mutant["package"] == package and mutant["function"]]
        chosen += random.Random(given.seed).sample(ours, min(given.per_package, len(ours)))
    return dict(enumerate(sorted(chosen, key=lambda mutant: mutant["name"]), start=1))


def run(mutants, tests, package, given):
    """Runs the tests of a package with each of its changes, in random order; how many were run, and how many noticed."""
    looked_at = unchanged(tests)
    ours = [(number, mutant) for number, mutant in mutants.items() if mutant["package"] == package]
    random.Random(given.seed).shuffle(ours)
    begin, count, caught = time.monotonic(), 0, 0
    for number, mutant in ours:
        if time.monotonic() - begin > 60 * given.minutes:
            break
        by = noticed(number, looked_at)
        count, caught = count + 1, caught + (by is not None)
        come_to = any(number in reached for _, _, reached in looked_at)
        words = f"caught by {by}" if by else "SURVIVED" if come_to else "NEVER COME TO"
        print(f"{words}: {mutant['name']}", flush=True)
    return count, caught


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    arguments.add_argument("packages", nargs="+", choices=sorted(FOLDERS))
    arguments.add_argument("--per-package", type=int, default=120, help="changes of each package (120)")
    arguments.add_argument("--seed", type=int, default=1, help="of the sample (1)")
    arguments.add_argument("--minutes", type=float, default=math.inf, help="for the tests of each package (no limit)")
    arguments.add_argument("--skip", action="append", default=[], help="a test program that is not run")
    arguments.add_argument("--list", type=pathlib.Path, help="what `cargo mutants --list --json` said, instead of asking")
    given = arguments.parse_args()
    mutants = sample(given)
    viable(mutants, given.packages)
    tests = {package: [one for one in all_of if one[1] not in given.skip] for package, all_of in programs(given.packages).items()}
    table = {package: run(mutants, tests[package], package, given) for package in given.packages}
    for package, (count, caught) in table.items():
        print(f"| {package} | {count} | {caught} | {100 * caught / max(count, 1):.0f} % |")


if __name__ == "__main__":
    main()
