/** The messages of the subprotocol `steadymesh.v1`, as `proto/README.md` lays them out. */

import { asNumber, asRecord, asText } from "./json.js";
import { parseConfig, type StreamConfig } from "./lists.js";
import { type FrameMetrics, parseMetrics } from "./metrics.js";

export const SUBPROTOCOL = "steadymesh.v1";

/** Bytes before the metrics in a binary message. */
export const HEADER_BYTES = 16;

const FRAME_VERSION = 1;
const MAGIC = [0x53, 0x4d, 0x44, 0x46]; // "SMDF"
const FLAG_TEXTURE = 1;

/** A frame as it was sent. */
export interface Frame {
  metrics: FrameMetrics;
  /** A Draco mesh in a buffer of its own, so that a worker can take it over. */
  mesh: ArrayBuffer;
  /** The image's file, where the message carries it (`textures=inline`). */
  texture: Uint8Array<ArrayBuffer> | null;
  /** Size of the whole message. */
  messageBytes: number;
}

export type ControlMessage =
  | { type: "hello"; stream: string | null; latestSeq: number | null; config: StreamConfig }
  | { type: "skipped"; missed: number }
  | { type: "end"; reason: string };

/** A binary message that is not a frame of version 1. */
export class ProtocolError extends Error {
  override name = "ProtocolError";
}

/**
 * Parses one binary message.
 *
 * @throws {ProtocolError} if the envelope or its lengths are wrong, or the metrics are not JSON.
 */
export function parseFrame(message: ArrayBuffer): Frame {
  if (message.byteLength < HEADER_BYTES) {
    throw new ProtocolError(`frame of ${message.byteLength} bytes is shorter than its header`);
  }
  const view = new DataView(message);
  if (MAGIC.some((byte, at) => view.getUint8(at) !== byte)) {
    throw new ProtocolError("frame does not begin with SMDF");
  }
  const version = view.getUint16(4, true);
  if (version !== FRAME_VERSION) {
    throw new ProtocolError(`frame version ${version} is not supported`);
  }
  const hasTexture = (view.getUint16(6, true) & FLAG_TEXTURE) !== 0;
  const metricsEnd = HEADER_BYTES + view.getUint32(8, true);
  const meshEnd = metricsEnd + view.getUint32(12, true);
  const fits = hasTexture ? meshEnd < message.byteLength : meshEnd === message.byteLength;
  if (!fits) {
    throw new ProtocolError(`frame announces ${meshEnd} bytes and has ${message.byteLength}`);
  }
  const json = new Uint8Array(message, HEADER_BYTES, metricsEnd - HEADER_BYTES);
  return {
    metrics: parseMetrics(readJson(json)),
    mesh: message.slice(metricsEnd, meshEnd),
    texture: hasTexture ? new Uint8Array(message.slice(meshEnd)) : null,
    messageBytes: message.byteLength,
  };
}

/** Parses one text message; `null` for types that are not known. */
export function parseControl(text: string): ControlMessage | null {
  let json: unknown;
  try {
    json = JSON.parse(text);
  } catch {
    return null;
  }
  const message = asRecord(json);
  switch (message.type) {
    case "hello":
      return {
        type: "hello",
        stream: asText(message.stream),
        latestSeq: asNumber(message.latest_seq),
        config: parseConfig(message.config),
      };
    case "skipped":
      return { type: "skipped", missed: Math.max(0, asNumber(message.missed) ?? 0) };
    case "end":
      return { type: "end", reason: asText(message.reason) ?? "unknown" };
    default:
      return null;
  }
}

function readJson(bytes: Uint8Array): unknown {
  // A frame without metrics is legal: a stream may have them switched off.
  if (bytes.length === 0) return {};
  try {
    return JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(bytes));
  } catch {
    throw new ProtocolError("frame metrics are not JSON");
  }
}
