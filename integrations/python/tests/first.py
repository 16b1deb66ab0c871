"""From an installed wheel to a first trial, and to one after a long pause; the daemon is the one that the wheel holds."""

import time

import treewright

client = treewright.Client.local(deadline_ms=20000)
space = treewright.Space().integer("leaf", 1, 32, default=8, log=True)
study = client.study("first", space, minimise={"render_ms": 1.0})
with study.suggest() as trial:
    trial.report(render_ms=5 + abs(trial["leaf"] - 3))
client.flush()
# Longer than the daemon would stay for nobody.
time.sleep(5)
assert study.suggest().source == "daemon", study.suggest().problem
print(study.best(), "by", treewright.__file__)
