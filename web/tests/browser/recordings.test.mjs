/** Recordings in the player: the list, playback, pause, steps, seeking and speed. */

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { setTimeout as delay } from "node:timers/promises";
import { Bench, frameAfter, frameNumber, PATIENCE_MS, statusBecomes, stop } from "./support.mjs";

const FRAMES = 24;

let bench;
let page;

before(async () => {
  bench = await Bench.open({ settings: '[recordings]\nurl = "file://FOLDER/recordings"\n' });
  const rig = await bench.publish("demo", { config: { record: "output" }, fps: 5 });
  const deadline = Date.now() + PATIENCE_MS;
  for (;;) {
    const { latest_seq: latest } = await (await fetch(`${bench.url}/v1/streams/demo`)).json();
    if (latest >= FRAMES) break;
    assert.ok(Date.now() < deadline, "the stream does not come");
    await delay(200);
  }
  await stop(rig);
  await bench.endRecorded("demo");
});

after(() => bench?.close());

test("the list of recordings has a picture and leads to the recording", async () => {
  page = await bench.page("/#recordings", { width: 700, height: 560 });
  const card = page.locator('a[href^="/watch/demo?recording="]');
  await card.locator(".picture.drawn").waitFor({ timeout: PATIENCE_MS });
  assert.match(await card.textContent(), /complete/);
  await card.click();
  await frameNumber(page);
});

test("a recording is played to its end, and again from its beginning", async () => {
  await page.getByRole("combobox", { name: "Speed" }).selectOption("4");
  await statusBecomes(page, "At the end");
  // It is known that no more will come before the last that has come is drawn.
  await page.waitForFunction(
    (frames) => Number(document.querySelector("[data-stat=seq]")?.textContent) >= frames,
    FRAMES,
    { timeout: PATIENCE_MS },
  );
  const last = await frameNumber(page);
  await page.getByRole("button", { name: "Play", exact: true }).click();
  await page.waitForFunction(
    (end) => Number(document.querySelector("[data-stat=seq]")?.textContent) < end,
    last,
    { timeout: PATIENCE_MS },
  );
});

test("it pauses, steps frame by frame and is sought", async () => {
  await page.locator(".view-canvas").focus();
  await page.keyboard.press("Home");
  await page.getByRole("combobox", { name: "Speed" }).selectOption("0.5");
  await page.getByRole("button", { name: "Pause" }).click();
  await statusBecomes(page, "Paused");
  await delay(600);
  const seq = await frameNumber(page);
  await delay(800);
  assert.equal(await frameNumber(page), seq);
  await page.keyboard.press(".");
  assert.equal(await frameAfter(page, seq), seq + 1);
  await page.keyboard.press(",");
  await shows(seq);
  const timeline = page.getByRole("slider", { name: "Position" });
  const { x, y, width, height } = await timeline.boundingBox();
  await page.mouse.click(x + width * 0.75, y + height / 2);
  const sought = await frameAfter(page, FRAMES / 2);
  assert.ok(sought < FRAMES, `frame ${sought} is at three quarters`);
  await statusBecomes(page, "Paused");
  assert.match(await page.locator(".place").textContent(), /^\d:\d\d\.\d \/ \d:\d\d\.\d$/);
});

test("nothing was wrong on the console", () => {
  assert.deepEqual(bench.consoleErrors, []);
});

async function shows(seq) {
  await page.waitForFunction(
    (wanted) => Number(document.querySelector("[data-stat=seq]")?.textContent) === wanted,
    seq,
    { timeout: PATIENCE_MS },
  );
}
