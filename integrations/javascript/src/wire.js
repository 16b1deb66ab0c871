// Between plain JavaScript and the messages of proto/treewright/v1.

import { TreewrightError } from "./error.js";

export function valueToWire(value, float = false) {
  if (typeof value === "boolean") return { boolean: value };
  if (typeof value === "string") return { text: value };
  if (typeof value !== "number" || !Number.isFinite(value))
    throw new TreewrightError("invalid", `${value} is no value of a parameter; use a boolean, a finite number or text`);
  return float || !Number.isInteger(value) ? { float: value } : { integer: value };
}

export function configurationFromWire(message) {
  const plain = {};
  for (const [name, value] of Object.entries(message?.values ?? {})) {
    if (value.kind === undefined) throw new TreewrightError("refused", `${name} has a value of an unknown kind`);
    plain[name] = value.kind === "integer" ? Number(value.integer) : value[value.kind];
  }
  return plain;
}

const isFloat = (parameter) =>
  parameter.type === "float" ||
  (parameter.type === "choice" && parameter.values.some((each) => typeof each === "number" && !Number.isInteger(each)));

/** JavaScript has one kind of number; the space says which of them are floats. */
export function configurationToWire(configuration, spec) {
  const values = {};
  for (const [name, value] of Object.entries(configuration)) {
    const parameter = spec.parameters.find((each) => each.name === name);
    values[name] = valueToWire(value, parameter !== undefined && isFloat(parameter));
  }
  return { values };
}

/** The contract cuts fractions off without a word. */
function checkWhole(parameter, ends) {
  for (const [end, value] of Object.entries(ends)) {
    if (Number.isSafeInteger(value)) continue;
    throw new TreewrightError("invalid", `parameter ${parameter}: ${end} is ${value}; the ends of an integer are whole numbers below 2^53`);
  }
}

function parameterToWire(parameter, all) {
  const { name, type, min, max } = parameter;
  const scale = parameter.log ? "SCALE_LOG" : "SCALE_LINEAR";
  const float = isFloat(parameter);
  const message = { name, defaultValue: valueToWire(parameter.default, float) };
  if (type === "integer") {
    checkWhole(name, { min, max });
    message.integer = { min, max, scale };
  } else if (type === "float") message.float = { min, max, scale };
  else if (type === "boolean") message.boolean = {};
  else if (type === "choice")
    message.categorical = { values: parameter.values.map((value) => valueToWire(value, float)) };
  else throw new TreewrightError("invalid", `parameter ${name} has type ${type}; use integer, float, boolean or choice`);
  if (parameter.setup) message.setup = true;
  if (parameter.activeIf) {
    const other = all.find((each) => each.name === parameter.activeIf.parameter);
    const anyOf = parameter.activeIf.anyOf.map((value) => valueToWire(value, other !== undefined && isFloat(other)));
    message.activeIf = { parameter: parameter.activeIf.parameter, anyOf };
  }
  return message;
}

/** Frames of a trial as they are sent: one is sent as it was before there were several. */
function framesToWire(frames) {
  if (!(Number.isInteger(frames) && frames >= 1 && frames <= 64))
    throw new TreewrightError("invalid", `episodeFrames is ${frames}; give 1 to 64`);
  return frames === 1 ? 0 : frames;
}

