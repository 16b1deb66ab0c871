"""The sampler as OptunaHub loads it; it lives in the package ``treewright``."""

from treewright.optuna import TreewrightSampler

__all__ = ["TreewrightSampler"]
