// Reports on their way: a bounded queue that is sent in order, and again after a pause, until it is acknowledged.

const PAUSE_MIN_MS = 50;
const PAUSE_MAX_MS = 5000;
// INTERNAL, UNKNOWN, RESOURCE_EXHAUSTED, UNAVAILABLE, DEADLINE_EXCEEDED, ABORTED pass with time.
const PASSING = [13, 2, 8, 14, 4, 10, 1];
// INTERNAL and UNKNOWN are defects of the daemon: they may pass, but must not hold up the queue for ever.
const DEFECTS = [13, 2];
const ATTEMPTS_AFTER_DEFECT = 8;

export class Outbox {
  #waiting = [];
  #sending = false;
  #closed = false;

  constructor(limit, stats) {
    this.limit = limit;
    this.stats = stats;
  }

  /** `send` makes one attempt. `worker` is who ran the trial that it is about. */
  put(worker, kind, send) {
    if (this.#closed) {
      this.stats.dropped += 1;
      return;
    }
    if (this.#waiting.length >= this.limit) {
      // The first may be under way, and is kept then.
      for (const item of this.#waiting.splice(this.#sending ? 1 : 0, 1)) {
        item.end();
        this.stats.dropped += 1;
      }
    }
    let end;
    const ended = new Promise((resolve) => (end = resolve));
    this.#waiting.push({ worker, kind, send, end, ended, attempts: 0 });
    this.stats.queued = this.#waiting.length;
    this.#work();
  }

  /** Resolves when what was queued before is reported, of this worker or of all, so that a question does not overtake it. */
  async told(worker) {
    await this.#waiting.findLast((item) => worker === undefined || item.worker === worker)?.ended;
  }

  close() {
    this.#closed = true;
    this.stats.dropped += this.#waiting.length;
    for (const item of this.#waiting.splice(0)) item.end();
    this.stats.queued = 0;
  }

  async #work() {
    if (this.#sending) return;
    this.#sending = true;
    let failures = 0;
    while (this.#waiting.length > 0 && !this.#closed) {
      const item = this.#waiting[0];
      try {
        await item.send();
        // It is dropped already, and counts as that.
        if (this.#closed) break;
        failures = 0;
        if (item.kind === "report") this.stats.acknowledged += 1;
      } catch (error) {
        if (this.#closed) break;
        item.attempts += 1;
        this.stats.lastError = error.message;
        const isGivenUp = DEFECTS.includes(error.code) && item.attempts >= ATTEMPTS_AFTER_DEFECT;
        if (PASSING.includes(error.code) && !isGivenUp) {
          failures += 1;
          const pause = Math.min(PAUSE_MAX_MS, PAUSE_MIN_MS * 2 ** Math.min(failures, 10)) * (0.5 + Math.random() / 2);
          await new Promise((resolve) => setTimeout(resolve, pause).unref());
          continue;
        }
        // A trial that cannot be given back is no report; its lease runs out.
        if (item.kind === "report") this.stats.refused += 1;
      }
      this.#waiting.shift();
      item.end();
      this.stats.queued = this.#waiting.length;
    }
    this.#sending = false;
  }
}
