/**
 * The watch page against the real server, in a real browser: `npm run test:browser`.
 *
 * STEADYMESH_BIN is the server binary (built after `npm run build`, which it embeds); CHROMIUM is
 * the browser, by default /usr/bin/chromium.
 */

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { once } from "node:events";
import { createServer } from "node:net";
import { after, before, test } from "node:test";
import { setTimeout as delay } from "node:timers/promises";
import { chromium } from "playwright-core";

const BINARY = process.env.STEADYMESH_BIN;
const CHROMIUM = process.env.CHROMIUM ?? "/usr/bin/chromium";
/** Software rendering, so that the test needs no graphics card and sees the same everywhere. */
const CHROMIUM_ARGUMENTS = [
  "--no-sandbox",
  "--disable-background-networking",
  "--use-gl=angle",
  "--use-angle=swiftshader",
  "--enable-unsafe-swiftshader",
];
const READY_MS = 20_000;
const PATIENCE_MS = 30_000;

/** Channel differences up to this are noise of the rasterizer. */
const VISIBLE_DIFFERENCE = 24;

const running = new Set();
const consoleErrors = [];
let browser;
let page;
let inspector;
let ports;
let server;
let publisher;

before(async () => {
  assert.ok(
    BINARY,
    "Set STEADYMESH_BIN to the steadymesh binary, such as target/debug/steadymesh.",
  );
  ports = { api: await freePort(), internal: await freePort() };
  await startStream();
  browser = await chromium.launch({ executablePath: CHROMIUM, args: CHROMIUM_ARGUMENTS });
  page = await browser.newPage({ viewport: { width: 1000, height: 700 } });
  // Screenshots are decoded in a page of its own: the player's policy would not let them in.
  inspector = await browser.newPage();
  await page.bringToFront();
  page.on("console", (message) => {
    if (message.type() === "error") consoleErrors.push(message.text());
  });
  page.on("pageerror", (error) => consoleErrors.push(String(error)));
  await page.goto(`http://127.0.0.1:${ports.api}/watch/demo?rotate=0`);
});

after(async () => {
  await browser?.close();
  await Promise.all([...running].map(stop));
});

test("the frame counter advances", async () => {
  const first = await frameNumber();
  assert.ok((await frameAfter(first + 2)) > first);
});

test("the mesh is drawn and moves with the frames", async () => {
  const seq = await frameNumber();
  const earlier = await screenshot();
  await frameAfter(seq + 5);
  const { meshPixels, changedPixels, pixels } = await compare(earlier, await screenshot());
  assert.ok(meshPixels > pixels * 0.01, `${meshPixels} of ${pixels} pixels show the mesh`);
  assert.ok(changedPixels > 100, `${changedPixels} of ${pixels} pixels changed`);
});

test("the numbers are shown with their units", async () => {
  await page.waitForFunction(
    () => Number.parseFloat(document.querySelector("[data-stat=fps]")?.textContent ?? "") > 0,
  );
  assert.match(await stat("fps"), /^\d+\.\d fps$/);
  assert.match(await stat("bytes"), /^[\d.]+ (B|kB|MB)$/);
  assert.match(await stat("bitrate"), /^[\d.]+ [kMG]?bit\/s$/);
  assert.match(await stat("latency"), /^[\d.]+ (µs|ms|s)$/);
  assert.match(await stat("faces"), /^[\d,]+$/);
});

test("the plots have a line for each distance and for each kind of persistence", async () => {
  const counts = await page.locator(".plot-canvas").evaluateAll((canvases) => {
    const style = getComputedStyle(document.documentElement);
    const names = [
      ["--previous", "--current"],
      ["--vertices", "--edges"],
    ];
    return canvases.flatMap((canvas, plot) => {
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      return names[plot].map((name) => {
        const color = Number.parseInt(style.getPropertyValue(name).trim().slice(1), 16);
        const wanted = [color >> 16, (color >> 8) & 255, color & 255];
        let count = 0;
        for (let i = 0; i < data.length; i += 4) {
          if (wanted.every((value, channel) => Math.abs(data[i + channel] - value) < 32))
            count += 1;
        }
        return count;
      });
    });
  });
  assert.equal(counts.length, 4);
  assert.ok(
    counts.every((count) => count > 10),
    `${counts} pixels of the four lines`,
  );
});

test("a paused page stands still, and the wireframe toggle changes it", async () => {
  await page.keyboard.press("Space");
  // The frame that was being decoded may still appear.
  await delay(1000);
  const still = await screenshot();
  await delay(500);
  const paused = await screenshot();
  assert.equal((await compare(still, paused)).changedPixels, 0);

  const wireframe = page.locator("[data-toggle=wireframe]");
  await page.keyboard.press("w");
  assert.equal(await wireframe.getAttribute("aria-pressed"), "true");
  await delay(500);
  const edges = await compare(paused, await screenshot());
  assert.ok(edges.changedPixels > 500, `edges changed ${edges.changedPixels} pixels`);

  await wireframe.click();
  assert.equal(await wireframe.getAttribute("aria-pressed"), "false");
  const seq = await frameNumber();
  await page.locator("[data-toggle=pause]").click();
  assert.ok((await frameAfter(seq)) > seq, "frames go on after the pause");
});

