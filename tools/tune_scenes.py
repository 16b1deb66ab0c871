#!/usr/bin/env python3
"""Searches of several scenes: what they cost and find, beside an earlier version's, or with other scenes known.

    make build
    tools/tune_scenes.py --before FOLDER --folder RUNS
    tools/tune_scenes.py --start native --known builtin:scaffold --known builtin:gallery --scene builtin:hall --folder RUNS

With --before, a folder of the programs of another version, that version searches each scene, too. Then its winner runs
beside this version's in interleaved rounds of this version. With --known, those scenes are searched first into one
database, and every other scene is searched once alone and once with a copy of it.

Each search has a fresh daemon. What they wrote stays in --folder, and what is there is not measured again, so a run goes
on where it was stopped. The tables are those of search_table.py. Ratios of two versions are medians of the rows, with
95 % intervals from the signs of the rows. Run it where nothing else does.
"""

import argparse
import contextlib
import json
import os
import pathlib
import re
import shutil
import signal
import statistics
import subprocess
import sys

import search_table
from rounds import ratio
from search_table import COLUMNS, NOTHING, head, row

ROOT = pathlib.Path(__file__).resolve().parent.parent
BIN = pathlib.Path(os.environ.get("BIN", ROOT / "target" / "release"))
SCENES = [f"builtin:{name}" for name in ("hall", "voxels", "city", "gallery", "sea", "scaffold")]
NOW, BEFORE, KNOWN = "now", "before", "known"


class Failed(Exception):
    """Why a program did not do what it was to."""


@contextlib.contextmanager
def served(programs, database):
    """The address of a daemon, which ends with the block."""
    command = [programs / "treewrightd", "serve", "--listen", "127.0.0.1:0", "--database", database]
    daemon = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        url = re.search(r"http:\S+", daemon.stdout.readline())
        if not url:
            raise Failed(f"{programs / 'treewrightd'} did not start")
        yield url.group(0)
    finally:
        daemon.send_signal(signal.SIGTERM)
        daemon.wait()


