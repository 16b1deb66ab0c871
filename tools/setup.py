#!/usr/bin/env python3
"""Gets a machine ready to build Treewright: Embree 4.4, libclang and a C compiler.

What is on the machine is used; what is missing is installed when that is allowed, and otherwise one
message says the exact command. Running it again does nothing and takes a fraction of a second. With --tests it also
sees to the PostgreSQL server that the tests start.

Everything fetched lands below target/native:
  embree/lib/libembree4.so      the library the renderer links (link or fetched copy)
  embree/origin.json            where it came from and which version it is
  libclang/lib/libclang.so      needed by embree4-sys, which generates its bindings at build time
"""

import hashlib
import importlib.util
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
NATIVE = ROOT / "target" / "native"
EMBREE = NATIVE / "embree"
LIBCLANG = NATIVE / "libclang"

# The wheel carries libembree4 4.4.0 and the TBB it was built with. The tag is fixed, so the local
# Python's version does not matter: only the shared libraries inside are used.
EMBREE_WHEEL = {
    "package": "embreex==4.4.0.post1",
    "sha256": "2cd0f7d5c6342e6247e31f700761689cae7829454d8c6de0c41e62124a023e1f",
    "select": ["--python-version", "311", "--implementation", "cp", "--platform", "manylinux_2_28_x86_64"],
}
LIBCLANG_WHEEL = {
    "package": "libclang==18.1.1",
    "sha256": "c533091d8a3bbf7460a00cb6c1a71da93bffe148f172c7d03b1c31fbf8aa2a0b",
    "select": ["--python-version", "311", "--platform", "manylinux2010_x86_64"],
}
# The ray structures the renderer hands to Embree are laid out for this series and verified at start.
EMBREE_SERIES = (4, 4)


def say(text):
    print(f"setup: {text}", flush=True)


def fail(text):
    sys.exit(f"setup: {text}")


def apt(packages, why):
    """Installs Debian packages as root or through sudo, or ends with the command to run."""
    command = ["apt-get", "install", "-y", "--no-install-recommends", *packages]
    by_hand = f"{why}. Run this, then try again:\n    sudo apt-get update && sudo {' '.join(command)}"
    if not shutil.which("apt-get"):
        fail(f"{why}. Install the equivalent of these Debian packages, then try again: {' '.join(packages)}")
    if os.geteuid() == 0:
        prefix = []
    elif shutil.which("sudo") and subprocess.run(["sudo", "-n", "true"], capture_output=True).returncode == 0:
        prefix = ["sudo", "-n"]
    else:
        fail(by_hand)
    say(f"installing {' '.join(packages)}")
    environment = [*prefix, "env", "DEBIAN_FRONTEND=noninteractive"]
    for step in (["apt-get", "update", "-q"], command):
        if subprocess.run([*environment, *step], stdout=subprocess.DEVNULL).returncode != 0:
            fail(by_hand)


def need_compiler():
    if not (shutil.which("cc") and pathlib.Path("/usr/include/stdio.h").exists()):
        apt(["gcc", "libc6-dev"], "a C compiler and the C headers are needed to link and to bundle SQLite")


def need_postgres():
    """The tests run against PostgreSQL: the server that DATABASE_URL names, or a private one that they start."""
    if os.environ.get("DATABASE_URL"):
        return
    places = [pathlib.Path(place) for place in os.environ.get("PATH", "").split(os.pathsep) if place]
    places += pathlib.Path("/usr/lib/postgresql").glob("*/bin")
    if not any((place / "initdb").exists() and (place / "pg_ctl").exists() for place in places):
        apt(["postgresql"], "PostgreSQL is needed by the tests, which start a private server (or set DATABASE_URL)")


def want_fault_tools():
    """Tests of faults (docs/durability.md), of alerting rules, of the C++ headers, of the wheel and of the dashboard in a browser pass by what is not there, so
    these are only installed where that is easy."""
    missing = [package for package, there in {
        "g++": shutil.which("c++"),
        "strace": shutil.which("strace"),
        "iproute2": shutil.which("ip"),
        "chromium": shutil.which("chromium"),
        "chromium-driver": shutil.which("chromedriver"),
        # For promtool.
        "prometheus": shutil.which("promtool"),
        # For the test of the wheel.
        "python3-venv": importlib.util.find_spec("ensurepip"),
        "libfaketime": any(pathlib.Path("/usr/lib").glob("**/faketime/libfaketime.so.1")),
    }.items() if not there]
    if not missing or os.geteuid() != 0 or not shutil.which("apt-get"):
        return
    say(f"installing {' '.join(missing)}")
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    for step in (["update", "-q"], ["install", "-y", "--no-install-recommends", *missing]):
        if subprocess.run(["apt-get", *step], env=environment, stdout=subprocess.DEVNULL).returncode != 0:
            return say(f"without {' '.join(missing)} some tests of faults, of alerts, of C++, of the wheel, or of the dashboard in a browser are passed by")


def need_pip():
    if subprocess.run([sys.executable, "-m", "pip", "--version"], capture_output=True).returncode != 0:
        apt(["python3-pip"], "pip is needed to fetch the Embree library")


def fetch(wheel, into):
    """Downloads one wheel, checks its hash and returns it as an open zip file."""
    need_pip()
    say(f"fetching {wheel['package']}")
    command = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--only-binary", ":all:",
               *wheel["select"], "-d", str(into), wheel["package"]]
    if subprocess.run(command).returncode != 0:
        fail(f"could not download {wheel['package']}: see pip's message above; check the network or proxy and try again")
    (file,) = pathlib.Path(into).glob("*.whl")
    found = hashlib.sha256(file.read_bytes()).hexdigest()
    if found != wheel["sha256"]:
        fail(f"{file.name} has SHA-256 {found}, expected {wheel['sha256']}: the download is damaged or was replaced; nothing was unpacked")
    return zipfile.ZipFile(file)