test("the list of streams leads to the stream", async () => {
  const list = await browser.newPage();
  await list.goto(`http://127.0.0.1:${ports.api}/`);
  await list.locator('a[href="/watch/demo"]').waitFor({ timeout: PATIENCE_MS });
  await list.close();
  await page.bringToFront();
});

test("nothing was wrong on the console", () => {
  assert.deepEqual(consoleErrors, []);
});

test("the page reconnects once the server is back", async () => {
  // From a fresh page, whatever the tests before left pressed.
  await page.reload();
  await frameNumber();
  await stop(publisher);
  await stop(server);
  await statusBecomes("Reconnecting");
  await startStream();
  await statusBecomes("Live");
});

async function startStream() {
  const { api, internal } = ports;
  server = start([
    "serve",
    ...["--listen", `127.0.0.1:${api}`],
    ...["--internal-listen", `127.0.0.1:${internal}`],
  ]);
  await untilReady(`http://127.0.0.1:${internal}/readyz`, server);
  const url = `http://127.0.0.1:${api}/v1/streams/demo`;
  // The mode that says what has come back of the frame before.
  const made = await fetch(url, { method: "PUT", body: '{"tracking": "robust"}' });
  assert.ok(made.ok, `the stream was not made: ${made.status}`);
  publisher = start(["publish", url, "--synthetic", "--fps", "10", "--loop"]);
}

function start(parameters) {
  const child = spawn(BINARY, parameters, { stdio: ["ignore", "ignore", "pipe"] });
  child.said = "";
  child.stderr.on("data", (chunk) => {
    child.said = (child.said + chunk).slice(-4000);
  });
  running.add(child);
  child.once("exit", () => running.delete(child));
  return child;
}

/** Asks the process to end and waits until it has. */
async function stop(child) {
  if (child.exitCode !== null || child.signalCode !== null) return;
  const ended = once(child, "exit");
  child.kill("SIGTERM");
  await ended;
}

async function untilReady(url, child) {
  const deadline = Date.now() + READY_MS;
  while (Date.now() < deadline) {
    assert.equal(child.exitCode, null, `the server ended at once: ${child.said}`);
    const response = await fetch(url).catch(() => null);
    if (response?.ok) return;
    await delay(100);
  }
  assert.fail(`${url} was not ready after ${READY_MS} ms: ${child.said}`);
}

async function freePort() {
  const probe = createServer().listen(0, "127.0.0.1");
  await once(probe, "listening");
  const { port } = probe.address();
  probe.close();
  await once(probe, "close");
  return port;
}

function stat(name) {
  return page.locator(`[data-stat=${name}]`).textContent();
}

/** The number of the frame that is shown, once there is one. */
function frameNumber() {
  return frameAfter(-1);
}

/** Waits for a frame beyond `seq` and returns its number. */
async function frameAfter(seq) {
  const number = await page.waitForFunction(
    (least) => {
      const text = document.querySelector("[data-stat=seq]")?.textContent ?? "";
      const shown = Number(text.replaceAll(",", "") || Number.NaN);
      // In an object, because frame 0 would not count as true.
      return shown > least ? { shown } : null;
    },
    seq,
    { timeout: PATIENCE_MS },
  );
  return (await number.jsonValue()).shown;
}

async function statusBecomes(text) {
  const wanted = page.locator("[role=status]", { hasText: text });
  await wanted.waitFor({ timeout: PATIENCE_MS });
}

/** The middle of the view, without the buttons and the title over it. */
async function screenshot() {
  const { x, y, width, height } = await page.locator(".view-canvas").boundingBox();
  const clip = {
    x: x + width * 0.2,
    y: y + height * 0.1,
    width: width * 0.6,
    height: height * 0.75,
  };
  return (await page.screenshot({ clip })).toString("base64");
}

/**
 * Counts pixels. The lit mesh is bright in every channel (the floor is green on near black);
 * changed pixels differ visibly between the two screenshots.
 */
function compare(first, second) {
  return inspector.evaluate(
    async ([images, visible]) => {
      const [a, b] = await Promise.all(
        images.map(async (base64) => {
          const image = new Image();
          image.src = `data:image/png;base64,${base64}`;
          await image.decode();
          const canvas = new OffscreenCanvas(image.width, image.height);
          const context = canvas.getContext("2d");
          context.drawImage(image, 0, 0);
          return context.getImageData(0, 0, image.width, image.height).data;
        }),
      );
      const counts = { pixels: b.length / 4, meshPixels: 0, changedPixels: 0 };
      for (let i = 0; i < b.length; i += 4) {
        if (Math.min(b[i], b[i + 1], b[i + 2]) > 70) counts.meshPixels += 1;
        const changed = [0, 1, 2].some(
          (channel) => Math.abs(a[i + channel] - b[i + channel]) > visible,
        );
        if (changed) counts.changedPixels += 1;
      }
      return counts;
    },
    [[first, second], VISIBLE_DIFFERENCE],
  );
}
