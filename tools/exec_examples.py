#!/usr/bin/env python3
"""Runs the examples of `treewright exec` in the documents, and prints how many runs and seconds each took, how it ended and
what it said.

    tools/exec_examples.py --bin target/release            print the table
    tools/exec_examples.py --bin target/release --write    put it into docs/measurements/exec-examples.md

Each runs in an empty folder and an empty home, with a daemon of its own that it starts there: it takes the commands as the
documents have them. An example whose program is not installed is passed by.
"""

import argparse
import datetime
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "measurements" / "exec-examples.md"
BEGIN, END = "<!-- exec: made by tools/exec_examples.py -->", "<!-- end of exec -->"
# No example takes so long, seconds.
LONGEST_S = 900


def block(page, beginning):
    """The shell block of a page that begins so."""
    blocks = re.findall(r"^```sh\n(.*?)^```", (ROOT / page).read_text(), re.DOTALL | re.MULTILINE)
    found = [each for each in blocks if beginning in each]
    if len(found) != 1:
        sys.exit(f"exec_examples: {page} has {len(found)} blocks with {beginning!r}")
    return found[0][found[0].index(beginning):]


def examples():
    """Names, the programs that they need, and their commands."""
    zstd = block("README.md", "treewright exec zstd")
    return [
        ("SQLite, the first example", "sqlite3", block("docs/exec.md", "{ echo 'CREATE TABLE")),
        ("zstd, of the front page", "zstd", zstd),
        # A space of 19 configurations, without a number of trials.
        ("zstd, its level alone", "zstd",
         "treewright exec level --tune 'level=1..19:3' -- zstd -q -{level} -kf data.tar"),
        ("zstd, three levels", "zstd",
         "treewright exec three --trials 20 --tune 'level=1|9|19:9' -- zstd -q -{level} -kf data.tar"),
        ("nothing to gain", "true", "treewright exec nothing --trials 30 --tune 'level=1..30:3' -- sh -c 'sleep 0.05; : {level}'"),
    ]


def run(name, command, folder, programs):
    """One row of the table."""
    home = folder / "home"
    home.mkdir()
    paths = f"{programs}{os.pathsep}{os.environ['PATH']}"
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("TREEWRIGHT", "XDG"))}
    environment = {**kept, "PATH": paths, "HOME": str(home)}
    subprocess.run(["tar", "-cf", folder / "data.tar", "-C", ROOT, "docs", "model", "server", "client"], check=True)
    begin = time.monotonic()
    done = subprocess.run(["bash", "-c", command], cwd=folder, env=environment, capture_output=True, text=True, timeout=LONGEST_S)
    took = time.monotonic() - begin
    said = [line.strip() for line in done.stdout.splitlines() if line.strip()]
    first = re.match(r"\S+: (\d+) trial\(s\), (.*)", said[0]) if said else None
    if done.returncode or not first:
        sys.exit(f"exec_examples: {name} ended with {done.returncode}\n{done.stdout}{done.stderr}")
    announced = re.search(r"\d+ configurations; about \d+ runs?", done.stderr)
    cells = [name, announced[0] if announced else "", first[1], f"{took:.0f}", first[2], said[-1]]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, default=ROOT / "target" / "release", help="folder of treewright and treewrightd")
    parser.add_argument("--write", action="store_true", help="put the table into the page")
    options = parser.parse_args()
    lines = ["| example | announced | runs | seconds | it ended because | its last words |", "|---|---|--:|--:|---|---|"]
    for name, program, command in examples():
        if shutil.which(program) is None:
            print(f"passed by: {name}, because there is no {program}", file=sys.stderr)
            continue
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            lines.append(run(name, command, pathlib.Path(folder), options.bin.resolve()))
        print(f"{name}: done", file=sys.stderr)
    table = "\n".join(lines)
    print(table)
    if options.write:
        before, _, rest = PAGE.read_text().partition(BEGIN)
        _, _, after = rest.partition(END)
        if not after:
            sys.exit(f"exec_examples: {PAGE} has no place for the table; write the lines {BEGIN} and {END} where it belongs")
        when = f"{datetime.date.today():%d %B %Y}, {os.cpu_count()} processors."
        PAGE.write_text(f"{before}{BEGIN}\n{when}\n\n{table}\n{END}{after}")


if __name__ == "__main__":
    main()
