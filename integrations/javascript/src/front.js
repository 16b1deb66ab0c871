// Pareto fronts: the directions of two or three metrics, the runs of each, and what they found. A front is a study whose indicator
// `direction` says how the metrics are weighed; model/src/front.rs and client/src/front.rs say why, and other languages do the same.

import { TreewrightError } from "./error.js";
import { configurationFromWire, defaultOfSpace } from "./wire.js";

/** The weights of the directions, the metrics themselves first. */
const WEIGHTS = {
  2: [[1, 0], [0, 1], [1 / 2, 1 / 2], [1 / 4, 3 / 4], [3 / 4, 1 / 4], [1 / 8, 7 / 8], [7 / 8, 1 / 8], [3 / 8, 5 / 8], [5 / 8, 3 / 8]],
  3: [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1 / 3, 1 / 3, 1 / 3], [3 / 7, 3 / 7, 1 / 7], [3 / 7, 1 / 7, 3 / 7], [1 / 7, 3 / 7, 3 / 7]],
};
/** Weight of the weighted sum beside the largest part, as in ParEGO. */
const AUGMENTATION = 0.05;
/** One run in this number minimises a metric itself. */
const FIRST_PART = 4;
/** Runs that a direction may have beyond its share of the planned ones. */
const SPARE = 8;
/** Most characters that are kept of a client's name in that of its carried trials. */
const CLIENT_CHARACTERS = 120;
const [DIRECTION, COST] = ["direction", "front_cost"];
/** The beginning of the display name of a study that is made for a front. */
const NAME = "front of ";

const wrong = (problem) => new TreewrightError("invalid", `metrics of a front: ${problem}`);

/** Whether a metric of this value can be weighed against others. */
const isUsable = (value) => value > 0 && Number.isFinite(value) && Number.isFinite(1 / value);

/** A trial as the service has stored it, with what a front wants to know of it. */
function recorded(trial) {
  const number = (name) => (name === undefined ? undefined : Number(name));
  // Such a trial is no run: it tells another direction of one. Without directions, it comes from another study.
  const origin = trial.indicators?.[DIRECTION] === undefined ? undefined : trial.origin;
  const repeats = number(/^studies\/.*\/(\d+)$/.exec(origin ?? "")?.[1]);
  const isMeasured = trial.outcome?.kind === "ok" && !trial.fidelity && !trial.exclusion;
  return { trial, number: number(/\/trials\/(\d+)$/.exec(trial.name)?.[1]), repeats, isMeasured, measurements: trial.measurements ?? {} };
}

/** The metrics of a front, and what follows from them alone. */
class Metrics {
  constructor(metrics) {
    if (!Array.isArray(metrics) || !(metrics.length in WEIGHTS)) throw wrong(`${metrics?.length ?? 0} of them; name two or three`);
    this.all = metrics.map((metric) => {
      const [, reciprocal, name] = /^(1\/)?([a-z][a-z0-9_]{0,63})$/.exec(metric) ?? [];
      if (name === undefined || name === COST) throw wrong(`\`${metric}\` is not the name of a measurement, or 1/ and a name`);
      return { name, isMaximised: reciprocal !== undefined };
    });
    this.names = this.all.map(({ name }) => name);
    const twice = this.names.find((name, place) => this.names.indexOf(name) !== place);
    if (twice !== undefined) throw wrong(`\`${twice}\` is named twice`);
    this.weights = WEIGHTS[metrics.length];
    this.studyName = NAME + metrics.join(", ");
  }

  /** The study of these metrics. */
  spec({ parameters, constraints, limits, policy = {} }) {
    // A race would be one of a single direction.
    const races = "confirm_rounds" in policy || "confirmRounds" in policy ? {} : { confirm_rounds: 0 };
    const indicators = { [DIRECTION]: [0, this.weights.length - 1] };
    return { displayName: this.studyName, parameters, constraints, limits, indicators, minimise: { [COST]: 1 }, policy: { ...policy, ...races } };
  }

  /** The metrics of a run, where all were measured and are above 0. */
  measured(measurements) {
    const values = this.names.map((name) => measurements[name]);
    return values.every(isUsable) ? values : undefined;
  }

