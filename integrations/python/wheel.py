"""What `pip wheel` adds to the package: the native module, the daemon and the command line, without symbols.

They are those in the folder that TREEWRIGHT_BUILT names; without it, cargo builds them for release.
"""

import os
import pathlib
import platform
import re
import shutil
import subprocess
import tempfile

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
# What cargo calls them, and their places in the wheel.
PARTS = {
    "libtreewright_native.so": "treewright/_native.abi3.so",
    "treewrightd": "treewright/programs/treewrightd",
    "treewright": "treewright/programs/treewright",
}


def built() -> pathlib.Path:
    """The folder with what cargo built."""
    if os.environ.get("TREEWRIGHT_BUILT"):
        return ROOT / os.environ["TREEWRIGHT_BUILT"]
    packages = [word for name in ("python", "server", "cli") for word in ("-p", f"treewright-{name}")]
    subprocess.run(["cargo", "build", "--release", "--locked", "--lib", "--bins", *packages], cwd=ROOT, check=True)
    return ROOT / os.environ.get("CARGO_TARGET_DIR", "target") / "release"


def stripped(source: pathlib.Path, into: str) -> pathlib.Path:
    copy = pathlib.Path(into) / source.name
    if shutil.which("strip"):
        subprocess.run(["strip", "-o", copy, source], check=True)
    else:
        shutil.copy(source, copy)
    copy.chmod(0o755)
    return copy


def tag(parts: "list[pathlib.Path]") -> str:
    """Any Python from 3.9 on, on systems with the youngest function of the C library that is asked for."""
    wanted = [int(minor) for part in parts for minor in re.findall(rb"GLIBC_2\.(\d+)\0", part.read_bytes())]
    return f"cp39-abi3-manylinux_2_{max(wanted)}_{platform.machine()}"


class Built(BuildHookInterface):
    """The hook that hatchling calls around the making of a wheel."""

    def initialize(self, version, build_data):
        folder = built()
        missing = [name for name in PARTS if not (folder / name).exists()]
        if missing:
            raise FileNotFoundError(f"{folder} has no {', '.join(missing)}; run: cargo build --workspace --bins --lib")
        self.folder = tempfile.mkdtemp()
        parts = {stripped(folder / name, self.folder): place for name, place in PARTS.items()}
        build_data["pure_python"] = False
        build_data["tag"] = tag(list(parts))
        build_data["force_include"].update({str(part): place for part, place in parts.items()})

    def finalize(self, version, build_data, artifact_path):
        shutil.rmtree(self.folder, ignore_errors=True)
