"""Measures tuning services side by side: one study of six parameters, clients as processes, durable writes.

    python3 tests/peers/service/run.py --peers target/peers/env --vizier target/peers/vizier --clients 1 8 32

For each system and number of clients a fresh server is started on a fresh database; clients connect, wait for each
other, and then ask and report as fast as they are answered. Clients of `treewright-python` are Python's as the others' are
(gRPC's own package, code from the contract; wants grpcio-tools in the environment of --peers). A trial is a suggestion and its report. Prints a table;
--out keeps it as JSON. Systems whose Python environment is not given are left out.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
SYSTEMS = [
    "treewright-tune", "treewright-calls", "treewright-auto", "treewright-python-calls", "treewright-python-tune", "vizier-random", "vizier-quasi",
    "optuna-grpc-random", "optuna-journal-random", "optuna-sqlite-random", "optuna-journal-tpe",
]


def start(command):
    return subprocess.Popen(
        [str(part) for part in command], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL if not os.environ.get("VERBOSE") else None, text=True,
    )


def said(process, what):
    line = process.stdout.readline().strip()
    if not line:
        raise RuntimeError(f"{what} ended without a word; VERBOSE=1 shows why")
    return line


def resident_mb(process):
    """The most memory that the server held, in megabytes."""
    status = pathlib.Path(f"/proc/{process.pid}/status").read_text()
    fields = dict(line.split(":", 1) for line in status.splitlines() if ":" in line)
    return int(fields["VmHWM"].split()[0]) / 1024


def processor_s(process):
    """Processor time of a process since its start, in seconds."""
    fields = pathlib.Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure(system, clients, arguments, folder):
    server = None
    is_python = "python" in system
    if system.startswith("treewright"):
        command = [arguments.bin / "treewrightd", "serve", "--listen", "127.0.0.1:0", "--database", folder / "t.db"]
        server = start(command + ["--log", "warn"])
        address = said(server, "treewrightd").rsplit(" ", 1)[1]
        how = "calls" if system.endswith("calls") else "tune"
        search = "auto" if system.endswith("auto") else "random"
        program = [arguments.bin / "examples" / "load", address]
        commands = [program + [f"client-{n}", arguments.seconds, how, search] for n in range(clients)]
        if is_python:
            python = arguments.peers / "bin" / "python"
            subprocess.run([python, HERE / "peer_client.py", "--generate", folder], check=True)
            program = [python, HERE / "peer_client.py", system, f"{address},{folder}"]
            commands = [program + [f"client-{n}", arguments.seconds] for n in range(clients)]
    else:
        python = (arguments.vizier if system.startswith("vizier") else arguments.peers) / "bin" / "python"
        if system.startswith("vizier") or system.startswith("optuna-grpc"):
            kind = "vizier" if system.startswith("vizier") else "optuna"
            server = start([python, HERE / "peer_server.py", kind, folder])
            address = said(server, kind)
        elif "journal" in system:
            address = folder / "journal.log"
        else:
            address = f"sqlite:///{folder / 'optuna.db'}"
        program = [python, HERE / "peer_client.py", system, address]
        commands = [program + [f"client-{n}", arguments.seconds] for n in range(clients)]
    running = []
    try:
        for command in commands:
            running.append(start(command))
        for process in running:
            said(process, system)
        processes = {"server": [server] if server else [], "clients": running}
        spent_s = {who: -sum(map(processor_s, some)) for who, some in processes.items()}
        begin = time.monotonic()
        for process in running:
            process.stdin.write("go\n")
            process.stdin.flush()
        results = [json.loads(said(process, system)) for process in running]
        wall_s = time.monotonic() - begin
        for who, some in processes.items():
            spent_s[who] += sum(map(processor_s, some))
        memory_mb = resident_mb(server) if server else None
    finally:
        for process in running + ([server] if server else []):
            process.kill()
            process.wait()
    times = sorted(time_us for result in results for time_us in result["times_us"])
    at = lambda share: times[int((len(times) - 1) * share)] / 1e3
    return {
        "system": system, "clients": clients, "trials": len(times), "trials_per_s": len(times) / wall_s,
        "p50_ms": at(0.5), "p99_ms": at(0.99), "most_ms": at(1.0), "server_mb": memory_mb,
        "server_us": 1e6 * spent_s["server"] / len(times), "clients_us": 1e6 * spent_s["clients"] / len(times),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, default=pathlib.Path("target/release"), help="Treewright's programs")
    parser.add_argument("--peers", type=pathlib.Path, help="environment with optuna and grpcio")
    parser.add_argument("--vizier", type=pathlib.Path, help="environment with google-vizier")
    parser.add_argument("--systems", nargs="+", default=SYSTEMS, choices=SYSTEMS)
    parser.add_argument("--clients", nargs="+", type=int, default=[1, 8, 32])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=1, help="repeat everything; the table shows medians")
    parser.add_argument("--folder", type=pathlib.Path, help="where databases go; must lie on a real disk")
    parser.add_argument("--out", type=pathlib.Path)
    arguments = parser.parse_args()
    rows = []
    for _ in range(arguments.rounds):
        for clients in arguments.clients:
            for system in arguments.systems:
                environment = arguments.vizier if system.startswith("vizier") else arguments.peers
                if environment is None and ("python" in system or not system.startswith("treewright")):
                    continue
                with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
                    row = measure(system, clients, arguments, pathlib.Path(folder))
                print(json.dumps(row), file=sys.stderr, flush=True)
                rows.append(row)
    print("| system | clients | trials/s | p50 ms | p99 ms | server MB | server, µs of processor a trial | clients |\n|---|---|---|---|---|---|---|---|")
    for key in dict.fromkeys((row["system"], row["clients"]) for row in rows):
        same = [row for row in rows if (row["system"], row["clients"]) == key]
        median = lambda field: statistics.median(row[field] for row in same)
        memory = f"{median('server_mb'):.0f}" if same[0]["server_mb"] else "–"
        print(
            f"| {key[0]} | {key[1]} | {median('trials_per_s'):.1f} | {median('p50_ms'):.2f} | {median('p99_ms'):.2f} "
            f"| {memory} | {median('server_us'):.0f} | {median('clients_us'):.0f} |"
        )
    if arguments.out:
        arguments.out.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
