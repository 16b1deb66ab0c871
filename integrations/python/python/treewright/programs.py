"""The programs that the package holds: the daemon ``treewrightd`` and the command line ``treewright``."""

import os
import sys
from typing import Optional

__all__ = ["held"]


def held(name: str) -> Optional[str]:
    """The path of a program that lies in this package; None in a package that was put together without it."""
    path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "programs", name)
    return path if os.access(path, os.X_OK) else None


def main() -> None:
    """Becomes the program by whose name it was called."""
    name = os.path.basename(sys.argv[0])
    path = held(name)
    if path is None:
        sys.exit(f"{name}: this package does not hold the program; install the wheel of treewright")
    os.execv(path, [path, *sys.argv[1:]])
