#!/usr/bin/env python3
"""Plants defects in the service and lets the simulator hunt them: each has to be found within minutes.

The sources are copied below target/hunt and changed there, one defect at a time, so the service itself holds no switch for
any of them. `make hunt` runs all; `tests/simulation/hunt.py --minutes 2 acknowledged_before_durable` one. `--check` only
looks whether every defect can still be planted, which a test does.
"""

import argparse
import json
import pathlib
import shutil
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
COPY = ROOT / "target" / "hunt" / "source"
BUILD = ROOT / "target" / "hunt" / "build"

FRAMES = "server/src/tuning/frames.rs"

# Name: file, what stands there, what is put in its place.
DEFECTS = {
    "acknowledged_before_durable": (
        FRAMES,
        "self.durable(&report.trial.study, receipt, deferred).await?;\n                    return Ok(Reported::Taken",
        "drop((receipt, deferred));\n                    return Ok(Reported::Taken",
    ),
    "suggested_before_durable": (
        FRAMES,
        "self.metrics().durable(receipt).await?;\n        Ok(trial)",
        "drop(receipt);\n        Ok(trial)",
    ),
    "frame_acknowledged_when_its_write_failed": (
        FRAMES,
        "let reported = durable.map(|()| Reported::Taken(completed)).map_err(Error::from);",
        "drop(durable);\n                let reported = Ok::<_, Error>(Reported::Taken(completed));",
    ),
    "broken_fence_ignored": (
        "server/src/tuning/runtime.rs",
        "live.as_mut().filter(|live| live.fence.holds() && !live.is_stale)",
        "live.as_mut().filter(|live| !live.is_stale)",
    ),
    "repeated_report_refused": (
        FRAMES,
        "return Ok(Reported::Duplicate(Box::new(stored)));",
        "return Err(TunerError::AlreadyCompleted { number: stored.number }.into());",
    ),
    "completed_trial_learnt_twice": (
        "server/core/src/tuner/report.rs",
        "let learnt = self.complete(completed);\n",
        "self.states.learn(state, completed);\n        let learnt = self.complete(completed);\n",
    ),
    "lease_never_ends": (
        "server/core/src/tuner/trials.rs",
        "self.leases.range(..(now_ms, TrialNumber(0)))",
        "self.leases.range(..(0.min(now_ms), TrialNumber(0)))",
    ),
    "trial_handed_to_two": (
        "server/core/src/tuner/suggest.rs",
        "let number = self.trials.last().next();",
        "let number = TrialNumber(self.trials.last().0.max(1));",
    ),
}


def broken(name):
    """The text of the defect's file with the defect in it."""
    path, sound, defect = DEFECTS[name]
    text = (ROOT / path).read_text()
    if text.count(sound) != 1:
        sys.exit(f"hunt: {name}: what it changes stands {text.count(sound)} times in {path}; mend DEFECTS")
    return text.replace(sound, defect)


def copy_sources():
    """Copies what git knows, and leaves alone what is the same already: cargo goes by the time of a file."""
    names = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"], cwd=ROOT, check=True, capture_output=True
    ).stdout
    for name in filter(None, names.decode().split("\0")):
        source, target = ROOT / name, COPY / name
        if source.is_file() and not (target.is_file() and target.read_bytes() == source.read_bytes()):
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, target)


def simulate(minutes, profile):
    """Builds the simulator in the copy and runs it; what it reports."""
    build = ["cargo", "build", "--quiet", "--locked", "--profile", profile, "-p", "treewright-simulation"]
    subprocess.run([*build, "--target-dir", str(BUILD)], cwd=COPY, check=True)
    program = BUILD / ("debug" if profile == "dev" else profile) / "simulate"
    run = subprocess.run(
        [program, "--minutes", str(minutes), "--steps", "5000"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    # A defect may also end the simulator itself.
    return json.loads(run.stdout) if run.stdout else {"found": {"plan": {}, "violations": [{"what": "a panic"}]}}


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    arguments.add_argument("defects", nargs="*", help="which; all when left out")
    arguments.add_argument("--minutes", type=float, default=5, help="for how long each is hunted (5)")
    arguments.add_argument("--profile", default="release", help="of cargo (release)")
    arguments.add_argument("--check", action="store_true", help="only look whether they can be planted")
    given = arguments.parse_args()
    unknown = set(given.defects) - set(DEFECTS)
    if unknown:
        sys.exit(f"hunt: {', '.join(unknown)}: no such defect; there are {', '.join(DEFECTS)}")
    if given.check:
        return [broken(name) for name in DEFECTS] and None
    escaped = []
    for name in given.defects or DEFECTS:
        copy_sources()
        (COPY / DEFECTS[name][0]).write_text(broken(name))
        begin = time.monotonic()
        report = simulate(given.minutes, given.profile)
        found = report.get("found")
        if not found:
            escaped.append(name)
            print(f"{name}: NOT found in {report['worlds']} worlds, {report['wall_s']:.1f} s", flush=True)
            continue
        seed, what = found["plan"].get("seed", "?"), found["violations"][0]["what"]
        took = report.get("wall_s", time.monotonic() - begin)
        print(f"{name}: found in {took:.1f} s, seed {seed}: {what[:160]}", flush=True)
    copy_sources()
    if escaped:
        sys.exit(f"hunt: {len(escaped)} escaped: {', '.join(escaped)}")


if __name__ == "__main__":
    main()
