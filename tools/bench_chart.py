#!/usr/bin/env python3
"""Draws a chart of what tools/bench.py measured.

    tools/bench_chart.py bench.json chart.svg [--row 2@320x240]

Bars are speeds over native Embree's default (1 on the axis): medians of paired rounds, with whiskers from quartile to
quartile.
"""

import argparse
import html
import json
import pathlib
import statistics

BARS = [("paper default", "paper's default", "#9aa0a6"), ("native used well", "native Embree, used well", "#c9a227"),
        ("best fixed configuration", "best fixed configuration", "#b5651d"), ("full {}", "tuned, full space", "#1b7f4b")]
PANELS = [("render", "Progressive: one build for a thousand frames"), ("total", "Real time: every frame pays for its build")]
NATIVE = "native Embree default"
LEFT, RIGHT, BAR, GAP, TOP = 120, 20, 9, 14, 66
# Beside each scene's bars stands what a search adds to the best fixed configuration.
FIXED = "best fixed configuration"
PANEL = 420


def quartiles(standings, name, other=NATIVE):
    """Speed over native Embree's default or another, pair by pair."""
    rounds = {each["name"]: each["rounds_ms"] for each in standings}
    pairs = [theirs / own for own, theirs in zip(rounds.get(name, []), rounds.get(other, []))]
    return statistics.quantiles(pairs, n=4, method="inclusive") if len(pairs) > 1 else None


def draw(rows):
    """The chart of rows {scene: result} as SVG."""
    group = len(BARS) * BAR + GAP
    height = TOP + len(rows) * group + 30
    width = LEFT + len(PANELS) * PANEL + RIGHT
    found = {(scene, objective, name): quartiles(result[objective], name.format(objective))
             for scene, result in rows.items() for objective, _ in PANELS for name, _, _ in BARS}
    most = max(triple[2] for triple in found.values() if triple) * 1.04
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="12">',
             f'<rect width="{width}" height="{height}" fill="white"/>']

    def text(x, y, words, more=""):
        parts.append(f'<text x="{x:.1f}" y="{y:.1f}" {more}>{html.escape(words)}</text>')

    x = LEFT
    for _, label, colour in BARS:
        parts.append(f'<rect x="{x}" y="10" width="12" height="12" fill="{colour}"/>')
        text(x + 17, 20, label)
        x += 45 + 6.3 * len(label)
    for panel, (objective, title) in enumerate(PANELS):
        left, wide = LEFT + panel * PANEL, PANEL - 90
        at = lambda value: left + value / most * wide
        text(left, TOP - 22, title, 'font-weight="bold"')
        for step in range(int(most * 2) + 1):
            value = step / 2
            parts.append(f'<line x1="{at(value):.1f}" x2="{at(value):.1f}" y1="{TOP - 8}" y2="{height - 26}" '
                         f'stroke="{"#333" if value == 1 else "#ddd"}"/>')
            if value.is_integer():
                text(at(value), height - 10, f"{value:.0f} ×", 'text-anchor="middle"')
        for number, scene in enumerate(rows):
            top = TOP + number * group
            if panel == 0:
                text(LEFT - 8, top + len(BARS) * BAR / 2 + 4, scene, 'text-anchor="end"')
            gain = quartiles(rows[scene][objective], f"full {objective}", FIXED)
            if gain:
                text(left + wide + 78, top + len(BARS) * BAR / 2 + 4, f"{gain[1]:.2f} × fixed", 'text-anchor="end" font-size="10"')
            for bar, (name, _, colour) in enumerate(BARS):
                triple = found[scene, objective, name]
                if triple is None:
                    continue
                y = top + bar * BAR
                low, middle, high = triple
                parts.append(f'<rect x="{left}" y="{y}" width="{at(middle) - left:.1f}" height="{BAR - 1}" fill="{colour}"/>')
                parts.append(f'<line x1="{at(low):.1f}" x2="{at(high):.1f}" y1="{y + 4}" y2="{y + 4}" stroke="black" stroke-opacity="0.6"/>')
    return "\n".join(parts + ["</svg>", ""])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=pathlib.Path, help="what tools/bench.py wrote")
    parser.add_argument("out", type=pathlib.Path, help="the chart, .svg")
    parser.add_argument("--row", default="2@320x240", help="threads and size")
    options = parser.parse_args()
    results = json.loads(options.results.read_text())["rows"]
    rows = {key.split(" ")[0]: result for key, result in results.items() if key.endswith(" " + options.row)}
    if not rows:
        raise SystemExit(f"bench_chart: {options.results} has no row {options.row}")
    options.out.write_text(draw(rows))


if __name__ == "__main__":
    main()
