/** Numbers as they are measured, scaled and written. */

import { expect, test } from "vitest";
import * as format from "../../src/base/format";
import { RateMeter } from "../../src/base/rate";
import { endToEndUs } from "../../src/play/deck";
import { percentOfDiagonal, percentOfShare } from "../../src/play/figures";
import { niceCeiling, ticksUpTo } from "../../src/ui/plot";

test("thirty frames a second of a thousand bytes are 240 kbit/s", () => {
  const meter = new RateMeter();
  for (let frame = 0; frame <= 60; frame += 1) meter.add((frame * 1000) / 30, 1000);
  const { perSecond, bitsPerSecond } = meter.measure(2000);
  expect(perSecond).toBeCloseTo(30, 6);
  expect(bitsPerSecond).toBeCloseTo(240_000, 3);
});

test("an image adds to the bytes and not to the frames", () => {
  const meter = new RateMeter();
  meter.add(0, 1000);
  meter.add(1000, 1000);
  meter.addBytes(500);
  expect(meter.measure(1000)).toEqual({ perSecond: 1, bitsPerSecond: 12_000 });
});

test("a stream that stopped has a rate of zero two seconds later", () => {
  const meter = new RateMeter();
  meter.add(0, 1000);
  meter.add(100, 1000);
  expect(meter.measure(2200)).toEqual({ perSecond: 0, bitsPerSecond: 0 });
});

test("distances are shares of the diagonal, in percent", () => {
  expect(percentOfDiagonal({ mean: 0.5, max: null }, 50)).toBe(1);
  expect(percentOfDiagonal({ mean: 0.5, max: null }, 0)).toBeNull();
  expect(percentOfDiagonal(null, 50)).toBeNull();
  expect(percentOfShare(0.25)).toBe(25);
  expect(percentOfShare(null)).toBeNull();
});

test("end to end is from capture to now, if the rig's clock can be the time of day", () => {
  expect(endToEndUs(1_000_000, 1_020)).toBe(20_000);
  expect(endToEndUs(33_333, 1.7e12)).toBeNull();
  expect(endToEndUs(2_000_000, 1_000)).toBeNull();
  expect(endToEndUs(null, 1_000)).toBeNull();
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
  [format.clock(0), "0:00.0"],
  [format.clock(75.26), "1:15.3"],
])("%s reads as %s", (text, expected) => {
  expect(text).toBe(expected);
});
