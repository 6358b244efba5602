/** Streams with images: they lie on the mesh the right way round, and each is fetched once. */

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { deflateSync } from "node:zlib";
import { centersOf, screenshot } from "./pixels.mjs";
import { Bench, eventually, frameAfter, frameNumber, PATIENCE_MS, stat } from "./support.mjs";

const RED = [230, 20, 20];
const GREEN = [20, 230, 20];
const BLUE = [20, 20, 230];
const GRAY = [120, 120, 120];
const CELLS = 24;

/** As they are seen: two above, two below. */
const FIRST = [RED, GREEN, BLUE, GRAY];
const SECOND = [BLUE, GRAY, RED, GREEN];

let bench;
let page;
const fetched = [];

before(async () => {
  bench = await Bench.open({ settings: '[recordings]\nurl = "file://FOLDER/recordings"\n' });
  const config = { target_faces: 4000, tracking: "off", record: "output" };
  await fetch(`${bench.url}/v1/streams/sheet`, { method: "PUT", body: JSON.stringify(config) });
  await send(FIRST);
  page = await bench.page("/watch/sheet?rotate=0", { width: 860, height: 640 });
  page.on("request", (request) => {
    if (request.url().includes("/textures/")) fetched.push(request.url());
  });
  await frameNumber(page);
});

after(() => bench?.close());

test("the image lies on the mesh, its upper left corner at the upper left", async () => {
  await eventually(standsRight);
  assert.equal(await stat(page, "texture"), "64×64");
});

test("another image takes its place, and one that comes again is not fetched again", async () => {
  const seq = await frameNumber(page);
  await send(SECOND);
  await frameAfter(page, seq);
  await eventually(async () => {
    const second = await centersOf(bench.browser, await screenshot(page));
    assert.ok(second.blue.y < second.red.y, "blue is not above red");
  });
  for (let i = 0; i < 4; i += 1) await send(SECOND);
  await frameAfter(page, seq + 4);
  assert.equal(new Set(fetched).size, fetched.length, `fetched again: ${fetched}`);
});

test("many images leave nothing behind on the graphics card", async () => {
  const count = () => page.locator(".view-canvas").getAttribute("data-textures");
  const before = await count();
  const seq = await frameNumber(page);
  for (let i = 0; i < 30; i += 1) await send([[i * 8, 0, 0], ...SECOND.slice(1)]);
  await frameAfter(page, seq + 29);
  await eventually(async () => assert.equal(await count(), before));
});

test("a held frame has the image of its time", async () => {
  await page.keyboard.press("Space");
  await page.keyboard.press("Home");
  await page.waitForFunction(
    () => document.querySelector("[data-stat=seq]")?.textContent === "0",
    null,
    { timeout: PATIENCE_MS },
  );
  await eventually(standsRight);
});

test("colour is one of the views: shaded, it is clay", async () => {
  await page.keyboard.press("2");
  await eventually(async () => {
    const clay = await centersOf(bench.browser, await screenshot(page));
    assert.equal(clay.red.count + clay.green.count + clay.blue.count, 0);
  });
});

test("a recording has its images, too", async () => {
  const { id } = await bench.endRecorded("sheet");
  await page.goto(`${bench.url}/watch/sheet?recording=${id}&rotate=0`);
  await frameNumber(page);
  await page.keyboard.press("Space");
  await page.keyboard.press("Home");
  await eventually(standsRight);
});

test("nothing was wrong on the console", () => {
  assert.deepEqual(bench.consoleErrors, []);
});

/** The colours of the upper left, upper right and lower left quarter. */
async function standsRight() {
  const { red, green, blue } = await centersOf(bench.browser, await screenshot(page));
  for (const { count } of [red, green, blue])
    assert.ok(count > 1000, `${count} pixels of a colour`);
  assert.ok(red.x < green.x, "left and right are the wrong way round");
  assert.ok(red.y < blue.y, "above and below are the wrong way round");
}

/** One frame: an upright sheet with this image. */
async function send(quarters) {
  const form = new FormData();
  form.append("mesh", new Blob([sheet()], { type: "model/obj" }), "sheet.obj");
  form.append("texture", new Blob([png(quarters)], { type: "image/png" }), "sheet.png");
  const sent = await fetch(`${bench.url}/v1/streams/sheet/frames`, {
    method: "POST",
    headers: { Prefer: "wait" },
    body: form,
  });
  assert.equal(sent.status, 200, await sent.text());
}

/** A square in the plane z = 0, a little wavy. It faces the viewer; v goes up. */
function sheet() {
  const lines = [];
  for (let y = 0; y <= CELLS; y += 1) {
    for (let x = 0; x <= CELLS; x += 1) {
      const [u, v] = [x / CELLS, y / CELLS];
      lines.push(`v ${u} ${v} ${0.03 * Math.sin(u * 9) * Math.cos(v * 7)}`, `vt ${u} ${v}`);
    }
  }
  for (let y = 0; y < CELLS; y += 1) {
    for (let x = 0; x < CELLS; x += 1) {
      const a = y * (CELLS + 1) + x + 1;
      const corners = [a, a + 1, a + CELLS + 2, a + CELLS + 1].map((i) => `${i}/${i}`);
      lines.push(`f ${corners.join(" ")}`);
    }
  }
  return `${lines.join("\n")}\n`;
}

/** 64 x 64 pixels of four colours. */
function png(quarters) {
  const size = 64;
  const rows = Buffer.alloc(size * (1 + size * 3));
  for (let y = 0; y < size; y += 1) {
    for (let x = 0; x < size; x += 1) {
      const quarter = (y < size / 2 ? 0 : 2) + (x < size / 2 ? 0 : 1);
      rows.set(quarters[quarter], y * (1 + size * 3) + 1 + x * 3);
    }
  }
  const header = Buffer.alloc(13);
  header.writeUInt32BE(size, 0);
  header.writeUInt32BE(size, 4);
  header.set([8, 2, 0, 0, 0], 8);
  return Buffer.concat([
    Buffer.from([0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a]),
    chunk("IHDR", header),
    chunk("IDAT", deflateSync(rows)),
    chunk("IEND", Buffer.alloc(0)),
  ]);
}

function chunk(name, data) {
  const body = Buffer.concat([Buffer.from(name), data]);
  const frame = Buffer.alloc(8);
  frame.writeUInt32BE(data.length, 0);
  frame.writeUInt32BE(checksum(body), 4);
  return Buffer.concat([frame.subarray(0, 4), body, frame.subarray(4)]);
}

/** CRC-32, as PNG has it. */
function checksum(bytes) {
  let crc = 0xffffffff;
  for (const byte of bytes) {
    crc ^= byte;
    for (let bit = 0; bit < 8; bit += 1) crc = (crc >>> 1) ^ (crc & 1 ? 0xedb88320 : 0);
  }
  return (crc ^ 0xffffffff) >>> 0;
}
