#!/usr/bin/env python3
"""Makes the tables and the chart of unseen scenes from the record of a measurement, so that no figure is older than its record.

    tools/record_tables.py            write them
    tools/record_tables.py --check    say whether they are what the record gives; a test asks

The record is what `treewright-lab leave-scene-out` judged, `lab/record/README.json` names it.
"""

import argparse
import html
import json
import math
import pathlib
import random
import statistics
import sys
import textwrap

ROOT = pathlib.Path(__file__).resolve().parent.parent
README, CHART, RECORD = ROOT / "README.md", ROOT / "docs" / "gains.svg", ROOT / "lab" / "record"
PAGES = {"render": ROOT / "docs/measurements/unseen-progressive.md", "total": ROOT / "docs/measurements/unseen-real-time.md"}
BEGIN, END = "<!-- record: made by tools/record_tables.py -->", "<!-- end of record -->"
TITLES = {"render": "Progressive: a frame with a thousandth of its build", "total": "Real time: a frame with its whole build"}
COLUMNS = {"over_fixed": "best fixed configuration of the other scenes", "over_used_well": "native Embree used well",
           "of_roofline": "fastest that ever ran there"}
FRAMES = ["0", "8", "16", "32", "60"]
# The chart: a band a scene, two panels, a logarithmic axis. One scene must not flatten all others, so it ends at MOST.
LEFT, PANEL, BAND, TOP, LEAST, MOST = 128, 330, 22, 64, 0.7, 2.0
FIXED, TUNED = "#b26a00", "#0072b2"


def ratio(of):
    low, high = of["interval"]
    return f"{of['median']:.2f} [{low:.2f}, {high:.2f}]"


def spread(values):
    """Median over the scenes with its 95 % interval, by drawing the scenes 4,000 times, and the least."""
    draw = random.Random(1)
    medians = sorted(statistics.median(draw.choices(values, k=len(values))) for _ in range(4000))
    return f"{statistics.median(values):.2f} [{medians[100]:.2f}, {medians[-101]:.2f}] ({min(values):.2f})"


def over(rows, column, frames):
    """What is said of one column of all scenes."""
    values = [row[column][frames] if frames else row[column] for row in rows]
    return spread([value["median"] if isinstance(value, dict) else value for value in values])


def ceiling(rows):
    """The fastest that ever ran over the best fixed configuration: what choosing by scene can win at most."""
    return spread([row["frame_ms"][2] / (row["of_roofline"]["60"] * row["frame_ms"][3]) for row in rows])


def summary(objectives):
    """The README's rows: progressive and real time side by side."""
    rows = [("native Embree's default: medium quality, path by path", "over_default", None)]
    for frames, when in (("0", "before the first frame"), ("60", "after 60 frames")):
        rows += [(f"{COLUMNS[column]}, {when}", column, frames) for column in ("over_used_well", "over_fixed")]
    rows.append((COLUMNS["of_roofline"] + ", after 60 frames", "of_roofline", "60"))
    lines = ["| speed over … | progressive | real time |", "|---|---|---|"]
    lines += [f"| {name} | " + " | ".join(over(own, column, frames) for own in objectives.values()) + " |"
              for name, column, frames in rows]
    lines.append("| the fastest that ever ran over the best fixed: the most that choosing by scene can win | "
                 + " | ".join(ceiling(own) for own in objectives.values()) + " |")
    return "\n".join(lines)


def progress(rows):
    """Median, interval and least over the scenes, by the number of searched frames."""
    lines = ["| median of the scenes [95 %] (least) | " + " | ".join(f"{frames} frames" for frames in FRAMES) + " |",
             "|---|" + "---|" * len(FRAMES)]
    lines += [f"| over the {name} | " + " | ".join(over(rows, column, frames) for frames in FRAMES) + " |"
              for column, name in COLUMNS.items()]
    return "\n".join(lines)


def table(rows):
    """One objective, a row a scene."""
    lines = ["| scene | default, ms | used well, ms | fixed, ms | tuned, ms | over used well | over fixed | of the fastest |",
             "|---|--:|--:|--:|--:|---|---|--:|"]
    for row in rows:
        native, well, fixed, tuned = (f"{ms:.1f}" for ms in row["frame_ms"])
        lines.append(f"| {row['scene']} | {native} | {well} ({row['native_quality']}) | {fixed} | {tuned} | "
                     f"{ratio(row['over_used_well']['60'])} | {ratio(row['over_fixed']['60'])} | {row['of_roofline']['60']:.2f} |")
    return "\n".join(lines)


def place(ratio_of):
    """Where a ratio stands on the axis, in pixels from its beginning; what is beyond an end stands there."""
    clipped = min(max(ratio_of, LEAST), MOST)
    return (PANEL - 30) * math.log(clipped / LEAST) / math.log(MOST / LEAST)


