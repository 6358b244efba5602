/** What screenshots show. */

import assert from "node:assert/strict";
import { setTimeout as delay } from "node:timers/promises";
import { eventually } from "./support.mjs";

/** The middle of the view, without what lies over it; of its width from one share to another. */
export async function screenshot(page, [from, to] = [0.2, 0.8]) {
  const { x, y, width, height } = await page.locator(".view-canvas").boundingBox();
  const clip = {
    x: x + width * from,
    y: y + height * 0.12,
    width: width * (to - from),
    height: height * 0.62,
  };
  return (await page.screenshot({ clip })).toString("base64");
}

/** The view once nothing in it has moved for a while. */
export function stillScreenshot(page, part) {
  return eventually(async () => {
    const first = await screenshot(page, part);
    await delay(500);
    const later = await screenshot(page, part);
    assert.ok(first === later, "the picture does not come to rest");
    return later;
  });
}

/** Channel differences up to this are noise of the rasterizer. */
const VISIBLE_DIFFERENCE = 24;

/**
 * Counts pixels: `changed` differ visibly between the two, `bright` are lit clay in the second one, as
 * the floor is dark.
 */
export async function compare(browser, first, second) {
  const [a, b] = await pixelsOf(browser, [first, second]);
  const counts = { pixels: b.length / 4, bright: 0, changed: 0 };
  for (let i = 0; i < b.length; i += 4) {
    if (Math.min(b[i], b[i + 1], b[i + 2]) > 70) counts.bright += 1;
    const differs = [0, 1, 2].some((at) => Math.abs(a[i + at] - b[i + at]) > VISIBLE_DIFFERENCE);
    if (differs) counts.changed += 1;
  }
  return counts;
}

/** How many pixels are mostly red, green and blue, and where their middle is. */
export async function centersOf(browser, image) {
  const [data, width] = await pixelsOf(browser, [image]);
  const centers = {};
  ["red", "green", "blue"].forEach((name, channel) => {
    const center = { count: 0, x: 0, y: 0 };
    for (let i = 0; i < data.length; i += 4) {
      const others = [0, 1, 2].filter((other) => other !== channel);
      if (data[i + channel] < 150 || others.some((other) => data[i + other] > 90)) continue;
      center.count += 1;
      center.x += (i / 4) % width;
      center.y += Math.floor(i / 4 / width);
    }
    center.x /= center.count;
    center.y /= center.count;
    centers[name] = center;
  });
  return centers;
}

/**
 * Red, green, blue and alpha of each pixel, and the width behind the last image. Decoded in a page of
 * its own: the player's policy would not let screenshots in.
 */
async function pixelsOf(browser, images) {
  const page = await browser.newPage();
  try {
    const decoded = await page.evaluate(decode, images);
    const arrays = decoded.map(({ base64 }) => Buffer.from(base64, "base64"));
    return [...arrays, decoded.at(-1).width];
  } finally {
    await page.close();
  }
}

function decode(images) {
  return Promise.all(
    images.map(async (source) => {
      const image = new Image();
      image.src = `data:image/png;base64,${source}`;
      await image.decode();
      const { width, height } = image;
      const context = new OffscreenCanvas(width, height).getContext("2d");
      context.drawImage(image, 0, 0);
      const { data } = context.getImageData(0, 0, width, height);
      let binary = "";
      for (let i = 0; i < data.length; i += 8192) {
        binary += String.fromCharCode(...data.subarray(i, i + 8192));
      }
      return { width, base64: btoa(binary) };
    }),
  );
}
