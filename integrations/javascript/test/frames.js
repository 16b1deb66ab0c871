// Runs a frame for each size against a running daemon: `node test/frames.js URL SIZE...`. Prints the size,
// leaf and window of each, and whether it ran.

// The package installed beside this file; in the checkout, the checkout itself.
import { Client } from "treewright";

const [url, ...sizes] = process.argv.slice(2);
const client = new Client(url, { clientId: "node-frames", deadlineMs: 20000 });
const study = await client.study("frozen", {
  parameters: [
    { name: "leaf", type: "integer", min: 1, max: 32, log: true, default: 8 },
    { name: "window", type: "integer", min: 1, max: 15, default: 8 },
  ],
  indicators: { size: [0, 100] },
  minimise: { ms: 1 },
  policy: { epsilon: 0.8, confirm_rounds: 0 },
});
for (const size of sizes.map(Number)) {
  const suggestion = await study.suggest({ size });
  if (suggestion.source !== "daemon") throw new Error(suggestion.problem);
  const { leaf, window } = suggestion.configuration;
  // The cheapest lie just beside those that cannot be used.
  const ran = leaf + window <= 24;
  if (ran) suggestion.report({ ms: 60 - leaf - window });
  else suggestion.infeasible("its output grows");
  console.log(`${size} ${leaf} ${window} ${ran ? "ran" : "failed"}`);
}
await client.flush(20000);
client.close();
