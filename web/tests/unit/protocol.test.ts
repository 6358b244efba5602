import { describe, expect, test } from "vitest";
import {
  endToEndUs,
  HEADER_BYTES,
  ProtocolError,
  parseControl,
  parseFrame,
  parseMetrics,
  parseStreamList,
  percentOfDiagonal,
  percentOfShare,
} from "../../src/protocol";

const MESH = [0x44, 0x52, 0x41, 0x43, 0x4f];

function frameBytes(metrics: string, change: (view: DataView) => void = () => {}): ArrayBuffer {
  const json = new TextEncoder().encode(metrics);
  const bytes = new Uint8Array(HEADER_BYTES + json.length + MESH.length);
  const view = new DataView(bytes.buffer);
  bytes.set(new TextEncoder().encode("SMDF"));
  view.setUint16(4, 1, true);
  view.setUint32(8, json.length, true);
  view.setUint32(12, MESH.length, true);
  bytes.set(json, HEADER_BYTES);
  bytes.set(MESH, HEADER_BYTES + json.length);
  change(view);
  return bytes.buffer;
}

describe("a binary message", () => {
  test("is split into its metrics and a mesh in a buffer of its own", () => {
    const message = frameBytes('{"seq":7,"latency_us":1500}');
    const frame = parseFrame(message);
    expect(frame.metrics.seq).toBe(7);
    expect(frame.metrics.latencyUs).toBe(1500);
    expect([...new Uint8Array(frame.mesh)]).toEqual(MESH);
    expect(frame.mesh).not.toBe(message);
    expect(frame.messageBytes).toBe(message.byteLength);
  });

  test("may come without metrics", () => {
    expect(parseFrame(frameBytes("")).metrics.seq).toBeNull();
  });

  test.each<[string, ArrayBuffer]>([
    ["shorter than a header", new ArrayBuffer(HEADER_BYTES - 1)],
    ["with another magic", frameBytes("{}", (view) => view.setUint8(0, 0x58))],
    ["of another version", frameBytes("{}", (view) => view.setUint16(4, 2, true))],
    ["longer than announced", frameBytes("{}", (view) => view.setUint32(12, 4, true))],
    ["shorter than announced", frameBytes("{}", (view) => view.setUint32(12, 6, true))],
    ["with a huge length", frameBytes("{}", (view) => view.setUint32(8, 0xffffffff, true))],
    ["with metrics that are not JSON", frameBytes("{seq")],
  ])("%s is refused", (_, message) => {
    expect(() => parseFrame(message)).toThrow(ProtocolError);
  });
});

describe("metrics", () => {
  test("are read in full", () => {
    const metrics = parseMetrics({
      seq: 41,
      capture_time_us: 5,
      tracking: "robust",
      reset: "registration failed",
      input: { vertices: 4, faces: 3, bytes: 2 },
      output: { vertices: 3, faces: 2, bytes: 1 },
      surface_distance: { previous: { mean: 0.5, max: 2 }, current: { mean: 0.25, max: 1 } },
      consistency: { vertex_persistence: 0.75, edge_persistence: 0.5, flicker: 0.1 },
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
    expect(metrics.output).toEqual({ vertices: 3, faces: 2, bytes: 1 });
  });

  test.each([[null], [[]], ["text"], [{ surface_distance: null, stage_us: null, input: 3 }]])(
    "%j leave everything unknown",
    (json) => {
      const metrics = parseMetrics(json);
      expect(metrics.surfaceDistance).toEqual({ previous: null, current: null });
      expect(metrics.consistency).toEqual({ vertexPersistence: null, edgePersistence: null });
      expect(metrics.stages).toEqual([]);
      expect(metrics.input.faces).toBeNull();
    },
  );

  test("give distances as a share of the diagonal", () => {
    expect(percentOfDiagonal({ mean: 0.5, max: null }, 50)).toBe(1);
    expect(percentOfDiagonal({ mean: 0.5, max: null }, 0)).toBeNull();
    expect(percentOfDiagonal(null, 50)).toBeNull();
  });

  test("give shares in percent", () => {
    expect(percentOfShare(0.25)).toBe(25);
    expect(percentOfShare(null)).toBeNull();
  });
});

describe("a text message", () => {
  test("of each known type is read", () => {
    expect(
      parseControl(
        '{"type":"hello","stream":"demo","latest_seq":null,"config":{"target_faces":9}}',
      ),
    ).toEqual({
      type: "hello",
      stream: "demo",
      latestSeq: null,
      config: { targetFaces: 9, targetRatio: null, tracking: null },
    });
    expect(parseControl('{"type":"skipped","missed":3}')).toEqual({ type: "skipped", missed: 3 });
    expect(parseControl('{"type":"end","reason":"deleted"}')).toEqual({
      type: "end",
      reason: "deleted",
    });
  });

  test.each(['{"type":"novelty"}', "{", "null", "[]", '"hello"'])("%s is ignored", (text) => {
    expect(parseControl(text)).toBeNull();
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

describe("end-to-end latency", () => {
  test("is the time from capture to now", () => {
    expect(endToEndUs(1_000_000, 1_020)).toBe(20_000);
  });

  test("is unknown where the rig's clock cannot be the time of day", () => {
    expect(endToEndUs(33_333, 1.7e12)).toBeNull();
    expect(endToEndUs(2_000_000, 1_000)).toBeNull();
    expect(endToEndUs(null, 1_000)).toBeNull();
  });
});
