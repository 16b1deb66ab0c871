export class TreewrightError extends Error {
  constructor(kind, message, code, passes = false) {
    super(message);
    this.name = "TreewrightError";
    this.kind = kind;
    this.code = code;
    /** Whether the daemon is there and said itself that asking again will do, as while it loads a study. */
    this.passes = passes;
  }
}

// UNAVAILABLE, DEADLINE_EXCEEDED, CANCELLED: nobody there, or not in time.
const PASSING = [14, 4, 1];

/** Whether the details of a status say when to ask again. */
const saysWhen = (error) => error.metadata?.get("grpc-status-details-bin").some((each) => each.includes("google.rpc.RetryInfo")) ?? false;

/** An error of gRPC, with what can be done about it. */
export function refined(error, url, call) {
  if (error instanceof TreewrightError) return error;
  const words = error.details || error.message;
  if (PASSING.includes(error.code))
    return new TreewrightError(
      "unreachable",
      `no daemon answers at ${url} (${words}); start one with \`treewrightd serve --listen ADDRESS --database FILE\``,
      error.code,
      error.code === 14 && saysWhen(error),
    );
  return new TreewrightError("refused", `the daemon refused ${call}: ${words}`, error.code);
}