  minimised(values) {
    return values.map((value, place) => (this.all[place].isMaximised ? 1 / value : value));
  }

  /** The cost of a run in a direction: the augmented Chebyshev norm of the logarithms beside the best known, as an exponential. */
  cost(direction, values, ideal) {
    if (direction < values.length) return values[direction];
    const parts = values.map((value, place) => this.weights[direction][place] * (Math.log(value) - Math.log(ideal[place])));
    return Math.exp(Math.max(...parts) + AUGMENTATION * parts.reduce((sum, part) => sum + part, 0));
  }
}

/** The metrics that a study of this display name was made for; none for any other name. */
function ofStudy(displayName = "") {
  try {
    return displayName.startsWith(NAME) ? new Metrics(displayName.slice(NAME.length).split(", ")) : undefined;
  } catch {
    return undefined;
  }
}

/** The trials of a front so far, and what follows from them. */
class History {
  #over = new Set();

  constructor(metrics, known, planned) {
    const trials = known.map(recorded);
    const excluded = new Set(trials.filter(({ trial }) => trial.exclusion).map(({ number }) => number));
    this.metrics = metrics;
    this.trials = trials.filter(({ trial, number, repeats }) => !trial.fidelity && !excluded.has(number) && !excluded.has(repeats));
    // Repeats that were excluded by themselves are not made again.
    this.spared = trials.filter(({ trial, repeats }) => trial.exclusion && repeats !== undefined);
    this.planned = planned;
    this.before = this.runs().length;
  }

  runs() {
    return this.trials.filter(({ repeats }) => repeats === undefined);
  }

  push(trial) {
    this.trials.push(recorded(trial));
  }

  end(direction) {
    this.#over.add(direction);
  }

  direction({ trial }) {
    const direction = Math.round(trial.indicators?.[DIRECTION]);
    return direction >= 0 && direction < this.metrics.weights.length ? direction : undefined;
  }

  /** The best of each metric in the runs before the first trial that needed it; none while only the metrics themselves are minimised. */
  ideal() {
    const extremes = this.metrics.names.length;
    const needing = this.trials.filter((one) => this.direction(one) >= extremes);
    const first = needing.reduce((first, { number }) => Math.min(first, number), Infinity);
    const wanted = Math.max(Math.floor(this.planned / FIRST_PART), 2);
    const areOver = this.metrics.names.every((_, direction) => this.#over.has(direction));
    if (first === Infinity && this.runs().length < wanted && !areOver) return undefined;
    const before = this.runs().filter(({ isMeasured, number }) => isMeasured && number < first);
    const known = before.map(({ measurements }) => this.metrics.measured(measurements)).filter((values) => values !== undefined);
    if (known.length === 0) return undefined;
    return known.map((values) => this.metrics.minimised(values)).reduce((best, one) => best.map((value, place) => Math.min(value, one[place])));
  }

  #directions(ideal) {
    return [...Array(ideal ? this.metrics.weights.length : this.metrics.names.length).keys()];
  }

  /** The direction of the next run: the one that had the fewest; none once all are over. */
  next() {
    const counts = new Map();
    for (const run of this.runs()) counts.set(this.direction(run), (counts.get(this.direction(run)) ?? 0) + 1);
    const count = (direction) => counts.get(direction) ?? 0;
    const left = this.#directions(this.ideal()).filter((direction) => !this.#over.has(direction));
    return left.sort((one, other) => count(one) - count(other) || one - other)[0];
  }

  /** The budget of each direction's search. */
  runsEach() {
    return Math.ceil((this.before + this.planned) / this.metrics.weights.length) + SPARE;
  }

  /** Measurements of a run with its cost in the direction of its trial. */
  withCost(trial, measurements) {
    const values = this.metrics.measured(measurements);
    if (values === undefined) {
      const name = this.metrics.names.find((each) => !isUsable(measurements[each]));
      throw new TreewrightError("invalid", `measurement \`${name}\` is ${measurements[name]}; a front needs it in every run, finite and above 0`);
    }
    return { ...measurements, [COST]: this.metrics.cost(this.direction(recorded(trial)), this.metrics.minimised(values), this.ideal()) };
  }

