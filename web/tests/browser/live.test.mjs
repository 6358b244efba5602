/** A live stream in the player: playback, pause, seeking, keys, views and a second stream. */

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { setTimeout as delay } from "node:timers/promises";
import { compare, screenshot, stillScreenshot } from "./pixels.mjs";
import {
  Bench,
  eventually,
  frameAfter,
  frameNumber,
  PATIENCE_MS,
  stat,
  statusBecomes,
} from "./support.mjs";

let bench;
let page;

before(async () => {
  bench = await Bench.open();
  // The mode that says what has come back of the frame before.
  await bench.publish("demo-robust", { config: { tracking: "robust" }, fps: 4 });
  page = await bench.page("/watch/demo-robust?rotate=0");
});

after(() => bench?.close());

test("frames come and the mesh moves with them", async () => {
  const seq = await frameAfter(page, 2);
  const earlier = await screenshot(page);
  await frameAfter(page, seq + 3);
  const { bright, changed, pixels } = await compare(bench.browser, earlier, await screenshot(page));
  assert.ok(bright > pixels * 0.01, `${bright} of ${pixels} pixels show the mesh`);
  assert.ok(changed > 100, `${changed} of ${pixels} pixels changed`);
});

test("the numbers are shown with their units", async () => {
  await page.waitForFunction(
    () => Number.parseFloat(document.querySelector("[data-stat=fps]")?.textContent ?? "") > 0,
  );
  assert.match(await stat(page, "fps"), /^\d+\.\d fps$/);
  assert.match(await stat(page, "bytes"), /^[\d.]+ (B|kB|MB)$/);
  assert.match(await stat(page, "bitrate"), /^[\d.]+ [kMG]?bit\/s$/);
  assert.match(await stat(page, "latency"), /^[\d.]+ (µs|ms|s)$/);
  assert.match(await stat(page, "endToEnd"), /^[\d.]+ (ms|s)$/);
  assert.match(await stat(page, "buffer"), /^[\d.]+ (µs|ms)$/);
  assert.match(await stat(page, "faces"), /^[\d,]+$/);
  assert.match(await stat(page, "dropped"), /^[\d,]+$/);
});

test("the plots have a line for each distance and for each kind of persistence", async () => {
  await frameAfter(page, 4);
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
          const same = wanted.every((value, channel) => Math.abs(data[i + channel] - value) < 32);
          if (same) count += 1;
        }
        return count;
      });
    });
  });
  assert.equal(counts.length, 4);
  const drawn = counts.every((count) => count > 10);
  assert.ok(drawn, `${counts} pixels of the four lines`);
});

test("a paused page stands still, and each kind of surface looks different", async () => {
  await page.keyboard.press("Space");
  await statusBecomes(page, "Paused");
  const still = await stillScreenshot(page);
  const seq = await frameNumber(page);
  await delay(1000);
  const later = await screenshot(page);
  assert.equal((await compare(bench.browser, still, later)).changed, 0);
  assert.equal(await frameNumber(page), seq);

  let before = later;
  for (const [key, mode] of [
    ["3", "normals"],
    ["4", "change"],
    ["2", "shaded"],
  ]) {
    await page.keyboard.press(key);
    await eventually(() => changes(before, 500, mode));
    assert.ok(await page.locator(`[data-mode=${mode}]`).isChecked());
    before = await stillScreenshot(page);
  }
  const wireframe = page.locator("[data-toggle=wireframe]");
  await page.keyboard.press("w");
  assert.equal(await wireframe.getAttribute("aria-pressed"), "true");
  await eventually(() => changes(before, 500, "edges"));
  await wireframe.click();
  assert.equal(await wireframe.getAttribute("aria-pressed"), "false");
  await page.keyboard.press("1");
});

test("frames are stepped through, sought and played again, and the live edge is found", async () => {
  const seq = await frameNumber(page);
  await page.keyboard.press(",");
  await shows((shown) => shown < seq, "a frame before");
  await page.keyboard.press(".");
  await shows((shown) => shown === seq, "the same frame again");
  // From the page's beginning on, and before: this one was not here when it came.
  await page.keyboard.press("Home");
  await shows((shown) => shown < 3, "the oldest frame");
  assert.ok((await frameNumber(page)) < seq);
  const timeline = page.getByRole("slider", { name: "Position" });
  const { x, y, width, height } = await timeline.boundingBox();
  await page.mouse.click(x + width / 2, y + height / 2);
  const middle = await shows((shown) => shown > 2, "a frame in the middle");
  await page.getByRole("button", { name: "Play", exact: true }).click();
  await shows((shown) => shown > middle, "the frames behind it");
  await statusBecomes(page, "Behind");
  await page.getByRole("button", { name: "Live", exact: true }).click();
  await statusBecomes(page, "Live");
  const newest = await frameNumber(page);
  assert.ok(newest > seq, `${newest} is the newest`);
  await frameAfter(page, newest);
});

test("a slower speed leaves the live edge behind", async () => {
  await page.getByRole("combobox", { name: "Speed" }).selectOption("0.25");
  await statusBecomes(page, "Behind");
  const seq = await frameNumber(page);
  await frameAfter(page, seq);
  await page.locator(".view-canvas").focus();
  await page.keyboard.press("End");
  await statusBecomes(page, "Live");
});

