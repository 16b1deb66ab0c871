"""A server of Vizier's or Optuna's on a durable SQLite file: prints its address, serves until killed.

usage: peer_server.py vizier|optuna FOLDER
"""

import pathlib
import socket
import sys
import time


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def main():
    system, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    port = free_port()
    if system == "vizier":
        from vizier.service import servers

        server = servers.DefaultVizierServer(
            host="localhost", port=port, database_url=f"sqlite:///{folder / 'vizier.db'}"
        )
        print(server.endpoint, flush=True)
        while True:
            time.sleep(3600)
    import optuna

    storage = optuna.storages.RDBStorage(
        f"sqlite:///{folder / 'optuna.db'}", engine_kwargs={"connect_args": {"timeout": 60}}
    )
    print(f"localhost:{port}", flush=True)
    optuna.storages.run_grpc_proxy_server(storage, host="localhost", port=port)


if __name__ == "__main__":
    main()
