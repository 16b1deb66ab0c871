// three-mesh-bvh, tuned per mesh and per number of rays that its tree has to serve.
//
//   node --single-threaded node_modules/treewright/examples/three_mesh_bvh.js --url URL --trials 25 --rays 1000,1000000 [--rounds 5] [SCENE.ply ...]
//
// How many rays follow a build is the use: a thousand for picking in a mesh that is edited, a million for a light map. Cost is build plus
// rays, in milliseconds of processor time. Of many rays a run traces --sample and multiplies. With --rounds the tuned configuration is then
// measured against every fixed one, in turns within each round. V8's option keeps compiling and clearing memory out of other threads, whose
// time would be counted. Memory is not cleared between runs by `gc()`: that throws compiled code away, and builds took up to ten times as
// long after it. Lines of JSON go to standard output. Without scenes two are generated.

import { readFileSync } from "node:fs";
import { basename } from "node:path";
import { parseArgs } from "node:util";

import { BufferAttribute, BufferGeometry, DoubleSide, Ray, Vector3 } from "three";
import { AVERAGE, CENTER, MeshBVH, SAH } from "three-mesh-bvh";
import { Client } from "treewright";

const STRATEGIES = { center: CENTER, average: AVERAGE, sah: SAH };
// The package's own default comes first.
const FIXED = [
  ["center", 10], ["center", 4], ["center", 40], ["average", 10], ["sah", 2], ["sah", 10],
].map(([strategy, leaf]) => ({ strategy, leaf, indirect: false }));

const spec = {
  parameters: [
    { name: "strategy", type: "choice", values: Object.keys(STRATEGIES), default: "center" },
    { name: "leaf", type: "integer", min: 1, max: 100, log: true, default: 10 },
    { name: "indirect", type: "boolean", default: false },
  ],
  indicators: { triangles: [0, 1e7, "log"], rays: [0, 1e9, "log"], elongation: [0, 10] },
  minimise: { build_ms: 1, rays_ms: 1 },
};

// The PLY that integrations/scenes.py writes: binary, float positions, lists of three.
function readPly(path) {
  const bytes = readFileSync(path);
  const end = bytes.indexOf("end_header\n") + 11;
  const header = bytes.toString("latin1", 0, end);
  const count = (what) => Number(new RegExp(`element ${what} (\\d+)`).exec(header)?.[1]);
  const [vertices, faces] = [count("vertex"), count("face")];
  if (bytes.length !== end + 12 * vertices + 13 * faces) throw new Error(`${path} is no binary PLY of triangles`);
  const positions = new Float32Array(bytes.buffer.slice(bytes.byteOffset + end, bytes.byteOffset + end + 12 * vertices));
  const indices = new Uint32Array(3 * faces);
  for (let face = 0, at = end + 12 * vertices; face < faces; face++, at += 13)
    for (let corner = 0; corner < 3; corner++) indices[3 * face + corner] = bytes.readUInt32LE(at + 1 + 4 * corner);
  return { name: basename(path, ".ply"), positions, indices };
}

function generator(seed) {
  let state = seed;
  return () => ((state = (Math.imul(state, 1664525) + 1013904223) >>> 0) >>> 8) / 16777216;
}

// A cloud of long thin triangles, and a height field.
function generate(kind) {
  const random = generator(7);
  const positions = [];
  if (kind === "needles")
    for (let each = 0; each < 8000; each++) {
      const corner = [random() * 6, random() * 6, random() * 6];
      const other = corner.map((value) => value + 1.5 * (random() - 0.5));
      positions.push(...corner, ...other, other[0] + 0.01, other[1] + 0.01, other[2]);
    }
  else
    for (let x = 0; x < 60; x++)
      for (let z = 0; z < 60; z++) {
        const at = (u, v) => [u * 0.1, Math.sin(u * 0.3) * Math.cos(v * 0.2), v * 0.1];
        positions.push(...at(x, z), ...at(x + 1, z), ...at(x, z + 1));
      }
  return { name: kind, positions: new Float32Array(positions), indices: Uint32Array.from({ length: positions.length / 3 }, (_, each) => each) };
}

// Processor time, so that what else the machine does is left out.
function now() {
  const { user, system } = process.cpuUsage();
  return (user + system) / 1e3;
}

function run({ positions, indices }, { strategy, leaf, indirect }, rays) {
  const traced = Math.min(rays, sample);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(positions, 3));
  // The build reorders the triangles in place.
  geometry.setIndex(new BufferAttribute(indices.slice(), 1));
  const start = now();
  const tree = new MeshBVH(geometry, { strategy: STRATEGIES[strategy], targetLeafSize: leaf, indirect, verbose: false });
  const built = now();
  const box = tree.getBoundingBox(geometry.boundingBox ?? (geometry.computeBoundingBox(), geometry.boundingBox)).clone();
  const center = box.getCenter(new Vector3());
  const random = generator(1);
  const ray = new Ray(center.clone(), new Vector3());
  let hits = 0;
  // A walk: each ray begins where the one before hit, as a path does.
  for (let each = 0; each < traced; each++) {
    ray.direction.set(random() - 0.5, random() - 0.5, random() - 0.5).normalize();
    const hit = tree.raycastFirst(ray, DoubleSide);
    if (hit) {
      hits += 1;
      ray.at(hit.distance * 0.999, ray.origin);
    } else ray.origin.copy(center);
  }
  return { build_ms: built - start, rays_ms: ((now() - built) * rays) / traced, hits };
}

