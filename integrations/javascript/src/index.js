// Client SDK of the Treewright tuning service for Node. The wire contract is proto/treewright/v1; index.d.ts says what each thing promises.

import { existsSync } from "node:fs";
import { isIPv4 } from "node:net";
import { availableParallelism, cpus, hostname } from "node:os";
import { basename } from "node:path";
import { fileURLToPath } from "node:url";
import { threadId } from "node:worker_threads";

import * as grpc from "@grpc/grpc-js";
import { loadSync } from "@grpc/proto-loader";

import { Episode } from "./episode.js";
import { TreewrightError, refined } from "./error.js";
import { Front, FrontTrial, storedFront } from "./front.js";
import { Memory, costOf } from "./memory.js";
import { Outbox } from "./outbox.js";
import { bestFromWire, checkIndicators, checkStart, configurationFromWire, configurationToWire, defaultConfiguration, spaceToWire, specToWire, valueToWire } from "./wire.js";
import { takeWorker } from "./workers.js";

export { Front, FrontTrial, TreewrightError };

// Beside the package where it is installed, in the workspace where it is developed.
const PLACES = ["../proto", "../../../proto"].map((each) => fileURLToPath(new URL(each, import.meta.url)));
const PROTO = PLACES.find((each) => existsSync(`${each}/treewright/v1/tuning.proto`));
const Service = grpc.loadPackageDefinition(
  loadSync("treewright/v1/tuning.proto", { includeDirs: [PROTO], longs: String, enums: String, oneofs: true }),
).treewright.v1.TuningService;

/** The contract drops fields that it does not have, and words that it does not know, without a word. */
function checkPolicy(policy) {
  const { requestSerialize, requestDeserialize } = Service.service.CreateStudy;
  const given = Object.entries(policy);
  // What is 0 may not be sent either.
  const probe = Object.fromEntries(given.map(([name, value]) => [name, value === 0 ? 1 : value === false ? true : value]));
  const sent = requestDeserialize(requestSerialize({ study: { policy: probe } })).study?.policy ?? {};
  for (const [name, value] of given) {
    if (value === undefined || value === null || Object.hasOwn(sent, name)) continue;
    throw new TreewrightError("invalid", `policy: the wire contract has no field ${name} with the value ${value}; see message Policy in study.proto`);
  }
}

/** A later answer to a question that missed its deadline is awaited for so long, to give its trial back. */
const LATE_ANSWER_MS = 5000;

/** A daemon that is still loading the study is asked again after so long. */
const ASK_AGAIN_MS = 100;

const modeOf = (mode) => `${mode}`.replace("MODE_", "").toLowerCase();

/** By these rules the default is an answer; by others it is measured as a baseline. */
const SETTLED = ["EXPLOIT", "FINISHED", "FROZEN", "GAIN", "ROLLED_BACK", "SHADOW"].map((rule) => `RULE_${rule}`);

/** Whether an address of host and port is this machine. A name that only begins like it is not. */
const isLocal = (address) => {
  const host = address.replace(/:\d*$/, "");
  return host === "localhost" || host === "[::1]" || (isIPv4(host) && host.startsWith("127."));
};

export class Client {
  /** The contract as @grpc/grpc-js reads it, for tests. */
  static Service = Service;

