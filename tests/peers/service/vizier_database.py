"""Lets Vizier write the database that the tests of `treewright import` read, and what Vizier itself reads out of it:
`written.sql`, the database as SQL, and `written.json`, the trials of its first study. Values are random.

usage: vizier_database.py FOLDER       (cli/src/carry/vizier)

Needs google-vizier 0.1.24 with its extra [jax], and jax 0.4.35, flax 0.10.2: with newer ones its services do not start.
"""

import importlib.metadata
import json
import pathlib
import socket
import sqlite3
import sys
import tempfile

from vizier.service import clients, pyvizier as vz, servers

METRIC = "Render ms"


def config(*goals):
    config = vz.StudyConfig(algorithm="RANDOM_SEARCH")
    root = config.search_space.root
    root.add_float_param("alpha", -2.0, 3.0, default_value=0.25)
    root.add_float_param("learning-rate", 1e-4, 1.0, scale_type=vz.ScaleType.LOG)
    root.add_float_param("momentum", 0.5, 0.999, scale_type=vz.ScaleType.REVERSE_LOG)
    root.add_int_param("Depth", 1, 20, default_value=8)
    root.add_int_param("bins", 4, 256, scale_type=vz.ScaleType.LOG)
    root.add_discrete_param("width", [2, 4, 8, 16], default_value=8)
    root.add_discrete_param("ratio", [0.25, 0.5, 1.5], default_value=0.5)
    root.add_categorical_param("kind", ["sah", "median", "morton"], default_value="median")
    root.add_bool_param("spatial splits", default_value=True)
    for name, goal in goals:
        config.metric_information.append(vz.MetricInformation(name, goal=goal))
    return config


def nested(minimise):
    config = vz.StudyConfig(algorithm="RANDOM_SEARCH")
    builder = config.search_space.root.add_categorical_param("builder", ["sah", "lbvh"])
    builder.select_values(["sah"]).add_int_param("bins", 4, 64)
    config.metric_information.append(vz.MetricInformation(METRIC, goal=minimise))
    return config


def run(study, trials):
    for number in range(1, trials + 1):
        (trial,) = study.suggest(count=1, client_id=f"worker-{number % 3}")
        values = trial.parameters
        cost = 5 + (float(values["alpha"]) - 1) ** 2 + int(values["Depth"]) / 10
        if number == 5:
            trial.complete(infeasible_reason="out of memory")
        elif number < trials:
            trial.add_measurement(vz.Measurement({METRIC: 2 * cost}, steps=1))
            trial.complete(vz.Measurement({METRIC: cost}, steps=2, elapsed_secs=cost / 1000))


def read(study):
    trials = []
    for trial in (each.materialize() for each in study.trials()):
        final = trial.final_measurement
        trials.append({
            "id": trial.id,
            "client": trial.assigned_worker,
            "infeasible": trial.infeasibility_reason,
            "parameters": {name: value.value for name, value in trial.parameters.items()},
            "cost": final.metrics[METRIC].value if final else None,
        })
    return trials


def main():
    folder = pathlib.Path(sys.argv[1])
    minimise, maximise = vz.ObjectiveMetricGoal.MINIMIZE, vz.ObjectiveMetricGoal.MAXIMIZE
    with tempfile.TemporaryDirectory() as temporary, socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
        probe.close()
        path = pathlib.Path(temporary) / "vizier.db"
        server = servers.DefaultVizierServer(host="localhost", port=port, database_url=f"sqlite:///{path}")
        clients.environment_variables.server_endpoint = server.endpoint
        create = clients.Study.from_study_config
        study = create(config((METRIC, minimise)), owner="ann", study_id="builds")
        run(study, 12)
        create(config((METRIC, minimise)), owner="bob", study_id="builds")
        create(config((METRIC, maximise)), owner="ann", study_id="upside")
        create(config((METRIC, minimise), ("Build ms", minimise)), owner="ann", study_id="two")
        create(nested(minimise), owner="ann", study_id="nested")
        (folder / "written.json").write_text(json.dumps(read(study), indent=1) + "\n")
        database = sqlite3.connect(path)
        dump = [line for line in database.iterdump() if not line.startswith('INSERT INTO "suggestion_operations"')]
    version = importlib.metadata.version("google-vizier")
    head = f"-- Written by OSS Vizier {version} (tests/peers/service/vizier_database.py), without its table of operations' rows."
    (folder / "written.sql").write_text("\n".join([head, *dump]) + "\n")


if __name__ == "__main__":
    main()
