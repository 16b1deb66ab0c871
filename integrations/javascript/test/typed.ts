// What a type checker makes of the package; never run.
import { Client, Front, TreewrightError, type StudySpec, type Value } from "treewright";

const spec: StudySpec = {
  parameters: [
    { name: "leaf", type: "integer", min: 1, max: 9, default: 3 },
    { name: "split", type: "choice", values: ["sah", "median"], default: "sah", activeIf: { parameter: "leaf", anyOf: [3] } },
  ],
  indicators: { triangles: [0, 1e8, "log"] },
  minimise: { ms: 1 },
};

export async function tune(client: Client): Promise<number> {
  const study = await client.study("typed", spec);
  const trial = await study.suggest({ triangles: 5 });
  await trial.extendLease();
  const leaf: Value = trial.configuration.leaf;
  trial.report({ ms: Number(leaf) });
  const tuner = study.tuner();
  tuner.finish(await tuner.next({ triangles: 5 }), { ms: 1 });
  try {
    return (await study.best()).cost;
  } catch (error) {
    return error instanceof TreewrightError && error.kind === "refused" ? 0 : 1;
  }
}
export async function look(client: Client): Promise<number | undefined> {
  const front = await Front.open(client, "typed", { parameters: spec.parameters, metrics: ["ms", "1/rate"], trials: 9 });
  await (await front.suggest())?.report({ ms: 1, rate: 2 });
  const study = await client.study("typed", spec);
  const { keptTrials } = await client.changeSpace("typed", { parameters: spec.parameters }, { fixed: { leaf: 3 }, onlyTry: true });
  const { points, hypervolume } = keptTrials > 0 ? front.found() : await study.front({ metrics: ["ms", "mb"], state: 1 });
  return points[0]?.ratios?.ms ?? hypervolume;
}
// @ts-expect-error: a choice has values
export const wrong: StudySpec = { parameters: [{ name: "x", type: "choice", default: 1 }], minimise: { ms: 1 } };
