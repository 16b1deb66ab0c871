#!/usr/bin/env python3
"""Tunes the evaluation scenes and measures the winners side by side with native Embree.

    make build
    SCENES=FOLDER tools/bench.py [--out bench.json] [--only NAME,...] [--rows 2@320x240,1@1280x720]

Scenes are built-in ones and, where SCENES names a folder that holds NAME/*.glb or NAME/*.obj, real ones. Each scene is
searched for both objectives (a frame with a thousandth of its build, and with a whole one) in the paper's space
and in the full one, with all threads at the first row's size. For every further row the winners take part in a
shorter search there. Then everybody builds and renders in interleaved rounds; one run of rounds serves both
objectives. Figures come from these rounds alone, never from a search.

Results go into the JSON file after every step, with a Markdown table beside it; a run that was stopped goes on
where it was. --dry-run tells what is missing and about how long it takes.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
BIN = pathlib.Path(os.environ.get("BIN", ROOT / "target" / "release"))
FILES = ["sponza", "fireplace_room", "living_room", "bmw-m6", "kitchen", "buddha_100k"]
BUILTIN = ["voxels", "gallery", "city"]
OBJECTIVES = ["render", "total"]
NATIVE = "native Embree default"
# Native with stages and packets, in whichever quality is the fastest; and the one configuration that is best over all scenes.
USED_WELL, FIXED = "native used well", "best fixed configuration"
# At large sizes only these: the others would double the time and answer nothing new.
LARGE = [NATIVE, USED_WELL, FIXED]
LARGE_PIXELS = 640 * 480
# Seconds a scene has taken so far on two cores, before any of this run's own are known: search, and a row's rounds.
GUESS = {"search": 60, "small": 60, "large": 170}


def scenes(chosen):
    folder = pathlib.Path(os.environ["SCENES"]) if os.environ.get("SCENES") else None
    found = {}
    for name in FILES:
        files = [*sorted((folder / name).glob("*.glb")), *sorted((folder / name).glob("*.obj"))] if folder else []
        if files:
            found[name] = str(files[0])
    found |= {name: f"builtin:{name}" for name in BUILTIN}
    if chosen:
        missing = [name for name in chosen if name not in found]
        if missing:
            sys.exit(f"bench: no such scene: {', '.join(missing)}; there are {', '.join(found)} (set SCENES for real ones)")
        found = {name: found[name] for name in chosen}
    return found


class Row:
    """Threads and size, written 2@320x240."""

    def __init__(self, text):
        threads, _, size = text.partition("@")
        width, _, height = size.partition("x")
        if not (threads.isdigit() and width.isdigit() and height.isdigit()):
            raise argparse.ArgumentTypeError(f"a row is written THREADS@WIDTHxHEIGHT, not {text}")
        self.text, self.threads, self.size = text, threads, size
        self.large = int(width) * int(height) > LARGE_PIXELS


def rows(text):
    return [Row(part) for part in text.split(",")]


class Daemon:
    """A daemon on a fresh database, for the length of a with block."""

    def __enter__(self):
        self.folder = tempfile.TemporaryDirectory()
        database = str(pathlib.Path(self.folder.name) / "tuning.db")
        self.process = subprocess.Popen([str(BIN / "treewrightd"), "serve", "--listen", "127.0.0.1:0", "--database", database],
                                        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        line = self.process.stdout.readline()
        if "http://" not in line:
            sys.exit("bench: treewrightd did not start; run: make build")
        return line.split()[-1]

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait()
        self.folder.cleanup()


def render(command, *arguments):
    """Runs treewright-render and returns what it wrote as JSON."""
    with tempfile.TemporaryDirectory() as folder:
        result = pathlib.Path(folder) / "result.json"
        done = subprocess.run([str(BIN / "treewright-render"), command, "--json", str(result), *map(str, arguments)],
                              stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        if done.returncode != 0:
            sys.exit(f"bench: {command} {' '.join(map(str, arguments))} failed:\n{done.stderr}")
        return json.loads(result.read_text())


def search(url, scene, row, space, objective, iterations, candidates=()):
    """A search and the confirmation of its best few. What is kept: the winner, and what the search cost."""
    with tempfile.TemporaryDirectory() as folder:
        more = []
        for number, candidate in enumerate(candidates):
            file = pathlib.Path(folder) / f"{number}.json"
            file.write_text(json.dumps(candidate))
            more += ["--candidate", file]
        # The rounds that count are measured later, with everybody.
        run = render("tune", "--server", url, "--scene", scene, "--threads", row.threads, "--size", row.size, "--space", space,
                     "--objective", objective, "--iterations", iterations, "--worth", "inf", "--rounds", 1, *more)
    return {"tuned": run["found"], "triangles": run["scene"]["triangles"], "trials": len(run["trials"]),
            "infeasible": sum(trial["cost"] is None for trial in run["trials"]),
            "waiting_ms": run["overhead"]["waiting_ms"]["median"], "share_of_frame": run["overhead"]["share_of_frame"]}


def measure(scene, row, found, rounds):
    with tempfile.TemporaryDirectory() as folder:
        more = []
        for space in ["paper", "full"]:
            for objective in OBJECTIVES:
                file = pathlib.Path(folder) / f"{space}-{objective}.json"
                file.write_text(json.dumps(found[f"{space} {objective}"]["tuned"]))
                more += ["--contender", f"{space} {objective}={space}:{file}"]
        if row.large:
            more += ["--only", ",".join(LARGE + [f"full {objective}" for objective in OBJECTIVES])]
        return render("bench", "--scene", scene, "--threads", row.threads, "--size", row.size, "--rounds", rounds, *more)


def quartiles(values):
    low, middle, high = statistics.quantiles(values, n=4, method="inclusive")
    return low, middle, high


def over(standings, name, other):
    """How many times faster one is than another, pair by pair: quartiles and median; nothing where one is missing."""
    find = {each["name"]: each["rounds_ms"] for each in standings}
    pairs = [theirs / own for own, theirs in zip(find.get(name, []), find.get(other, []))]
    return quartiles(pairs) if len(pairs) > 1 else None


def ratio(triple):
    return "–" if triple is None else f"{triple[1]:.2f} [{triple[0]:.2f}, {triple[2]:.2f}]"


def table(results):
    """Both tables, and the medians over all rows, as Markdown."""
    lines = []
    for objective in OBJECTIVES:
        lines += ["", f"Objective {objective}: ms a frame with " + ("a thousandth of its build" if objective == "render" else "its build"), "",
                  "| scene | threads | size | paper default | native default | native high | native used well | best fixed | paper space | **full space** "
                  "| fixed / native used well | full / native default | full / native used well | full / best fixed |", "|" + "---|" * 14]
        gains = {NATIVE: {}, USED_WELL: {}, FIXED: {}}
        for key, row in results["rows"].items():
            scene, setting = key.split(" ")
            threads, size = setting.split("@")
            standings = row[objective]
            ms = {each["name"]: "fails" if each["failure"] else f"{each['frame_ms']['median']:.1f}" for each in standings}
            names = ["paper default", NATIVE, "native Embree high", USED_WELL, FIXED, f"paper {objective}"]
            own = f"full {objective}"
            ratios = {other: over(standings, own, other) for other in gains}
            for other, triple in ratios.items():
                if triple is not None:
                    gains[other].setdefault(size, []).append(triple[1])
            cells = [ms.get(name, "–") for name in names]
            lines.append(f"| {scene} | {threads} | {size} | {' | '.join(cells)} | **{ms.get(own, '–')}** "
                         f"| {ratio(over(standings, FIXED, USED_WELL))} | {' | '.join(ratio(ratios[other]) for other in gains)} |")
        for other, medians in gains.items():
            for size, own in medians.items():
                lines.append(f"\nfull space over {other}, {size}: median {statistics.median(own):.2f}, least {min(own):.2f}, most {max(own):.2f}")
    return "\n".join(lines[1:]) + "\n"


class Book:
    """The results on disk, written after every step."""

    def __init__(self, path):
        self.path = path
        self.results = {"searches": {}, "rows": {}, "seconds": {}}
        if path.exists():
            self.results = json.loads(path.read_text())

    def step(self, kind, key, work):
        """Does what is not done yet, and keeps what it gave and how long it took."""
        done = self.results[kind]
        if key not in done:
            begun = time.time()
            done[key] = work()
            self.results["seconds"][f"{kind} {key}"] = time.time() - begun
            self.path.write_text(json.dumps(self.results, indent=1))
            self.path.with_suffix(".md").write_text(table(self.results))
        return done[key]


def guess(book, kind):
    """Median seconds of finished steps of a kind, else what they took elsewhere."""
    seconds = book.results["seconds"]
    known = {"search": [took for step, took in seconds.items() if step.startswith("searches ")],
             "small": [took for step, took in seconds.items() if step.startswith("rows ") and not Row(step.split()[-1]).large],
             "large": [took for step, took in seconds.items() if step.startswith("rows ") and Row(step.split()[-1]).large]}[kind]
    return statistics.median(known) if known else GUESS[kind]


def left(book, found, chosen):
    """About how many seconds the missing steps take."""
    total = 0
    for name in found:
        for row in chosen:
            total += guess(book, "search") * (f"{name} {row.text}" not in book.results["searches"])
            total += guess(book, "large" if row.large else "small") * (f"{name} {row.text}" not in book.results["rows"])
    return total


def minutes(seconds):
    return f"{seconds / 60:.0f} min" if seconds >= 90 else f"{seconds:.0f} s"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", type=lambda text: text.split(","), help="only these scenes, e.g. hall,sponza")
    parser.add_argument("--rows", type=rows, default="2@320x240,1@320x240,2@1280x720,1@1280x720", help="threads and size of each row")
    parser.add_argument("--iterations", type=int, default=60, help="trials of the full search")
    parser.add_argument("--more-iterations", type=int, default=8, help="trials of the searches for further rows; 0 takes the first row's winners as they are")
    parser.add_argument("--rounds", type=int, default=21, help="paired rounds of the final measurement")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("bench.json"), help="results; the table goes beside them as .md")
    parser.add_argument("--dry-run", action="store_true", help="tell what would be done, and about how long it takes")
    options = parser.parse_args()
    found, book = scenes(options.only), Book(options.out)
    chosen = options.rows
    print(f"{len(found)} scenes, {len(chosen)} rows each, about {minutes(left(book, found, chosen))} left", file=sys.stderr)
    if options.dry_run:
        return
    first = chosen[0]
    for name, scene in found.items():
        for row in chosen:
            key = f"{name} {row.text}"

            def searches():
                if row is not first and options.more_iterations == 0:
                    return book.results["searches"][f"{name} {first.text}"]
                with Daemon() as url:
                    known = {} if row is first else book.results["searches"][f"{name} {first.text}"]
                    ran = {}
                    for space in ["paper", "full"]:
                        for objective in OBJECTIVES:
                            this = f"{space} {objective}"
                            if space == "paper" and known:
                                ran[this] = known[this]
                                continue
                            # In another row the best for the other objective may be the better one.
                            candidates = [known[f"{space} {each}"]["tuned"] for each in OBJECTIVES] if known else []
                            iterations = options.more_iterations if known else options.iterations
                            ran[this] = search(url, scene, row, space, objective, iterations, candidates)
                    return ran

            begun = time.time()
            winners = book.step("searches", key, searches)
            searched = time.time()
            result = book.step("rows", key, lambda: measure(scene, row, winners, options.rounds))
            gains = "  ".join(f"{objective} {ratio(over(result[objective], f'full {objective}', NATIVE))}" for objective in OBJECTIVES)
            print(f"{key:32} over native default: {gains}  (search {searched - begun:.0f} s, rounds {time.time() - searched:.0f} s; "
                  f"about {minutes(left(book, found, chosen))} left)", file=sys.stderr, flush=True)
    print(table(book.results))


if __name__ == "__main__":
    main()
