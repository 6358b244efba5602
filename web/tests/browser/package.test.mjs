/**
 * The package `clients/js` in a page of somebody else, on another origin: its example with three.js
 * draws a stream, and its decoder is fast enough.
 */

import assert from "node:assert/strict";
import { once } from "node:events";
import { readFile } from "node:fs/promises";
import { createServer } from "node:http";
import { createRequire } from "node:module";
import { dirname, join } from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";
import { bundleWorker } from "../../../clients/js/worker-bundle.mjs";
import { Bench, PATIENCE_MS, stop } from "./support.mjs";

const packages = fileURLToPath(new URL("../../node_modules", import.meta.url));
const client = fileURLToPath(new URL("../../../clients/js", import.meta.url));
const draco = dirname(createRequire(import.meta.url).resolve("draco3d"));

const RECORDINGS = '[recordings]\nurl = "file://FOLDER/recordings"\n';

let bench;
let rig;
let host;
let page;

before(async () => {
  const script = await bundle();
  const wasm = await readFile(join(draco, "draco_decoder.wasm"));
  host = createServer(({ url }, response) => {
    const [type, body] = {
      "/page.js": ["text/javascript", script],
      "/draco_decoder.wasm": ["application/wasm", wasm],
    }[url] ?? ["text/html", '<link rel="icon" href="data:,"><canvas width="300" height="300">'];
    response.setHeader("Content-Type", type);
    response.end(body);
  }).listen(0, "127.0.0.1");
  await once(host, "listening");
  const origin = `http://127.0.0.1:${host.address().port}`;
  bench = await Bench.open({ settings: `[http]\nallowed_origins = ["${origin}"]\n${RECORDINGS}` });
  rig = await bench.publish("demo", { config: { target_faces: 4000, record: "output" }, fps: 5 });
  page = await bench.browser.newPage();
  page.on("console", (message) => {
    if (message.type() === "error") bench.consoleErrors.push(message.text());
  });
  page.on("pageerror", (error) => bench.consoleErrors.push(String(error)));
  await page.goto(origin);
});

after(async () => {
  await bench?.close();
  host?.close();
});

test("the example with three.js draws what comes", async () => {
  const drawn = await page.evaluate(async (address) => {
    const { show } = await import("/page.js");
    const canvas = document.querySelector("canvas");
    const copy = new OffscreenCanvas(300, 300).getContext("2d", { willReadFrequently: true });
    const session = show(canvas, address);
    // Right after it was drawn: a canvas of WebGL is empty later.
    const deadline = performance.now() + 20_000;
    let bright = 0;
    while (bright < 1000 && performance.now() < deadline) {
      await new Promise(requestAnimationFrame);
      copy.clearRect(0, 0, 300, 300);
      copy.drawImage(canvas, 0, 0);
      const { data } = copy.getImageData(0, 0, 300, 300);
      bright = 0;
      for (let i = 0; i < data.length; i += 4) if (data[i] > 200) bright += 1;
    }
    session.close();
    return bright;
  }, `${bench.url}/v1/streams/demo`);
  assert.ok(drawn >= 1000, `${drawn} pixels show the figure`);
});

test("a mesh of 4,000 faces is decoded in less than a thirtieth of a second", async (t) => {
  const meanMs = await page.evaluate(async (address) => {
    const { DecoderPool } = await import("/page.js");
    const mesh = await (await fetch(`${address}/frames/latest.drc`)).arrayBuffer();
    const pool = new DecoderPool({ workers: 1 });
    const decoded = await pool.decode(mesh.slice(0));
    if (decoded.indices.length !== 12_000) throw new Error(`${decoded.indices.length} indices`);
    const start = performance.now();
    const rounds = 100;
    for (let i = 0; i < rounds; i += 1) await pool.decode(mesh.slice(0));
    pool.close();
    return (performance.now() - start) / rounds;
  }, `${bench.url}/v1/streams/demo`);
  t.diagnostic(`${meanMs.toFixed(2)} ms for a mesh, one worker: ${(1000 / meanMs).toFixed(0)} fps`);
  assert.ok(meanMs < 1000 / 30, `${meanMs} ms`);
});

test("a held frame comes with its numbers", async () => {
  const frame = await page.evaluate(async (address) => {
    const { watch } = await import("/page.js");
    let first = null;
    return new Promise((resolve, reject) => {
      const session = watch(address, {
        onFrame: async ({ metrics: { seq: shown } }) => {
          if (first !== null) return;
          first = shown;
          const held = await session.held(10);
          const seq = held.at(0).seq;
          const { metrics, mesh } = await session.frame(seq);
          session.close();
          resolve({ asked: seq, got: metrics.seq, faces: mesh.indices.length / 3 });
        },
        onError: reject,
      });
    });
  }, `${bench.url}/v1/streams/demo`);
  assert.equal(frame.got, frame.asked);
  assert.equal(frame.faces, 4000);
});

test("a recording is played as fast as it comes without a frame missing", async () => {
  const url = `${bench.url}/v1/streams/demo`;
  const deadline = Date.now() + PATIENCE_MS;
  while ((await (await fetch(url)).json()).latest_seq < 12) {
    assert.ok(Date.now() < deadline, "the stream does not come");
    await new Promise((resolve) => setTimeout(resolve, 100));
  }
  await stop(rig);
  const { id, output } = await bench.endRecorded("demo");
  const address = `${bench.url}/v1/recordings/demo/${id}`;
  const seqs = await page.evaluate(async (recording) => {
    const { play } = await import("/page.js");
    const shown = [];
    let isOver = false;
    return new Promise((resolve, reject) => {
      const session = play(recording, {
        speed: 0,
        frames: "all",
        onFrame: ({ metrics }) => shown.push(metrics.seq),
        onState: ({ kind }) => {
          isOver = kind === "finished";
        },
        onError: reject,
      });
      // What waits is decoded after the last message has come.
      let seen = -1;
      const timer = setInterval(() => {
        if (isOver && shown.length === seen) {
          clearInterval(timer);
          session.close();
          resolve(shown);
        }
        seen = shown.length;
      }, 300);
    });
  }, address);
  assert.ok(output.frames > 5, `${output.frames} frames were recorded`);
  assert.equal(seqs.length, output.frames);
  assert.deepEqual(
    seqs,
    [...seqs].sort((a, b) => a - b),
  );
});

test("nothing was wrong on the console", () => {
  assert.deepEqual(bench.consoleErrors, []);
});

/** The example and the package in one script. */
async function bundle() {
  const { outputFiles } = await build({
    stdin: {
      contents: 'export * from "./examples/three.js"; export * from "steadymesh";',
      resolveDir: client,
    },
    bundle: true,
    format: "esm",
    target: "es2022",
    write: false,
    nodePaths: [packages],
    alias: { steadymesh: join(client, "src/index.ts") },
    plugins: [
      {
        name: "worker-source",
        setup({ onResolve, onLoad }) {
          onResolve({ filter: /^worker-source$/ }, ({ path }) => ({ path, namespace: "worker" }));
          onLoad({ filter: /.*/, namespace: "worker" }, async () => ({
            contents: await bundleWorker(build, [packages]),
            loader: "text",
          }));
        },
      },
    ],
  });
  return outputFiles[0].text;
}
