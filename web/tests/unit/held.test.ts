/** What is held of a live stream. */

import { type FrameMetrics, parseMetrics, type Server } from "steadymesh";
import { expect, test } from "vitest";
import { HELD_FRAMES, HeldFrames } from "../../src/play/held";

function metrics(seq: number, captureTimeUs: number | null = seq * 100_000): FrameMetrics {
  return parseMetrics({ seq, capture_time_us: captureTimeUs });
}

function received(seq: number, captureTimeUs?: number | null) {
  const mesh = new Uint8Array([seq % 256]).buffer;
  return { metrics: metrics(seq, captureTimeUs), mesh, texture: null, messageBytes: 1 };
}

/** A server that holds these frames. */
function bench(held: number[]) {
  const fetched: number[] = [];
  const server = {
    metrics: async () => held.map((seq) => metrics(seq)),
    mesh: async (_place: unknown, seq: number) => {
      fetched.push(seq);
      if (!held.includes(seq)) throw new Error("gone");
      return new Uint8Array([seq]).buffer;
    },
  } as unknown as Server;
  const frames = new HeldFrames(server, "demo");
  const seqs = () => Array.from({ length: frames.length }, (_, i) => frames.at(i)?.seq);
  return { frames, fetched, seqs };
}

test("frames from before the page was opened stand before those that came since", async () => {
  const { frames, seqs } = bench([1, 2, 3]);
  frames.add(received(3));
  frames.add(received(4));
  await frames.refresh();
  expect(seqs()).toEqual([1, 2, 3, 4]);
});

test("what was received is not fetched again", async () => {
  const { frames, fetched } = bench([1, 2, 3]);
  frames.add(received(3));
  await frames.refresh();
  for (const index of [0, 2]) {
    const held = frames.at(index);
    const { mesh } = await frames.fetch(held as NonNullable<typeof held>);
    expect([...new Uint8Array(mesh)]).toEqual([held?.seq]);
  }
  expect(fetched).toEqual([1]);
});

test("a frame that the server has forgotten is forgotten here", async () => {
  const { frames, seqs } = bench([1, 2]);
  await frames.refresh();
  const held = frames.at(0) as NonNullable<ReturnType<typeof frames.at>>;
  held.seq = 99;
  await expect(frames.fetch(held)).rejects.toThrow("gone");
  expect(seqs()).toEqual([2]);
});

test("places are seconds of capture, whatever the numbers", () => {
  const { frames } = bench([]);
  for (const [seq, time] of [
    [5, 0],
    [9, 100_000],
    [10, 400_000],
  ] as const) {
    frames.add(received(seq, time));
  }
  expect(frames.newest?.atS).toBeCloseTo(0.4, 9);
  expect(frames.indexAt(0.399)).toBe(1);
  expect(frames.indexAt(-1)).toBe(0);
  expect(frames.indexAt(9)).toBe(2);
  expect(frames.indexOf(6)).toBe(1);
});

test("a silence of the rig is not waited for", () => {
  const { frames } = bench([]);
  frames.add(received(0, 0));
  frames.add(received(1, 60_000_000));
  expect(frames.newest?.atS).toBeLessThan(0.1);
});

test("another stream of the same name takes the place of the first", () => {
  const { frames, seqs } = bench([]);
  for (const seq of [7, 8, 8, 0, 1]) frames.add(received(seq));
  expect(seqs()).toEqual([0, 1]);
});

test("no more are held than a server holds", () => {
  const { frames } = bench([]);
  for (let seq = 0; seq < HELD_FRAMES + 20; seq += 1) frames.add(received(seq));
  expect(frames.length).toBe(HELD_FRAMES);
  expect(frames.at(0)?.seq).toBe(20);
});

test("the nearest frame of another stream is that of the same moment", () => {
  const { frames } = bench([]);
  for (const seq of [0, 1, 2]) frames.add(received(seq));
  expect(frames.nearestTo(metrics(77, 110_000))?.seq).toBe(1);
  expect(frames.nearestTo(metrics(2, null))?.seq).toBe(2);
});
