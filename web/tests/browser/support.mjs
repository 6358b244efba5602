/**
 * What the browser's tests have in common: a server with streams, a browser, and what a page shows.
 *
 * STEADYMESH_BIN is the server binary, which has the page in it; with STEADYMESH_PAGE=dist the page
 * comes from that folder, so that it can be tested without building the server again. CHROMIUM is
 * the browser, by default /usr/bin/chromium.
 */

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { once } from "node:events";
import { mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { createServer } from "node:net";
import { tmpdir } from "node:os";
import { extname, join } from "node:path";
import { setTimeout as delay } from "node:timers/promises";
import { chromium } from "playwright-core";

const { STEADYMESH_BIN, STEADYMESH_PAGE } = process.env;
const CHROMIUM = process.env.CHROMIUM ?? "/usr/bin/chromium";
/** Software rendering, so that the tests need no graphics card and see the same everywhere. */
const CHROMIUM_ARGUMENTS = [
  "--no-sandbox",
  "--disable-background-networking",
  "--use-gl=angle",
  "--use-angle=swiftshader",
  "--enable-unsafe-swiftshader",
  "--enable-precise-memory-info",
  "--js-flags=--expose-gc",
];
/** A page that no server has sent may not reach one on this machine. */
const FROM_FOLDER = ["--disable-features=LocalNetworkAccessChecks"];
const READY_MS = 20_000;
export const PATIENCE_MS = 30_000;
export const DESKTOP = { width: 1200, height: 760 };
export const PHONE = { width: 390, height: 844 };

/** As `src/server/player.rs` sends it. */
const POLICY =
  "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src blob:; connect-src 'self'; " +
  "style-src 'self'; img-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

const TYPES = {
  ".html": "text/html; charset=utf-8",
  ".js": "text/javascript",
  ".css": "text/css",
  ".svg": "image/svg+xml",
  ".wasm": "application/wasm",
};

/** A server, the rigs that publish to it, and a browser. */
export class Bench {
  /** What pages have complained of. */
  consoleErrors = [];
  #running = new Set();
  #settings;
  #folder;

  /** `settings` go into the server's configuration, in TOML. */
  static async open({ settings = "" } = {}) {
    assert.ok(STEADYMESH_BIN, "Set STEADYMESH_BIN to the binary, such as target/debug/steadymesh.");
    const bench = new Bench();
    bench.#settings = settings;
    bench.#folder = await mkdtemp(join(tmpdir(), "steadymesh-page-"));
    bench.port = await freePort();
    bench.internalPort = await freePort();
    await bench.startServer();
    bench.browser = await chromium.launch({
      executablePath: CHROMIUM,
      args: [...CHROMIUM_ARGUMENTS, ...(STEADYMESH_PAGE === undefined ? [] : FROM_FOLDER)],
    });
    return bench;
  }

  async close() {
    await this.browser?.close();
    await Promise.all([...this.#running].map(stop));
    await rm(this.#folder, { recursive: true, force: true });
  }

  get url() {
    return `http://127.0.0.1:${this.port}`;
  }

  async startServer() {
    const file = join(this.#folder, "steadymesh.toml");
    await writeFile(file, this.#settings.replaceAll("FOLDER", this.#folder));
    this.server = this.#start([
      "serve",
      ...["--config", file],
      ...["--listen", `127.0.0.1:${this.port}`],
      ...["--internal-listen", `127.0.0.1:${this.internalPort}`],
    ]);
    await untilReady(`http://127.0.0.1:${this.internalPort}/readyz`, this.server);
  }

  /** A stream and a rig; the animated figure unless there are `paths` of frames. */
  async publish(stream, { config = {}, fps = 10, paths = ["--synthetic"], token } = {}) {
    const url = `${this.url}/v1/streams/${stream}`;
    const headers = token === undefined ? {} : { Authorization: `Bearer ${token}` };
    const made = await fetch(url, { method: "PUT", headers, body: JSON.stringify(config) });
    assert.ok(made.ok, `the stream was not made: ${made.status} ${await made.text()}`);
    const environment = token === undefined ? {} : { STEADYMESH_TOKEN: token };
    return this.#start(["publish", url, ...paths, "--fps", String(fps), "--loop"], environment);
  }

  /** Deletes a stream; its recording once nothing more will be added to it. */
  async endRecorded(stream) {
    const deleted = await fetch(`${this.url}/v1/streams/${stream}`, { method: "DELETE" });
    assert.equal(deleted.status, 204);
    const deadline = Date.now() + PATIENCE_MS;
    for (;;) {
      const { recordings } = await (await fetch(`${this.url}/v1/recordings`)).json();
      const [recording] = recordings.filter((one) => one.stream === stream);
      if (recording?.state === "complete") return recording;
      assert.ok(Date.now() < deadline, `the recording does not end: ${recording?.state}`);
      await delay(100);
    }
  }

  /** A page whose complaints are kept. */
  async page(path, viewport = DESKTOP, options = {}) {
    const context = await this.browser.newContext({ viewport, ...options });
    const page = await context.newPage();
    page.on("console", (message) => {
      if (message.type() === "error") this.consoleErrors.push(message.text());
    });
    page.on("pageerror", (error) => this.consoleErrors.push(String(error)));
    if (STEADYMESH_PAGE !== undefined) {
      await page.route(
        ({ pathname }) => !pathname.startsWith("/v1/"),
        (route) => fulfil(route, STEADYMESH_PAGE),
      );
    }
    await page.goto(`${this.url}${path}`);
    return page;
  }

  #start(parameters, environment = {}) {
    const child = spawn(STEADYMESH_BIN, parameters, {
      stdio: ["ignore", "ignore", "pipe"],
      env: { ...process.env, ...environment },
    });
    child.said = "";
    child.stderr.on("data", (chunk) => {
      child.said = (child.said + chunk).slice(-4000);
    });
    this.#running.add(child);
    child.once("exit", () => this.#running.delete(child));
    return child;
  }
}

/** Answers from a folder as the server answers from its binary. */
async function fulfil(route, folder) {
  const { pathname } = new URL(route.request().url());
  const file = extname(pathname) === "" ? "index.html" : pathname;
  const body = await readFile(join(folder, file)).catch(() => null);
  if (body === null) return route.continue();
  const headers = { "Content-Type": TYPES[extname(file)] ?? "application/octet-stream" };
  if (file === "index.html") headers["Content-Security-Policy"] = POLICY;
  return route.fulfill({ body, headers });
}

/** Asks the process to end and waits until it has. */
export async function stop(child) {
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

/** Checks until it holds, however long a loaded machine takes; fails as the check did last. */
export async function eventually(check) {
  const deadline = Date.now() + PATIENCE_MS;
  for (;;) {
    try {
      return await check();
    } catch (error) {
      if (Date.now() > deadline) throw error;
    }
    await delay(100);
  }
}

export function stat(page, name) {
  return page.locator(`[data-stat=${name}]`).textContent();
}

/** The number of the frame that is shown, once there is one. */
export function frameNumber(page) {
  return frameAfter(page, -1);
}

/** Waits for a frame beyond `seq` and returns its number. */
export async function frameAfter(page, seq, patienceMs = PATIENCE_MS) {
  const number = await page.waitForFunction(
    (least) => {
      const text = document.querySelector("[data-stat=seq]")?.textContent ?? "";
      const shown = Number(text.replaceAll(",", "") || Number.NaN);
      // In an object, because frame 0 would not count as true.
      return shown > least ? { shown } : null;
    },
    seq,
    { timeout: patienceMs },
  );
  return (await number.jsonValue()).shown;
}

export async function statusBecomes(page, text) {
  const wanted = page.locator(".bar [role=status]", { hasText: text });
  await wanted.waitFor({ timeout: PATIENCE_MS });
}