// The run with the median cost out of several, as many as fit into a third of a second; `each` gets all of them.
function repeated(mesh, configuration, rays, each = () => {}) {
  const runs = [];
  const start = now();
  while (runs.length % 2 === 0 || (runs.length < 9 && now() - start < 330)) {
    const one = run(mesh, configuration, rays);
    runs.push({ ...one, cost: one.build_ms + one.rays_ms });
    each(runs.at(-1).cost);
  }
  return runs.sort((a, b) => a.cost - b.cost)[runs.length >> 1];
}

function describe({ positions, indices }, rays) {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (const index of indices)
    for (let axis = 0; axis < 3; axis++) {
      low[axis] = Math.min(low[axis], positions[3 * index + axis]);
      high[axis] = Math.max(high[axis], positions[3 * index + axis]);
    }
  const sides = high.map((value, axis) => Math.max(value - low[axis], 1e-9)).sort((a, b) => a - b);
  return { triangles: indices.length / 3, rays, elongation: Math.log2(sides[2] / sides[0]) };
}

// Costs of the tuned configuration and of every fixed one, in turns within each round, and what each hits more or less.
function compare(mesh, tuned, rays, rounds) {
  const all = [tuned, ...FIXED].map((configuration) => ({ configuration, costs: [], hits: 0 }));
  const random = generator(3);
  for (let round = 0; round < rounds; round++)
    // In another order each time: what ran before leaves its mark on caches and heap.
    for (const { one } of all.map((one) => ({ one, key: random() })).sort((a, b) => a.key - b.key)) {
      const { cost, hits } = repeated(mesh, one.configuration, rays);
      one.costs.push(cost);
      one.hits = hits;
    }
  const [{ costs, hits }, ...fixed] = all;
  return { tuned_costs: costs, fixed: fixed.map((one) => ({ configuration: one.configuration, costs: one.costs, differs: Math.abs(one.hits - hits) })) };
}

const { values, positionals } = parseArgs({
  allowPositionals: true,
  options: {
    url: { type: "string", default: "http://127.0.0.1:50611" },
    trials: { type: "string", default: "25" },
    rays: { type: "string", default: "1000,1000000" },
    rounds: { type: "string", default: "0" },
    sample: { type: "string", default: "1000000" },
  },
});
const sample = Number(values.sample);
const meshes = positionals.length > 0 ? positionals.map(readPly) : [generate("needles"), generate("field")];
const client = new Client(values.url, { clientId: "three-mesh-bvh-example", deadlineMs: 1000, software: { "three-mesh-bvh": "0.9.17" } });
const study = await client.study("three-mesh-bvh", spec);
// Compiles what is measured: every way to split and to trace.
for (let round = 0; round < 3; round++)
  for (const fixed of FIXED) for (const indirect of [false, true]) run(meshes[0], { ...fixed, indirect }, Math.min(sample, 10000));
for (const mesh of meshes) {
  for (const rays of values.rays.split(",").map(Number)) {
    const input = describe(mesh, rays);
    const [costs, medians] = [[], []];
    const measure = (suggestion) => {
      const { build_ms, rays_ms, cost } = repeated(mesh, suggestion.configuration, rays, (each) => costs.push(each));
      suggestion.report({ build_ms, rays_ms });
      medians.push(cost);
    };
    // First what is known to be good somewhere, then the search, and in the last quarter the best so far and the best known setting in turns,
    // which tells merit from luck.
    const trials = Number(values.trials);
    for (const known of FIXED.slice(0, trials)) measure(await study.trialOf(known, input));
    const bestKnown = FIXED[medians.indexOf(Math.min(...medians))];
    const pairs = Math.min(trials >> 3, (trials - medians.length) >> 1);
    for (let left = trials - medians.length - 2 * pairs; left > 0; left--) measure(await study.suggest(input));
    for (let pair = 0; pair < pairs; pair++) {
      await client.flush(20000);
      measure(await study.trialOf((await study.best(input)).configuration, input));
      measure(await study.trialOf(bestKnown, input));
    }
    await client.flush(20000);
    const best = await study.best(input);
    const line = { scene: mesh.name, triangles: input.triangles, use: `${rays} rays`, trial_costs: costs, tuned: best.configuration };
    if (Number(values.rounds) > 0) Object.assign(line, compare(mesh, best.configuration, rays, Number(values.rounds)));
    console.log(JSON.stringify(line));
  }
}
client.close();
