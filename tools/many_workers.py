#!/usr/bin/env python3
"""One, 8 and 32 workers on one state, with a real daemon and a real process for each question and report.

    make build
    tools/many_workers.py [--seeds 8] [--evaluation-ms 100] [--trials 80]

The problem is a bowl of five parameters with a known optimum and 3 % noise; its default costs 3.7 times the optimum. Told are,
as medians over the seeds (answers: mean and worst): trials until one within 5 % of the optimum was reported and how long that
took, the time of all trials, distinct configurations a second, and the true cost of what the service then answers.
"""

import argparse
import json
import math
import os
import pathlib
import random
import statistics
import subprocess
import sys
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
BIN = pathlib.Path(os.environ.get("BIN", ROOT / "target" / "release"))
OPTIMUM, CURVATURE = [0.3, 0.7, 0.2, 0.6, 0.45], [4, 2, 1, 0.5, 3]
DEFAULT, NOISE, ARRIVED = 0.9, 0.03, 1 / 0.95
STUDY = "bowl"


def over_optimum(configuration):
    x = [float(configuration[f"x{axis}"]) for axis in range(len(OPTIMUM))]
    return 1 + sum(a * (v - o) ** 2 for a, v, o in zip(CURVATURE, x, OPTIMUM))


def ask(url, *arguments):
    done = subprocess.run([BIN / "treewright", *arguments, "--server", url], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"many_workers: treewright {arguments[0]} failed:\n{done.stderr}")
    return done.stdout


def run(workers, seed, arguments):
    """What one seed tells: trials and seconds until close, seconds in all, distinct configurations, and the answer."""
    generator, lock = random.Random(seed), threading.Lock()
    reported, handed = [], [0]
    with tempfile.TemporaryDirectory() as folder:
        study = pathlib.Path(folder) / "study.toml"
        axes = [f'[[parameters]]\nname = "x{axis}"\ntype = "float"\nmin = 0.0\nmax = 1.0\ndefault = {DEFAULT}\n' for axis in range(len(OPTIMUM))]
        study.write_text("\n".join([*axes, '[[objective]]\nmetric = "cost"\n', "[policy]\nepsilon = 1.0\n"]))
        command = [BIN / "treewrightd", "serve", "--listen", "127.0.0.1:0", "--database", f"{folder}/tuning.db"]
        daemon = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        try:
            url = next((word for word in daemon.stdout.readline().split() if word.startswith("http://")), None)
            if not url:
                sys.exit(f"many_workers: {command[0]} did not start")
            ask(url, "study", "create", str(study), "--id", STUDY)
            begin = time.monotonic()

            def work(worker):
                while True:
                    with lock:
                        if handed[0] == arguments.trials:
                            return
                        handed[0] += 1
                    trial = json.loads(ask(url, "suggest", STUDY, "--format", "json", "--client", f"worker-{worker}"))
                    truth = over_optimum(trial["configuration"])
                    time.sleep(arguments.evaluation_ms / 1000)
                    with lock:
                        cost = 10 * truth * math.exp(generator.gauss(0, NOISE))
                    ask(url, "report", trial["name"], f"cost={cost}")
                    with lock:
                        reported.append((time.monotonic() - begin, truth, json.dumps(trial["configuration"])))

            threads = [threading.Thread(target=work, args=(worker,)) for worker in range(workers)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            seconds = time.monotonic() - begin
            answer = json.loads(ask(url, "best", STUDY, "--json"))["configuration"]
        finally:
            daemon.kill()
            daemon.wait()
    close = next(((place + 1, at) for place, (at, truth, _) in enumerate(reported) if truth <= ARRIVED), None)
    return close, seconds, len({configuration for _, _, configuration in reported}) / seconds, over_optimum(answer)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--trials", type=int, default=80)
    parser.add_argument("--evaluation-ms", type=float, default=100)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 8, 32])
    arguments = parser.parse_args()
    print("| workers | runs that came close | trials until then | seconds until then | seconds of all trials | distinct configurations a second | answer over the optimum: mean (worst) |")
    print("|---|---|---|---|---|---|---|")
    for workers in arguments.workers:
        runs = [run(workers, seed, arguments) for seed in range(arguments.seeds)]
        close = [close for close, *_ in runs if close]
        trials, until = (f"{statistics.median(values):.3g}" for values in zip(*close)) if close else ("–", "–")
        answers = [answer for *_, answer in runs]
        print(f"| {workers} | {len(close)} of {len(runs)} | {trials} | {until} | {statistics.median(run[1] for run in runs):.3g} "
              f"| {statistics.median(run[2] for run in runs):.3g} | {statistics.mean(answers):.3f} ({max(answers):.3f}) |", flush=True)


if __name__ == "__main__":
    main()
