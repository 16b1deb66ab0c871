#!/usr/bin/env python3
"""Makes what is handed out: target/dist-VERSION/treewright-VERSION-x86_64-linux.tar.gz and its SHA-256.

The archive holds the four programs without symbols, their manual pages and completions, the Embree that the
renderer was built with, the SDKs for C, C++ and Node, the documentation and the licences, and runs from
whatever folder it is unpacked in. The same commit gives the same bytes: paths of this machine are mapped
away, and times are those of the commit. The wheel for Python is laid beside it; pip fetches what makes it.
`--pack-only` packs what was built before. `--links` only checks that all documents and sources are there,
and the links of the documentation.
"""

import gzip
import hashlib
import io
import json
import os
import pathlib
import posixpath
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib

ROOT = pathlib.Path(__file__).resolve().parent.parent
PROGRAMS = ["treewrightd", "treewright", "treewright-render", "treewright-lab"]
PACKAGES = [
    "treewright-server", "treewright-cli", "treewright-render-cli", "treewright-lab", "treewright-c", "treewright-python",
]
# Of the repository; links in pages that lead out of the archive are replaced.
C = "integrations/c"
NODE = "integrations/javascript"
FILES = [
    "README.md", "CHANGELOG.md", "LICENSE", "client/examples/integrate.rs", f"{NODE}/README.md", f"{C}/README.md", f"{C}/install.sh",
    f"{C}/treewright.pc.in", f"{C}/treewright-config.cmake", f"{C}/treewright-config-version.cmake",
]
FOLDERS = ["docs", "server/deploy", "proto/treewright", f"{C}/include", f"{C}/examples"]
# Below share/, where each shell looks for what completes the commands of a program.
COMPLETIONS = {
    "bash": "bash-completion/completions/{}",
    "fish": "fish/vendor_completions.d/{}.fish",
    "zsh": "zsh/site-functions/_{}",
}
# [words](path#part)
LINK = re.compile(r"\[([^\]]*)\]\(([^)#\s]+)(#[^)\s]*)?\)")


def version():
    return tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]


def commit_time():
    """Seconds since 1970 of the last commit; SOURCE_DATE_EPOCH where it is set."""
    if os.environ.get("SOURCE_DATE_EPOCH"):
        return int(os.environ["SOURCE_DATE_EPOCH"])
    asked = subprocess.run(["git", "log", "-1", "--format=%ct"], cwd=ROOT, capture_output=True, text=True)
    return int(asked.stdout) if asked.returncode == 0 else 0


def build(when):
    home = pathlib.Path(os.environ.get("CARGO_HOME", pathlib.Path.home() / ".cargo"))
    sysroot = subprocess.run(["rustc", "--print", "sysroot"], capture_output=True, text=True, check=True).stdout.strip()
    maps = {str(ROOT): "/treewright", str(home): "/cargo", sysroot: "/rust"}
    flags = [f"--remap-path-prefix={here}={there}" for here, there in maps.items()]
    environment = {
        **os.environ,
        "RUSTFLAGS": " ".join(flags),
        # C code, such as SQLite's.
        "CFLAGS": " ".join(f"-ffile-prefix-map={here}={there}" for here, there in maps.items()),
        "TREEWRIGHT_RUN_PATH": "$ORIGIN/../lib",
        "SOURCE_DATE_EPOCH": str(when),
        "CARGO_INCREMENTAL": "0",
    }
    command = ["cargo", "build", "--profile", "dist", "--locked", "--bins", "--lib"]
    for package in PACKAGES:
        command += ["-p", package]
    if subprocess.run(command, cwd=ROOT, env=environment).returncode != 0:
        sys.exit("dist: the programs could not be built")


def soname(library):
    """The name by which programs ask for a library, which need not be that of its file."""
    said = subprocess.run(["readelf", "-d", library], capture_output=True, text=True, check=True).stdout
    found = re.search(r"\(SONAME\).*\[(.+)\]", said)
    return found.group(1) if found else library.name


def share():
    """What the programs say of themselves, manual pages and completions, as a folder."""
    folder = ROOT / "target" / "dist" / "share"
    shutil.rmtree(folder, ignore_errors=True)
    environment = {**os.environ, "LD_LIBRARY_PATH": str(ROOT / "target" / "native" / "embree" / "lib")}

    def said(program, *arguments):
        command = [ROOT / "target" / "dist" / program, *arguments]
        try:
            return subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True).stdout
        except (OSError, subprocess.CalledProcessError) as problem:
            sys.exit(f"dist: {problem}")

    for program in PROGRAMS:
        said(program, "man", folder / "man" / "man1")
        for shell, name in COMPLETIONS.items():
            file = folder / name.format(program)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(said(program, "completions", shell))
    return folder


def files_below(folder):
    return sorted(file for file in folder.rglob("*") if file.is_file())


def documents():
    """Names in the archive with the files of the repository that they are."""
    yield "START.md", ROOT / "tools" / "install-archive.md"
    for name in FILES:
        yield name, ROOT / name
    for folder in FOLDERS:
        for file in files_below(ROOT / folder):
            yield str(file.relative_to(ROOT)), file