  /** The results to carry over, so that every direction knows of every run: questions, each with its report. They are not run. */
  owed() {
    const repeats = [...this.spared, ...this.trials.filter(({ repeats }) => repeats !== undefined)];
    const known = new Set(repeats.map((one) => `${one.repeats} ${this.direction(one)}`));
    const ideal = this.ideal();
    const owed = [];
    for (const run of this.runs()) {
      const { trial, number, measurements } = run;
      const { kind } = trial.outcome ?? {};
      const values = this.metrics.measured(measurements);
      // What else came of a run says nothing of its configuration.
      if (kind !== "infeasible" && !(kind === "ok" && values)) continue;
      for (const direction of this.#directions(ideal)) {
        if (direction === this.direction(run) || known.has(`${number} ${direction}`)) continue;
        const cost = kind === "ok" ? { [COST]: this.metrics.cost(direction, this.metrics.minimised(values), ideal) } : {};
        const question = {
          indicators: { ...trial.indicators, [DIRECTION]: direction },
          // Not the client that runs, whose visits stay as they are.
          clientId: `${Array.from(trial.clientId ?? "").slice(0, CLIENT_CHARACTERS).join("")}/front`,
          fingerprint: trial.fingerprint,
          wanted: trial.configuration,
          origin: trial.name,
        };
        owed.push([question, { ...measurements, ...cost }, trial.outcome]);
      }
    }
    return owed;
  }
}

function median(values) {
  const sorted = [...values].sort((one, other) => one - other);
  return (sorted[(sorted.length - 1) >> 1] + sorted[sorted.length >> 1]) / 2;
}

/** The volume of the unit cube between the points and its far corner, by slices across the last dimension. */
function hypervolume(points, dimensions) {
  const last = dimensions - 1;
  const sorted = [...points].sort((one, other) => one[last] - other[last]);
  let least = 1;
  const slice = (point, place) => {
    least = Math.min(least, point[0]);
    const behind = last === 1 ? 1 - least : hypervolume(sorted.slice(0, place + 1), last);
    return behind * ((sorted[place + 1]?.[last] ?? 1) - point[last]);
  };
  return sorted.map(slice).reduce((sum, volume) => sum + volume, 0);
}

const key = (configuration) => JSON.stringify(Object.entries(configuration).sort(([one], [other]) => (one < other ? -1 : 1)));

/** The front of recorded trials; the runs count that measured every metric. The reference is a value of each, or else the default's. */
function paretoFront(metrics, trials, defaults, reference) {
  const known = new Map();
  for (const { trial, repeats, isMeasured, measurements } of trials) {
    const values = metrics.measured(measurements);
    if (!isMeasured || repeats !== undefined || values === undefined) continue;
    const configuration = configurationFromWire(trial.configuration);
    const name = key(configuration);
    if (!known.has(name)) known.set(name, { configuration, runs: [] });
    known.get(name).runs.push(values);
  }
  const each = [...known].map(([name, { configuration, runs }]) => {
    const medians = metrics.names.map((_, place) => median(runs.map((values) => values[place])));
    return { name, configuration, runs: runs.length, medians, values: metrics.minimised(medians) };
  });
  const ofDefault = each.find(({ name }) => name === key(defaults));
  const named = (values) => Object.fromEntries(metrics.names.map((name, place) => [name, values[place]]));
  const point = ({ configuration, runs, medians }) => ({
    configuration, runs, metrics: named(medians), ratios: ofDefault && named(medians.map((value, place) => value / ofDefault.medians[place])),
  });
  // No other is as small everywhere and smaller somewhere.
  const beats = ({ values: one }, { values: other }) => one.every((value, place) => value <= other[place]) && one.some((value, place) => value < other[place]);
  const inOrder = (one, other) => one.values.map((value, place) => value - other.values[place]).find((difference) => difference !== 0) ?? 0;
  const [members, dominated] = [[], []];
  // What is dominated is so by one that comes earlier in this order and is itself not dominated; of two metrics, by the last of these.
  const rivals = () => (metrics.names.length === 2 ? members.slice(-1) : members);
  for (const one of each.sort(inOrder)) (rivals().some((other) => beats(other, one)) ? dominated : members).push(one);
  const given = reference ?? ofDefault?.medians;
  const ends = given && metrics.minimised(given);
  const shares = ({ values }) => values.map((value, place) => Math.min(value / ends[place], 1));
  return {
    metrics: metrics.names,
    maximised: metrics.all.filter(({ isMaximised }) => isMaximised).map(({ name }) => name),
    runs: each.reduce((sum, { runs }) => sum + runs, 0),
    configurations: each.length,
    default: ofDefault && point(ofDefault),
    points: members.map(point),
    dominated: dominated.map(point),
    hypervolume: ends && hypervolume(members.map(shares), metrics.names.length),
  };
}

