// Exercises the SDK against a running daemon: `node test/run.js URL`. Ends with `ok`.

import assert from "node:assert/strict";

import * as grpc from "@grpc/grpc-js";

// The package installed beside this file; in the checkout, the checkout itself.
import { Client, Front, TreewrightError } from "treewright";

const url = process.argv[2] ?? "http://127.0.0.1:50611";
const spec = {
  parameters: [
    { name: "leaf", type: "integer", min: 1, max: 32, log: true, default: 8 },
    { name: "split", type: "choice", values: ["sah", "median"], default: "sah" },
    { name: "cost", type: "float", min: 0.5, max: 4, default: 1, activeIf: { parameter: "split", anyOf: ["sah"] } },
    { name: "budget", type: "choice", values: [1.2, 2], default: 2 },
    { name: "compact", type: "boolean", default: false },
    { name: "block-size", type: "integer", min: 8, max: 72, step: 16, default: 24 },
  ],
  constraints: ["leaf % 4 == 0 or compact or split == 'median'", ["cost", "leaf"]],
  indicators: { triangles: [0, 1e8, "log"] },
  minimise: { ms: 1 },
  limits: { ms: { atLeast: 0, atMost: 30 } },
  policy: { epsilon: 0.5, confirm_rounds: 0 },
};
const parameters = [{ name: "level", type: "integer", min: 1, max: 9, default: 5 }];
const rejects = (promise, kind, words) =>
  assert.rejects(promise, (error) => error instanceof TreewrightError && error.kind === kind && error.message.includes(words));

async function trials() {
  const client = new Client(url, { clientId: "node-test", deadlineMs: 20000 });
  const study = await client.study("node", spec);
  const input = { triangles: 1000 };
  for (let each = 0; each < 40; each++) {
    const suggestion = await study.suggest(input);
    const { configuration } = suggestion;
    assert.equal(suggestion.source, "daemon", suggestion.problem);
    assert.equal("cost" in configuration, configuration.split === "sah");
    assert.equal(typeof configuration.compact, "boolean");
    assert.equal(configuration["block-size"] % 16, 8);
    assert.ok(configuration.leaf % 4 === 0 || configuration.compact || configuration.split === "median");
    assert.ok(configuration.cost === undefined || configuration.cost <= configuration.leaf);
    suggestion.report({ ms: 5 + Math.abs(configuration.leaf - 3) });
    assert.throws(() => suggestion.report({ ms: 1 }), /already/);
  }
  const own = await study.trialOf({ leaf: 3, split: "median", budget: 2, compact: false, "block-size": 24 }, input);
  own.report({ ms: 5 });
  const long = await study.suggest(input);
  await long.extendLease();
  long.abandon();
  await rejects(long.extendLease(), "invalid", "already");
  const wrong = await study.suggest(input);
  assert.throws(() => wrong.report({ ms: NaN }), /ms is NaN/);
  for (const bound of [NaN, -1, Infinity, undefined]) {
    const stopped = await study.suggest(input);
    assert.throws(() => stopped.aborted(bound), /lower bound is/);
    assert.throws(() => stopped.report({ ms: 1 }), /already/);
  }
  (await study.suggest(input)).failed("the lamp went out");
  await client.flush(20000);
  assert.ok(client.stats.acknowledged >= 42 && client.stats.dropped === 0, JSON.stringify(client.stats));
  const best = await study.best(input);
  assert.deepEqual([best.value, best.defaultValue], [best.cost, best.defaultCost]);
  assert.ok(best.cost >= 5 && best.cost <= 10 && best.measurements >= 1 && /^studies\/node@\w+\/trials\/\d+$/.test(best.trial), JSON.stringify(best));
  const { standing } = best;
  assert.ok(standing.costLow <= standing.cost && standing.cost <= standing.costHigh, JSON.stringify(best));
  assert.ok(standing.gain.share >= 0 && standing.gain.low <= standing.gain.share && standing.stage.length > 2, JSON.stringify(best));
  assert.deepEqual([best.valueLow, best.valueHigh], [standing.costLow, standing.costHigh]);
  assert.match(standing.status, /^(proven better|likely better|searching|confirming|open|nothing better|nothing to win)$/);
  assert.ok((await study.predict(input)).configuration.leaf >= 1);
  await rejects(study.trialOf({ leaf: 99 }, input), "refused", "leaf");
  await rejects(client.study("bad", { ...spec, minimise: {} }), "refused", "objective");
  const rate = await client.study("node-rate", { parameters, maximise: { fps: 1000 } });
  (await rate.suggest({})).report({ fps: 50 });
  for (const fps of [0, 1e-320]) {
    const still = await rate.suggest({});
    assert.throws(() => still.report({ fps }), new RegExp(`fps is ${fps};.* above 0`));
  }
  const other = await rate.suggest({});
  assert.throws(() => other.report({ ms: 1 }), /fps is missing/);
  await client.flush(20000);
  const fastest = await rate.best({});
  assert.deepEqual([fastest.cost, fastest.value, rate.value(10)], [20, 50, 100]);
  const ends = fastest.standing && [rate.value(fastest.standing.costHigh), rate.value(fastest.standing.costLow)];
  assert.deepEqual([fastest.valueLow, fastest.valueHigh], [ends?.[0], ends?.[1]]);
  const [tile, minimise] = [{ name: "tile", type: "integer", min: 16, max: 64, default: 32 }, { ms: 1 }];
  await client.study("node-steps", { parameters: [{ ...tile, step: 16 }], minimise });
  // As a program in another language spells it: it is the same study.
  await client.study("node-steps", { parameters: [tile], constraints: ["tile % 16 == 0"], minimise });
  for (const [ends, words] of [[{ min: 1.5 }, "min is 1.5"], [{ max: 64.25 }, "max is 64.25"], [{ max: "64" }, "max is 64"], [{ max: 2 ** 53 }, "max is 9007"]])
    await rejects(client.study("bad", { parameters: [{ ...tile, ...ends }], minimise }), "invalid", `parameter tile: ${words}`);
  const sum = await client.study("node-sum", { parameters, minimise: { ms: 1, mb: 1 } });
  const huge = await sum.suggest({});
  assert.throws(() => huge.report({ ms: 1e308, mb: 1e308 }), /sum of the measurements is not finite/);
  assert.throws(() => huge.report({ ms: 1, mb: 1 }), /already/);
  await rejects(client.study("bad", { ...spec, limits: { ms: {} } }), "refused", "at_most");
  await rejects(client.study("node", { ...spec, limits: { ms: { atMost: 31 } } }), "refused", "limit");
  await rejects(client.study("bad", { ...spec, constraints: ["leef < 3"] }), "refused", "did you mean");
  for (const [policy, words] of [[{ epsilonn: 0.1 }, "epsilonn"], [{ search: "random" }, "random"], [{ lease_seconds: 5 }, "leaseSeconds"]])
    await rejects(client.study("bad", { ...spec, policy }), "invalid", words);
  await rejects(client.study("bad", { ...spec, indicators: { triangles: [0, 1, "Log"] } }), "invalid", "Log is no scale");
  for (const wrong of [{ triangle: 1 }, { ...input, triangle: 1 }, {}, { triangles: NaN }])
    for (const ask of [() => study.suggest(wrong), () => study.trialOf(own.configuration, wrong), () => study.predict(wrong)])
      await rejects(ask(), "invalid", "triangle");
  await rejects(study.best({ triangle: 1 }), "invalid", "triangle");
  assert.equal(client.stats.fallbacks, 0);
  await client.deleteStudy("node");
  client.close();
}

