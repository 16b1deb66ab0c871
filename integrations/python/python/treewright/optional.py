"""Packages of others that only parts of this one need."""

import importlib
from typing import Any

__all__ = ["needed"]


def needed(package: str, for_what: str, extra: str) -> Any:
    """Imports a package, or raises ImportError with what to install."""
    try:
        return importlib.import_module(package)
    except ImportError as problem:
        name = package.partition(".")[0]
        raise ImportError(f"{for_what} needs the package {name}: pip install 'treewright[{extra}]'", name=name) from problem
