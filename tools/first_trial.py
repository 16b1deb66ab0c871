#!/usr/bin/env python3
"""Measures lines and seconds from an empty folder to the first trial with each client.

    tools/first_trial.py                                 build what is handed out, and print the table
    tools/first_trial.py --built target/release --write  take what cargo built, and put the table into docs/install.md

Each client is installed as its page says, and runs the program that its page shows. What is handed out lies
there before the clock starts. It runs while files are copied, packages fetched, the daemon started and the
program compiled, until the program ends. `treewright` then has to find the completed trial in the daemon. The
programs ask for a daemon on port 50611, so none may run there. The folder of the built files wants treewright,
treewrightd, libtreewright.so and libtreewright_native.so.
"""

import argparse
import contextlib
import dataclasses
import datetime
import json
import os
import pathlib
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from typing import Callable

import dist

ROOT = dist.ROOT
PAGE = ROOT / "docs" / "install.md"
BEGIN, END = "<!-- first trial: made by tools/first_trial.py -->", "<!-- end of first trial -->"
# The table stands before this where the page has none yet.
NEXT = "**Other systems.**"
PORT = 50611
PROGRAMS = ("treewright", "treewrightd")
BUILD = ["cargo", "build", "--release", "--locked", "--lib", "--bins"]
BUILD += [word for name in ("c", "python", "server", "cli") for word in ("-p", f"treewright-{name}")]
COMMAND_LIMIT_S = 1800
# A daemon that a client started ends by itself after so long without a request.
IDLE_S = 3
# A suggestion that comes too late is a fallback, which is no trial: the program is started again, as its user would.
RUNS = ("", " in the second run", " in the third run")


class Missing(Exception):
    """Why a client has no figures."""


@dataclasses.dataclass
class Place:
    """An empty folder to install a client into, and the folder of what is handed out."""

    folder: pathlib.Path
    handed_out: pathlib.Path
    offline: bool
    # The page's program.
    program: str = ""

    def environment(self):
        """As a new user's: without settings of Treewright, with data folders of its own."""
        ours = ("TREEWRIGHT_", "PYTHON", "VIRTUAL_ENV", "CARGO_TARGET_DIR", "CARGO_BUILD_", "RUSTFLAGS")
        kept = {name: value for name, value in os.environ.items() if not name.startswith(ours)}
        return {
            **kept,
            "PATH": f"{self.folder / 'bin'}{os.pathsep}{kept['PATH']}",
            "XDG_DATA_HOME": str(self.folder / "data"),
            "XDG_CONFIG_HOME": str(self.folder / "config"),
            "TREEWRIGHT_LOCAL_IDLE_S": str(IDLE_S),
        }

    def run(self, *command):
        """Runs a command in the folder, and returns what it prints."""
        name = pathlib.Path(command[0]).name
        try:
            ran = subprocess.run(command, cwd=self.folder, env=self.environment(), stdin=subprocess.DEVNULL, capture_output=True,
                                 text=True, timeout=COMMAND_LIMIT_S)
        except OSError as problem:
            raise Missing(f"{name} does not start: {problem.strerror}") from problem
        except subprocess.TimeoutExpired as problem:
            raise Missing(f"{name} took longer than {COMMAND_LIMIT_S} s") from problem
        if ran.returncode != 0:
            print("first_trial:", *command, f"\n{ran.stdout}{ran.stderr}", file=sys.stderr)
            last = (ran.stderr.strip() or ran.stdout.strip() or f"exit code {ran.returncode}").splitlines()[-1]
            raise Missing(f"{name} failed: {last}")
        return ran.stdout

    def install_programs(self):
        """The daemon and the command line, as out of the archive."""
        (self.folder / "bin").mkdir()
        for name in PROGRAMS:
            shutil.copy(self.handed_out / name, self.folder / "bin" / name)

    def write(self, name):
        (self.folder / name).write_text(self.program)
        return name


def install_command_line(place):
    place.install_programs()


def first_of_command_line(place):
    # Any file of the user's. The page's command runs until the search ends; its first trial is asked for.
    (place.folder / "data.tar").write_bytes(bytes(range(256)) * 4096)
    place.run("sh", "-c", re.sub(r"--trials \d+ --confirm", "--trials 1", place.program))


def install_rust(place):
    place.install_programs()
    place.run("cargo", "init", "--quiet", "--name", "first")
    place.run("cargo", "add", "--quiet", *["--offline"] * place.offline, "--path", ROOT / "client")


def first_of_rust(place):
    place.write("src/main.rs")
    place.run("cargo", "run", "--quiet", *["--offline"] * place.offline)


