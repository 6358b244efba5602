/** A server that restarts, and a stream that ends and begins again, under a page that stays open. */

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { Bench, frameAfter, frameNumber, statusBecomes, stop } from "./support.mjs";

let bench;
let rig;
let page;

before(async () => {
  bench = await Bench.open();
  rig = await bench.publish("demo", { fps: 5 });
  page = await bench.page("/watch/demo", { width: 600, height: 500 });
  await frameNumber(page);
});

after(() => bench?.close());

test("the page goes on by itself after the server was restarted", async () => {
  await frameAfter(page, 3);
  await stop(rig);
  await stop(bench.server);
  await statusBecomes(page, "Reconnecting");
  await bench.startServer();
  rig = await bench.publish("demo", { fps: 5 });
  await statusBecomes(page, "Live");
  // The new server counts from 0: frames are shown although their numbers are lower.
  const seq = await frameNumber(page);
  await frameAfter(page, seq);
});

test("a stream that ends is waited for, and shown when it begins again", async () => {
  await stop(rig);
  const deleted = await fetch(`${bench.url}/v1/streams/demo`, { method: "DELETE" });
  assert.equal(deleted.status, 204);
  await statusBecomes(page, "Ended");
  rig = await bench.publish("demo", { fps: 5 });
  await statusBecomes(page, "Live");
});

test("a stream that nobody publishes is waited for", async () => {
  const early = await bench.page("/watch/later", { width: 600, height: 500 });
  await statusBecomes(early, "Not live");
  const other = await bench.publish("later", { fps: 5 });
  await statusBecomes(early, "Live");
  await frameNumber(early);
  await stop(other);
  await early.context().close();
});

test("the console says only that the server was away", () => {
  const others = bench.consoleErrors.filter(
    (text) => !/ERR_CONNECTION_REFUSED|ERR_CONNECTION_RESET|ERR_EMPTY_RESPONSE/.test(text),
  );
  assert.deepEqual(others, []);
});
