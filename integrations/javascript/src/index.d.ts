/** A parameter. */
export type Value = boolean | number | string;
/** Indicators go in, measurements come out; all finite, measurements not negative. */
export type Numbers = Record<string, number>;
export type Configuration = Record<string, Value>;

/** The parameter exists only while an earlier one has one of these values. */
export interface Condition {
  parameter: string;
  anyOf: Value[];
}

/**
 * `default` is the value used so far, against which everything is judged. With `setup` a change of it needs a build, a compilation or the
 * like; that of other parameters only a run.
 */
export type Parameter = { name: string; activeIf?: Condition; setup?: boolean } & (
  | { type: "integer"; min: number; max: number; log?: boolean; default: number; /** From `min` on. */ step?: number }
  | { type: "float"; min: number; max: number; log?: boolean; default: number }
  | { type: "boolean"; default: boolean }
  | { type: "choice"; /** Numbers are searched in the order of their sizes; words have none. */ values: string[] | number[]; default: string | number }
);

export interface StudySpec {
  displayName?: string;
  parameters: Parameter[];
  /** Conditions that every configuration fulfils: an expression such as `"x * y <= 1024"`, or `[lesser, greater]`. */
  constraints?: (string | [string, string])[];
  /** `[lowest, highest]`, mapped to 0 and 1; with `"log"` by the logarithm. */
  indicators?: Record<string, [number, number] | [number, number, "linear" | "log"]>;
  /** Weights of measurements; the objective is their weighted sum. */
  minimise?: Record<string, number>;
  /** Weights of measurements that are to be large, such as rates: the weight over the measurement is added. */
  maximise?: Record<string, number>;
  auxiliary?: string[];
  /** Limits of measurements; a configuration that goes beyond is infeasible. */
  limits?: Record<string, { atLeast?: number; atMost?: number }>;
  /** Frames of a trial, 1 to 64, for costs that rise or fall while a configuration is in use; see `Tuner`. Default 1. */
  episodeFrames?: number;
  /** Cheaper levels, such as fewer samples, the cheapest first: the cost of a trial there as a share of a full one. At most 4. */
  fidelities?: { name: string; cost: number }[];
  stateTolerance?: number;
  /** Fields and words as in the wire contract, any others are refused: `{epsilon: 0.1, search: "SEARCH_METHOD_RANDOM"}`. */
  policy?: Record<string, unknown>;
  seed?: number;
}

export interface Options {
  /**
   * Unique among the processes that work on a study, 1 to 128 characters. Trials that one process runs side by side get names
   * of their own, as ID, ID#2, ID#3 and so on. Default: program, machine, process, and the number of a worker thread.
   */
  clientId?: string;
  /** How long a suggestion may keep its caller waiting. Default 50. */
  deadlineMs?: number;
  /** How long any other call may take. Default 5000. */
  callDeadlineMs?: number;
  /** Reports that may wait for the daemon; the oldest is dropped when it is full. Default 1024. */
  queue?: number;
  /** A token, sent only over TLS or to this machine. */
  token?: string;
  /** PEM of the authority of the daemon's certificate; for `https:` addresses. */
  authority?: string | Uint8Array;
  /** PEM of a certificate, and of its key, for a daemon that asks its clients for one. Both or neither, and only with an `https:` address. */
  certificate?: string | Uint8Array;
  key?: string | Uint8Array;
  /** Names and versions of software that decides how fast something is. */
  software?: Record<string, string>;
  /** Every trial runs at the level that `Suggestion.fidelity` names. Default false: all trials are full ones. */
  fidelities?: boolean;
}

/** `kind` says what can be done about it; the message names cause and remedy. */
export class TreewrightError extends Error {
  readonly kind: "invalid" | "unreachable" | "refused";
  /** The canonical gRPC code, where there was one. */
  readonly code?: number;
  /** Whether the daemon is there and said itself that asking again will do, as while it loads a study. */
  readonly passes: boolean;
}

export interface Stats {
  suggestions: number;
  fallbacks: number;
  unreported: number;
  acknowledged: number;
  refused: number;
  dropped: number;
  queued: number;
  lastError?: string;
}