def install_python(place):
    place.run(sys.executable, "-m", "venv", "env")
    place.run("env/bin/python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *place.handed_out.glob("*.whl"))


def first_of_python(place):
    place.run("env/bin/python", place.write("first.py"))


def install_node(place):
    place.install_programs()
    place.run("npm", "install", "--loglevel=error", *["--offline"] * place.offline, *place.handed_out.glob("*.tgz"))


def first_of_node(place):
    place.run("node", place.write("first.mjs"))


def install_c(place):
    place.install_programs()
    place.run("bash", ROOT / dist.C / "install.sh", place.folder / "usr", place.handed_out)


def first_of_c(place, compiler=("cc",), name="first.c"):
    usr = place.folder / "usr"
    place.run(*compiler, place.write(name), "-I", usr / "include", "-L", usr / "lib", f"-Wl,-rpath,{usr / 'lib'}", "-ltreewright",
              "-o", "first")
    place.run("./first")


def first_of_cpp(place):
    first_of_c(place, ("c++", "-std=c++17"), "first.cpp")


@dataclasses.dataclass
class Client:
    """How a client is handed out, installed and used."""

    name: str
    # The program is the page's first block of this language with these words, and its trial is one of this study.
    page: str
    language: str
    words: str
    study: str
    needs: tuple
    # What is handed out, and how it is called.
    artefact: str
    patterns: tuple
    install: Callable
    first: Callable
    starts_daemon: bool = False

    def program(self):
        blocks = (ROOT / self.page).read_text().split(f"```{self.language}\n")[1:]
        return next(code for code in (block.split("```")[0] for block in blocks) if self.words in code)

    def lines(self):
        """Lines of the program without blanks and comments."""
        comment = ("#",) if self.language in ("sh", "python") else ("//", "/*")
        lines = map(str.strip, self.program().splitlines())
        return sum(bool(line) and not line.startswith(comment) for line in lines)

    def files(self, handed_out):
        if self.language == "rust":
            return [file for name in ("model", "proto", "client") for file in dist.files_below(ROOT / name)]
        found = [file for pattern in self.patterns for file in handed_out.glob(pattern)]
        if len(found) < len(self.patterns):
            raise Missing(f"{self.artefact} could not be made")
        if self.language in ("c", "cpp"):
            found += dist.files_below(ROOT / dist.C / "include")
        return found


CLIENTS = [
    Client("command line", "README.md", "sh", "treewright exec", "zstd", ("zstd",), "the two programs", PROGRAMS,
           install_command_line, first_of_command_line, starts_daemon=True),
    Client("Rust", "client/README.md", "rust", "use treewright_client", "my-renderer", ("cargo", "cc"), "sources of three crates", (),
           install_rust, first_of_rust),
    Client("Python", "integrations/python/README.md", "python", "import treewright", "my-renderer", (), "wheel, with the daemon",
           ("*.whl",), install_python, first_of_python, starts_daemon=True),
    Client("Node", "integrations/javascript/README.md", "js", "import { Client }", "my-viewer", ("node", "npm"), "package",
           ("*.tgz",), install_node, first_of_node),
    Client("C", "integrations/c/README.md", "c", "int main", "my-renderer", ("cc", "bash"), "library and headers",
           ("libtreewright.so",), install_c, first_of_c),
    Client("C++", "integrations/c/README.md", "cpp", "int main", "my-renderer", ("c++", "bash"), "library and headers",
           ("libtreewright.so",), install_c, first_of_cpp),
]


def is_taken():
    """Whether something listens where the programs look for a daemon."""
    with socket.socket() as asked:
        return asked.connect_ex(("127.0.0.1", PORT)) == 0


@contextlib.contextmanager
def daemon(place):
    """A daemon as the pages start it."""
    command = [place.folder / "bin" / "treewrightd", "serve", "--listen", f"127.0.0.1:{PORT}", "--database", "tuning.db"]
    with (place.folder / "log").open("w") as log:
        process = subprocess.Popen(command, cwd=place.folder, env=place.environment(), stdout=subprocess.PIPE, stderr=log, text=True)
    try:
        if not process.stdout.readline():
            raise Missing("the daemon does not start: " + ((place.folder / "log").read_text().strip() or "no word").splitlines()[-1])
        yield
    finally:
        process.terminate()
        process.wait()


@contextlib.contextmanager
def own_daemon():
    """Waits at the end until the daemon that a client started is gone."""
    yield
    time.sleep(2 * IDLE_S)


def trials(client, place):
    """The completed trials that the daemon knows."""
    server = "local" if client.starts_daemon else f"http://127.0.0.1:{PORT}"
    asked = ["--server", server, "--json", "trials", client.study, "--filter", "state = COMPLETED"]
    return json.loads(place.run(place.handed_out / "treewright", *asked))


def measured(client, handed_out, offline):
    """Seconds until a client is installed, until its first trial, and in which run that came."""
    absent = [tool for tool in client.needs if not shutil.which(tool)]
    if absent:
        raise Missing(f"{' and '.join(absent)} not found")
    if is_taken():
        raise Missing(f"another daemon listens on port {PORT}")
    with tempfile.TemporaryDirectory(prefix="first-trial-", ignore_cleanup_errors=True) as folder:
        place = Place(pathlib.Path(folder).resolve(), handed_out, offline, client.program())
        begin = time.monotonic()
        client.install(place)
        install_s = time.monotonic() - begin
        with own_daemon() if client.starts_daemon else daemon(place):
            for run in RUNS:
                client.first(place)
                first_s = time.monotonic() - begin
                if trials(client, place):
                    return install_s, first_s, run
    raise Missing("the daemon has no completed trial after three runs")


def size(files):
    total = sum(file.stat().st_size for file in files)
    return f"{total / 1e6:.1f} MB" if total >= 1e6 else f"{total / 1e3:.0f} kB"


def row(client, handed_out, offline):
    link = f"[{client.name}](../{client.page})"
    try:
        begun = f"| {link} | {client.artefact}, {size(client.files(handed_out))} | {client.lines()} |"
        install_s, first_s, run = measured(client, handed_out, offline)
    except Missing as reason:
        said = str(reason).replace("|", "\\|").replace("\n", " ")
        return f"| {link} | {client.artefact} | {client.lines()} | – | not measured: {said} |"
    return f"{begun} {install_s:.1f} | {first_s:.1f}{run} |"


def hand_out(built, folder, wheel, package):
    """Lays into a folder what is handed out: what cargo built without symbols, the wheel, and the package for Node."""
    for name in (*PROGRAMS, "libtreewright.so"):
        source = built / name
        if not source.exists():
            if name in PROGRAMS:
                sys.exit(f"first_trial: {source} is missing; run: {' '.join(BUILD)}")
        elif shutil.which("strip"):
            subprocess.run(["strip", "--strip-unneeded", "-o", folder / name, source], check=True)
            (folder / name).chmod(0o755)
        else:
            shutil.copy(source, folder / name)
    if wheel:
        shutil.copy(wheel, folder)
    else:
        dist.wheel(folder, dist.commit_time(), built)
    if package:
        shutil.copy(package, folder)
    else:
        name, content = dist.node_package(dist.commit_time())
        (folder / name).write_bytes(content)


def table(rows, built, programs, offline):
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True).stdout.strip()
    today = datetime.date.today()
    fetched = "from caches on disk" if offline else "from their registries or caches"
    return f"""**First trial.** Each client was installed into an empty folder, and ran the program that its page shows.
Both times count from the beginning; the last one includes the start of the daemon and the compilation of the
program. All but the wheel need the two programs, {programs}, which were copied while the clock ran. Crates and
packages of others came {fetched}. Lines are those of the program without
blanks and comments. `make first-trial` measures again.

| client | what is handed out | lines | installed after, s | first trial after, s |
|---|---|---|---|---|
{chr(10).join(rows)}

Commit {commit}, {today.day} {today:%B %Y}, {os.cpu_count()} processors, a {built.name} build."""