def mark(x, y, value, colour, low=None, high=None):
    """A dot, with its interval where there is one. A triangle and the figure stand for what is beyond the axis."""
    if value > MOST:
        return (f'<path d="M{x + place(MOST) - 4:.1f} {y - 4} l8 4 l-8 4z" fill="{colour}"/>'
                f'<text x="{x + place(MOST) - 8:.1f}" y="{y + 4}" font-size="10" text-anchor="end">{value:.2f}</text>')
    interval = "" if low is None else (f'<line x1="{x + place(low):.1f}" x2="{x + place(high):.1f}" y1="{y}" y2="{y}" '
                                       f'stroke="{colour}" stroke-width="2"/>')
    return interval + f'<circle cx="{x + place(value):.1f}" cy="{y}" r="4" fill="{colour}"/>'


def chart(objectives):
    """Speed over native Embree used well, as SVG that follows the reader's colours."""
    scenes = [row["scene"] for row in next(iter(objectives.values()))]
    bottom = TOP + len(scenes) * BAND
    width, height = LEFT + len(objectives) * PANEL, bottom + 44
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="12">',
           "<title>Speed over native Embree used well, for each scene</title>",
           "<style>text{fill:#222}.axis{stroke:#777}.faint{stroke:#ddd}"
           "@media(prefers-color-scheme:dark){text{fill:#ddd}.axis{stroke:#888}.faint{stroke:#333}}</style>"]
    for index, (name, colour) in enumerate([("best fixed configuration of the other scenes", FIXED),
                                            ("tuned, after 60 frames, with its 95 % interval", TUNED)]):
        out.append(f'<circle cx="{LEFT + index * 300 + 4}" cy="14" r="4" fill="{colour}"/>'
                   f'<text x="{LEFT + index * 300 + 14}" y="18">{name}</text>')
    for index, (objective, own) in enumerate(objectives.items()):
        left = LEFT + index * PANEL
        out.append(f'<text x="{left}" y="44" font-weight="bold">{html.escape(TITLES[objective].split(":")[0])}</text>')
        for tick in (0.7, 0.8, 1.0, 1.2, 1.4, 1.6, 2.0):
            x, kind = left + place(tick), "axis" if tick == 1 else "faint"
            out.append(f'<line class="{kind}" x1="{x:.1f}" x2="{x:.1f}" y1="{TOP - 8}" y2="{bottom}"/>'
                       f'<text x="{x:.1f}" y="{bottom + 16}" text-anchor="middle">{tick:g}</text>')
        out.append(f'<text x="{left + (PANEL - 30) / 2}" y="{bottom + 36}" text-anchor="middle">'
                   "speed over native Embree used well (log scale)</text>")
        for line, row in enumerate(own):
            y = TOP + line * BAND + BAND // 2
            if index == 0:
                out.append(f'<text x="{LEFT - 10}" y="{y + 4}" text-anchor="end">{html.escape(row["scene"])}</text>')
            tuned = row["over_used_well"]["60"]
            out.append(mark(left, y - 4, row["fixed_over_used_well"]["median"], FIXED))
            out.append(mark(left, y + 4, tuned["median"], TUNED, *tuned["interval"]))
    return "\n".join(out + ["</svg>", ""])


def within(path, text):
    """The page with the text between its two marks."""
    before, _, rest = path.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    if not rest or not after:
        sys.exit(f"record_tables: {path} has no place for the record; write the lines {BEGIN} and {END} where it belongs")
    return f"{before}{BEGIN}\n{text}\n{END}{after}"


def made():
    """Each file, and what it should hold."""
    about = json.loads((RECORD / "README.json").read_text())
    rows = json.loads((RECORD / about["judged"]).read_text())["rows"]
    rows.sort(key=lambda row: row["scene"])
    disturbed = sum(row["disturbed"] for row in rows)
    objectives = {objective: [row for row in rows if row["objective"] == objective] for objective in TITLES}
    conditions = (f"{about['machine']}, {about['date']}, version {about['version']}; {about['setting']}. "
                  f"{disturbed or 'None'} of {len(rows)} rows {'are' if disturbed != 1 else 'is'} marked as measured beside other work.")
    yield README, within(README, summary(objectives))
    for objective, page in PAGES.items():
        own = objectives[objective]
        # The page of real time refers to the conditions of the other.
        parts = [textwrap.fill(conditions, 110)] if objective == "render" else []
        yield page, within(page, "\n\n".join([*parts, progress(own), table(own)]))
    yield CHART, chart(objectives)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; fail where something is older than the record")
    options = parser.parse_args()
    for path, text in made():
        if options.check and path.read_text() != text:
            sys.exit(f"record_tables: {path.relative_to(ROOT)} is not what the record gives; run tools/record_tables.py")
        if not options.check:
            path.write_text(text)


if __name__ == "__main__":
    main()