/** Each suggestion that is open is a trial of its own, and who starts again is given those that it left. */
async function sideBySide() {
  const client = new Client(url, { clientId: "node-side", deadlineMs: 20000 });
  const definition = { ...spec, policy: { epsilon: 1, confirm_rounds: 0 } };
  const studies = [await client.study("node-side", definition), await client.study("node-side", definition)];
  const input = { triangles: 1000 };
  const trials = new Set();
  const loop = async (each) => {
    for (let frame = 0; frame < 10; frame++) {
      const suggestion = await studies[each % 2].suggest(input);
      assert.equal(suggestion.source, "daemon", suggestion.problem);
      trials.add(suggestion.trial);
      await new Promise((resolve) => setTimeout(resolve, 1));
      suggestion.report({ ms: 5 + Math.abs(suggestion.configuration.leaf - 3) });
    }
  };
  await Promise.all([0, 1, 2, 3].map(loop));
  assert.equal(trials.size, 40);
  const left = await Promise.all([0, 1, 2].map(() => studies[0].suggest(input)));
  assert.equal(new Set(left.map((each) => each.trial)).size, 3);
  await client.flush(20000);
  // As a program that ended without a word: its suggestions are nobody's any more.
  const again = new Client(`${url}/`, { clientId: "node-side", deadlineMs: 20000 });
  const study = await again.study("node-side", definition);
  const found = await Promise.all([0, 1, 2].map(() => study.suggest(input)));
  assert.deepEqual(new Set(found.map((each) => each.trial)), new Set(left.map((each) => each.trial)));
  for (const each of found) each.abandon();
  await again.flush(20000);
  await again.deleteStudy("node-side");
  again.close();
  client.close();
}

