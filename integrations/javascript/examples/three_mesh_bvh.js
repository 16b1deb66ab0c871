// three-mesh-bvh, tuned per mesh and per number of rays that its tree has to serve.
//
//   node --expose-gc --single-threaded-gc examples/three_mesh_bvh.js --url URL --trials 25 --rays 20000,500000 [--rounds 5] [SCENE.ply ...]
//
// Cost is build plus rays, in milliseconds. With --rounds the tuned configuration is then measured against every fixed one, in turns within
// each round. Lines of JSON go to standard output. Without scenes two are generated.

import { readFileSync } from "node:fs";
import { basename } from "node:path";
import { parseArgs } from "node:util";

import { BufferAttribute, BufferGeometry, DoubleSide, Ray, Vector3 } from "three";
import { AVERAGE, CENTER, MeshBVH, SAH } from "three-mesh-bvh";

import { Client } from "../src/index.js";

const STRATEGIES = { center: CENTER, average: AVERAGE, sah: SAH };
// The package's own default comes first.
const FIXED = [
  ["center", 10], ["center", 4], ["center", 20], ["average", 10], ["sah", 4], ["sah", 10], ["sah", 20], ["sah", 40],
].map(([strategy, max_leaf]) => ({ strategy, max_leaf, max_depth: 40 }));

const spec = {
  parameters: [
    { name: "strategy", type: "choice", values: Object.keys(STRATEGIES), default: "center" },
    { name: "max_leaf", type: "integer", min: 2, max: 60, log: true, default: 10 },
    { name: "max_depth", type: "integer", min: 20, max: 60, default: 40 },
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

function run({ positions, indices }, configuration, rays) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(positions, 3));
  // The build orders the triangles anew, in place.
  geometry.setIndex(new BufferAttribute(indices.slice(), 1));
  globalThis.gc?.(); // with `node --expose-gc`: what earlier trees left is not cleared at this one's cost
  const start = now();
  const tree = new MeshBVH(geometry, {
    strategy: STRATEGIES[configuration.strategy], maxLeafTris: configuration.max_leaf, maxDepth: configuration.max_depth, verbose: false,
  });
  const built = now();
  const box = tree.getBoundingBox(geometry.boundingBox ?? (geometry.computeBoundingBox(), geometry.boundingBox)).clone();
  const center = box.getCenter(new Vector3());
  const random = generator(1);
  const ray = new Ray(center.clone(), new Vector3());
  let hits = 0;
  // A walk: each ray begins where the one before hit, as a path does.
  for (let each = 0; each < rays; each++) {
    ray.direction.set(random() - 0.5, random() - 0.5, random() - 0.5).normalize();
    const hit = tree.raycastFirst(ray, DoubleSide);
    if (hit) {
      hits += 1;
      ray.at(hit.distance * 0.999, ray.origin);
    } else ray.origin.copy(center);
  }
  return { build_ms: built - start, rays_ms: now() - built, hits };
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
      const { build_ms, rays_ms, hits } = run(mesh, one.configuration, rays);
      one.costs.push(build_ms + rays_ms);
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
    rays: { type: "string", default: "20000,500000" },
    rounds: { type: "string", default: "0" },
  },
});
const meshes = positionals.length > 0 ? positionals.map(readPly) : [generate("needles"), generate("field")];
const client = new Client(values.url, { clientId: "three-mesh-bvh-example", deadlineMs: 1000, software: { "three-mesh-bvh": "0.9" } });
const study = await client.study("three-mesh-bvh", spec);
for (const mesh of meshes) {
  run(mesh, FIXED[0], 20000); // compiles what is measured
  run(mesh, FIXED[5], 20000);
  for (const rays of values.rays.split(",").map(Number)) {
    const input = describe(mesh, rays);
    const costs = [];
    const measure = async (suggestion) => {
      const { build_ms, rays_ms } = run(mesh, suggestion.configuration, rays);
      suggestion.report({ build_ms, rays_ms });
      costs.push(build_ms + rays_ms);
    };
    // First what is known to be good somewhere, then the search, and in the last quarter the best so far and the best known setting in turns,
    // which tells merit from luck.
    const trials = Number(values.trials);
    for (const known of FIXED.slice(0, trials)) await measure(await study.trialOf(known, input));
    const bestKnown = FIXED[costs.indexOf(Math.min(...costs))];
    const pairs = Math.min(trials >> 3, (trials - costs.length) >> 1);
    for (let left = trials - costs.length - 2 * pairs; left > 0; left--) await measure(await study.suggest(input));
    for (let pair = 0; pair < pairs; pair++) {
      await client.flush(20000);
      await measure(await study.trialOf((await study.best(input)).configuration, input));
      await measure(await study.trialOf(bestKnown, input));
    }
    await client.flush(20000);
    const best = await study.best(input);
    const line = { scene: mesh.name, triangles: input.triangles, use: `${rays} rays`, trial_costs: costs, tuned: best.configuration };
    if (Number(values.rounds) > 0) Object.assign(line, compare(mesh, best.configuration, rays, Number(values.rounds)));
    console.log(JSON.stringify(line));
  }
}
client.close();
