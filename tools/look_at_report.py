#!/usr/bin/env python3
"""Pictures of a report as it looks in a wide and in a narrow window, light and dark, with Chromium.

    tools/look_at_report.py demo/report.html demo/pictures

Says of each how far the page is wider than its window, and ends with 1 where one is. Only parts with a scroll bar of
their own may be.
"""

import argparse
import html
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

from pictures import BROWSERS

WIDTHS = (1280, 390)
# What Blink calls a preference of its user.
SCHEMES = {"light": 1, "dark": 0}
# A window of Chromium is at least 500 pixels wide, a frame within it as wide as wanted.
AROUND = """<!doctype html><meta name="color-scheme" content="light dark"><style>body {{ margin: 0 }} iframe {{ border: 0 }}</style>
<iframe width="{width}" height="{height}" srcdoc="{page}" onload="
  const page = this.contentDocument.documentElement;
  document.documentElement.dataset.wide = page.scrollWidth - {width};
  document.documentElement.dataset.high = page.scrollHeight"></iframe>"""
HEIGHT = 900


def browse(browser, scheme, *options):
    command = [browser, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
               f"--blink-settings=preferredColorScheme={SCHEMES[scheme]}", *options]
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=120).stdout


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("report", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    arguments = parser.parse_args()
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        sys.exit("look_at_report: there is no Chromium; Debian has it as chromium")
    arguments.folder.mkdir(parents=True, exist_ok=True)
    page = html.escape(arguments.report.read_text())
    too_wide = False
    with tempfile.TemporaryDirectory() as folder:
        around = pathlib.Path(folder) / "around.html"
        for width in WIDTHS:
            around.write_text(AROUND.format(width=width, height=HEIGHT, page=page))
            told = browse(browser, "light", "--dump-dom", around.as_uri())
            wide, high = (int(re.search(rf'data-{name}="(-?\d+)"', told).group(1)) for name in ("wide", "high"))
            too_wide |= wide > 0
            around.write_text(AROUND.format(width=width, height=high, page=page))
            for scheme in SCHEMES:
                file = arguments.folder / f"{arguments.report.stem}-{width}-{scheme}.png"
                browse(browser, scheme, f"--window-size={width},{high}", f"--screenshot={file.resolve()}", around.as_uri())
                print(f"{file}: {max(wide, 0)} pixels wider than its window")
    return int(too_wide)


if __name__ == "__main__":
    sys.exit(main())
