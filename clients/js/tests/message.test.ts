/** Messages, the golden ones of `proto/vectors` among them. */

import { describe, expect, test } from "vitest";
import { HEADER_BYTES, ProtocolError, parseControl, parseFrame } from "../src/message.js";
import { MESH, message, metricsWithImage, vector } from "./support/frames.js";

/** A message without an image, changed by hand. */
function changed(metrics: string, change: (view: DataView) => void): ArrayBuffer {
  const bytes = message(metrics);
  change(new DataView(bytes));
  return bytes;
}

describe("the golden message", () => {
  test("is read in full", async () => {
    const bytes = await vector("delivered_frame.bin");
    const frame = parseFrame(bytes);
    expect(new TextDecoder().decode(frame.mesh)).toBe("DRACO");
    expect(frame.metrics).toMatchObject({
      seq: 41,
      captureTimeUs: null,
      tracking: "paper",
      input: { vertices: 20672, faces: 39421, bytes: 1305760 },
      output: { vertices: 2043, faces: 4000, bytes: 5 },
      bboxDiagonal: 21.25,
      latencyUs: 21,
      surfaceDistance: { previous: null, current: null },
    });
    expect(frame.metrics.stages.map(({ us }) => us)).toEqual([1, 2, 3, 4, 5, 6]);
    expect(frame.messageBytes).toBe(bytes.byteLength);
  });

  test("is refused when a byte is missing", async () => {
    const bytes = await vector("delivered_frame.bin");
    expect(() => parseFrame(bytes.slice(0, -1))).toThrow(ProtocolError);
  });
});

describe("a binary message", () => {
  test("is split into its metrics and a mesh in a buffer of its own", () => {
    const bytes = message('{"seq":7,"latency_us":1500}');
    const frame = parseFrame(bytes);
    expect(frame.metrics.seq).toBe(7);
    expect(frame.metrics.latencyUs).toBe(1500);
    expect([...new Uint8Array(frame.mesh)]).toEqual(MESH);
    expect(frame.mesh).not.toBe(bytes);
    expect(frame.texture).toBeNull();
  });

  test("has its image behind the mesh", () => {
    const frame = parseFrame(message(metricsWithImage(7, "ab12"), [1, 2, 3]));
    expect([...new Uint8Array(frame.mesh)]).toEqual(MESH);
    expect([...(frame.texture ?? [])]).toEqual([1, 2, 3]);
    expect(frame.metrics.texture).toMatchObject({ id: "ab12", mediaType: "image/png", bytes: 3 });
  });

  test("may come without metrics", () => {
    expect(parseFrame(message("")).metrics.seq).toBeNull();
  });

  test.each<[string, ArrayBuffer]>([
    ["shorter than a header", new ArrayBuffer(HEADER_BYTES - 1)],
    ["with another magic", changed("{}", (view) => view.setUint8(0, 0x58))],
    ["of another version", changed("{}", (view) => view.setUint16(4, 2, true))],
    ["longer than announced", changed("{}", (view) => view.setUint32(12, 4, true))],
    ["shorter than announced", changed("{}", (view) => view.setUint32(12, 6, true))],
    ["with a huge length", changed("{}", (view) => view.setUint32(8, 0xffffffff, true))],
    ["that announces an image and has none", changed("{}", (view) => view.setUint16(6, 1, true))],
    ["with metrics that are not JSON", message("{seq")],
  ])("%s is refused", (_, bytes) => {
    expect(() => parseFrame(bytes)).toThrow(ProtocolError);
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
