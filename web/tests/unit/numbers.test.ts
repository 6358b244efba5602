import { expect, test } from "vitest";
import * as format from "../../src/format";
import { niceCeiling, ticksUpTo } from "../../src/plot";
import { RateMeter } from "../../src/rate";
import { retryDelayMs } from "../../src/subscription";

test("thirty frames a second of a thousand bytes are 240 kbit/s", () => {
  const meter = new RateMeter();
  for (let frame = 0; frame <= 60; frame += 1) meter.add((frame * 1000) / 30, 1000);
  const { perSecond, bitsPerSecond } = meter.measure(2000);
  expect(perSecond).toBeCloseTo(30, 6);
  expect(bitsPerSecond).toBeCloseTo(240_000, 3);
});

test("a stream that stopped has a rate of zero two seconds later", () => {
  const meter = new RateMeter();
  meter.add(0, 1000);
  meter.add(100, 1000);
  expect(meter.measure(2200)).toEqual({ perSecond: 0, bitsPerSecond: 0 });
});

test("retries wait twice as long each time, up to ten seconds", () => {
  expect([0, 1, 2, 3].map((attempt) => retryDelayMs(attempt, 1))).toEqual([500, 1000, 2000, 4000]);
  expect(retryDelayMs(40, 1)).toBe(10_000);
  expect(retryDelayMs(0, 0)).toBe(250);
});

test.each([
  [0.07, 0.1],
  [0.11, 0.2],
  [0.2, 0.2],
  [2.3, 2.5],
  [51, 100],
  [0, 1],
])("%d is rounded up to %d", (value, expected) => {
  expect(niceCeiling(value)).toBeCloseTo(expected, 12);
});

test("the lines of the plot begin at zero and reach the highest value", () => {
  expect(ticksUpTo(0.27)).toEqual([0, 0.1, 0.2, 0.3]);
  expect(ticksUpTo(0)).toEqual([0, 1]);
});

test.each([
  [format.bytes(999), "999 B"],
  [format.bytes(7_490), "7.49 kB"],
  [format.bitRate(1_234_567), "1.23 Mbit/s"],
  [format.duration(850), "850 µs"],
  [format.duration(25_430), "25.4 ms"],
  [format.duration(1_500_000), "1.50 s"],
  [format.count(52_290), "52,290"],
  [format.percent(0.0567), "0.0567 %"],
  [format.percent(null), "–"],
])("%s reads as %s", (text, expected) => {
  expect(text).toBe(expected);
});