async function withoutDaemon() {
  const client = new Client("http://127.0.0.1:1", { callDeadlineMs: 500 });
  const study = await client.study("away", spec);
  const started = performance.now();
  const suggestion = await study.suggest({ triangles: 1 });
  assert.ok(performance.now() - started < 2000);
  assert.equal(suggestion.source, "default");
  assert.deepEqual(suggestion.configuration, { leaf: 8, split: "sah", cost: 1, budget: 2, compact: false, "block-size": 24 });
  const start = { leaf: 3, split: "median", budget: 2, compact: false, "block-size": 24 };
  study.setStart(start);
  assert.deepEqual((await study.suggest({ triangles: 1 })).configuration, start);
  study.setStart();
  const { leaf: _, ...partial } = start;
  for (const [wrong, words] of [
    [{ ...start, leef: 3 }, /no parameter leef/],
    [partial, /leaf is active here and has no value/],
    [{ ...start, cost: 2 }, /cost is not active/],
    [{ ...start, leaf: 64 }, /64 is no value of leaf/],
    [{ ...start, budget: 1.3 }, /1.3 is no value of budget/],
  ])
    assert.throws(() => study.setStart(wrong), words);
  await suggestion.extendLease();
  suggestion.report({ ms: 1 });
  assert.equal(client.stats.unreported, 1);
  await rejects(study.best(), "unreachable", "start one with");
  client.close();
  assert.throws(() => new Client("not an address"), /not an address/);
  assert.throws(() => new Client("http://localhost:1", { authority: "PEM" }), /only used with TLS.*https:\/\/localhost:1/);
  // Names that only begin like this machine are other machines.
  for (const host of ["example.com", "localhost.example.com", "127.example.com", "127.0.0.1.example.com", "localhost@example.com"])
    assert.throws(() => new Client(`http://${host}:1`, { token: "x" }), /https/, host);
  for (const alone of ["certificate", "key"]) assert.throws(() => new Client("https://localhost:1", { [alone]: "PEM" }), /go together/);
  assert.throws(() => new Client("http://localhost:1", { certificate: "PEM", key: "PEM" }), /only shown over TLS.*https:\/\/localhost:1/);
  for (const host of ["localhost", "127.0.0.1", "127.1.2.3", "[::1]"]) new Client(`http://${host}:1`, { token: "x" }).close();
}

/** A client of a daemon with these answers, and the end of both. All other studies and trials are of one level. */
async function served(handlers, options = {}) {
  const usual = {
    CreateStudy: ({ request: { studyId, study } }, answer) => answer(null, { name: `studies/${studyId}`, objective: study.objective }),
    Suggest: ({ request: { study } }, answer) =>
      answer(null, { name: `${study}/trials/1`, configuration: { values: { level: { integer: "5" } } } }),
    Report: (call, answer) => answer(null, {}),
    AbandonTrial: (call, answer) => answer(null, {}),
  };
  const server = new grpc.Server();
  server.addService(Client.Service.service, { ...usual, ...handlers });
  const bind = (resolve, reject) => (error, port) => (error ? reject(error) : resolve(port));
  const port = await new Promise((resolve, reject) =>
    server.bindAsync("127.0.0.1:0", grpc.ServerCredentials.createInsecure(), bind(resolve, reject)),
  );
  const client = new Client(`http://127.0.0.1:${port}`, { deadlineMs: 20000, callDeadlineMs: 20000, ...options });
  const end = () => {
    client.close();
    server.forceShutdown();
  };
  return { client, end };
}

/** A daemon that answers as if it were still loading the study, a given number of times. */
async function whileTheStudyIsLoaded(times) {
  const details = Buffer.from("\n(type.googleapis.com/google.rpc.RetryInfo", "latin1");
  let asked = 0;
  const onceLoaded = (reply) => (call, answer) => {
    asked += 1;
    if (asked > times) return answer(null, reply(call.request));
    const metadata = new grpc.Metadata();
    metadata.set("grpc-status-details-bin", details);
    answer({ code: grpc.status.UNAVAILABLE, details: "study \"loading\" is being loaded; try again", metadata });
  };
  const handlers = {
    Suggest: onceLoaded(({ wanted, study }) => ({ name: `${study}/trials/1`, configuration: wanted })),
    Predict: onceLoaded(() => ({
      configuration: { values: { leaf: { integer: "5" } } },
      predictedCost: 2.5,
      mode: "MODE_EXPLOIT",
      reason: { summary: "Predicted, not measured here" },
    })),
    GetBest: onceLoaded(() => ({ configuration: { values: { leaf: { integer: "6" } } }, cost: 1.5 })),
  };
  const { client, end } = await served(handlers);
  const study = await client.study("loading", spec);
  const own = await study.trialOf({ leaf: 3, split: "median", budget: 2, compact: false, "block-size": 24 }, { triangles: 1000 });
  assert.deepEqual([own.configuration.leaf, asked], [3, times + 1]);
  own.abandon();
  await client.flush(20000);
  for (const [ask, leaf, cost] of [[() => study.predict({ triangles: 1000 }), 5, 2.5], [() => study.best(), 6, 1.5]]) {
    asked = 0;
    const known = await ask();
    assert.deepEqual([known.configuration.leaf, known.cost, asked], [leaf, cost, times + 1]);
    if (leaf === 5) assert.deepEqual([known.mode, known.reason], ["exploit", "Predicted, not measured here"]);
  }
  client.options.callDeadlineMs = 300;
  [asked, times] = [0, Infinity];
  await rejects(study.trialOf({ leaf: 3, split: "median", budget: 2, compact: false, "block-size": 24 }, { triangles: 1000 }), "unreachable", "is being loaded");
  assert.ok(asked >= 1);
  end();
}

