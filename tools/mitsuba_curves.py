#!/usr/bin/env python3
"""Error against time beside Mitsuba 3: both render one scene from one camera, each is compared with its own reference.

    tools/mitsuba_curves.py living_room.glb --out FOLDER [--programs target/release] [--config candidates=8]

Wants `pip install mitsuba numpy`, and for the variant llvm_ad_rgb an LLVM that this Mitsuba accepts (3.9.1: LLVM 15 is
too old, 19 works), whose library DRJIT_LIBLLVM_PATH names. The scene must be a GLB whose lights are emissive meshes.
FOLDER gets a copy of it in which every surface is matt and flat, so that both renderers have one picture to render (the
references are compared, too), converge.json, curves.json, and charts of both errors: relative_mse is that of converge,
trimmed the one that searches for light sampling minimise, without the worst thousandth of the pixels.

Equal: triangles, albedos, lights, camera, box filter, depth, no roulette, threads. Not equal: Mitsuba chooses evenly
among its lights, which shine to one side, and has samplers of its own (two are shown). It renders all samples in one
call, and has compiled for the scene before its clock runs (LLVM). Neither clock counts loading and building.
"""

import argparse
import html
import json
import math
import multiprocessing
import pathlib
import statistics
import subprocess
import sys

try:
    import mitsuba
    import numpy
    from mitsuba_render import SAMPLERS, SAMPLES, matt_copy, measure
except ImportError as missing:
    sys.exit(f"mitsuba_curves: {missing}; pip install mitsuba numpy")

VARIANTS = ("llvm_ad_rgb", "scalar_rgb")
OURS = ("native Embree default", "best fixed configuration")
# Of renderer/src/noise.rs and lab/src/converge/metrics.rs.
TRIMMED, BLOCK, FLOOR, EPSILON, LUMINANCE = 1e-3, 8, 0.1, 0.01, (0.2126, 0.7152, 0.0722)
COLOURS = ("#9aa0a6", "#1b7f4b", "#0b5394", "#b5651d", "#c9a227", "#8e44ad", "#c0392b", "#2c3e50", "#16a085")


class Yardstick:
    """Errors against a reference that was rendered as two independent halves."""

    def __init__(self, halves):
        self.reference = numpy.mean(halves, 0, "f8")
        bright = self.reference @ LUMINANCE
        self.weights = 1 / (self.reference**2 + EPSILON * bright.mean()**2)
        height, width = bright.shape  # multiples of a block
        blocks = bright.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK).mean((1, 3))
        self.block_weights = 1 / (numpy.kron(blocks, numpy.ones((BLOCK, BLOCK)))**2 + (FLOOR * bright.mean())**2)
        self.noise = float((((halves[0] - halves[1]) / 2)**2 * self.weights).mean())

    def error(self, picture):
        """As `converge` measures it."""
        return float(((picture - self.reference)**2 * self.weights).mean())

    def trimmed(self, picture):
        """Of luminance, without the worst thousandth, as searches for light sampling measure it."""
        errors = numpy.sort((((picture - self.reference) @ LUMINANCE)**2 * self.block_weights).ravel())
        return float(errors[:len(errors) - int(len(errors) * TRIMMED)].sum() / len(errors))


def row(who, samples, seconds, errors, trimmed):
    """A point of a curve, from several runs."""
    return {"who": who, "samples": samples, "render_s": statistics.median(seconds), "relative_mse": statistics.mean(errors),
            "trimmed": statistics.mean(trimmed)}


