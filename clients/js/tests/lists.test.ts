/** What the server says in JSON. */

import { describe, expect, test } from "vitest";
import { parseRecordedFrames, parseRecordingList, parseStreamList } from "../src/lists.js";
import { parseMetrics } from "../src/metrics.js";

describe("metrics", () => {
  test("are read in full", () => {
    const metrics = parseMetrics({
      seq: 41,
      capture_time_us: 5,
      tracking: "robust",
      reset: "registration failed",
      input: { vertices: 4, faces: 3, bytes: 2 },
      output: { vertices: 3, faces: 2, bytes: 1, points: 5 },
      surface_distance: { previous: { mean: 0.5, max: 2 }, current: { mean: 0.25, max: 1 } },
      consistency: { vertex_persistence: 0.75, edge_persistence: 0.5, flicker: 0.1 },
      texture: { id: "0a", media_type: "image/jpeg", width: 4, height: 2, encoded: true },
      bbox_diagonal: 50,
      stage_us: { parse: 10, encode: 20 },
      latency_us: 99,
      something_new: true,
    });
    expect(metrics.reset).toBe("registration failed");
    expect(metrics.surfaceDistance.previous).toEqual({ mean: 0.5, max: 2 });
    expect(metrics.consistency).toEqual({ vertexPersistence: 0.75, edgePersistence: 0.5 });
    expect(metrics.stages).toEqual([
      { name: "parse", us: 10 },
      { name: "encode", us: 20 },
    ]);
    expect(metrics.output).toEqual({ vertices: 3, faces: 2, bytes: 1, points: 5 });
    expect(metrics.texture).toEqual({
      id: "0a",
      mediaType: "image/jpeg",
      bytes: null,
      width: 4,
      height: 2,
      encoded: true,
    });
  });

  test.each([[null], [[]], ["text"], [{ surface_distance: null, stage_us: null, input: 3 }]])(
    "%j leave everything unknown",
    (json) => {
      const metrics = parseMetrics(json);
      expect(metrics.surfaceDistance).toEqual({ previous: null, current: null });
      expect(metrics.consistency).toEqual({ vertexPersistence: null, edgePersistence: null });
      expect(metrics.stages).toEqual([]);
      expect(metrics.input.faces).toBeNull();
      expect(metrics.texture).toBeNull();
    },
  );

  test("name no image whose id could leave its place in an address", () => {
    expect(
      parseMetrics({ texture: { id: "../../x", media_type: "image/png" } }).texture,
    ).toBeNull();
  });
});

describe("the list of streams", () => {
  test("keeps the server's order and skips what has no name", () => {
    const list = parseStreamList({
      streams: [{ stream: "b", latest_seq: 4, counters: { published: 5 } }, {}, { stream: "a" }],
    });
    expect(list.map(({ stream }) => stream)).toEqual(["b", "a"]);
    expect(list[0]).toMatchObject({ latestSeq: 4, published: 5, dropped: null });
  });

  test("is empty where the answer is something else", () => {
    expect(parseStreamList({ title: "Not Found" })).toEqual([]);
  });
});

describe("recordings", () => {
  test("say what can be played", () => {
    const output = { frames: 3, bytes: 9, first_seq: 4, last_seq: 6, first_time_us: 1 };
    const list = parseRecordingList({
      recordings: [
        { stream: "demo", id: "x", state: "complete", output },
        { stream: "demo", id: "y", output: null },
        { stream: "demo" },
      ],
    });
    expect(list.map(({ id }) => id)).toEqual(["x", "y"]);
    expect(list[0]?.output).toMatchObject({ frames: 3, firstSeq: 4, lastSeq: 6, lastTimeUs: null });
    expect(list[1]?.output).toBeNull();
  });

  test("have frames at the time of capture, or else of storage", () => {
    const frames = parseRecordedFrames({
      frames: [
        { seq: 1, capture_time_us: 10, stored_us: 20 },
        { seq: 2, capture_time_us: null, stored_us: 30 },
      ],
      more: true,
    });
    expect(frames).toEqual({
      frames: [
        { seq: 1, timeUs: 10 },
        { seq: 2, timeUs: 30 },
      ],
      more: true,
    });
  });
});