/** Parameters and constraints; a step is a constraint as other languages write it, so that programs in several share a study. */
export function spaceToWire({ parameters, constraints = [] }) {
  const steps = parameters.filter(({ step }) => step !== undefined).map(({ name, min, step }) => ({
    expression: `${min % step === 0 ? `\`${name}\`` : `(\`${name}\` - ${min})`} % ${step} == 0`,
  }));
  const given = constraints.map((each) => (typeof each === "string" ? { expression: each } : { lesser: each[0], greater: each[1] }));
  return { parameters: parameters.map((each) => parameterToWire(each, parameters)), constraints: [...given, ...steps] };
}

export function specToWire(spec) {
  const indicators = Object.entries(spec.indicators ?? {}).map(([name, [min, max, scale = "linear"]]) => {
    if (scale !== "log" && scale !== "linear")
      throw new TreewrightError("invalid", `indicator ${name}: ${scale} is no scale; use "log" or "linear"`);
    return { name, min, max, scale: scale === "log" ? "SCALE_LOG" : "SCALE_LINEAR" };
  });
  // A metric in both stays twice, so that it is refused.
  const metrics = [...Object.entries(spec.minimise ?? {}), ...Object.entries(spec.maximise ?? {})];
  const terms = metrics.map(([metric, weight]) => ({ metric, weight }));
  const policy = Object.fromEntries(
    Object.entries(spec.policy ?? {}).map(([name, value]) => [name.replace(/_(.)/g, (_, each) => each.toUpperCase()), value]),
  );
  return {
    displayName: spec.displayName ?? "",
    space: spaceToWire(spec),
    indicators,
    objective: {
      terms,
      auxiliary: spec.auxiliary ?? [],
      maximised: Object.keys(spec.maximise ?? {}),
      limits: Object.entries(spec.limits ?? {}).map(([metric, { atLeast, atMost }]) => ({ metric, atLeast, atMost })),
      episodeFrames: framesToWire(spec.episodeFrames ?? 1),
      fidelities: (spec.fidelities ?? []).map(({ name, cost }) => ({ name, cost })),
    },
    stateTolerance: spec.stateTolerance,
    policy,
    seed: spec.seed ?? 0,
  };
}

/** The values to run with when the daemon has never answered: defaults of what is active. */
export function defaultConfiguration(spec) {
  const plain = {};
  for (const { name, activeIf, default: value } of spec.parameters)
    if (!activeIf || activeIf.anyOf.includes(plain[activeIf.parameter])) plain[name] = value;
  return plain;
}

/** The defaults of a stored space, of what is active. */
export function defaultOfSpace({ parameters }) {
  const plain = configurationFromWire({ values: Object.fromEntries(parameters.map(({ name, defaultValue }) => [name, defaultValue])) });
  for (const { name, activeIf } of parameters)
    if (activeIf && !Object.values(configurationFromWire({ values: activeIf.anyOf })).includes(plain[activeIf.parameter])) delete plain[name];
  return plain;
}

/** What is wrong with a program's indicators is reported before anything is asked, as it will not pass. */
export function checkIndicators(indicators, spec) {
  const known = Object.keys(spec.indicators ?? {});
  const wrong = (problem) => new TreewrightError("invalid", `indicators: ${problem}; this study has ${known.join(", ") || "none"}`);
  for (const name of Object.keys(indicators)) if (!known.includes(name)) throw wrong(`there is none called ${name}`);
  for (const name of known) {
    if (!(name in indicators)) throw wrong(`${name} is missing`);
    if (!Number.isFinite(indicators[name])) throw wrong(`${name} is ${indicators[name]}, which is not finite`);
  }
}

/** Whether a value is in the domain of a parameter. */
function fits({ type, min, max, values }, value) {
  if (type === "boolean") return typeof value === "boolean";
  if (type === "choice") return values.includes(value);
  return typeof value === "number" && value >= min && value <= max && (type === "float" || Number.isInteger(value));
}

/** A start must be whole, as it runs without the daemon, too. Constraints are left to the daemon. */
export function checkStart(start, spec) {
  const wrong = (problem) => new TreewrightError("invalid", `start: ${problem}`);
  for (const name of Object.keys(start))
    if (!spec.parameters.some((each) => each.name === name)) throw wrong(`the study has no parameter ${name}`);
  for (const parameter of spec.parameters) {
    const { name, activeIf } = parameter;
    const isActive = !activeIf || activeIf.anyOf.includes(start[activeIf.parameter]);
    if (!isActive && Object.hasOwn(start, name)) throw wrong(`${name} is not active here; leave it out`);
    if (isActive && !Object.hasOwn(start, name)) throw wrong(`${name} is active here and has no value; give it one`);
    if (isActive && !fits(parameter, start[name])) throw wrong(`${start[name]} is no value of ${name}; see its range or its list`);
  }
}

const STATE_TOLERANCE = 0.01;

/** A value on the scale of its indicator, where the lowest is 0 and the highest 1. */
function normalised(value, [min, max, scale]) {
  if (scale !== "log") return (value - min) / (max - min);
  return (Math.sign(value - min) * Math.log1p(Math.abs(value - min))) / Math.log1p(max - min);
}

/** Whether the service takes both for one state. */
export function isOneState(spec, one, other) {
  const tolerance = spec.stateTolerance ?? STATE_TOLERANCE;
  return Object.entries(spec.indicators ?? {}).every(
    ([name, range]) => Math.abs(normalised(one[name], range) - normalised(other[name], range)) <= tolerance,
  );
}

// A number that is 0 is not sent; one that may be missing stays so.
const gainFromWire = (gain) =>
  gain ? { share: gain.share ?? 0, low: gain.low, high: gain.high, probabilityBetter: gain.probabilityBetter } : undefined;

/** Least probabilities of being better that are called a proof, by the rounds of a confirmation, and likely, by all measurements. */
const [PROVEN, LIKELY] = [0.99, 0.8];
/** The largest gain, as a share, that counts as nothing to win. */
const NOTHING_TO_WIN = 0.01;

/** The standing, in the words of every surface. */
function statusOf({ gain, confirmation, gainAtMost }) {
  const stage = confirmation?.stage;
  const rounds = confirmation?.gain;
  // An earlier version of the daemon does not send the probability.
  const isProven = rounds !== undefined && rounds !== null && (rounds.probabilityBetter === undefined ? rounds.low > 0 : rounds.probabilityBetter >= PROVEN);
  if (stage === "CONFIRMATION_STAGE_RACING") return "confirming";
  if (stage === "CONFIRMATION_STAGE_BETTER" && isProven) return "proven better";
  if (gain?.probabilityBetter >= LIKELY) return "likely better";
  if (stage === "CONFIRMATION_STAGE_SEARCHING") return "searching";
  if (stage !== "CONFIRMATION_STAGE_NOTHING_BETTER") return "open";
  return gainAtMost <= NOTHING_TO_WIN ? "nothing to win" : "nothing better";
}

/** The best known configuration, with its standing. */
export function bestFromWire(best) {
  const { cost = 0, defaultCost, measurements = 0, trial, standing } = best;
  const told = standing ? {
    cost: standing.cost ?? 0, costLow: standing.costLow ?? 0, costHigh: standing.costHigh ?? 0, gain: gainFromWire(standing.gain),
    nothingBetter: standing.nothingBetter ?? false,
    stage: standing.confirmation?.stage?.replace("CONFIRMATION_STAGE_", "").toLowerCase(),
  } : undefined;
  if (told) told.status = statusOf(standing);
  return { configuration: configurationFromWire(best.configuration), cost, defaultCost, measurements, trial, standing: told };
}