export class Client {
  constructor(url?: string, options?: Options);
  /** Creates the study, or finds the equal one. An absent daemon is no error: it is created when it is there. */
  study(id: string, spec: StudySpec): Promise<Study>;
  /** Waits until every report is acknowledged or refused; rejects when some still wait. */
  flush(deadlineMs?: number): Promise<void>;
  /**
   * Changes the space of a study for all programs. Trials stay; those outside the new space are not used. Programs that know the space of
   * before go on in it; `study` with the new one works in that. `fixed` has values of parameters that are added or removed, where they are
   * not the defaults: what all trials before had of one that is added, and what all from now on have of one that is removed. With
   * `onlyTry` nothing is changed.
   */
  changeSpace(
    id: string,
    space: Pick<StudySpec, "parameters" | "constraints">,
    change?: { fixed?: Configuration; onlyTry?: boolean },
  ): Promise<ChangedSpace>;
  deleteStudy(id: string): Promise<void>;
  /** Closes the connection; what waits is lost, so flush before. */
  close(): void;
  readonly stats: Stats;
}

/** The effect of a change of a space on the trials of its study. */
export interface ChangedSpace {
  /** Of the space, after the change or, where it was only tried, as it is. */
  revision: number;
  /** Completed trials inside the new space, and outside. */
  keptTrials: number;
  outsideTrials: number;
  /** Open trials outside. */
  givenBackTrials: number;
}

/** By how much the cost lies below that of the default, as a share of it, with its 95 % interval where that is known. */
export interface Gain {
  share: number;
  low?: number;
  high?: number;
  probabilityBetter?: number;
}

/** The standing of an answer: its cost, drawn from all that was measured and never the luckiest run, with its 95 % interval. */
export interface Standing {
  cost: number;
  costLow: number;
  costHigh: number;
  /** Absent where the default was not measured in the state. */
  gain?: Gain;
  nothingBetter: boolean;
  /** How far confirmation is: off, searching, racing, better, nothing_better. */
  stage?: string;
  /** The standing, in the words of every surface. */
  status: "proven better" | "likely better" | "searching" | "confirming" | "open" | "nothing better" | "nothing to win";
}

export interface Best {
  configuration: Configuration;
  /** Mean objective of its measurements, and of the default's where there are some. */
  cost: number;
  defaultCost?: number;
  /** The values behind these; see `Study.value`. */
  value: number;
  defaultValue?: number;
  /** The 95 % interval of the value, from all that was measured; absent where there is no standing. */
  valueLow?: number;
  valueHigh?: number;
  measurements: number;
  /** The most recent trial that measured it. */
  trial: string;
  standing?: Standing;
}

export class Study {
  readonly name: string;
  /**
   * The next configuration to run. Rejects only for wrong indicators. Without the daemon it is the last good configuration, or the
   * default, and `problem` says why. Each suggestion that is neither reported nor given back is a trial of its own, for every caller.
   */
  suggest(indicators?: Numbers): Promise<Suggestion>;
  /** A frame loop. */
  tuner(): Tuner;
  /** A trial of one's own choice. Here and below, a daemon that is still loading the study is asked again until `callDeadlineMs` is over. */
  trialOf(configuration: Configuration, indicators?: Numbers): Promise<Suggestion>;
  /**
   * Sets what the program runs by default, with all its values, where that is not the study's default; without an argument it is that.
   * It is measured first in a state, and answers there are what is better than it.
   * Throws where a value is missing, unknown or out of its range.
   */
  setStart(configuration?: Configuration): void;
  /**
   * What would be exploited. `mode` is exploit where something is known, here or elsewhere, default where nothing is, pinned where the
   * policy says so. `reason` says in a sentence whether it was measured for such an input or is only predicted.
   */
  predict(indicators?: Numbers): Promise<{ configuration: Configuration; cost?: number; mode: string; reason: string }>;
  /** The best that is known there, or of all states without indicators. Rejects when nothing was measured. */
  best(indicators?: Numbers): Promise<Best>;
  /** The Pareto front of the stored trials, without those that are excluded, ran at a cheaper level, or are outside the present space. */
  front(query?: FrontQuery): Promise<ParetoFront>;
  /** The value behind a cost: the metric in its own unit where one is maximised and nothing else counts, else the cost. */
  value(cost: number): number;
}