const machine = ({ cpuModel = "", isa = "", threads = 0, software = {} } = {}) =>
  JSON.stringify([cpuModel, isa, threads, Object.entries(software).sort(([one], [other]) => (one < other ? -1 : 1))]);

export class Front {
  #client;
  #study;
  #history;
  #default;
  #left;
  /** What is under way: calls follow each other. */
  #turn = Promise.resolve();

  static async open(client, id, { metrics, trials = 80, ...definition }) {
    const front = new Front();
    const named = new Metrics(metrics);
    if (!(Number.isSafeInteger(trials) && trials >= 0)) throw new TreewrightError("invalid", `trials is ${trials}; give the number of planned runs`);
    const study = await client.study(id, named.spec(definition));
    if (!study.created) throw new TreewrightError("unreachable", client.stats.lastError);
    if (study.displayName !== named.studyName)
      throw new TreewrightError("invalid", `${study.name} is no ${named.studyName}, but \`${study.displayName}\`; give another id`);
    // Trials are read as they are in the present space, of which the program may know an earlier one.
    const { space: present } = await storedStudy(client, study.asked);
    const known = await allTrials(client, study.asked);
    // Costs of different machines are never mixed.
    const own = known.filter(({ fingerprint }) => machine(fingerprint) === machine(client.fingerprint));
    [front.#client, front.#study, front.#history, front.#left] = [client, study, new History(named, own, trials), trials];
    front.#default = defaultOfSpace(present);
    return front;
  }

  get metrics() {
    return [...this.#history.metrics.names];
  }

  #inTurn(work) {
    const done = this.#turn.then(work);
    this.#turn = done.catch(() => {});
    return done;
  }

  #call(name, request) {
    return this.#client.untilReady((deadlineMs) => this.#client.call(name, request, deadlineMs));
  }

  #ask(question) {
    return this.#call("suggest", { study: this.#study.asked, ...question });
  }

  async #tell(trial, measurements, outcome) {
    const stored = await this.#call("report", { trial: trial.name, measurements, outcome });
    this.#history.push(stored.trial);
  }

  /** Reports runs for the directions that do not know of them. None of these trials is a run. */
  async #carryOver() {
    for (const [question, measurements, outcome] of this.#history.owed()) await this.#tell(await this.#ask(question), measurements, outcome);
  }

  suggest() {
    return this.#inTurn(async () => {
      if (this.#left === 0) return undefined;
      await this.#carryOver();
      const { fingerprint, options: { clientId } } = this.#client;
      const { spaceRevision } = this.#study;
      for (let direction; (direction = this.#history.next()) !== undefined; this.#history.end(direction)) {
        const sessionPolicy = { epsilon: 1, trialsPerState: this.#history.runsEach() };
        const trial = await this.#ask({ clientId, indicators: { [DIRECTION]: direction }, fingerprint, sessionPolicy, spaceRevision });
        if (trial.reason?.explanation?.rule !== "RULE_FINISHED")
          return new FrontTrial(trial, (measurements, outcome) => this.#end(trial, measurements, outcome), () => this.#giveBack(trial));
        await this.#giveBack(trial);
      }
      return undefined;
    });
  }

  #giveBack(trial) {
    return this.#call("abandonTrial", { trial: trial.name });
  }

  #end(trial, measurements, outcome) {
    return this.#inTurn(async () => {
      await this.#tell(trial, outcome.ok ? this.#history.withCost(trial, measurements) : measurements, outcome);
      this.#left = Math.max(this.#left - 1, 0);
      // What fails here is done before the next question.
      await this.#carryOver().catch((error) => (this.#client.stats.lastError = error.message));
    });
  }

  found() {
    return paretoFront(this.#history.metrics, this.#history.trials, this.#default);
  }
}

