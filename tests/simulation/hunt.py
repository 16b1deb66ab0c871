#!/usr/bin/env python3
"""Plants defects in the service and lets the simulator hunt them: each has to be found within minutes.

The sources are copied below target/hunt and changed there, so the service itself holds no switch for any of them. In the copy a
variable of the environment says which defect is there, so that one build serves for all. `make hunt` runs all;
`tests/simulation/hunt.py --minutes 2 acknowledged_before_durable` one. `--check` only looks whether every defect can still
be planted, which a test does.
"""

import argparse
import json
import os
import pathlib
import shutil
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
COPY = ROOT / "target" / "hunt" / "source"
BUILD = ROOT / "target" / "hunt" / "build"

FRAMES = "server/src/tuning/frames.rs"
VARIABLE = "TREEWRIGHT_HUNTED_DEFECT"

# Name: file, what stands there, what is put in its place. HERE is true when the defect is.
DEFECTS = {
    "acknowledged_before_durable": (
        FRAMES,
        "self.durable(&report.trial.study.id, receipt, deferred).await?;\n        Ok(Reported::Taken",
        "if HERE { drop((receipt, deferred)); } else { self.durable(&report.trial.study.id, receipt, deferred).await?; }\n"
        "        Ok(Reported::Taken",
    ),
    "suggested_before_durable": (
        FRAMES,
        "self.metrics().durable(receipt).await?;\n        Ok(trial)",
        "if HERE { drop(receipt); } else { self.metrics().durable(receipt).await?; }\n        Ok(trial)",
    ),
    "frame_acknowledged_when_its_write_failed": (
        FRAMES,
        "durable.map(|()| Reported::Taken(completed)).map_err(Error::from);",
        "(if HERE { Ok(()) } else { durable }).map(|()| Reported::Taken(completed)).map_err(Error::from);",
    ),
    "broken_fence_ignored": (
        "server/src/tuning/runtime.rs",
        "live.as_mut().filter(|live| live.fence.holds() && !live.is_stale)",
        "live.as_mut().filter(|live| (HERE || live.fence.holds()) && !live.is_stale)",
    ),
    "repeated_report_refused": (
        FRAMES,
        "Err(stored) => return Ok(Reported::Duplicate(stored)),",
        "Err(stored) if HERE => return Err(TunerError::AlreadyCompleted(stored.number).into()),\n"
        "                Err(stored) => return Ok(Reported::Duplicate(stored)),",
    ),
    "completed_trial_learnt_twice": (
        "server/core/src/tuner/report.rs",
        "let learnt = self.knowledge.complete(&self.spec, is_few, completed);\n",
        "if HERE { self.knowledge.states.learn(state, completed, 0.0); }\n"
        "        let learnt = self.knowledge.complete(&self.spec, is_few, completed);\n",
    ),
    "lease_never_ends": (
        "server/core/src/tuner/clients/trials.rs",
        "self.leases.range(..(now_ms, TrialNumber(0)))",
        "self.leases.range(..(if HERE { 0.min(now_ms) } else { now_ms }, TrialNumber(0)))",
    ),
    "trial_handed_to_two": (
        "server/core/src/tuner/suggest.rs",
        "let number = self.clients.trials.last().next();",
        "let number = if HERE { TrialNumber(self.clients.trials.last().0.max(1)) }\n"
        "                else { self.clients.trials.last().next() };",
    ),
}

# What the simulated disk and network do themselves when they are told to (`simulate --plant`): the service is not changed.
PLANTED = {
    "disk_answers_before_it_has_written": "acknowledge-before-commit",
    "lease_without_claim": "lease-without-claim",
    "lost_wake_up": "lost-wake-up",
    "budget_overspent": "overspending",
}


def broken():
    """The texts of the files with defects, with all of them in."""
    texts = {}
    for name, (path, sound, defect) in DEFECTS.items():
        text = texts.get(path) or (ROOT / path).read_text()
        if text.count(sound) != 1:
            sys.exit(f"hunt: {name}: what it changes stands {text.count(sound)} times in {path}; mend DEFECTS")
        here = f'std::env::var("{VARIABLE}").is_ok_and(|name| name == "{name}")'
        texts[path] = text.replace(sound, defect.replace("HERE", here))
    return texts


def copy_sources():
    """Copies what git knows, with the defects, and leaves alone what is the same already: cargo goes by the time of a file.
    So does a first copy keep its time."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(command, cwd=ROOT, check=True, capture_output=True).stdout
    texts = broken()
    for name in filter(None, names.decode().split("\0")):
        source, target = ROOT / name, COPY / name
        if not source.is_file():
            continue
        wanted = texts[name].encode() if name in texts else source.read_bytes()
        if target.is_file() and target.read_bytes() == wanted:
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        is_new = not target.exists()
        target.write_bytes(wanted)
        if is_new and name not in texts:
            shutil.copystat(source, target)


def build(profile):
    """Builds the simulator in the copy."""
    command = ["cargo", "build", "--quiet", "--locked", "--profile", profile, "--workspace", "--bin", "simulate"]
    subprocess.run([*command, "--target-dir", str(BUILD)], cwd=COPY, check=True)
    return BUILD / ("debug" if profile == "dev" else profile) / "simulate"


def simulate(program, minutes, name):
    """Runs the simulator with a defect; what it reports."""
    more = ["--plant", PLANTED[name]] if name in PLANTED else []
    environment = {**os.environ, VARIABLE: name}
    command = [program, "--minutes", str(minutes), "--steps", "5000", *more]
    run = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment)
    # A defect may also end the simulator itself.
    return json.loads(run.stdout) if run.stdout else {"found": {"plan": {}, "violations": [{"what": "a panic"}]}}


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    arguments.add_argument("defects", nargs="*", help="which; all when left out")
    arguments.add_argument("--minutes", type=float, default=5, help="for how long each is hunted (5)")
    arguments.add_argument("--profile", default="release", help="of cargo (release)")
    arguments.add_argument("--check", action="store_true", help="only look whether they can be planted")
    given = arguments.parse_args()
    everything = [*PLANTED, *DEFECTS]
    unknown = set(given.defects) - set(everything)
    if unknown:
        sys.exit(f"hunt: {', '.join(unknown)}: no such defect; there are {', '.join(everything)}")
    if given.check:
        broken()
        return
    copy_sources()
    program = build(given.profile)
    escaped = []
    for name in given.defects or everything:
        begin = time.monotonic()
        report = simulate(program, given.minutes, name)
        found = report.get("found")
        if not found:
            escaped.append(name)
            print(f"{name}: NOT found in {report['worlds']} worlds, {report['wall_s']:.1f} s", flush=True)
            continue
        seed, what = found["plan"].get("seed", "?"), found["violations"][0]["what"]
        took = report.get("wall_s", time.monotonic() - begin)
        print(f"{name}: found in {took:.1f} s, seed {seed}: {what[:160]}", flush=True)
    if escaped:
        sys.exit(f"hunt: {len(escaped)} escaped: {', '.join(escaped)}")


if __name__ == "__main__":
    main()