def render(programs, *arguments):
    done = subprocess.run([programs / "treewright-render", *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if done.returncode:
        raise Failed(f"treewright-render {' '.join(map(str, arguments))}:\n{done.stderr}")


def knows(programs, option):
    """Whether `tune` of that version has an option."""
    told = subprocess.run([programs / "treewright-render", "tune", "--help"], capture_output=True, text=True, check=True)
    return option in told.stdout


class Bench:
    """Searches and comparisons of one call."""

    def __init__(self, arguments):
        self.arguments = arguments
        self.folder = arguments.folder
        self.folder.mkdir(parents=True, exist_ok=True)
        self.programs = {NOW: BIN, KNOWN: BIN, BEFORE: arguments.before}

    def where(self, scene):
        """What every command about a scene wants."""
        return ["--scene", scene, "--size", self.arguments.size, "--threads", str(self.arguments.threads)]

    def path(self, scene, objective, what):
        return self.folder / f"{pathlib.Path(scene.split(':')[-1]).stem}-{objective}-{what}.json"

    def tune(self, scene, objective, what, database):
        """One search, unless its results are there."""
        results, programs = self.path(scene, objective, what), self.programs[what]
        if not results.exists():
            options = ["--objective", objective, "--iterations", str(self.arguments.iterations), "--rounds", str(self.arguments.rounds)]
            if knows(programs, "--worth"):
                options += ["--worth", self.arguments.worth]
            if self.arguments.start != "recommended":
                options += ["--start", self.arguments.start]
            with served(programs, database) as url:
                render(programs, "tune", "--server", url, *self.where(scene), *options, "--json", results)
            print(f"{results.stem} is searched", file=sys.stderr, flush=True)
        return json.loads(results.read_text())

    def fresh(self, of=None):
        """A database with nothing in it, or with what another one has."""
        for left in self.folder.glob("one.db*"):
            left.unlink()
        if of:
            for part in self.folder.glob(f"{of}.db*"):
                shutil.copy(part, self.folder / part.name.replace(of, "one", 1))
        return self.folder / "one.db"

    def teach(self, objective):
        """Searches the known scenes into one database; its name."""
        name = f"known-{objective}"
        for scene in self.arguments.known:
            self.tune(scene, objective, KNOWN, self.folder / f"{name}.db")
        return name

    def paired(self, scene, objective, found):
        """This version's winner over the earlier one's, in interleaved rounds; None where the latter cannot run now."""
        told = self.path(scene, objective, "paired")
        if not told.exists():
            command = ["bench", *self.where(scene), "--rounds", str(self.arguments.paired_rounds), "--only", f"{BEFORE},{NOW}"]
            for name in (BEFORE, NOW):
                path = self.path(scene, objective, f"{name}-found")
                path.write_text(json.dumps(found[name]["tuned"]))
                command += ["--contender", f"{name}=full:{path}"]
            try:
                render(BIN, *command, "--json", told)
            except Failed as failed:
                print(failed, file=sys.stderr)
                return None
        costs = {one["name"]: one["rounds_ms"] for one in json.loads(told.read_text())[objective]}
        return ratio(costs[BEFORE], costs[NOW])


def compare(bench, pairs):
    """This version's searches beside those of the one before."""
    print("\n| scene | objective | seconds before, now | frames before, now | answer's speed, now over before |\n|---|---|---|---|---|")
    speeds = []
    for (scene, objective), found in pairs.items():
        speed = bench.paired(scene, objective, found)
        shown = NOTHING if speed is None else f"{speed[0]:.3f} [{speed[1][0]:.3f}, {speed[1][1]:.3f}]"
        speeds += [] if speed is None else [speed]
        took = ", ".join(f"{search_table.seconds(found[what]):.1f}" for what in (BEFORE, NOW))
        frames = ", ".join(str(search_table.shown(found[what])) for what in (BEFORE, NOW))
        print(row([scene.split(":")[-1], objective, took, frames, shown]))
    for name, of in (("seconds", search_table.seconds), ("frames", search_table.shown)):
        median, ends = ratio(*([of(found[what]) for found in pairs.values()] for what in (NOW, BEFORE)))
        print(f"\n{name}, now over before: {median:.2f} [{ends[0]:.2f}, {ends[1]:.2f}]")
    if speeds:
        median, ends = ratio([speed for speed, _ in speeds], [1] * len(speeds))
        slower = sum(most < 1 for _, (_, most) in speeds)
        print(f"\nanswer's speed, now over before: {median:.3f} [{ends[0]:.3f}, {ends[1]:.3f}]; slower beyond doubt in {slower} of {len(speeds)}")


def goals(name, all_results):
    """How many searches met the goals of a session that begins at a start of its own, and which frames were dear."""
    reached = [frames for frames in map(search_table.until, all_results) if frames is not None]
    most = [ratio for ratio in map(search_table.session, all_results) if ratio is not None]
    median = f", after {statistics.median(reached):.0f} frames in the median of these" if reached else ""
    below = sum(ratio <= 1 for ratio in most)
    print(f"\n{name}: shown to be {search_table.FASTER} times as fast as the start in {len(reached)} of {len(all_results)}{median}; the "
          f"whole session never above the baseline's after {search_table.SESSION} frames in {below} of {len(most)}")
    unsafe = list(filter(None, map(search_table.dear, all_results)))
    if unsafe:
        print(f"\n{name}: frames above {search_table.DEAR_ABOVE} times the start: {statistics.median(share for share, _ in unsafe):.0%} in the "
              f"median of the searches, {max(share for share, _ in unsafe):.0%} at most; the dearest {max(worst for _, worst in unsafe):.2f} times")


def parsed():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", action="append", help=f"can be repeated; default: {', '.join(SCENES)}")
    parser.add_argument("--objective", action="append", choices=["render", "total"], help="can be repeated; default: both")
    parser.add_argument("--before", type=pathlib.Path, help="folder with treewrightd and treewright-render of another version")
    parser.add_argument("--known", action="append", default=[], metavar="SCENE", help="a scene to be known; can be repeated")
    parser.add_argument("--start", default="recommended", help="where searches begin, as in `tune`")
    parser.add_argument("--iterations", type=int, default=24)
    parser.add_argument("--worth", default="inf", help="`--worth` of `tune`, for versions that have it")
    parser.add_argument("--rounds", type=int, default=7, help="rounds at the end of each search")
    parser.add_argument("--paired-rounds", type=int, default=11, help="rounds of two versions' winners")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--size", default="160x120")
    parser.add_argument("--folder", type=pathlib.Path, required=True, help="keeps all results")
    arguments = parser.parse_args()
    arguments.scene = [scene for scene in arguments.scene or SCENES if scene not in arguments.known]
    return arguments


def main():
    arguments = parsed()
    bench = Bench(arguments)
    whats = [BEFORE] * bool(arguments.before) + [NOW] + [KNOWN] * bool(arguments.known)
    found = {}
    for objective in arguments.objective or ["render", "total"]:
        known = bench.teach(objective)
        for scene in arguments.scene:
            # Versions take turns scene by scene, so that a machine that changes its speed affects both.
            for what in whats:
                database = bench.fresh(known if what == KNOWN else None)
                found[scene, objective, what] = bench.tune(scene, objective, what, database)
    print(head(("version", *COLUMNS)))
    for (_, _, what), results in found.items():
        print(row([what, *search_table.cells(results)]))
    for what in whats:
        goals(what, [results for (_, _, own), results in found.items() if own == what])
    if arguments.before:
        pairs = {}
        for (scene, objective, what), results in found.items():
            pairs.setdefault((scene, objective), {})[what] = results
        compare(bench, pairs)


if __name__ == "__main__":
    try:
        main()
    except Failed as failed:
        sys.exit(f"tune_scenes: {failed}")