def ours(options, scene):
    """The curves of `converge`; pictures and reference of `image`."""
    view = ["--scene", scene, f"--eye={options.eye}", f"--target={options.target}", "--fov", options.fov]
    view += ["--size", options.size, "--bounces", options.bounces, "--threads", options.threads]
    light = lambda configs: ["--space", "light", *(f"--config={config}" for config in configs)] if configs else []
    run = lambda program, *words: subprocess.run(
        [options.programs / program, *map(str, [*words[:1], *view, *words[1:]])], check=True, stdout=subprocess.DEVNULL)
    file, exr = options.out / "converge.json", options.out / "picture.exr"
    run("treewright-lab", "converge", *light(options.config), "--runs", options.repeats, "--spp", SAMPLES[-1],
        "--seconds", 3600, "--reference-spp", options.reference_spp, "--json", file)

    def picture(samples, seed, *how):
        run("treewright-render", "image", *how, "--spp", samples, "--seed", seed, "--out", exr)
        return numpy.array(mitsuba.Bitmap(str(exr)).convert(component_format=mitsuba.Struct.Type.Float32))

    yardstick, rows = Yardstick([picture(options.reference_spp // 2, seed) for seed in (501, 502)]), []
    for found in json.loads(file.read_text())["contenders"]:
        name = found["name"]
        for samples in SAMPLES if name in (*OURS, *options.config) else ():
            points = [point for run in found["runs"] for point in run["points"] if point["samples"] == samples]
            how = light([name] if name in options.config else [])
            pictures = [picture(samples, 601 + number, *how) for number in range(options.repeats)]
            who = f"light {1 + options.config.index(name)}" if name in options.config else name
            rows.append(row(who, samples, [point["render_ms"] / 1e3 for point in points],
                            [point["relative_mse"] for point in points], map(yardstick.trimmed, pictures)))
    return yardstick, rows


def theirs(options, meshes):
    """The curves of Mitsuba, and its reference."""
    yardstick, rows, file = None, [], options.out / "mitsuba.npz"
    for variant in VARIANTS:
        work = (variant, meshes, options, yardstick is None, file)
        process = multiprocessing.get_context("spawn").Process(target=measure, args=work)
        process.start()
        process.join()
        if process.exitcode:
            print(f"{variant} does not run; llvm_ad_rgb may want another LLVM (DRJIT_LIBLLVM_PATH)", file=sys.stderr)
            continue
        found = numpy.load(file)
        yardstick = yardstick or Yardstick(found["reference"])
        for key in (f"{sampler} {samples}" for sampler in SAMPLERS for samples in SAMPLES):
            sampler, samples = key.split()
            rows.append(row(f"Mitsuba {variant}, {sampler}", int(samples), found[key + " s"].tolist(),
                            map(yardstick.error, found[key]), map(yardstick.trimmed, found[key])))
    return yardstick, rows


def chart(rows, error):
    """A kind of error against time, both logarithmic, as SVG."""
    left, top, wide, high, keys = 60, 20, 460, 340, ("render_s", error)
    logs = lambda each: [math.log10(each[key]) for key in keys]
    least, most = ([bound(values) for values in zip(*map(logs, rows))] for bound in (min, max))
    share = lambda value, axis: (value - least[axis]) / (most[axis] - least[axis])
    place = lambda x, y: (left + wide * share(x, 0), top + high * (1 - share(y, 1)))
    parts = ['<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 800 410" font-family="sans-serif" font-size="12">',
             '<rect width="800" height="410" fill="white"/>']
    text = lambda x, y, words: parts.append(f'<text x="{x:.0f}" y="{y:.0f}">{html.escape(words)}</text>')

    def line(points, colour):
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.5"/>')

    for axis in (0, 1):
        for power in range(math.ceil(least[axis]), math.floor(most[axis]) + 1):
            ends = [place(*((end[0], power) if axis else (power, end[1]))) for end in (least, most)]
            line(ends, "#ddd")
            text(*((14, ends[0][1] + 4) if axis else (ends[0][0] - 12, top + high + 16)), f"{10.0**power:g}")
    text(left, top + high + 36, f"Seconds of rendering; upwards: {error} against the renderer's own reference")
    for number, (name, colour) in enumerate(zip(dict.fromkeys(each["who"] for each in rows), COLOURS)):
        line([place(*logs(each)) for each in rows if each["who"] == name], colour)
        line([(left + wide + x, 36 + 20 * number) for x in (10, 30)], colour)
        text(left + wide + 36, 40 + 20 * number, name)
    return "\n".join(parts) + "\n</svg>\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("scene", type=pathlib.Path)
    add("--out", type=pathlib.Path, required=True)
    add("--programs", type=pathlib.Path, default=pathlib.Path("target/release"))
    add("--eye", default="2.25009,1.31171,6.17872", help="the defaults are the camera of living_room")
    add("--target", default="1.815914,1.275080,5.278637")
    add("--fov", type=float, default=58.7155, help="vertical, in degrees")
    add("--size", default="320x240", help="multiples of eight")
    add("--bounces", type=int, default=3)
    add("--threads", type=int, default=2)
    add("--repeats", type=int, default=3)
    add("--reference-spp", type=int, default=4096)
    add("--config", action="append", default=[], help="as for converge --space light; in charts light 1, 2, …")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    meshes = matt_copy(options.scene, options.out / "matt.glb")
    mitsuba.set_variant("scalar_rgb")
    peer, rows = theirs(options, meshes)
    own, own_rows = ours(options, options.out / "matt.glb")
    rows = own_rows + rows
    facts = {"mitsuba": mitsuba.__version__, "noise": [own.noise, peer.noise], "differ": own.error(peer.reference),
             "brightness": float(peer.reference.mean() / own.reference.mean())}
    options.out.joinpath("curves.json").write_text(json.dumps({**facts, "rows": rows}, indent=1) + "\n")
    for error in ("relative_mse", "trimmed"):
        options.out.joinpath(error + ".svg").write_text(chart(rows, error))
    print("Mitsuba's reference over ours: {brightness:.4f}; they differ by {differ:.2e}, of which noise".format(**facts),
          f"{own.noise:.2e} and {peer.noise:.2e}\n\n| who | samples | seconds | error | without the worst thousandth "
          "| error × seconds | without |\n|---|--:|--:|--:|--:|--:|--:|")
    for each in rows:
        print("| {who} | {samples} | {render_s:.3f} | {relative_mse:.4f} | {trimmed:.4f}".format(**each),
              f"| {each['relative_mse'] * each['render_s']:.4f} | {each['trimmed'] * each['render_s']:.4f} |")


if __name__ == "__main__":
    main()