/** Report it, or give it back with `abandon()`; one that is forgotten is given back when it is collected. */
export class Suggestion {
  readonly configuration: Configuration;
  readonly source: "daemon" | "last_good" | "default";
  readonly trial?: string;
  readonly reason: string;
  readonly problem?: string;
  readonly predictedCost?: number;
  /** Stop as soon as the objective exceeds this, and call `aborted`; undefined is never. In a frame loop it is the cost of this frame. */
  readonly abortAbove?: number;
  /** The cheaper level at which to run; absent for a full trial. */
  readonly fidelity?: string;
  /**
   * Whether what was set up for the suggestion before serves this one: that was measured to its end, with the same values of all
   * parameters with `setup`. Always false once trials of the study ran side by side.
   */
  readonly isPrepared: boolean;
  /**
   * Renews the lease, counted from now, for work that takes longer than `lease_s` of the policy; does nothing without the daemon. Rejects
   * where it is reported or given back, and where the daemon has ended its trial.
   */
  extendLease(): Promise<void>;
  /** Each returns at once; the result is sent in the background, again until it is acknowledged. */
  /** Standard errors are those of measurements that are estimates: poor ones count for less. */
  report(measurements: Numbers, standardErrors?: Numbers): void;
  aborted(lowerBound: number): void;
  infeasible(reason: string): void;
  failed(reason: string): void;
  abandon(): void;
}

/**
 * A frame loop. Where `episodeFrames` of the study is above 1 it keeps a suggestion for that number of frames, at once and without the
 * daemon, and then reports their means; the trial ends early once its mean must be above its bound. In another state an unfinished trial
 * is given back. Without a loop, a trial is reported with the means over that number of frames.
 */
export class Tuner {
  next(indicators?: Numbers): Promise<Suggestion>;
  /** The frame's result. */
  finish(suggestion: Suggestion, measurements: Numbers, standardErrors?: Numbers): void;
}

/** A front and its planned runs. */
export interface FrontDefinition extends Pick<StudySpec, "parameters" | "constraints" | "limits" | "policy"> {
  /** Two or three measurements, above 0 in every run; `"1/rate"` is one that is to be large. */
  metrics: string[];
  /** Planned runs. Default 80. */
  trials?: number;
}

/** A configuration with its measurements. */
export interface FrontPoint {
  configuration: Configuration;
  /** Runs that measured it. */
  runs: number;
  /** The median of each metric, in its own unit. */
  metrics: Numbers;
  /** These over the default's; absent where that was not measured. */
  ratios?: Numbers;
}

export interface ParetoFront {
  metrics: string[];
  /** Those of them that are to be large. */
  maximised: string[];
  /** Runs that measured all metrics, and different configurations among them. */
  runs: number;
  configurations: number;
  default?: FrontPoint;
  /** The front, the best of the first metric first. */
  points: FrontPoint[];
  /** All other configurations. */
  dominated: FrontPoint[];
  /** The share, 0 to 1, of the box between zero and the reference, or else the default, that the front leaves behind; absent without. */
  hypervolume?: number;
}

/** Which front of a study's trials. */
export interface FrontQuery {
  /** As for `FrontDefinition`; of them the study need not minimise any. Default: those that the study was made for. */
  metrics?: string[];
  /** The number of a state; needed where trials are of several inputs or machines, which do not compare. */
  state?: number;
  /** A value of each metric, above 0, to which the hypervolume refers. */
  reference?: number[];
}

/**
 * Two or three metrics of which none is given up for another: runs that look for the configurations of which no other is better in all of
 * them. One program at a time adds to a front, and runs one trial at a time.
 */
export class Front {
  private constructor();
  /** Creates the study, or goes on with the one of that id that was made for the same metrics. Rejects where no daemon answers. */
  static open(client: Client, id: string, definition: FrontDefinition): Promise<Front>;
  /** The names of the metrics. */
  readonly metrics: string[];
  /**
   * The next run; the same trial until it is reported or given back. Undefined once the planned runs are done, or nothing more is to be
   * tried. Rejects where no daemon answers.
   */
  suggest(): Promise<FrontTrial | undefined>;
  /** The front of all runs so far on this machine, without those that were excluded when it was opened. */
  found(): ParetoFront;
}

/** A run of a front. Each call waits for the daemon; where it rejects, the run is open as before. */
export class FrontTrial {
  private constructor();
  readonly configuration: Configuration;
  /** Name of its trial. */
  readonly trial: string;
  readonly isOpen: boolean;
  /** Tells every direction. Rejects where a metric is missing or not above 0. */
  report(measurements: Numbers): Promise<void>;
  infeasible(reason: string): Promise<void>;
  /** It failed for a reason that says nothing about the configuration. */
  failed(reason: string): Promise<void>;
  /** Gives the run back unmeasured; nothing where it has ended. */
  abandon(): Promise<void>;
}