test("the mesh turns and comes nearer by keys and by the pointer, and the view is reset", async () => {
  const canvas = page.locator(".view-canvas");
  await canvas.focus();
  await page.keyboard.press("Space");
  await statusBecomes(page, "Paused");
  // A frame that was asked for before may still come.
  await stillScreenshot(page);
  await page.keyboard.press("r");
  const fitted = await stillScreenshot(page);
  const differs = async (what) => {
    await eventually(() => changes(fitted, 300, what));
    await page.keyboard.press("r");
    await eventually(async () => {
      const reset = await compare(bench.browser, fitted, await screenshot(page));
      assert.ok(reset.changed < 50, `${reset.changed} pixels are not as they were`);
    });
  };
  for (let i = 0; i < 4; i += 1) await page.keyboard.press("ArrowLeft");
  await differs("turning");
  for (let i = 0; i < 4; i += 1) await page.keyboard.press("+");
  await differs("coming nearer");
  const { x, y, width, height } = await canvas.boundingBox();
  await page.mouse.move(x + width * 0.4, y + height * 0.4);
  await page.mouse.down();
  await page.mouse.move(x + width * 0.6, y + height * 0.4, { steps: 5 });
  await page.mouse.up();
  await differs("dragging");
  await page.mouse.move(x + width * 0.4, y + height * 0.4);
  await page.mouse.down({ button: "right" });
  await page.mouse.move(x + width * 0.5, y + height * 0.4, { steps: 5 });
  await page.mouse.up({ button: "right" });
  await differs("moving");
});

test("the help sheet opens and closes by keys", async () => {
  const sheet = page.getByRole("dialog", { name: "Keys and gestures" });
  await page.keyboard.press("?");
  await sheet.waitFor({ timeout: PATIENCE_MS });
  assert.match(await sheet.textContent(), /Play or pause.*Wireframe.*Full screen/s);
  await page.keyboard.press("Escape");
  await sheet.waitFor({ state: "hidden" });
});

test("the page fills the screen and gives it back", async () => {
  await page.keyboard.press("f");
  await page.waitForFunction(() => document.fullscreenElement !== null);
  await page.keyboard.press("f");
  await page.waitForFunction(() => document.fullscreenElement === null);
});

test("a second stream stands beside the first, follows it, and goes away", async () => {
  await page.locator(".view-canvas").focus();
  await page.keyboard.press("End");
  await bench.publish("demo-off", { config: { tracking: "off" }, fps: 4 });
  const choice = page.getByRole("combobox", { name: "Compare with" });
  await choice.focus();
  await choice.locator("option[value=demo-off]").waitFor({ state: "attached" });
  await choice.selectOption("demo-off");
  const labels = page.locator(".pane-labels span");
  await page.waitForFunction(
    () => document.querySelectorAll(".pane-labels span")[1]?.textContent.includes("off · off"),
    null,
    { timeout: PATIENCE_MS },
  );
  assert.match(await labels.first().textContent(), /demo-robust · robust/);
  assert.match(page.url(), /beside=demo-off/);
  await page.locator(".view-canvas").focus();
  await page.keyboard.press("Space");
  await statusBecomes(page, "Paused");
  const halves = [
    [0.05, 0.48],
    [0.52, 0.9],
  ];
  const still = [];
  for (const half of halves) still.push(await stillScreenshot(page, half));
  await delay(1000);
  for (const [i, half] of halves.entries()) {
    const counts = await compare(bench.browser, still[i], await screenshot(page, half));
    assert.ok(counts.bright > 1000, `${counts.bright} pixels of half ${i} show a mesh`);
    assert.equal(counts.changed, 0, `half ${i} goes on`);
  }
  await page.keyboard.press("End");
  await statusBecomes(page, "Live");
  await choice.selectOption("");
  await labels.first().waitFor({ state: "hidden" });
  assert.doesNotMatch(page.url(), /beside/);
});

test("who comes late sees the newest frame and can go back to what the server holds", async () => {
  const late = await bench.page("/watch/demo-robust?rotate=0");
  const first = await frameNumber(late);
  assert.ok(first > 5, `${first} is not the stream's beginning`);
  await late.keyboard.press("Home");
  await late.waitForFunction(
    () => Number(document.querySelector("[data-stat=seq]")?.textContent) < 3,
    null,
    { timeout: PATIENCE_MS },
  );
  await late.context().close();
});

test("the list shows the streams with pictures, and leads to them", async () => {
  const list = await bench.page("/");
  const card = list.locator('a[href="/watch/demo-robust"]');
  await card.locator(".picture.drawn").waitFor({ timeout: PATIENCE_MS });
  const colors = await card.locator(".picture").evaluate((canvas) => {
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    let bright = 0;
    for (let i = 0; i < data.length; i += 4) if (Math.min(data[i], data[i + 1]) > 90) bright += 1;
    return bright;
  });
  assert.ok(colors > 300, `${colors} bright pixels are in the picture`);
  const pair = list.locator('a[href="/watch/demo-off?beside=demo-robust"]');
  await pair.waitFor({ timeout: PATIENCE_MS });
  await card.click();
  await frameNumber(list);
  await list.context().close();
});

test("nothing was wrong on the console", () => {
  assert.deepEqual(bench.consoleErrors, []);
});

/** Waits until the number of the frame that is shown is right. */
function shows(isRight, what) {
  return eventually(async () => {
    const shown = await frameNumber(page);
    assert.ok(isRight(shown), `frame ${shown} is shown instead of ${what}`);
    return shown;
  });
}

/** More than `least` pixels of the view are not as they were. */
async function changes(before, least, what) {
  const { changed } = await compare(bench.browser, before, await screenshot(page));
  assert.ok(changed > least, `${what} changed ${changed} pixels`);
}