/** A loop keeps a trial for its frames without asking, and reports their means; it renews the lease meanwhile. */
async function inEpisodes() {
  const [reports, given, renewed] = [[], [], []];
  let asked = 0;
  const handlers = {
    Suggest: ({ request: { study } }, answer) => {
      asked += 1;
      // For a daemon whose clock is behind, a lease seems to have ended.
      const lease = { leaseExpireTime: { seconds: 1 } };
      answer(null, { name: `${study}/trials/${asked}`, ...lease, abortAbove: 10, configuration: { values: { level: { integer: "5" } } } });
    },
    ExtendLease: ({ request: { trial } }, answer) => {
      renewed.push(trial);
      answer(null, { name: trial });
    },
    Report: ({ request }, answer) => {
      reports.push(request);
      answer(null, {});
    },
    AbandonTrial: ({ request: { trial } }, answer) => {
      given.push(trial);
      answer(null, {});
    },
  };
  const { client, end } = await served(handlers);
  const indicators = { triangles: [0, 1e6, "log"] };
  const study = await client.study("long", { parameters, indicators, minimise: { ms: 1 }, episodeFrames: 5 });
  const [tuner, input] = [study.tuner(), { triangles: 1000 }];
  for (const ms of [20, 1, 3, 4, 4]) {
    const suggestion = await tuner.next(input);
    assert.equal(suggestion.trial, "studies/long/trials/1");
    tuner.finish(suggestion, { ms });
  }
  await client.flush(20000);
  assert.deepEqual([asked, reports[0].measurements], [1, { ms: 6.4, trend: 2 }]);
  // What makes the mean surely too high ends the trial.
  const dear = await tuner.next(input);
  assert.equal(dear.abortAbove, 50);
  tuner.finish(dear, { ms: 40 });
  assert.equal((await tuner.next({ triangles: 1010 })).abortAbove, 10);
  tuner.finish(dear, { ms: 15 });
  await client.flush(20000);
  assert.deepEqual([asked, reports[1].outcome.aborted.lowerBound], [2, 11]);
  // In another state it is given up, and one frame is not the trial.
  tuner.finish(await tuner.next(input), { ms: 1 });
  const other = await tuner.next({ triangles: 9 });
  assert.throws(() => other.report({ ms: 1 }), /its trial has more frames/);
  await client.flush(20000);
  assert.deepEqual([given, reports.length], [["studies/long/trials/3", "studies/long/trials/4"], 2]);
  // Beside its frames the lease is renewed.
  const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
  const slow = await tuner.next(input);
  await pause(300);
  tuner.finish(slow, { ms: 1 });
  assert.equal(await tuner.next(input), slow);
  for (let waited = 0; waited < 5000 && !renewed.includes(slow.trial); waited += 5) await pause(5);
  assert.ok(renewed.includes(slow.trial), JSON.stringify(renewed));
  slow.abandon();
  await client.flush(20000);
  for (const episodeFrames of [0, 1.5, 65])
    await rejects(client.study("long", { parameters, minimise: { ms: 1 }, episodeFrames }), "invalid", "give 1 to 64");
  end();
}

/** A daemon of before there were maximised metrics and limits: it drops the fields, and would minimise the rate. */
async function byAnOlderDaemon() {
  let [isThere, asked] = [true, 0];
  const away = { code: grpc.status.UNAVAILABLE, details: "it is not there yet" };
  const handlers = {
    CreateStudy: ({ request: { studyId, study } }, answer) => {
      if (!isThere) return answer(away);
      answer(null, { name: `studies/${studyId}`, objective: { terms: study.objective.terms } });
    },
    Suggest: ({ request: { study } }, answer) => {
      asked += 1;
      answer(null, { name: `${study}/trials/1`, configuration: { values: { level: { integer: "5" } } } });
    },
  };
  const { client, end } = await served(handlers);
  const rate = { parameters, maximise: { fps: 1000 } };
  await rejects(client.study("rate", rate), "invalid", "knows no maximised metrics");
  const limited = { parameters, minimise: { ms: 1 }, limits: { mb: { atMost: 99 } } };
  await rejects(client.study("limited", limited), "invalid", "knows no limits on measurements");
  const long = { parameters, minimise: { ms: 1 }, episodeFrames: 24 };
  await rejects(client.study("long", long), "invalid", "knows no trials of several frames");
  const plain = await client.study("plain", { parameters, minimise: { ms: 1 } });
  const suggestion = await plain.suggest({});
  assert.deepEqual([suggestion.source, asked], ["daemon", 1], suggestion.problem);
  suggestion.abandon();
  // One that is away at first is asked nothing either, and the default stands in for it.
  isThere = false;
  const later = await client.study("rate", rate);
  isThere = true;
  const fallback = await later.suggest({});
  assert.deepEqual([fallback.source, fallback.configuration, asked], ["default", { level: 5 }, 1]);
  assert.match(fallback.problem, /knows no maximised metrics/);
  await client.flush(20000);
  end();
}