  constructor(url = "http://127.0.0.1:50611", options = {}) {
    const found = /^(https?):\/\/([^/]+)\/?$/.exec(url);
    if (!found) throw new TreewrightError("invalid", `\`${url}\` is not an address of a daemon; write it like http://127.0.0.1:50611`);
    const [, scheme, host] = found;
    if (options.token && scheme === "http" && !isLocal(host))
      throw new TreewrightError("invalid", "a token is only sent over https, or to this machine");
    if (options.authority && scheme === "http")
      throw new TreewrightError("invalid", `an authority is only used with TLS, and ${url} has none: write https://${host}, or leave it out`);
    this.url = url;
    // Worker threads have a copy of this module each.
    const thread = threadId === 0 ? "" : `.${threadId}`;
    const name = `${basename(process.argv[1] ?? "node")}@${hostname()}-${process.pid}${thread}`;
    this.options = { clientId: name, deadlineMs: 50, callDeadlineMs: 5000, queue: 1024, ...options };
    if (options.certificate && scheme === "http")
      throw new TreewrightError("invalid", `a certificate is only shown over TLS, and ${url} is plain text: write https://${host}, or leave certificate and key out`);
    if (!options.certificate !== !options.key) throw new TreewrightError("invalid", "certificate and key go together: give both");
    const [authority, key, certificate] = ["authority", "key", "certificate"].map((each) => options[each] && Buffer.from(options[each]));
    const security = scheme === "https" ? grpc.credentials.createSsl(authority, key, certificate) : grpc.credentials.createInsecure();
    this.service = new Service(host, security, { "grpc.max_receive_message_length": 16 << 20 });
    this.stats = { suggestions: 0, fallbacks: 0, unreported: 0, acknowledged: 0, refused: 0, dropped: 0, queued: 0 };
    this.outbox = new Outbox(this.options.queue, this.stats);
    /** By study, for all of its handles: what the last trial has set up if it was measured to its end, whether one runs, and whether some ever ran side by side. */
    this.setUps = {};
    const model = cpus()[0]?.model ?? "";
    this.fingerprint = { cpuModel: model, threads: availableParallelism?.() ?? cpus().length, software: { node: process.version, ...options.software } };
  }

  /** One call of the service. */
  call(name, request, deadlineMs = this.options.callDeadlineMs) {
    const metadata = new grpc.Metadata();
    if (this.options.token) metadata.set("authorization", `Bearer ${this.options.token}`);
    return new Promise((resolve, reject) => {
      this.service[name](request, metadata, { deadline: Date.now() + deadlineMs }, (error, answer) =>
        error ? reject(refined(error, this.url, name)) : resolve(answer),
      );
    });
  }

  /** What `ask(deadlineMs)` brings; while the daemon says that it is still loading the study it is asked again, within the deadline of a call. */
  async untilReady(ask) {
    const end = Date.now() + this.options.callDeadlineMs;
    for (;;) {
      try {
        return await ask(Math.max(end - Date.now(), 1));
      } catch (error) {
        if (!error.passes || Date.now() + ASK_AGAIN_MS >= end) throw error;
        await new Promise((resolve) => setTimeout(resolve, ASK_AGAIN_MS));
      }
    }
  }

  async study(id, spec) {
    const request = { studyId: id, study: specToWire(spec) };
    checkPolicy(request.study.policy);
    const study = new Study(this, `studies/${id}`, spec, request);
    try {
      study.identify(await this.call("createStudy", request));
    } catch (error) {
      if (error.kind !== "unreachable") throw error;
      this.stats.lastError = error.message;
    }
    return study;
  }

  async changeSpace(id, space, { fixed = {}, onlyTry = false } = {}) {
    const asked = (name, request) => this.untilReady((deadlineMs) => this.call(name, request, deadlineMs));
    const study = await asked("getStudy", { name: `studies/${id}` });
    // The new space says which of the numbers are floats, or the one before.
    const isFloat = Object.fromEntries((study.space?.parameters ?? []).map(({ name, defaultValue }) => [name, defaultValue?.kind === "float"]));
    const { parameters, constraints } = spaceToWire(space);
    for (const { name, defaultValue } of parameters) isFloat[name] = "float" in defaultValue;
    const values = Object.entries(fixed).map(([name, value]) => [name, valueToWire(value, isFloat[name])]);
    const name = study.uid ? `${study.name}@${study.uid}` : study.name;
    const request = { name, revision: study.spaceRevision, space: { parameters, constraints }, fixed: Object.fromEntries(values), validateOnly: onlyTry };
    const answer = await asked("changeSpace", request);
    const count = (trials) => Number(trials ?? 0);
    return {
      revision: answer.study.spaceRevision, keptTrials: count(answer.keptTrials), outsideTrials: count(answer.outsideTrials),
      givenBackTrials: count(answer.givenBackTrials),
    };
  }

  async deleteStudy(id) {
    await this.call("deleteStudy", { name: `studies/${id}` });
  }

  async flush(deadlineMs = 5000) {
    await this.told(undefined, deadlineMs);
  }

