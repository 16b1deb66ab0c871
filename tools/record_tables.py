#!/usr/bin/env python3
"""Makes the README's tables and chart from the record of a measurement, so that no figure there is older than its record.

    tools/record_tables.py            write them
    tools/record_tables.py --check    say whether they are what the record gives; a test asks

The record is what `treewright-lab leave-scene-out` judged, `lab/record/README.json` names it.
"""

import argparse
import html
import json
import pathlib
import statistics
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
README, CHART, RECORD = ROOT / "README.md", ROOT / "docs" / "gains.svg", ROOT / "lab" / "record"
BEGIN, END = "<!-- record: made by tools/record_tables.py -->", "<!-- end of record -->"
TITLES = {"render": "Progressive: a frame with a thousandth of its build", "total": "Real time: a frame with its whole build"}
FRAMES = ["0", "8", "16", "32", "60"]
BARS = [("native Embree, used well", "#c9a227"), ("best fixed of the other scenes", "#b5651d"), ("tuned, 60 frames", "#1b7f4b")]
LEFT, PANEL, BAR, GAP, TOP = 130, 400, 9, 14, 74
# Longer bars end here and say how long they are: one scene must not flatten all others.
AXIS_MOST = 3.0


def ratio(of):
    low, high = of["interval"]
    return f"{of['median']:.2f} [{low:.2f}, {high:.2f}]"


def table(rows):
    """One objective: scenes, then medians over them."""
    lines = ["| scene | native default, ms | native used well, ms | best fixed of the others, ms | **tuned, ms** | over native default | over native used well | over best fixed | share of the roofline |",
             "|---|---|---|---|---|---|---|---|---|"]
    for row in rows:
        native, well, fixed, tuned = (f"{ms:.1f}" for ms in row["frame_ms"])
        lines.append(f"| {row['scene']} | {native} | {well} ({row['native_quality']}) | {fixed} | **{tuned}** | {ratio(row['over_default'])} | "
                     f"{ratio(row['over_used_well']['60'])} | {ratio(row['over_fixed']['60'])} | {row['of_roofline']['60']:.2f} |")
    return "\n".join(lines)


def progress(rows):
    """Median and least over the scenes, after so many frames."""
    def over(column, frames):
        values = [row[column][frames] for row in rows]
        values = [value["median"] if isinstance(value, dict) else value for value in values]
        return f"{statistics.median(values):.3f} ({min(values):.2f})"

    names = [("over_fixed", "over the best fixed configuration of the others"), ("over_used_well", "over native used well"),
             ("of_roofline", "share of the roofline's speed")]
    lines = ["| median of the scenes (least) | " + " | ".join(f"after {frames} frames" for frames in FRAMES) + " |",
             "|---|" + "---|" * len(FRAMES)]
    lines += [f"| {name} | " + " | ".join(over(column, frames) for frames in FRAMES) + " |" for column, name in names]
    return "\n".join(lines)


def chart(rows):
    """Speed over native Embree's default, as SVG that follows the reader's colours."""
    panels = [(objective, [row for row in rows if row["objective"] == objective]) for objective in TITLES]
    scenes = [row["scene"] for row in panels[0][1]]
    group = len(BARS) * BAR + GAP
    height, width = TOP + len(scenes) * group + 44, LEFT + len(panels) * PANEL + 20

    def speeds(row):
        native, well, fixed, tuned = row["frame_ms"]
        return [native / well, native / fixed, native / tuned]

    most = min(max(speed for row in rows for speed in speeds(row)) * 1.05, AXIS_MOST)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="12">',
           "<style>text{fill:#222}.axis{stroke:#999}.faint{stroke:#ddd}"
           "@media(prefers-color-scheme:dark){text{fill:#ddd}.axis{stroke:#777}.faint{stroke:#333}}</style>"]
    for place, (name, colour) in enumerate(BARS):
        out.append(f'<rect x="{LEFT + place * 230}" y="12" width="12" height="12" fill="{colour}"/>'
                   f'<text x="{LEFT + place * 230 + 18}" y="22">{html.escape(name)}</text>')
    for place, (objective, own) in enumerate(panels):
        left, bottom = LEFT + place * PANEL, height - 36
        scale = (PANEL - 40) / most
        out.append(f'<text x="{left}" y="54" font-weight="bold">{html.escape(TITLES[objective])}</text>')
        for tick in range(int(most * 2) + 1):
            x = left + tick / 2 * scale
            out.append(f'<line class="{"axis" if tick == 2 else "faint"}" x1="{x:.1f}" x2="{x:.1f}" y1="{TOP - 8}" y2="{bottom}"/>'
                       f'<text x="{x:.1f}" y="{bottom + 14}" text-anchor="middle">{tick / 2:g}</text>')
        out.append(f'<text x="{left + (PANEL - 40) / 2}" y="{bottom + 30}" text-anchor="middle">speed over native Embree\'s default</text>')
        for index, row in enumerate(own):
            y = TOP + index * group
            if place == 0:
                out.append(f'<text x="{LEFT - 8}" y="{y + 18}" text-anchor="end">{html.escape(row["scene"])}</text>')
            for bar, (speed, (_, colour)) in enumerate(zip(speeds(row), BARS)):
                out.append(f'<rect x="{left}" y="{y + bar * BAR}" width="{min(speed, most) * scale:.1f}" height="{BAR - 1}" fill="{colour}"/>')
                if speed > most:
                    out.append(f'<text x="{left + most * scale - 4:.1f}" y="{y + bar * BAR + 7}" font-size="9" text-anchor="end" style="fill:#fff">{speed:.1f}</text>')
    return "\n".join(out + ["</svg>", ""])


def made():
    """What the README and the chart should be."""
    about = json.loads((RECORD / "README.json").read_text())
    rows = json.loads((RECORD / about["judged"]).read_text())["rows"]
    rows.sort(key=lambda row: (row["objective"], row["scene"]))
    disturbed = sum(row["disturbed"] for row in rows)
    parts = [f"{about['machine']}, {about['date']}, version {about['version']}; {about['setting']}. "
             f"{disturbed or 'None'} of {len(rows)} rows {'are' if disturbed != 1 else 'is'} marked as measured beside other work."]
    for objective, title in TITLES.items():
        own = [row for row in rows if row["objective"] == objective]
        parts += [f"**{title}**", progress(own), table(own)]
    before, _, rest = README.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    if not rest or not after:
        sys.exit(f"record_tables: {README} has no place for the record; write the lines {BEGIN} and {END} where it belongs")
    return f"{before}{BEGIN}\n" + "\n\n".join(parts) + f"\n{END}{after}", chart(rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; fail where something is older than the record")
    options = parser.parse_args()
    for path, text in zip((README, CHART), made()):
        if options.check and path.read_text() != text:
            sys.exit(f"record_tables: {path.relative_to(ROOT)} is not what the record gives; run tools/record_tables.py")
        if not options.check:
            path.write_text(text)


if __name__ == "__main__":
    main()
