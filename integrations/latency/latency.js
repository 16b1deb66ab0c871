// Round trips from Node: `latency.js URL COUNT`. See run.sh.
import { Client } from "../javascript/src/index.js";

const [url, count] = [process.argv[2], Number(process.argv[3])];
const client = new Client(url, { deadlineMs: 5000 });
const study = await client.study("latency-node", {
  parameters: [{ name: "leaf", type: "integer", min: 1, max: 32, log: true, default: 8 }], minimise: { ms: 1 },
});
const [predict, suggest] = [[], []];
for (let each = -50; each < count; each++) {
  const start = performance.now();
  await study.predict();
  const middle = performance.now();
  const suggestion = await study.suggest();
  const end = performance.now();
  if (each >= 0) predict.push((middle - start) * 1e3), suggest.push((end - middle) * 1e3);
  suggestion.report({ ms: 1 });
  await client.flush();
}
const shown = (all) => (all.sort((a, b) => a - b), [all[count >> 1], all[Math.floor((count * 99) / 100)]].map(Math.round));
console.log(JSON.stringify({ from: "Node", predict_us: shown(predict), suggest_us: shown(suggest) }));
client.close();