/** A daemon with a defect: what it never takes is given up, and does not hold up what comes after it. */
async function byADefectiveDaemon() {
  let reports = 0;
  const handlers = {
    Report: (call, answer) => {
      reports += 1;
      answer({ code: grpc.status.UNKNOWN, details: "it stumbled" });
    },
    AbandonTrial: (call, answer) => answer({ code: grpc.status.NOT_FOUND, details: "there is no such trial" }),
  };
  const { client, end } = await served(handlers);
  const study = await client.study("defect", { parameters, minimise: { ms: 1 } });
  const [reported, abandoned] = [await study.suggest(), await study.suggest()];
  reported.report({ ms: 1 });
  abandoned.abandon();
  await client.flush(60000);
  assert.deepEqual([reports, client.stats.refused, client.stats.queued], [8, 1, 0], JSON.stringify(client.stats));
  end();
}

/** Every report counts once, also where the queue is full and where the client is closed. */
async function closedWhileReportsWait() {
  const answers = [];
  const { client, end } = await served({ Report: (call, answer) => answers.push(answer) }, { queue: 1 });
  const study = await client.study("closed", { parameters, minimise: { ms: 1 } });
  const suggestions = [await study.suggest(), await study.suggest(), await study.suggest()];
  const counts = () => [client.stats.acknowledged, client.stats.refused, client.stats.dropped, client.stats.queued];
  const expected = [[0, 0, 0, 1], [0, 0, 0, 2], [0, 0, 1, 2]];
  for (const suggestion of suggestions) {
    suggestion.report({ ms: 1 });
    assert.deepEqual(counts(), expected.shift());
  }
  while (answers.length === 0) await new Promise((resolve) => setTimeout(resolve, 5));
  client.close();
  assert.deepEqual(counts(), [0, 0, 3, 0]);
  answers[0](null, {});
  await new Promise((resolve) => setTimeout(resolve, 200));
  assert.deepEqual([...counts(), answers.length], [0, 0, 3, 0, 1]);
  end();
}

/** A daemon that takes no reports, and one that comes late: calls end within their deadline, and the study is created then. */
async function byADaemonThatComesLate() {
  let isThere = false;
  const away = { code: grpc.status.UNAVAILABLE, details: "it is not there yet" };
  const handlers = {
    CreateStudy: (call, answer) => (isThere ? answer(null, { name: "studies/late" }) : answer(away)),
    Report: (call, answer) => answer(away),
    Predict: (call, answer) => answer(null, { configuration: { values: { level: { integer: "6" } } } }),
    GetBest: (call, answer) => answer(null, { configuration: { values: { level: { integer: "7" } } }, cost: 1.5 }),
  };
  const { client, end } = await served(handlers, { callDeadlineMs: 2000 });
  const [one, other] = [await client.study("late", { parameters, minimise: { ms: 1 } }), await client.study("late", { parameters, minimise: { ms: 1 } })];
  isThere = true;
  assert.equal((await one.predict()).configuration.level, 6);
  assert.equal((await other.best()).configuration.level, 7);
  assert.ok(one.created && other.created);
  (await one.suggest()).report({ ms: 1 });
  // Its worker has a report that cannot be sent.
  const started = performance.now();
  await rejects(one.trialOf({ level: 3 }), "unreachable", "not acknowledged");
  assert.ok(performance.now() - started < 10000);
  end();
}

/** A newer daemon: a trial that this version cannot read is nothing to run, and given back. */
async function byANewerDaemon() {
  const [unreadable, given] = [[{ values: { level: {} } }, undefined], []];
  const handlers = {
    Suggest: ({ request: { study } }, answer) =>
      answer(null, { name: `${study}/trials/${unreadable.length}`, configuration: unreadable.shift() }),
    AbandonTrial: ({ request: { trial } }, answer) => {
      given.push(trial);
      answer(null, {});
    },
  };
  const { client, end } = await served(handlers);
  const study = await client.study("newer", { parameters, minimise: { ms: 1 } });
  for (const problem of [/unknown kind/, /has no configuration/]) {
    const suggestion = await study.suggest();
    assert.deepEqual([suggestion.source, suggestion.configuration], ["default", { level: 5 }]);
    assert.match(suggestion.problem, problem);
  }
  await client.flush(20000);
  assert.deepEqual(given, ["studies/newer/trials/2", "studies/newer/trials/1"]);
  end();
}

