// The workers of a client. The service hands a client that holds an open trial for a state that trial again, so who runs trials side by
// side needs several names: NAME, NAME#2, NAME#3 and so on. Each suggestion takes the lowest that is free, and lets it go when it ends.

import { TreewrightError } from "./error.js";

/** Most trials that one client may have open in one study. */
const WORKERS_MAX = 1024;
/** Longest id that the service takes, in characters. */
const CHARACTERS_MAX = 128;

/** Which numbers are busy, by daemon, client and study: clients of one id in one program share them. */
const busy = new Map();

const named = (clientId, number) => {
  if (number === 1) return clientId;
  const end = `#${number}`;
  return Array.from(clientId).slice(0, CHARACTERS_MAX - end.length).join("") + end;
};

/** Takes a free worker. `release` lets it go, once. */
export function takeWorker(url, clientId, study) {
  const key = JSON.stringify([url, clientId, study]);
  const numbers = busy.get(key) ?? busy.set(key, new Set()).get(key);
  let number = 1;
  while (numbers.has(number)) number += 1;
  if (number > WORKERS_MAX)
    throw new TreewrightError("invalid", `${WORKERS_MAX} trials of client ${clientId} are neither reported nor given back, which is the limit; end some`);
  numbers.add(number);
  return { name: named(clientId, number), release: () => numbers.delete(number) };
}