export class FrontTrial {
  #end;
  #giveBack;
  #open = true;

  constructor(trial, end, giveBack) {
    this.trial = trial.name;
    this.configuration = configurationFromWire(trial.configuration);
    [this.#end, this.#giveBack] = [end, giveBack];
  }

  get isOpen() {
    return this.#open;
  }

  async #close(work) {
    if (!this.#open) throw new TreewrightError("invalid", "this trial is reported or given back already");
    this.#open = false;
    try {
      await work();
    } catch (error) {
      this.#open = true;
      throw error;
    }
  }

  report(measurements) {
    return this.#close(() => this.#end(measurements, { ok: {} }));
  }

  infeasible(reason) {
    return this.#close(() => this.#end({}, { infeasible: { reason: reason.slice(0, 1000) } }));
  }

  failed(reason) {
    return this.#close(() => this.#end({}, { failed: { reason: reason.slice(0, 1000) } }));
  }

  async abandon() {
    if (this.#open) await this.#close(this.#giveBack);
  }
}

/** The front of what a study has stored, whatever it minimises. */
export async function storedFront(client, name, { metrics, state, reference } = {}) {
  const study = await storedStudy(client, name);
  const wanted = metrics ? new Metrics(metrics) : ofStudy(study.displayName);
  if (wanted === undefined) throw wrong(`${study.name} was made for none; name two or three of its measurements`);
  if (reference !== undefined && !(reference.length === wanted.names.length && reference.every(isUsable)))
    throw new TreewrightError("invalid", "reference of a front: give one number above 0 for each metric");
  const [stateOf, machineOf] = [({ trial }) => Number(trial.stateId ?? 0), ({ trial }) => machine(trial.fingerprint)];
  const completed = (await allTrials(client, name)).map(recorded);
  if (state !== undefined && !completed.some((one) => stateOf(one) === state))
    throw new TreewrightError("invalid", `state: ${study.name} has no completed trial in state ${state}; each trial has its number`);
  const all = completed.filter(({ isMeasured }) => isMeasured);
  const hasInputs = (study.indicators ?? []).some((indicator) => indicator.name !== DIRECTION);
  const count = (of) => new Set(all.map(of)).size;
  if (state === undefined && (count(machineOf) > 1 || (hasInputs && count(stateOf) > 1))) {
    const where = `${count(stateOf)} states, on ${count(machineOf)} machine(s)`;
    throw new TreewrightError("invalid", `state: ${study.name} has runs in ${where}, which do not compare: name one state by its number`);
  }
  const chosen = all.find((one) => stateOf(one) === state);
  // The directions of a front are states of one machine, too.
  const isMeant = (one) => state === undefined || stateOf(one) === state || (!hasInputs && chosen && machineOf(one) === machineOf(chosen));
  return paretoFront(wanted, all.filter(isMeant), defaultOfSpace(study.space), reference);
}

function storedStudy(client, name) {
  return client.untilReady((deadlineMs) => client.call("getStudy", { name }, deadlineMs));
}

/** All completed trials of a study, as they are in its present space. Excluded ones are among them: what repeats them does not count either. */
async function allTrials(client, study) {
  const all = [];
  let pageToken = "";
  do {
    const request = { study, filter: "state = COMPLETED", pageSize: 1000, pageToken, inPresentSpace: true };
    const page = await client.untilReady((deadlineMs) => client.call("queryTrials", request, deadlineMs));
    all.push(...(page.trials ?? []));
    pageToken = page.nextPageToken ?? "";
  } while (pageToken !== "");
  return all;
}