def written(text, made):
    """The page with the table in its place."""
    block = f"{BEGIN}\n{made}\n{END}"
    if BEGIN in text:
        return text[: text.index(BEGIN)] + block + text[text.index(END) + len(END):]
    place = text.index(NEXT)
    return f"{text[:place]}{block}\n\n{text[place:]}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clients", nargs="*", metavar="CLIENT", help="only these: " + ", ".join(f"'{each.name}'" for each in CLIENTS))
    parser.add_argument("--built", type=pathlib.Path, help="folder with what cargo built; without it, that is built for release")
    parser.add_argument("--wheel", type=pathlib.Path, help="the wheel for Python; without it, it is made of what was built")
    parser.add_argument("--package", type=pathlib.Path, help="what npm pack made; without it, it is packed as for the archive")
    parser.add_argument("--offline", action="store_true", help="keep cargo and npm from the network")
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.relative_to(ROOT)}")
    given = parser.parse_args()
    unknown = set(given.clients) - {client.name for client in CLIENTS}
    if unknown or given.clients and given.write:
        parser.error(f"there is no client {', '.join(unknown)}" if unknown else "--write wants all clients")
    if is_taken():
        sys.exit(f"first_trial: something listens on port {PORT}, where the programs look for a daemon; end it first")
    if not given.built:
        subprocess.run(BUILD, cwd=ROOT, check=True)
    built = (given.built or ROOT / os.environ.get("CARGO_TARGET_DIR", "target") / "release").resolve()
    with tempfile.TemporaryDirectory(prefix="first-trial-handed-out-") as folder:
        handed_out = pathlib.Path(folder).resolve()
        hand_out(built, handed_out, given.wheel, given.package)
        rows = []
        for client in CLIENTS:
            if not given.clients or client.name in given.clients:
                rows.append(row(client, handed_out, given.offline))
                print(rows[-1], file=sys.stderr, flush=True)
        made = table(rows, built, size([handed_out / name for name in PROGRAMS]), given.offline)
    print(made)
    if given.write:
        PAGE.write_text(written(PAGE.read_text(), made))


if __name__ == "__main__":
    main()