/** A program of before goes on in the space that it knows, and one of today gets the new parameter. */
async function acrossAChangeOfTheSpace() {
  const client = new Client(url, { clientId: "node-space", deadlineMs: 20000 });
  const before = await client.study("node-space", { parameters, minimise: { ms: 1 } });
  const first = await before.suggest();
  first.report({ ms: 5 });
  await client.flush(20000);
  const threads = { name: "threads", type: "integer", min: 1, max: 4, default: 2 };
  const wider = { parameters: [...parameters, threads] };
  const told = { keptTrials: 1, outsideTrials: 0, givenBackTrials: 0 };
  assert.deepEqual(await client.changeSpace("node-space", wider, { onlyTry: true }), { revision: 1, ...told });
  assert.deepEqual(await client.changeSpace("node-space", wider, { fixed: { threads: 3 } }), { revision: 2, ...told });
  await rejects(client.changeSpace("nowhere", wider), "refused", "nowhere");
  const after = await client.study("node-space", { ...wider, minimise: { ms: 1 } });
  assert.deepEqual((await after.best()).configuration, { ...first.configuration, threads: 3 });
  assert.deepEqual((await before.best()).configuration, first.configuration);
  for (const [study, names] of [[before, ["level"]], [after, ["level", "threads"]]]) {
    const suggestion = await study.suggest();
    assert.deepEqual([suggestion.source, Object.keys(suggestion.configuration).sort()], ["daemon", names], suggestion.problem);
    suggestion.report({ ms: 4 });
    await client.flush(20000);
  }
  await client.deleteStudy("node-space");
  client.close();
}

/** Two metrics at once: the runs, what is refused, and what was found. */
async function fronts() {
  const client = new Client(url, { clientId: "node-front", deadlineMs: 20000, callDeadlineMs: 20000 });
  const parameters = [{ name: "level", type: "integer", min: 1, max: 50, default: 25 }];
  const definition = { parameters, metrics: ["time_ms", "1/rate"], trials: 10 };
  const front = await Front.open(client, "node-front", definition);
  assert.deepEqual(front.metrics, ["time_ms", "rate"]);
  const [one, same] = await Promise.all([front.suggest(), front.suggest()]);
  assert.equal(one.trial, same.trial);
  for (const rate of [undefined, 0, Infinity]) await rejects(one.report({ time_ms: 1, rate }), "invalid", "measurement `rate`");
  assert.ok(one.isOpen);
  let ran = 0;
  for (let trial; (trial = await front.suggest()); ran++) {
    const { level } = trial.configuration;
    await trial.report({ time_ms: 100 / level, rate: 1000 / level ** 2 });
    await rejects(trial.report({ time_ms: 1, rate: 1 }), "invalid", "already");
  }
  assert.equal(ran, 10);
  const failed = await (await Front.open(client, "node-front", { ...definition, trials: 1 })).suggest();
  await failed.failed("the lamp went out");
  await failed.abandon();
  const again = async () => (await Front.open(client, "node-front", { ...definition, trials: 0 })).found();
  const found = await again();
  assert.deepEqual(found, front.found());
  assert.deepEqual([found.runs, found.maximised, found.dominated.length], [10, ["rate"], 0], JSON.stringify(found));
  const times = found.points.map(({ metrics }) => metrics.time_ms);
  assert.deepEqual([times, found.default.ratios.rate], [[...times].sort((a, b) => a - b), 1]);
  assert.ok(found.hypervolume >= 0 && found.hypervolume <= 1);
  // Every client of the study reads this.
  const study = await client.study("node-front", { parameters, indicators: { direction: [0, 8] }, minimise: { front_cost: 1 } });
  assert.deepEqual([await study.front(), await study.front({ metrics: definition.metrics })], [found, found]);
  assert.equal((await study.front({ reference: [1e-9, 1e9] })).hypervolume, 0);
  await rejects(study.front({ reference: [1] }), "invalid", "for each metric");
  // A repeat that is excluded by itself is not made again.
  const request = { study: "studies/node-front", filter: "state = COMPLETED", pageSize: 1000 };
  const repeats = async () => (await client.call("queryTrials", request)).trials.filter(({ origin }) => origin);
  const before = await repeats();
  const repeat = before.find(({ indicators }) => indicators.direction < 2);
  await client.call("excludeTrial", { trial: repeat.name, reason: "the machine was busy" });
  await (await (await Front.open(client, "node-front", { ...definition, trials: 1 })).suggest()).abandon();
  assert.equal((await repeats()).length, before.length);
  // An excluded run counts nowhere, nor does what repeats it for other directions.
  await client.call("excludeTrial", { trial: one.trial, reason: "the machine was busy" });
  const rest = await again();
  assert.deepEqual([rest.runs, rest.points.length <= found.points.length], [9, true], JSON.stringify(rest));
  for (const [metrics, words] of [[["time_ms"], "two or three"], [["time_ms", "time_ms"], "twice"], [["time_ms", "memory_mb"], "is no front of"]])
    await rejects(Front.open(client, "node-front", { ...definition, metrics }), "invalid", words);
  await client.deleteStudy("node-front");
  client.close();
}

