// The configurations to run with while no daemon answers, as the Rust SDK has them (client/src/memory.rs): in a state the daemon's
// latest answer that ran there, else the cheapest of those that ran there; in another state the latest answer that failed nowhere.

import { isOneState } from "./wire.js";

/** Configurations that are kept, each once for a state. */
const MOST = 64;

const isSame = (one, other) => JSON.stringify(Object.entries(one).sort()) === JSON.stringify(Object.entries(other).sort());

/** The objective of what was measured: the weighted sum, to which a maximised metric adds its reciprocal. */
export function costOf({ minimise = {}, maximise = {} }, measurements) {
  let cost = 0;
  for (const [name, weight] of Object.entries(minimise)) cost += weight * measurements[name];
  for (const [name, weight] of Object.entries(maximise)) cost += weight / measurements[name];
  return cost;
}

export class Memory {
  #spec;
  /** What ran last comes last. */
  #all = [];
  #answers = 0;

  constructor(spec) {
    this.#spec = spec;
  }

  /** It ran to its end in a state, at this cost; or it could not be run. `isAnswer`: the daemon answered it, and did not explore. */
  note(indicators, configuration, isAnswer, cost) {
    const isThis = (one) => isSame(one.configuration, configuration) && isOneState(this.#spec, one.indicators, indicators);
    const known = this.#all.find(isThis);
    if (isAnswer) this.#answers += 1;
    const answered = isAnswer ? this.#answers : known?.answered;
    // The dearer of its last two runs counts, so that a cost that was read wrongly misleads for one run.
    const costs = cost === undefined ? undefined : [known?.costs?.[1] ?? cost, cost];
    this.#all = [...this.#all.filter((one) => one !== known), { indicators, configuration, answered, costs }];
    if (this.#all.length > MOST) this.#all.splice(Math.max(this.#all.findIndex((one) => one.answered === undefined), 0), 1);
  }

  /** The configuration to run in a state; undefined where only the defaults are left. */
  lastGood(indicators) {
    const least = (all, key) => all.reduce((found, one) => (found === undefined || key(one) < key(found) ? one : found), undefined);
    const latest = (all) => least(all.filter((one) => one.answered !== undefined), (one) => -one.answered);
    const isHere = (one) => isOneState(this.#spec, one.indicators, indicators);
    const ran = this.#all.filter((one) => one.costs && isHere(one));
    const fails = (one) => this.#all.some((other) => !other.costs && isSame(one.configuration, other.configuration));
    const elsewhere = this.#all.filter((one) => !isHere(one) && !fails(one));
    return (latest(ran) ?? least(ran, (one) => Math.max(...one.costs)) ?? latest(elsewhere))?.configuration;
  }
}
