/** When frames are shown. */

import { expect, test } from "vitest";
import { JitterBuffer, type Timing } from "../../src/play/jitter";

const INTERVAL = 33;

/** Frames that were captured evenly and come as late as the list says; what is shown, and when. */
function play(lags: number[], options: { captureTimes?: boolean; tickMs?: number } = {}) {
  const discarded: number[] = [];
  const buffer = new JitterBuffer<number>((value) => discarded.push(value));
  const arrivals = lags.map((lag, seq): Timing => {
    const captureMs = seq * INTERVAL;
    return {
      seq,
      captureMs: options.captureTimes === false ? null : captureMs,
      arrivalMs: captureMs + lag,
    };
  });
  const shown: { seq: number; atMs: number }[] = [];
  const end = lags.length * INTERVAL + 500;
  const tickMs = options.tickMs ?? 1;
  for (let now = 0; now < end; now += tickMs) {
    const since = now - tickMs;
    for (const timing of arrivals.filter(({ arrivalMs: at }) => at > since && at <= now)) {
      buffer.push(timing.seq, timing);
    }
    const seq = buffer.take(now);
    if (seq !== null) shown.push({ seq, atMs: now });
  }
  return { buffer, shown, discarded };
}

/** How unevenly the later frames are shown. */
function unevenness(shown: { atMs: number }[]): number {
  const times = shown.slice(-60).map(({ atMs }) => atMs);
  const gaps = times.slice(1).map((time, i) => time - (times[i] as number));
  return Math.max(...gaps) - Math.min(...gaps);
}

/** Between 0 and 60 ms, the same in every run. */
const uneven = Array.from({ length: 150 }, (_, i) => ((i * 37) % 61) + 5);

test("frames that come unevenly are shown evenly", () => {
  const { shown } = play(uneven);
  expect(unevenness(shown)).toBeLessThan(15);
  expect(shown.map(({ seq }) => seq)).toEqual(
    [...shown].map(({ seq }) => seq).sort((a, b) => a - b),
  );
});

test("frames that come evenly do not wait", () => {
  const { buffer, shown } = play(Array.from({ length: 100 }, () => 20));
  expect(buffer.waitMs).toBeLessThan(1);
  expect(shown.length).toBe(100);
  expect(buffer.dropped).toBe(0);
});

test("without times of capture, numbers say how frames follow each other", () => {
  const { shown, buffer } = play(uneven, { captureTimes: false });
  expect(buffer.hasCaptureTimes).toBe(false);
  expect(unevenness(shown)).toBeLessThan(25);
});

test("the wait grows no further than a quarter of a second", () => {
  const { buffer } = play(Array.from({ length: 100 }, (_, i) => (i % 2) * 900));
  expect(buffer.waitMs).toBeLessThanOrEqual(250);
});

test("a screen that is refreshed rarely shows the newest frame that is due", () => {
  const { buffer, shown, discarded } = play(
    Array.from({ length: 60 }, () => 5),
    { tickMs: 100 },
  );
  expect(shown.length).toBeLessThan(25);
  expect(buffer.dropped).toBe(discarded.length);
  expect(shown.length + discarded.length).toBe(60);
});

test("a stream that begins again from 0 is shown at once", () => {
  const buffer = new JitterBuffer<string>(() => undefined);
  buffer.push("old", { seq: 900, captureMs: 50_000, arrivalMs: 50_010 });
  expect(buffer.take(50_010)).toBe("old");
  buffer.push("new", { seq: 0, captureMs: 100, arrivalMs: 50_050 });
  expect(buffer.take(50_050)).toBe("new");
});

test("what waits is given back when it is cleared", () => {
  const discarded: string[] = [];
  const buffer = new JitterBuffer<string>((value) => discarded.push(value));
  buffer.push("a", { seq: 0, captureMs: 0, arrivalMs: 0 });
  buffer.clear();
  expect(discarded).toEqual(["a"]);
  expect(buffer.take(1000)).toBeNull();
});