/** What is stored counts where it is a full run of one machine, and the volume is exact. */
async function frontsOfStoredTrials() {
  const trial = (number, level, time_ms, mb, more) => ({
    name: `studies/box/trials/${number}`, stateId: 1, configuration: { values: { level: { integer: level } } },
    measurements: { time_ms, mb }, outcome: { ok: {} }, ...more,
  });
  const trials = [
    trial(1, 5, 4, 4), trial(2, 1, 1, 2), trial(3, 2, 2, 1), trial(4, 3, 3, 3), trial(5, 2, 4, 3), trial(6, 2, 2, 1),
    trial(7, 4, 0.5, 0.5, { fidelity: "small" }), trial(9, 4, 0.1, 0.1, { exclusion: "the machine was busy" }),
    trial(8, 4, 0.1, 0.1, { origin: "studies/box@1/trials/2", indicators: { direction: 0 } }),
  ];
  const space = { parameters: [{ name: "level", integer: { min: 1, max: 9 }, defaultValue: { integer: 5 } }] };
  const box = { name: "studies/box", space };
  let perPage = 3;
  const handlers = {
    CreateStudy: (call, answer) => answer(null, box),
    GetStudy: (call, answer) => answer(null, box),
    QueryTrials: ({ request: { pageToken } }, answer) => {
      const end = Number(pageToken || 0) + perPage;
      answer(null, { trials: trials.slice(end - perPage, end), nextPageToken: end < trials.length ? `${end}` : "" });
    },
  };
  const { client, end } = await served(handlers);
  const study = await client.study("box", { parameters, minimise: { time_ms: 1 } });
  for (box.displayName of [undefined, "a box", "front of the house, its back"]) await rejects(study.front(), "invalid", "was made for none");
  box.displayName = "front of time_ms, mb";
  const found = await study.front();
  const levels = (points) => points.map(({ configuration }) => configuration.level);
  assert.deepEqual([found.runs, levels(found.points), levels(found.dominated)], [6, [1, 2], [3, 5]]);
  assert.deepEqual([found.points[0].ratios, found.points[1].runs, found.points[1].metrics], [{ time_ms: 0.25, mb: 0.5 }, 3, { time_ms: 2, mb: 1 }]);
  assert.equal(found.hypervolume, 0.5);
  // The same with the reciprocal of a third metric that all have in common: a box of half the height.
  for (const each of trials) each.measurements.rate = 4;
  const three = await study.front({ metrics: ["time_ms", "mb", "1/rate"], reference: [4, 4, 2] });
  assert.deepEqual([levels(three.points), three.hypervolume], [[1, 2], 0.25]);
  trials[3].fingerprint = { cpuModel: "another" };
  await rejects(study.front(), "invalid", "on 2 machine(s)");
  assert.equal((await study.front({ state: 1 })).runs, 6);
  for (const state of [9, null]) await rejects(study.front({ state }), "invalid", `no completed trial in state ${state}`);
  // Where there are no directions, it was carried over from another study of the database.
  trials.push(trial(10, 1, 1, 2, { origin: "studies/other/trials/1" }));
  assert.equal((await study.front({ state: 1 })).runs, 7);
  // Many trials, none of them dominated: the program does not stand still for seconds.
  const all = [...Array(20000).keys()].map((each) => each + 1);
  trials.splice(0, trials.length, ...all.map((each) => trial(each, each, each / 20000, 1 / each)));
  perPage = 1000;
  const started = performance.now();
  const large = await study.front({ reference: [1, 1] });
  const staircase = all.slice(1).reduce((sum, each) => sum + (1 - 1 / (each - 1)) / 20000, 0);
  assert.ok(large.points.length === 20000 && Math.abs(large.hypervolume - staircase) < 1e-9, `${large.hypervolume} and ${staircase}`);
  assert.ok(performance.now() - started < 5000);
  end();
}

/** A program that knows an earlier space still has the default beside its front, as it is in the present one. */
async function aFrontOfAnEarlierSpace() {
  const [level, threads] = ["level", "threads"].map((name) => ({ name, integer: { min: 1, max: 9 }, defaultValue: { integer: 5 } }));
  const wider = { name: "studies/wider", displayName: "front of time_ms, mb", space: { parameters: [level, threads] } };
  const trial = (number, level, time_ms) => ({
    name: `studies/wider/trials/${number}`, configuration: { values: { level: { integer: level }, threads: { integer: 5 } } },
    indicators: { direction: 0 }, measurements: { time_ms, mb: 4 }, outcome: { ok: {} }, fingerprint: client.fingerprint,
  });
  const handlers = {
    CreateStudy: (call, answer) => answer(null, { ...wider, space: { parameters: [level] }, spaceRevision: 1 }),
    GetStudy: (call, answer) => answer(null, { ...wider, spaceRevision: 2 }),
    QueryTrials: (call, answer) => answer(null, { trials: [trial(1, 5, 4), trial(2, 1, 2)] }),
  };
  const { client, end } = await served(handlers);
  const found = (await Front.open(client, "wider", { parameters, metrics: ["time_ms", "mb"], trials: 0 })).found();
  assert.deepEqual([found.default?.configuration, found.points[0].ratios?.time_ms], [{ level: 5, threads: 5 }, 0.5]);
  end();
}

