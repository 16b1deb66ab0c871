#!/usr/bin/env python3
"""Makes the pictures of the documentation, docs/voxels.png, docs/report.png and docs/dashboard.png, with the programs
in target/release.

    tools/pictures.py                   tune six built-in scenes, and take the pictures
    tools/pictures.py --looks FOLDER    also put every page into a folder, to be looked at

The scenes are tuned into one study of a daemon of its own. `--iterations` is the number of trials in each. Chromium,
without a window, takes the pictures of the report on the last of them and of the study's page. `--looks` adds every
page of the dashboard, the report, the page of `treewright analyze`, a front and the README's chart: 1280 and 390 pixels
wide, light and dark, and as they look under deuteranopia. It names those that are wider than the window.
(docs/gains.svg is drawn from the record by tools/record_tables.py.)
"""

import argparse
import base64
import itertools
import json
import pathlib
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import urllib.error
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parent.parent
DOCS, PROGRAMS = ROOT / "docs", ROOT / "target" / "release"
SCENES = ["hall", "forest", "voxels", "statue", "gallery", "city"]
WIDTHS, SCHEMES, SIGHTS = (1280, 390), ("light", "dark"), ("none", "deuteranopia")
# A page that takes longer is broken.
PATIENCE_S = 120


class Browser:
    """Chromium behind its driver, by the protocol of the W3C (WebDriver, 2018): JSON over HTTP."""

    def __init__(self):
        self.driver = subprocess.Popen(["chromedriver", "--port=0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        found = (re.search(r"successfully on port (\d+)", line) for line in self.driver.stdout)
        port = next((match.group(1) for match in found if match), None)
        if port is None:
            sys.exit("pictures: chromedriver does not start")
        self.address = f"http://127.0.0.1:{port}/session"
        options = {"args": ["--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu", "--hide-scrollbars"]}
        self.address += "/" + self.call("", {"capabilities": {"alwaysMatch": {"goog:chromeOptions": options}}})["sessionId"]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        with urllib.request.urlopen(urllib.request.Request(self.address, method="DELETE"), timeout=PATIENCE_S):
            pass
        self.driver.terminate()
        self.driver.wait()

    def call(self, command, content):
        request = urllib.request.Request(self.address + command, json.dumps(content).encode(), {"Content-Type": "application/json"})
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as problem:
            sys.exit(f"pictures: {json.load(problem)['value']['message']}")

    def tool(self, command, **parameters):
        """A command of Chromium's own protocol."""
        return self.call("/goog/cdp/execute", {"cmd": command, "params": parameters})

    def look(self, address, width, height=900, scheme="light", sight="none"):
        """Opens a page. Returns how wide it is."""
        self.tool("Emulation.setEmulatedVisionDeficiency", type=sight)
        self.tool("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        self.tool("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 500)
        self.call("/url", {"url": address})
        return self.call("/execute/sync", {"script": "return document.documentElement.scrollWidth", "args": []})

    def photograph(self, file, whole=False):
        """Keeps what is in the window, or the whole page."""
        parameters = {}
        if whole:
            size = self.tool("Page.getLayoutMetrics")["cssContentSize"]
            clip = {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}
            parameters = {"captureBeyondViewport": True, "clip": clip}
        shot = self.tool("Page.captureScreenshot", format="png", **parameters)
        pathlib.Path(file).write_bytes(base64.b64decode(shot["data"]))


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return listener.getsockname()[1]


def run(program, *arguments):
    subprocess.run([PROGRAMS / program, *arguments], check=True)


def tune(url, scene, report, iterations):
    search = ["--iterations", str(iterations), "--worth", "inf", "--report", report]
    run("treewright-render", "tune", "--server", url, "--scene", f"builtin:{scene}", "--objective", "total", *search)


def shown(figure, folder):
    """A page that shows a figure, as a README does."""
    page = folder / f"{figure.stem}.html"
    head = '<!doctype html><meta name="viewport" content="width=device-width"><meta name="color-scheme" content="light dark">'
    page.write_text(f'{head}<img src="{figure.resolve().as_uri()}" style="max-width: 100%" alt="{figure.name}">\n')
    return page


def pages(url, dashboard, study, report, folder):
    """All that is looked at: names with addresses."""
    metrics = "build_ms,render_ms,structure_bytes"
    run("treewright", "--server", url, "analyze", study, "--out", folder)
    figure = folder / "front.svg"
    run("treewright", "--server", url, "front", study, "--metrics", "render_ms,structure_bytes", "--state", "1", "--svg", figure)
    figures = {"front-figure": figure, "gains": DOCS / "gains.svg"}
    files = {"report": report, "analyze": folder / "analysis.html", **{name: shown(file, folder) for name, file in figures.items()}}
    parts = {
        "study": "?state=1", "parameters": "/parameters?state=1", "map": "/map", "map-cost": "/map?show=cost", "trials": "/trials",
        "trial": "/trials/5", "policy": "/policy", "front": f"/front?state=1&metrics={metrics}",
    }
    return {
        "studies": f"{dashboard}/", "compare": f"{dashboard}/compare?study={study}", "login": f"{dashboard}/login",
        **{name: f"{dashboard}/studies/{study}{part}" for name, part in parts.items()},
        **{name: file.resolve().as_uri() for name, file in files.items()},
    }


def keep_looks(browser, addresses, folder):
    folder.mkdir(parents=True, exist_ok=True)
    for (name, address), width, scheme, sight in itertools.product(addresses.items(), WIDTHS, SCHEMES, SIGHTS):
        wide = browser.look(address, width, scheme=scheme, sight=sight)
        if wide > width:
            print(f"pictures: {name} is {wide} wide in {width}", file=sys.stderr)
        browser.photograph(folder / f"{name}-{width}-{scheme}-{sight}.png", whole=True)
    print(f"pictures: {len(addresses)} pages, each in {len(WIDTHS) * len(SCHEMES) * len(SIGHTS)} ways, are in {folder}")


def take(url, dashboard, options, folder):
    """Tunes, and takes all pictures."""
    report = folder / "report.html"
    for scene in SCENES:
        tune(url, scene, report, options.iterations)
    with urllib.request.urlopen(f"{dashboard}/studies.json", timeout=PATIENCE_S) as answer:
        (study,) = (study["id"] for study in json.load(answer)["studies"])
    with Browser() as browser:
        for address, width, height, name in [
            (report.as_uri(), 936, 774, "report.png"),
            (f"{dashboard}/studies/{study}", 1000, 1218, "dashboard.png"),
        ]:
            browser.look(address, width, height)
            browser.photograph(DOCS / name)
        if options.looks:
            keep_looks(browser, pages(url, dashboard, study, report, folder), options.looks)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--iterations", type=int, default=40)
    parser.add_argument("--looks", type=pathlib.Path, metavar="FOLDER")
    options = parser.parse_args()
    if shutil.which("chromedriver") is None:
        sys.exit("pictures: there is no chromedriver; Debian has it, with its browser, as chromium-driver")
    run("treewright-render", "image", "--scene", "builtin:voxels", "--size", "800x450", "--out", DOCS / "voxels.png")
    with tempfile.TemporaryDirectory() as made:
        folder, dashboard = pathlib.Path(made), f"127.0.0.1:{free_port()}"
        command = [PROGRAMS / "treewrightd", "serve", "--listen", "127.0.0.1:0", "--database", folder / "tuning.db"]
        with subprocess.Popen([*command, "--dashboard", dashboard], stdout=subprocess.PIPE, text=True) as daemon:
            try:
                url = re.search(r"http:\S+", daemon.stdout.readline()).group(0)
                take(url, f"http://{dashboard}", options, folder)
            finally:
                daemon.terminate()


if __name__ == "__main__":
    main()
