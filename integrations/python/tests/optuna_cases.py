"""Optuna's own test cases for samplers, over a running daemon: ``TREEWRIGHT_URL=… pytest optuna_cases.py``."""

import itertools
import os

import pytest
import treewright
from optuna.testing.pytest_samplers import BasicSamplerTestCase, RelativeSamplerTestCase, SingleOnlySamplerTestCase
from treewright.optuna import TreewrightSampler

numbers = itertools.count()
client = treewright.Client(os.environ["TREEWRIGHT_URL"], client_id="optuna-cases", deadline_ms=20000, call_deadline_ms=20000)


class TestTreewrightSampler(BasicSamplerTestCase, RelativeSamplerTestCase, SingleOnlySamplerTestCase):
    @pytest.fixture
    def sampler(self):
        return lambda: TreewrightSampler(None, client, f"case-{next(numbers)}", values="any")