  /** Waits until the reports of a worker, or of all, are acknowledged or refused; rejects after the deadline. */
  async told(worker, deadlineMs) {
    let timer;
    const late = new Promise((_, reject) => {
      const words = () => `${this.stats.queued} report(s) are not acknowledged after ${deadlineMs} ms: ${this.stats.lastError}`;
      timer = setTimeout(() => reject(new TreewrightError("unreachable", words())), deadlineMs);
    });
    try {
      await Promise.race([this.outbox.told(worker), late]);
    } finally {
      clearTimeout(timer);
    }
  }

  close() {
    this.outbox.close();
    this.service.close();
  }
}

export class Study {
  #memory;
  #start;
  #setUps;

  constructor(client, name, spec, request) {
    this.client = client;
    this.name = name;
    this.spec = spec;
    this.#memory = new Memory(spec);
    this.#setUps = client.setUps[name] ??= { done: undefined, isRunning: false, sideBySide: false };
    this.request = request;
    this.asked = name;
    this.created = false;
  }

  /** Asks from now on for the study that the daemon has created or found, whatever gets its name later. */
  identify(found) {
    const sorted = (names) => JSON.stringify([...(names ?? [])].sort());
    // A daemon that does not know the field drops it without a word.
    if (sorted(found.objective?.maximised) !== sorted(this.request.study.objective.maximised)) {
      throw new TreewrightError("invalid", "objective: the daemon knows no maximised metrics and would minimise them; upgrade it");
    }
    const limited = (objective) => sorted(objective?.limits?.map(({ metric }) => metric));
    if (limited(found.objective) !== limited(this.request.study.objective)) {
      throw new TreewrightError("invalid", "objective: the daemon knows no limits on measurements and would go without; upgrade it");
    }
    if ((found.objective?.episodeFrames ?? 0) !== this.request.study.objective.episodeFrames) {
      throw new TreewrightError("invalid", "objective: the daemon knows no trials of several frames; upgrade it");
    }
    this.displayName = found.displayName;
    this.asked = found.uid ? `${found.name}@${found.uid}` : this.name;
    // The daemon answers in the space that the program knows.
    this.spaceRevision = found.spaceRevision ?? 0;
    this.created = true;
  }

