#!/usr/bin/env python3
"""Makes the pictures of the documentation, docs/voxels.png, docs/report.png and docs/dashboard.png, with the programs
in target/release.

Six built-in scenes are tuned into one study of a daemon of its own. Chromium, without a window, takes the pictures of the
report on the last of them and of the study's page. `--iterations` is the number of trials in each scene.
"""

import argparse
import json
import pathlib
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parent.parent
DOCS, PROGRAMS = ROOT / "docs", ROOT / "target" / "release"
SCENES = ["hall", "forest", "voxels", "statue", "gallery", "city"]
BROWSERS = ["chromium", "chromium-browser", "google-chrome"]


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return listener.getsockname()[1]


def render(*arguments):
    subprocess.run([PROGRAMS / "treewright-render", *arguments], check=True)


def photograph(browser, address, width, height, file):
    options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", f"--window-size={width},{height}"]
    subprocess.run([browser, *options, f"--screenshot={file}", address], check=True, capture_output=True, timeout=120)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--iterations", type=int, default=40)
    options = parser.parse_args()
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        sys.exit("pictures: there is no Chromium; Debian has it as chromium")
    render("image", "--scene", "builtin:voxels", "--size", "800x450", "--out", DOCS / "voxels.png")
    with tempfile.TemporaryDirectory() as folder:
        dashboard, report = f"127.0.0.1:{free_port()}", pathlib.Path(folder) / "report.html"
        command = [PROGRAMS / "treewrightd", "serve", "--listen", "127.0.0.1:0", "--database", f"{folder}/tuning.db"]
        with subprocess.Popen([*command, "--dashboard", dashboard], stdout=subprocess.PIPE, text=True) as daemon:
            try:
                url = re.search(r"http:\S+", daemon.stdout.readline()).group(0)
                for scene in SCENES:
                    search = ["--iterations", str(options.iterations), "--worth", "inf", "--report", report]
                    render("tune", "--server", url, "--scene", f"builtin:{scene}", "--objective", "total", *search)
                photograph(browser, report.as_uri(), 936, 774, DOCS / "report.png")
                with urllib.request.urlopen(f"http://{dashboard}/studies.json") as told:
                    (study,) = json.load(told)["studies"]
                photograph(browser, f"http://{dashboard}/studies/{study['id']}", 1000, 1218, DOCS / "dashboard.png")
            finally:
                daemon.terminate()


if __name__ == "__main__":
    main()
