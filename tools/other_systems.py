#!/usr/bin/env python3
"""Checks that the SDKs, the daemon and the command line compile for other systems.

    tools/other_systems.py                         Linux on ARM64
    tools/other_systems.py aarch64-apple-darwin    macOS on ARM64, or any other target of rustup

`cargo check` reads the Rust code of each package and of all that it depends on, and links nothing. rustup fetches
the standard library of the target. SQLite and ring hold C code as well. A compiler for the target compiles that: the
one in CC_ and the target's name with underscores, or that of Debian's gcc-aarch64-linux-gnu. Where there is none,
something that writes empty files stands in for it, and the last line says that the C code was not tried. Nothing is run.
The renderer is left out: it needs an Embree of the target.
"""

import argparse
import os
import pathlib
import shutil
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
# The SDK for Node has no code to compile.
PACKAGES = ["treewright-client", "treewright-c", "treewright-python", "treewright-cli", "treewright-server"]
# In place of a compiler and of `ar`: an empty object where `-o` says, an empty archive in the second word.
STAND_IN = """#!/bin/sh
archive=$2
while [ $# -gt 0 ]; do
    if [ "$1" = -o ]; then : > "$2"; exit; fi
    shift
done
case $archive in *.a) printf '!<arch>\\n' > "$archive" ;; esac
"""


def fail(text):
    sys.exit(f"other_systems: {text}")


def need_library(target):
    """Has rustup fetch the standard library of a target."""
    asked = subprocess.run(["rustc", "--print", "target-libdir", "--target", target], cwd=ROOT, capture_output=True, text=True)
    if asked.returncode != 0:
        fail(asked.stderr.strip() or f"rustc knows no target {target}")
    if pathlib.Path(asked.stdout.strip()).is_dir():
        return
    if not shutil.which("rustup") or subprocess.run(["rustup", "target", "add", target], cwd=ROOT).returncode != 0:
        fail(f"the standard library of {target} is missing; run this first: rustup target add {target}")


def compiler(target):
    """The C compiler for a target, if there is one."""
    machine = target.replace("-unknown", "")
    named = os.environ.get(f"CC_{target.replace('-', '_')}")
    return named or shutil.which(f"{machine}-gcc")


def environment(target, folder):
    """The variables for what compiles C code, with stand-ins from a folder where there is nothing."""
    name = target.replace("-", "_")
    # The headers of libclang, which .cargo/config.toml names, are for this machine's compiler.
    changed = {**os.environ, "C_INCLUDE_PATH": str(folder)}
    found = compiler(target)
    if found:
        changed[f"CC_{name}"] = found
        return changed
    tool = folder / "stand-in"
    tool.write_text(STAND_IN)
    tool.chmod(0o755)
    changed[f"CC_{name}"] = changed[f"AR_{name}"] = str(tool)
    # Else Apple's tools are asked where it is.
    changed.setdefault("SDKROOT", str(folder))
    return changed


def check(target):
    """Whether everything compiles; ends with cargo's words where it does not."""
    need_library(target)
    # Build scripts keep what they wrote: what a stand-in made must not pass for the compiler's.
    folder = ROOT / "target" / ("other-systems" if compiler(target) else "other-systems-no-c")
    folder.mkdir(parents=True, exist_ok=True)
    command = ["cargo", "check", "--locked", "--keep-going", "--target", target, "--target-dir", folder]
    command += [word for package in PACKAGES for word in ("-p", package)]
    if subprocess.run(command, cwd=ROOT, env=environment(target, folder)).returncode != 0:
        fail(f"{target}: not all of it compiles")
    c_code = "with the C code of SQLite and ring" if compiler(target) else "but the C code of SQLite and ring was not tried"
    print(f"{target}: {', '.join(PACKAGES)} compile, {c_code}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", metavar="TARGET", default=["aarch64-unknown-linux-gnu"])
    for target in parser.parse_args().targets:
        check(target)


if __name__ == "__main__":
    main()
