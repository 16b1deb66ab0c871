"""One client of Vizier's, Optuna's or Treewright's service in Python, as `client/examples/load.rs` is one of Treewright's: says `ready`, waits
for a line, asks and tells for some seconds, and prints the time of each trial in microseconds as JSON.

usage: peer_client.py SYSTEM ADDRESS CLIENT_ID SECONDS
       peer_client.py --generate FOLDER      (Python code from Treewright's contract; its clients get it as ADDRESS,FOLDER)
"""

import json
import pathlib
import queue
import sys
import time

CONTRACT = pathlib.Path(__file__).resolve().parents[3] / "proto"

PARAMETERS = [f"p{number}" for number in range(6)]


def cost(values):
    """A bowl with its minimum inside the space."""
    return 5.0 + sum((value - 0.3) ** 2 for value in values)


def patiently(create):
    """Several clients create the same thing at once, and all but one fail and must try again."""
    for _ in range(50):
        try:
            return create()
        except Exception as error:
            failure = error
            time.sleep(0.2)
    raise failure


def vizier(address, client_id, algorithm):
    from vizier.service import clients, pyvizier as vz

    clients.environment_variables.server_endpoint = address
    config = vz.StudyConfig(algorithm=algorithm)
    for name in PARAMETERS:
        config.search_space.root.add_float_param(name, 0.0, 1.0)
    config.metric_information.append(vz.MetricInformation("render_ms", goal=vz.ObjectiveMetricGoal.MINIMIZE))
    study = clients.Study.from_study_config(config, owner="load", study_id="load")

    def trial():
        (suggestion,) = study.suggest(count=1, client_id=client_id)
        measured = cost(float(suggestion.parameters[name]) for name in PARAMETERS)
        suggestion.complete(vz.Measurement({"render_ms": measured}))

    return trial


def optuna(storage, sampler):
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    samplers = {"random": optuna.samplers.RandomSampler, "tpe": optuna.samplers.TPESampler}
    study = patiently(
        lambda: optuna.create_study(
            storage=storage, study_name="load", load_if_exists=True, sampler=samplers[sampler]()
        )
    )

    def trial():
        asked = study.ask()
        study.tell(asked, cost(asked.suggest_float(name, 0.0, 1.0) for name in PARAMETERS))

    return trial


def generate(folder):
    import grpc_tools
    from grpc_tools import protoc

    well_known = pathlib.Path(grpc_tools.__file__).parent / "_proto"
    files = [str(path) for path in sorted((CONTRACT / "treewright" / "v1").glob("*.proto"))]
    ways = [f"-I{CONTRACT}", f"-I{well_known}", f"--python_out={folder}", f"--grpc_python_out={folder}"]
    sys.exit(protoc.main(["protoc", *ways, *files]))


def treewright(address, client_id, is_stream):
    address, folder = address.split(",", 1)
    sys.path.insert(0, folder)
    import grpc
    from treewright.v1 import study_pb2, trial_pb2, tuning_pb2, tuning_pb2_grpc

    service = tuning_pb2_grpc.TuningServiceStub(grpc.insecure_channel(address.split("://", 1)[1]))
    study = study_pb2.Study()
    for name in PARAMETERS:
        parameter = study.space.parameters.add(name=name)
        parameter.float.max = 1.0
        parameter.default_value.float = 0.5
    study.objective.terms.add(metric="render_ms", weight=1.0)
    study.policy.epsilon = 1.0
    study.policy.search = study_pb2.SEARCH_METHOD_RANDOM
    study.policy.trials_per_state = 100_000
    service.CreateStudy(tuning_pb2.CreateStudyRequest(study_id="load", study=study), wait_for_ready=True, timeout=60)
    ask = tuning_pb2.SuggestRequest(study="studies/load", client_id=client_id)

    def report(trial):
        values = trial.configuration.values
        measured = {"render_ms": cost(getattr(values[name], "float") for name in PARAMETERS)}
        outcome = trial_pb2.Outcome(ok=trial_pb2.Ok())
        return tuning_pb2.ReportRequest(trial=trial.name, measurements=measured, outcome=outcome)

    def calls():
        service.Report(report(service.Suggest(ask)))

    if not is_stream:
        return calls
    frames = queue.SimpleQueue()
    answers = service.Tune(iter(frames.get, None))
    frames.put(tuning_pb2.TuneRequest(suggest=ask))
    held = [next(answers).trial]

    def frame():
        frames.put(tuning_pb2.TuneRequest(report=report(held[0]), suggest=ask))
        held[0] = next(answers).trial

    return frame


def client(system, address, client_id):
    if system.startswith("treewright-python-"):
        return treewright(address, client_id, system.endswith("tune"))
    if system.startswith("vizier-"):
        return vizier(address, client_id, {"random": "RANDOM_SEARCH", "quasi": "QUASI_RANDOM_SEARCH"}[system[7:]])
    import optuna as package

    name, sampler = system.rsplit("-", 1)
    if name == "optuna-grpc":
        host, port = address.rsplit(":", 1)
        storage = package.storages.GrpcStorageProxy(host=host, port=int(port))
        storage.wait_server_ready(timeout=60)
    elif name == "optuna-journal":
        backend = package.storages.journal.JournalFileBackend(address)
        storage = package.storages.JournalStorage(backend)
    else:
        storage = patiently(
            lambda: package.storages.RDBStorage(address, engine_kwargs={"connect_args": {"timeout": 60}})
        )
    return optuna(storage, sampler)


def main():
    if sys.argv[1] == "--generate":
        generate(sys.argv[2])
    system, address, client_id, seconds = sys.argv[1:]
    trial = client(system, address, client_id)
    print("ready", flush=True)
    sys.stdin.readline()
    until = time.monotonic() + float(seconds)
    times_us = []
    while time.monotonic() < until:
        begin = time.monotonic()
        trial()
        times_us.append(int((time.monotonic() - begin) * 1e6))
    print(json.dumps({"times_us": times_us}))


if __name__ == "__main__":
    main()
