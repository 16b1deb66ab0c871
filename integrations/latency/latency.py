"""Round trips from Python: ``latency.py URL COUNT``. See run.sh."""

import json
import sys
from time import perf_counter_ns

import treewright

url, count = sys.argv[1], int(sys.argv[2])
client = treewright.Client(url, deadline_ms=5000)
space = treewright.Space().integer("leaf", 1, 32, default=8, log=True)
study = client.study("latency-python", space, minimise={"ms": 1.0})
predict, suggest = [], []
for each in range(-50, count):
    start = perf_counter_ns()
    study.predict()
    middle = perf_counter_ns()
    suggestion = study.suggest()
    end = perf_counter_ns()
    if each >= 0:
        predict.append((middle - start) / 1e3)
        suggest.append((end - middle) / 1e3)
    suggestion.report(ms=1)
    client.flush()
both = [[round(sorted(one)[count // 2]), round(sorted(one)[count * 99 // 100])] for one in (predict, suggest)]
print(json.dumps({"from": "Python", "predict_us": both[0], "suggest_us": both[1]}))