def node_package(when):
    """What `npm pack` makes of the SDK for Node: its name, and its bytes."""
    here = ROOT / NODE
    package = json.loads((here / "package.json").read_text())
    # The contract lies elsewhere in the repository.
    folders = [(here, here / name) for name in package["files"] if name != "proto"]
    folders.append((ROOT, ROOT / "proto" / "treewright"))
    files = [(f"package/{file.relative_to(top)}", file) for top, folder in folders for file in files_below(folder)]
    files += [(f"package/{name}", here / name) for name in ("package.json", "README.md")]
    files.append(("package/LICENSE", ROOT / "LICENSE"))
    return f"treewright-{package['version']}.tgz", tarred([(name, file.read_bytes()) for name, file in files], when)


def wheel(folder, when, built="target/dist"):
    """Lays the wheel for Python, of what was built, into a folder; says why where it cannot be made."""
    environment = {**os.environ, "TREEWRIGHT_BUILT": str(built), "SOURCE_DATE_EPOCH": str(when or 315532800)}
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, ROOT / "integrations" / "python"]
    if subprocess.run(command, env=environment).returncode != 0:
        print("dist: the wheel for Python could not be made; the archive does not need it", file=sys.stderr)


def linked():
    """The archive's pages. What they link to and only the repository holds is named in place of the link."""
    files = dict(documents())
    there = {str(path) for name in map(pathlib.PurePosixPath, files) for path in (name, *name.parents)}
    pages, dead = {}, []
    for page, file in files.items():
        def replaced(match):
            words, path = match.group(1), match.group(2)
            inside = posixpath.normpath(posixpath.join(posixpath.dirname(page), path))
            if ":" in path or inside in there:
                return match.group(0)
            if not (ROOT / inside).exists():
                dead.append(f"{page}: {path}")
            return words if inside in words else f"{words} (`{inside}`)"
        if page.endswith(".md"):
            pages[page] = LINK.sub(replaced, file.read_text()).encode()
    if dead:
        sys.exit("dist: links lead nowhere: " + ", ".join(dead))
    return pages


def contents():
    """Names in the archive with files of this machine."""
    for program in PROGRAMS:
        yield f"bin/{program}", ROOT / "target" / "dist" / program
    # Where its `install.sh` looks.
    yield f"{C}/lib/libtreewright.so", ROOT / "target" / "dist" / "libtreewright.so"
    embree = ROOT / "target" / "native" / "embree"
    library = (embree / "lib" / "libembree4.so").resolve()
    # Beside it lies the TBB that it was built with.
    for file in sorted({library, *(file.resolve() for file in library.parent.glob("libtbb[.-]*so*"))}):
        yield f"lib/{soname(file)}", file
    for licence in sorted(embree.glob("*LICENSE*")):
        yield f"lib/embree-{licence.name}", licence
    folder = share()
    for file in files_below(folder):
        yield f"share/{file.relative_to(folder)}", file
    yield from documents()


def tarred(files, when):
    """A compressed archive of names with their content."""
    archive = io.BytesIO()
    with gzip.GzipFile(fileobj=archive, mode="wb", mtime=when, compresslevel=9) as zipped:
        with tarfile.open(fileobj=zipped, mode="w", format=tarfile.USTAR_FORMAT) as tar:
            for name, content in sorted(files):
                entry = tarfile.TarInfo(name)
                entry.size = len(content)
                entry.mtime = when
                entry.mode = 0o755 if "/bin/" in name or name.endswith(".sh") else 0o644
                tar.addfile(entry, io.BytesIO(content))
    return archive.getvalue()


def pack(name, when):
    pages, files = linked(), []
    for inside, file in contents():
        if not file.exists():
            sys.exit(f"dist: {file} is missing")
        files.append((f"{name}/{inside}", pages.get(inside) or file.read_bytes()))
    node, content = node_package(when)
    return tarred([*files, (f"{name}/{NODE}/{node}", content)], when)


def main():
    when = commit_time()
    if "--links" in sys.argv[1:]:
        linked()
        node_package(when)
        return
    if "--pack-only" not in sys.argv[1:]:
        subprocess.run([sys.executable, ROOT / "tools" / "setup.py"], check=True)
        build(when)
    name = f"treewright-{version()}-x86_64-linux"
    folder = ROOT / "target" / f"dist-{version()}"
    folder.mkdir(parents=True, exist_ok=True)
    archive = folder / f"{name}.tar.gz"
    archive.write_bytes(pack(name, when))
    digest = hashlib.sha256(archive.read_bytes()).hexdigest()
    (folder / f"{name}.tar.gz.sha256").write_text(f"{digest}  {archive.name}\n")
    wheel(folder, when)
    print(f"{archive.relative_to(ROOT)}: {archive.stat().st_size / 1e6:.1f} MB, SHA-256 {digest}")


if __name__ == "__main__":
    main()