def link(source, target):
    target.parent.mkdir(parents=True, exist_ok=True)
    if target.is_symlink() or target.exists():
        target.unlink()
    target.symlink_to(source)


def header_version(include):
    config = pathlib.Path(include) / "embree4" / "rtcore_config.h"
    if not config.exists():
        return None
    found = re.search(r'RTC_VERSION_STRING\s+"(\d+)\.(\d+)\.(\d+)', config.read_text(errors="replace"))
    return tuple(int(part) for part in found.groups()) if found else None


def installed_embree():
    """Yields (library, version, how it was found) for each Embree on the machine."""
    roots = []
    if os.environ.get("EMBREE_DIR"):
        roots.append((pathlib.Path(os.environ["EMBREE_DIR"]), "EMBREE_DIR"))
    if shutil.which("pkg-config"):
        asked = subprocess.run(["pkg-config", "--variable=prefix", "embree4"], capture_output=True, text=True)
        if asked.returncode == 0 and asked.stdout.strip():
            roots.append((pathlib.Path(asked.stdout.strip()), "pkg-config"))
    roots += [(pathlib.Path(place), "system path") for place in ("/usr", "/usr/local", "/opt/embree")]
    for root, how in roots:
        version = header_version(root / "include")
        for folder in ("lib", "lib64", "lib/x86_64-linux-gnu", "lib/aarch64-linux-gnu"):
            library = root / folder / "libembree4.so"
            if library.exists():
                yield library.resolve(), version, how


def setup_embree():
    origin = EMBREE / "origin.json"
    wanted = os.environ.get("EMBREE_DIR", "")
    if origin.exists() and (EMBREE / "lib" / "libembree4.so").exists():
        if json.loads(origin.read_text()).get("embree_dir", "") == wanted:
            return
    (EMBREE / "lib").mkdir(parents=True, exist_ok=True)
    for library, version, how in installed_embree():
        if version and version[:2] == EMBREE_SERIES:
            link(library, EMBREE / "lib" / "libembree4.so")
            note = {"how": how, "version": list(version), "library": str(library)}
            break
        shown = ".".join(map(str, version)) if version else "of unknown version"
        reason = f"Embree {shown} at {library} ({how}) is not of the verified series {EMBREE_SERIES[0]}.{EMBREE_SERIES[1]}"
        if how == "EMBREE_DIR":
            fail(f"{reason}; unset EMBREE_DIR to fetch the pinned one")
        say(f"{reason}; passing it by")
    else:
        if wanted:
            fail(f"EMBREE_DIR={wanted} holds no lib/libembree4.so; unset it to fetch the pinned library")
        with tempfile.TemporaryDirectory() as scratch, fetch(EMBREE_WHEEL, scratch) as wheel:
            # Both libraries keep their names and their folder: one finds the other through $ORIGIN.
            for name in wheel.namelist():
                if name.startswith("embreex.libs/") and ".so" in name:
                    (EMBREE / "lib" / pathlib.Path(name).name).write_bytes(wheel.read(name))
            licences = [name for name in wheel.namelist() if "LICENSE" in name.upper() and not name.endswith("/")]
            for name in licences:
                (EMBREE / pathlib.Path(name).name).write_bytes(wheel.read(name))
        (library,) = (EMBREE / "lib").glob("libembree4-*.so.4")
        link(library.name, EMBREE / "lib" / "libembree4.so")
        note = {"how": EMBREE_WHEEL["package"], "version": [4, 4, 0], "library": library.name}
    origin.write_text(json.dumps({**note, "embree_dir": wanted}, indent=2) + "\n")
    say(f"Embree {'.'.join(map(str, note['version']))} from {note['how']}")


def installed_libclang():
    places = [pathlib.Path(os.environ["LIBCLANG_PATH"])] if os.environ.get("LIBCLANG_PATH") else []
    places += sorted(pathlib.Path("/usr/lib").glob("llvm-*/lib"), reverse=True)
    places += [pathlib.Path("/usr/lib/x86_64-linux-gnu"), pathlib.Path("/usr/lib64")]
    for place in places:
        for file in sorted(place.glob("libclang.so*")) + sorted(place.glob("libclang-[0-9]*.so*")):
            if file.exists():
                return file
    return None


def setup_libclang():
    target = LIBCLANG / "lib" / "libclang.so"
    if target.exists():
        return
    # bindgen needs stddef.h and stdint.h; the C compiler's own serve any libclang, found through
    # C_INCLUDE_PATH in .cargo/config.toml.
    include = subprocess.run(["cc", "-print-file-name=include"], capture_output=True, text=True).stdout.strip()
    if not (pathlib.Path(include) / "stddef.h").exists():
        fail("the C compiler does not say where its own headers are (cc -print-file-name=include)")
    link(include, LIBCLANG / "include")
    found = installed_libclang()
    if found:
        link(found, target)
        say(f"libclang from {found}")
        return
    with tempfile.TemporaryDirectory() as scratch, fetch(LIBCLANG_WHEEL, scratch) as wheel:
        target.parent.mkdir(parents=True, exist_ok=True)
        (member,) = [name for name in wheel.namelist() if name.endswith("/libclang.so")]
        target.write_bytes(wheel.read(member))
    say(f"libclang from {LIBCLANG_WHEEL['package']}")


def main():
    if not shutil.which("cargo"):
        fail("cargo is not on the PATH: install the Rust toolchain first (https://rustup.rs), version 1.94 or newer")
    need_compiler()
    if "--tests" in sys.argv[1:]:
        need_postgres()
        want_fault_tools()
    setup_embree()
    setup_libclang()


if __name__ == "__main__":
    main()
