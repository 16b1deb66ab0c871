// Trials of several frames, as the Rust SDK has them (client/src/episode.rs): their means are their measurements.

import { isOneState } from "./wire.js";

/** A lease is not renewed more often. */
const LEAST_RENEWAL_MS = 250;

const MEASUREMENTS_MOST = 64;

const sum = (numbers) => numbers.reduce((all, each) => all + each, 0);

/** Mean cost of the second half over that of the first; the first frame, which pays for what is built once, is left out. */
function trend(costs) {
  const later = costs.slice(1);
  if (later.length <= 3) return undefined;
  const middle = Math.floor(later.length / 2);
  const [first, second] = [later.slice(0, middle), later.slice(middle)];
  const found = sum(second) / second.length / (sum(first) / first.length);
  return Number.isFinite(found) ? found : undefined;
}

export class Episode {
  #spec;
  #indicators;
  #cap;
  #planned;
  #costs = [];
  #sums;
  /** The sums of squares of standard errors. */
  #squares = {};
  #renewAfterMs;
  #renewed = Date.now();

  constructor(spec, indicators, { abortAbove, leaseExpireTime }) {
    this.#spec = spec;
    this.#indicators = indicators;
    this.#cap = abortAbove;
    this.#planned = spec.episodeFrames;
    const leftMs = leaseExpireTime ? Number(leaseExpireTime.seconds) * 1000 - Date.now() : Infinity;
    // A renewal that fails is repeated before the lease ends.
    this.#renewAfterMs = Math.max(leftMs / 3, LEAST_RENEWAL_MS);
  }

  isIn(indicators) {
    return isOneState(this.#spec, this.#indicators, indicators);
  }

  renewalIsDue() {
    const isDue = Date.now() - this.#renewed >= this.#renewAfterMs;
    if (isDue) this.#renewed = Date.now();
    return isDue;
  }

  /** The cost of the next frame from which on the mean must be above the trial's cap. */
  get frameCap() {
    return this.#cap === undefined ? undefined : Math.max(this.#cap * this.#planned - sum(this.#costs), 0);
  }

  /** The trial's least cost where its next frame costs at least so much. */
  bound(frame) {
    return (sum(this.#costs) + frame) / this.#planned;
  }

  /** Takes a frame; one beyond a limit has no cost. Returns the trial's result, once that is known. */
  push(measurements, cost, standardErrors) {
    // It makes the trial infeasible, whatever the others are.
    if (cost === undefined) return { measurements, standardErrors, outcome: { ok: {} } };
    for (const [name, error] of Object.entries(standardErrors)) {
      // A reciprocal errs by the same share.
      const own = this.#isMaximised(name) ? error / measurements[name] / measurements[name] : error;
      this.#squares[name] = (this.#squares[name] ?? 0) + own * own;
    }
    const summand = (name, value) => (this.#isMaximised(name) ? 1 / value : value);
    this.#sums ??= Object.fromEntries(Object.keys(measurements).map((name) => [name, 0]));
    for (const name of Object.keys(this.#sums)) {
      if (Object.hasOwn(measurements, name)) this.#sums[name] += summand(name, measurements[name]);
      else delete this.#sums[name];
    }
    this.#costs.push(cost);
    if (this.#costs.length === this.#planned) {
      const means = this.#means();
      return { measurements: means, standardErrors: this.#errors(means), outcome: { ok: {} } };
    }
    const lowerBound = this.bound(0);
    return lowerBound > (this.#cap ?? Infinity) ? { measurements: {}, outcome: { aborted: { lowerBound } } } : undefined;
  }

  /** Of the means; those of frames are independent. */
  #errors(means) {
    const known = Object.entries(this.#squares).filter(([name]) => Object.hasOwn(this.#sums, name));
    const share = (name) => (this.#isMaximised(name) ? means[name] / this.#sums[name] : 1 / this.#planned);
    return Object.fromEntries(known.map(([name, square]) => [name, Math.sqrt(square) * share(name)]));
  }

  #isMaximised(name) {
    return Object.hasOwn(this.#spec.maximise ?? {}, name);
  }

  /** That of a maximised metric is the harmonic one, so that the trial's cost is the mean of its frames' costs. */
  #means() {
    const { limits = {} } = this.#spec;
    const mean = ([name, all]) => {
      const found = this.#isMaximised(name) ? this.#planned / all : all / this.#planned;
      // No frame was beyond a limit: so their mean is not, whatever its last digit is.
      const { atLeast = -Infinity, atMost = Infinity } = limits[name] ?? {};
      return [name, Math.min(Math.max(found, atLeast), atMost)];
    };
    const means = Object.fromEntries(Object.entries(this.#sums).map(mean));
    const found = trend(this.#costs);
    if (found !== undefined && !Object.hasOwn(means, "trend") && Object.keys(means).length < MEASUREMENTS_MOST) means.trend = found;
    return means;
  }
}
