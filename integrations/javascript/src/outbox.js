// Reports on their way: a bounded queue that is sent in order, and again after a pause, until it is acknowledged.

const PAUSE_MIN_MS = 50;
const PAUSE_MAX_MS = 5000;
// INTERNAL, UNKNOWN, RESOURCE_EXHAUSTED, UNAVAILABLE, DEADLINE_EXCEEDED, ABORTED pass with time.
const PASSING = [13, 2, 8, 14, 4, 10, 1];
const ATTEMPTS_AFTER_INTERNAL_ERROR = 8;

export class Outbox {
  #waiting = [];
  #sending = false;
  #idle = [];
  #closed = false;

  constructor(limit, stats) {
    this.limit = limit;
    this.stats = stats;
  }

  /** `send` makes one attempt. */
  put(trial, kind, send) {
    if (this.#waiting.length >= this.limit) {
      this.#waiting.splice(this.#sending ? 1 : 0, 1);
      this.stats.dropped += 1;
    }
    this.#waiting.push({ trial, kind, send, attempts: 0 });
    this.stats.queued = this.#waiting.length;
    this.#work();
  }

  /** Resolves when the results that were queued before are told, so that a question does not overtake them. */
  async told() {
    if (this.#waiting.length > 0) await new Promise((resolve) => this.#idle.push(resolve));
  }

  close() {
    this.#closed = true;
    this.stats.dropped += this.#waiting.length;
    this.#waiting.length = 0;
    this.#rest();
  }

  #rest() {
    for (const resolve of this.#idle.splice(0)) resolve();
  }

  async #work() {
    if (this.#sending) return;
    this.#sending = true;
    let failures = 0;
    while (this.#waiting.length > 0 && !this.#closed) {
      const item = this.#waiting[0];
      try {
        await item.send();
        failures = 0;
        if (item.kind === "report") this.stats.acknowledged += 1;
      } catch (error) {
        item.attempts += 1;
        this.stats.lastError = error.message;
        const given_up = error.code === 13 && item.attempts >= ATTEMPTS_AFTER_INTERNAL_ERROR;
        if (PASSING.includes(error.code) && !given_up && !this.#closed) {
          failures += 1;
          const pause = Math.min(PAUSE_MAX_MS, PAUSE_MIN_MS * 2 ** Math.min(failures, 10)) * (0.5 + Math.random() / 2);
          await new Promise((resolve) => setTimeout(resolve, pause).unref());
          continue;
        }
        this.stats.refused += 1;
      }
      if (this.#waiting[0] === item) this.#waiting.shift();
      this.stats.queued = this.#waiting.length;
    }
    this.#sending = false;
    this.#rest();
  }
}