  /** Creates the study where that was not possible before. */
  async #create(deadlineMs) {
    if (!this.created) this.identify(await this.client.call("createStudy", this.request, deadlineMs));
  }

  /** The suggestion of a trial. One that cannot be run is given back. */
  #accept(trial, worker, indicators, wanted) {
    try {
      if (!trial.configuration) throw new TreewrightError("refused", `${trial.name} has no configuration`);
      const isSettled = trial.mode === "MODE_DEFAULT" && SETTLED.includes(trial.reason?.explanation?.rule);
      const isAnswer = wanted === undefined && (isSettled || ["MODE_EXPLOIT", "MODE_PINNED"].includes(trial.mode));
      return new Suggestion(this, worker, trial, configurationFromWire(trial.configuration), { indicators: { ...indicators }, isAnswer });
    } catch (error) {
      giveBack(this.client, trial.name, worker);
      throw error;
    }
  }

  async #ask(indicators, wanted, deadlineMs) {
    const end = Date.now() + deadlineMs;
    await this.#create(deadlineMs);
    const worker = takeWorker(this.client.url, this.client.options.clientId, this.name);
    try {
      await this.client.told(worker.name, Math.max(end - Date.now(), 1));
      const { fingerprint, options } = this.client;
      const fidelities = options.fidelities === true;
      const { asked: study, spaceRevision } = this;
      const request = { study, clientId: worker.name, indicators, fingerprint, wanted, fidelities, spaceRevision, start: this.#startToWire() };
      const trial = await this.client.call("suggest", request, Math.max(end - Date.now(), 1));
      return this.#accept(trial, worker, indicators, wanted);
    } catch (error) {
      worker.release();
      // It was deleted: it is created again before the next question.
      if (error.code === grpc.status.NOT_FOUND) this.created = false;
      throw error;
    }
  }

  async suggest(indicators = {}) {
    checkIndicators(indicators, this.spec);
    let timer;
    let late = false;
    const { deadlineMs } = this.client.options;
    const asked = this.#ask(indicators, undefined, Math.max(deadlineMs, LATE_ANSWER_MS));
    // What comes after the deadline is given back.
    asked.then((suggestion) => late && suggestion.abandon(), () => {});
    const expired = new Promise((_, reject) => {
      const problem = () => new TreewrightError("unreachable", `the daemon at ${this.client.url} did not answer within ${deadlineMs} ms`);
      timer = setTimeout(() => reject(problem()), deadlineMs);
    });
    try {
      const suggestion = await Promise.race([asked, expired]);
      this.client.stats.suggestions += 1;
      return suggestion.handOut();
    } catch (error) {
      late = true;
      this.client.stats.fallbacks += 1;
      this.client.stats.lastError = error.message;
      const lastGood = this.#memory.lastGood(indicators);
      const given = { indicators: { ...indicators }, isLastGood: lastGood !== undefined, problem: error };
      return new Suggestion(this, undefined, undefined, lastGood ?? { ...(this.#start ?? defaultConfiguration(this.spec)) }, given).handOut();
    } finally {
      clearTimeout(timer);
    }
  }

  tuner() {
    return new Tuner(this);
  }

  async trialOf(configuration, indicators = {}) {
    checkIndicators(indicators, this.spec);
    const wanted = configurationToWire(configuration, this.spec);
    return (await this.client.untilReady((deadlineMs) => this.#ask(indicators, wanted, deadlineMs))).handOut();
  }

  setStart(configuration) {
    if (configuration) checkStart(configuration, this.spec);
    this.#start = configuration && { ...configuration };
  }

  #startToWire() {
    return this.#start && configurationToWire(this.#start, this.spec);
  }

  /** What is known of these indicators. A study whose daemon was away at first is created before. */
  async #known(name, indicators) {
    return this.client.untilReady(async (deadlineMs) => {
      const end = Date.now() + deadlineMs;
      await this.#create(deadlineMs);
      const { asked: study, spaceRevision } = this;
      const request = { study, indicators, fingerprint: this.client.fingerprint, spaceRevision, start: this.#startToWire() };
      return this.client.call(name, request, Math.max(end - Date.now(), 1));
    });
  }

  async predict(indicators = {}) {
    checkIndicators(indicators, this.spec);
    const known = await this.#known("predict", indicators);
    const { configuration, predictedCost: cost, mode = "", reason } = known;
    return { configuration: configurationFromWire(configuration), cost, mode: modeOf(mode), reason: reason?.summary ?? "" };
  }

  async best(indicators = {}) {
    if (Object.keys(indicators).length > 0) checkIndicators(indicators, this.spec);
    const best = bestFromWire(await this.#known("getBest", indicators));
    const defaultValue = best.defaultCost === undefined ? undefined : this.value(best.defaultCost);
    // Where a metric is maximised, the highest cost stands for the lowest value.
    const ends = best.standing && [best.standing.costLow, best.standing.costHigh].map((cost) => this.value(cost)).sort((a, b) => a - b);
    return { ...best, value: this.value(best.cost), valueLow: ends?.[0], valueHigh: ends?.[1], defaultValue };
  }

  async front(query) {
    await this.client.untilReady((deadlineMs) => this.#create(deadlineMs));
    return storedFront(this.client, this.asked, query);
  }

  value(cost) {
    const { minimise = {}, maximise = {} } = this.spec;
    const [weight, ...more] = [...Object.values(maximise), ...Object.values(minimise)];
    return Object.keys(maximise).length === 1 && more.length === 0 ? weight / cost : cost;
  }

  /** A trial begins: whether what the one before has set up serves it. Of trials side by side nobody knows which loop asks. */
  beginSetUp(wanted) {
    const all = this.#setUps;
    all.sideBySide ||= all.isRunning;
    const isPrepared = !all.sideBySide && all.done === wanted;
    all.isRunning = true;
    return isPrepared;
  }

  /** It ends; well where it says what it has set up. */
  endSetUp(setUp) {
    this.#setUps.isRunning = false;
    this.#setUps.done = setUp;
  }

  /** Learns from a result what to fall back on. What is beyond a limit does not count as run. */
  learn({ indicators, isAnswer }, configuration, measurements, outcome) {
    if (outcome.aborted) return;
    const { limits = {} } = this.spec;
    const isBeyond = ([name, { atLeast = -Infinity, atMost = Infinity }]) =>
      measurements[name] < atLeast || measurements[name] > atMost;
    const runs = outcome.ok && !Object.entries(limits).some(isBeyond);
    this.#memory.note(indicators, configuration, isAnswer === true, runs ? costOf(this.spec, measurements) : undefined);
  }
}

/** Gives back the trial of a suggestion that was let go without a word. */
const forgotten = new FinalizationRegistry(({ client, trial, worker }) => giveBack(client, trial, worker));

function giveBack(client, trial, worker) {
  client.outbox.put(worker.name, "abandon", () => client.call("abandonTrial", { trial }));
  worker.release();
}

export class Suggestion {
  #study;
  #worker;
  #lease;
  #given;
  #episode;
  #open = true;
  /** The level and the values that need a set-up, as text, from when the program gets it. */
  #setUp;

  /** `given`: the indicators; of a trial, whether it `isAnswer`; of what was chosen without the daemon, `isLastGood` and the `problem`. */
  constructor(study, worker, trial, configuration, given) {
    this.#study = study;
    this.#worker = worker;
    this.#given = given;
    if (trial) forgotten.register(this, { client: study.client, trial: trial.name, worker }, this);
    this.configuration = configuration;
    this.source = trial ? "daemon" : given.isLastGood ? "last_good" : "default";
    this.trial = trial?.name;
    this.reason = trial?.reason?.summary ?? "";
    this.problem = given.problem?.message;
    this.predictedCost = trial?.predictedCost;
    this.#lease = trial && { abortAbove: trial.abortAbove, leaseExpireTime: trial.leaseExpireTime };
    this.fidelity = trial?.fidelity || undefined;
    this.isPrepared = false;
  }

  /** On its way to the program. */
  handOut() {
    const needing = this.#study.spec.parameters.filter(({ setup }) => setup);
    this.#setUp = JSON.stringify([this.fidelity, ...needing.map(({ name }) => this.configuration[name])]);
    this.isPrepared = this.#study.beginSetUp(this.#setUp);
    return this;
  }

  get abortAbove() {
    return this.#episode ? this.#episode.frameCap : this.#lease?.abortAbove;
  }

  /** For a frame loop: makes the trial one of several frames, where the study has such. */
  begin(indicators) {
    const { spec } = this.#study;
    if (spec.episodeFrames > 1 && this.#lease) this.#episode = new Episode(spec, { ...indicators }, this.#lease);
  }

  /** For a frame loop: whether the trial's next frame can be one of these indicators. Renews its lease where a third is over. */
  goesOn(indicators) {
    if (!this.#open || !this.#episode?.isIn(indicators)) return false;
    // No frame waits for it.
    if (this.#episode.renewalIsDue()) this.extendLease().catch((error) => (this.#study.client.stats.lastError = error.message));
    return true;
  }

  #end(measurements, outcome, standardErrors = {}) {
    if (!this.#open) throw new TreewrightError("invalid", "this trial is reported or given back already");
    this.#checkValues(measurements);
    this.#open = false;
    this.#study.endSetUp(outcome.ok && this.#setUp);
    const { client } = this.#study;
    // That the default ran is no news, and at a cheaper level nothing ran in full.
    if (this.source !== "default" && this.fidelity === undefined) this.#study.learn(this.#given, this.configuration, measurements, outcome);
    if (this.trial === undefined) {
      client.stats.unreported += 1;
      return;
    }
    const { trial } = this;
    forgotten.unregister(this);
    client.outbox.put(this.#worker.name, "report", () => client.call("report", { trial, measurements, outcome, standardErrors }));
    this.#worker.release();
  }

  async extendLease() {
    if (!this.#open) throw new TreewrightError("invalid", "this trial is reported or given back already");
    if (this.trial !== undefined) await this.#study.client.call("extendLease", { trial: this.trial });
  }

  /** For a frame loop: takes the frame's result, and ends the trial with its last frame. Returns whether there are more. */
  frame(measurements, standardErrors = {}) {
    const cost = this.#open ? this.#check(measurements) : undefined;
    if (this.#open) this.#checkErrors(measurements, standardErrors);
    const whole = { measurements, standardErrors, outcome: { ok: {} } };
    const result = this.#open && this.#episode ? this.#episode.push(measurements, cost, standardErrors) : whole;
    if (result) this.#end(result.measurements, result.outcome, result.standardErrors);
    else this.isPrepared = true;
    return result === undefined;
  }

  report(measurements, standardErrors) {
    if (this.frame(measurements, standardErrors)) this.#refuse("its trial has more frames; hand what was measured to the tuner's finish");
  }

  #refuse(problem) {
    this.abandon();
    throw new TreewrightError("invalid", problem);
  }

  #checkValues(measurements) {
    for (const [name, value] of Object.entries(measurements)) {
      if (Number.isFinite(value) && value >= 0) continue;
      this.#refuse(`measurement ${name} is ${value}; it must be finite and not negative`);
    }
  }

  #checkErrors(measurements, errors) {
    for (const [name, error] of Object.entries(errors)) {
      if (Object.hasOwn(measurements, name) && Number.isFinite(error) && error >= 0) continue;
      this.#refuse(`standard error of ${name} is ${error}; it must be finite, not negative, and of a measurement of the report`);
    }
  }

  /** The daemon would refuse these later, when nobody looks. Returns the cost; there is none beyond a limit. */
  #check(measurements) {
    this.#checkValues(measurements);
    const { minimise = {}, maximise = {} } = this.#study.spec;
    // Limits hold for full trials alone.
    const limits = (this.fidelity === undefined && this.#study.spec.limits) || {};
    for (const name of [minimise, maximise, limits].flatMap(Object.keys)) {
      if (Object.hasOwn(measurements, name)) continue;
      this.#refuse(`measurement ${name} is missing; the study's objective or a limit needs it`);
    }
    // What is beyond a limit is infeasible, whatever it costs.
    const isBeyond = ([name, { atLeast = -Infinity, atMost = Infinity }]) =>
      measurements[name] < atLeast || measurements[name] > atMost;
    if (Object.entries(limits).some(isBeyond)) return undefined;
    for (const [name, weight] of Object.entries(maximise)) {
      const value = measurements[name];
      if (!Number.isFinite(weight / value))
        this.#refuse(`measurement ${name} is ${value}; what is maximised must be above 0, since its reciprocal is the cost`);
    }
    const cost = costOf(this.#study.spec, measurements);
    if (!Number.isFinite(cost)) this.#refuse("the weighted sum of the measurements is not finite; use smaller measurements or weights");
    return cost;
  }

  aborted(lowerBound) {
    if (this.#open && !(Number.isFinite(lowerBound) && lowerBound >= 0))
      this.#refuse(`the lower bound is ${lowerBound}; it must be finite and not negative`);
    this.#end({}, { aborted: { lowerBound: this.#episode ? this.#episode.bound(lowerBound) : lowerBound } });
  }

  infeasible(reason) {
    this.#end({}, { infeasible: { reason: reason.slice(0, 1000) } });
  }

  failed(reason) {
    this.#end({}, { failed: { reason: reason.slice(0, 1000) } });
  }

  abandon() {
    if (!this.#open) return;
    this.#open = false;
    if (this.#setUp !== undefined) this.#study.endSetUp(undefined);
    if (this.trial === undefined) return;
    forgotten.unregister(this);
    giveBack(this.#study.client, this.trial, this.#worker);
  }
}

export class Tuner {
  #study;
  /** The suggestion whose trial has frames left. */
  #kept;

  constructor(study) {
    this.#study = study;
  }

  async next(indicators = {}) {
    checkIndicators(indicators, this.#study.spec);
    const kept = this.#kept;
    this.#kept = undefined;
    if (kept?.goesOn(indicators)) return kept;
    // The mean of its first frames would be wrong for costs that rise or fall.
    kept?.abandon();
    const suggestion = await this.#study.suggest(indicators);
    suggestion.begin(indicators);
    return suggestion;
  }

  finish(suggestion, measurements, standardErrors) {
    if (suggestion.frame(measurements, standardErrors)) this.#kept = suggestion;
  }
}
