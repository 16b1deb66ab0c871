export class TreewrightError extends Error {
  constructor(kind, message, code) {
    super(message);
    this.name = "TreewrightError";
    this.kind = kind;
    this.code = code;
  }
}

// UNAVAILABLE, DEADLINE_EXCEEDED, CANCELLED: nobody there, or not in time.
const PASSING = [14, 4, 1];

/** An error of gRPC, with what can be done about it. */
export function refined(error, url, call) {
  if (error instanceof TreewrightError) return error;
  const words = error.details || error.message;
  if (PASSING.includes(error.code))
    return new TreewrightError(
      "unreachable",
      `no daemon answers at ${url} (${words}); start one with \`treewrightd serve --listen ADDRESS --database FILE\``,
      error.code,
    );
  return new TreewrightError("refused", `the daemon refused ${call}: ${words}`, error.code);
}
