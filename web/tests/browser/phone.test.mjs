/** The player on a phone: nothing is cut off, and fingers do what they should. */

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { compare, screenshot, stillScreenshot } from "./pixels.mjs";
import { Bench, eventually, frameNumber, PHONE, statusBecomes } from "./support.mjs";

const TOUCH = { hasTouch: true, isMobile: true };
/** A fingertip, in CSS pixels. */
const LEAST_TARGET = 36;

let bench;
let page;

before(async () => {
  bench = await Bench.open();
  await bench.publish("demo", { fps: 4 });
  page = await bench.page("/watch/demo?rotate=0", PHONE, TOUCH);
  await frameNumber(page);
});

after(() => bench?.close());

test("nothing is wider than the screen, and the mesh and its controls are on it", async () => {
  const { scrollWidth, clientWidth } = await sizes(page);
  assert.ok(scrollWidth <= clientWidth, `${scrollWidth} of ${clientWidth} pixels`);
  for (const selector of [".view-canvas", ".transport", ".modes", ".tools"]) {
    const { x, y, width, height } = await page.locator(selector).boundingBox();
    assert.ok(x >= 0 && x + width <= PHONE.width, `${selector} from ${x} to ${x + width}`);
    assert.ok(y + height <= PHONE.height, `${selector} ends at ${y + height}`);
  }
});

test("every control is large enough for a finger and has a name", async () => {
  const controls = await page
    .locator("button:visible, select:visible, a:visible, .modes label:visible")
    .evaluateAll((nodes) =>
      nodes.map((node) => {
        const { width, height } = node.getBoundingClientRect();
        const name = node.ariaLabel ?? node.textContent?.trim();
        return { name, least: Math.min(width, height), tag: node.tagName };
      }),
    );
  assert.ok(controls.length >= 12, `${controls.length} controls`);
  for (const { name, least, tag } of controls) {
    assert.ok(name, `a ${tag} has no name`);
    if (tag !== "A") assert.ok(least >= LEAST_TARGET, `${name} is ${least} pixels small`);
  }
});

test("a finger pauses and turns the mesh, two come nearer", async () => {
  await page.getByRole("button", { name: "Pause" }).tap();
  await statusBecomes(page, "Paused");
  const still = await stillScreenshot(page);
  const devtools = await page.context().newCDPSession(page);
  const touch = (type, ...points) =>
    devtools.send("Input.dispatchTouchEvent", {
      type,
      touchPoints: points.map(([x, y]) => ({ x, y })),
    });
  await touch("touchStart", [150, 250]);
  for (let i = 1; i <= 6; i += 1) await touch("touchMove", [150 + i * 15, 250]);
  await touch("touchEnd");
  await eventually(async () => {
    const { changed } = await compare(bench.browser, still, await screenshot(page));
    assert.ok(changed > 300, `turning changed ${changed} pixels`);
  });
  const turned = await stillScreenshot(page);

  await touch("touchStart", [180, 250], [210, 250]);
  for (let i = 1; i <= 6; i += 1)
    await touch("touchMove", [180 - i * 10, 250], [210 + i * 10, 250]);
  await touch("touchEnd");
  const { bright } = await compare(bench.browser, still, turned);
  await eventually(async () => {
    const near = await compare(bench.browser, turned, await screenshot(page));
    assert.ok(near.bright > bright * 1.2, `${near.bright} instead of ${bright} pixels of the mesh`);
  });
});

test("the list fits, too", async () => {
  const list = await bench.page("/", PHONE, TOUCH);
  await list.locator('a[href="/watch/demo"]').waitFor();
  const { scrollWidth, clientWidth } = await sizes(list);
  assert.ok(scrollWidth <= clientWidth, `${scrollWidth} of ${clientWidth} pixels`);
  await list.context().close();
});

test("nothing was wrong on the console", () => {
  assert.deepEqual(bench.consoleErrors, []);
});

function sizes(onPage) {
  return onPage.evaluate(() => {
    const { scrollWidth, clientWidth } = document.documentElement;
    return { scrollWidth, clientWidth };
  });
}