/** The best has the status that every other surface has, and the ends of a rate's interval in their order. */
async function statuses() {
  let standing;
  const handlers = {
    GetBest: (call, answer) => answer(null, { configuration: { values: { level: { integer: "7" } } }, cost: 4, standing }),
  };
  const { client, end } = await served(handlers);
  const study = await client.study("statuses", { parameters, maximise: { fps: 1000 } });
  const gain = (probabilityBetter) => (probabilityBetter === undefined ? undefined : { share: 0.12, low: 0.1, high: 0.14, probabilityBetter });
  for (const [stage, byAll, byRounds, gainAtMost, status] of [
    ["BETTER", 0.999, 0.995, 0.03, "proven better"],
    ["BETTER", 0.999, 0.97, 0.03, "likely better"],
    ["SEARCHING", 0.79, undefined, 0.03, "searching"],
    ["RACING", 0.9, 0.995, 0.03, "confirming"],
    ["NOTHING_BETTER", 0.31, undefined, 0.03, "nothing better"],
    ["NOTHING_BETTER", 0, undefined, 0.01, "nothing to win"],
    ["OFF", undefined, undefined, undefined, "open"],
  ]) {
    const confirmation = { stage: `CONFIRMATION_STAGE_${stage}`, gain: gain(byRounds) };
    standing = { cost: 4, costLow: 2, costHigh: 5, gain: gain(byAll), gainAtMost, confirmation };
    const best = await study.best();
    assert.deepEqual([best.standing.status, best.standing.stage, best.valueLow, best.valueHigh], [status, stage.toLowerCase(), 200, 500]);
  }
  standing = undefined;
  assert.equal((await study.best()).valueLow, undefined);
  end();
}

/** While the daemon is away, what ran here is run again: its latest answer, else the cheapest; not what nobody ran or what failed. */
async function fallingBack() {
  const levels = ["3", "4", "2", "4", "6", "7", "8", "1", "9"].flatMap((level) => [level, undefined]);
  let asked = 0;
  const handlers = {
    Suggest: ({ request: { study } }, answer) => {
      const level = levels[asked++];
      if (level === undefined) return answer({ code: grpc.status.UNAVAILABLE, details: "it is away" });
      const configuration = { values: { level: { integer: level } } };
      const mode = level === "8" ? "MODE_EXPLOIT" : "MODE_EXPLORE";
      answer(null, { name: `${study}/trials/${asked}`, configuration, mode, fidelity: level === "2" ? "small" : "" });
    },
  };
  const { client, end } = await served(handlers);
  const prepared = { parameters: [{ ...parameters[0], setup: true }], indicators: { size: [0, 100] } };
  const study = await client.study("fallbacks", { ...prepared, minimise: { ms: 1 } });
  const ends = [
    ["default", 5, [false, false], (suggestion) => suggestion.abandon()],
    ["last_good", 4, [false, true], (suggestion) => suggestion.report({ ms: 1 })],
    // At a cheaper level it did not run in full.
    ["last_good", 4, [false, false], (suggestion) => suggestion.report({ ms: 1 })],
    ["default", 5, [true, false], (suggestion) => suggestion.infeasible("it ran once")],
    ["last_good", 6, [false, true], (suggestion) => suggestion.report({ ms: 9 })],
    // The search tried something dearer last.
    ["last_good", 6, [false, false], (suggestion) => suggestion.report({ ms: 20 })],
    // The daemon knows more than this client.
    ["last_good", 8, [false, true], (suggestion) => suggestion.report({ ms: 30 })],
    ["last_good", 8, [false, false], (suggestion) => suggestion.report({ ms: 1 })],
    // In another state, where nothing ran.
    ["last_good", 8, [false, false], (suggestion) => suggestion.abandon(), 90],
  ];
  for (const [source, level, prepared, end, size = 10] of ends) {
    const suggestion = await study.suggest({ size });
    assert.equal(suggestion.source, "daemon", suggestion.problem);
    end(suggestion);
    const fallback = await study.suggest({ size });
    assert.deepEqual([fallback.source, fallback.configuration], [source, { level }]);
    assert.deepEqual([suggestion.isPrepared, fallback.isPrepared], prepared);
    fallback.report({ ms: 2 });
  }
  // Another handle of the study sets up something else.
  const other = await client.study("fallbacks", study.spec);
  for (const [handle, level] of [[other, 5], [study, 8]]) {
    const fallback = await handle.suggest({ size: 10 });
    assert.deepEqual([fallback.configuration, fallback.isPrepared], [{ level }, false]);
    fallback.report({ ms: 2 });
  }
  await client.flush(20000);
  end();
}

// Its pauses take some seconds, in which the others run.
const defective = byADefectiveDaemon();
await trials();
await sideBySide();
await inEpisodes();
await acrossAChangeOfTheSpace();
await fronts();
await frontsOfStoredTrials();
await aFrontOfAnEarlierSpace();
await statuses();
await byAnOlderDaemon();
await byANewerDaemon();
await fallingBack();
await whileTheStudyIsLoaded(3);
await byADaemonThatComesLate();
await closedWhileReportsWait();
await withoutDaemon();
await defective;
console.log("ok");
