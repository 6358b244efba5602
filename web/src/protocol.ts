/**
 * What the server sends to a subscriber (subprotocol `steadymesh.v1`) and lists at `/v1/streams`.
 *
 * Everything arrives from outside: a field that is missing or of another type becomes `null`,
 * unknown fields and message types are ignored, and only a broken frame envelope is an error.
 */

export const SUBPROTOCOL = "steadymesh.v1";

/** Bytes before the metrics in a binary message. */
export const HEADER_BYTES = 16;

const FRAME_VERSION = 1;
const MAGIC = [0x53, 0x4d, 0x44, 0x46]; // "SMDF"

/** One-sided distances in the mesh's own unit. */
export interface DistanceStatistics {
  mean: number;
  max: number | null;
}

export interface DistancePair {
  /** To the registered frame k-1; `null` for a first frame, after a reset and unregistered. */
  previous: DistanceStatistics | null;
  /** To frame k. */
  current: DistanceStatistics | null;
}

/** What has come back of the previous frame's result; `null` without a registration. */
export interface Consistency {
  /** Shares from 0 to 1. */
  vertexPersistence: number | null;
  edgePersistence: number | null;
}

export interface MeshSize {
  vertices: number | null;
  faces: number | null;
  bytes: number | null;
}

export interface FrameMetrics {
  seq: number | null;
  /** Microseconds since the Unix epoch by the rig's clock, where the rig says so. */
  captureTimeUs: number | null;
  tracking: string | null;
  /** Why it was treated as a first frame although there is one before. */
  reset: string | null;
  input: MeshSize;
  output: MeshSize;
  surfaceDistance: DistancePair;
  consistency: Consistency;
  /** In the mesh's own unit. */
  bboxDiagonal: number | null;
  /** Time of each pipeline stage, in the server's order. */
  stages: { name: string; us: number }[];
  /** From the frame's arrival at the server to its publication. */
  latencyUs: number | null;
}

export interface Frame {
  metrics: FrameMetrics;
  /** A Draco mesh in a buffer of its own, so that a worker can take it over. */
  mesh: ArrayBuffer;
  /** Size of the whole message. */
  messageBytes: number;
}

export interface StreamConfig {
  targetFaces: number | null;
  targetRatio: number | null;
  tracking: string | null;
}

export type ControlMessage =
  | { type: "hello"; stream: string | null; latestSeq: number | null; config: StreamConfig }
  | { type: "skipped"; missed: number }
  | { type: "end"; reason: string };

export interface StreamSummary {
  stream: string;
  state: string | null;
  config: StreamConfig;
  published: number | null;
  dropped: number | null;
  subscribers: number | null;
  latestSeq: number | null;
}

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
  const metricsEnd = HEADER_BYTES + view.getUint32(8, true);
  const expected = metricsEnd + view.getUint32(12, true);
  if (expected !== message.byteLength) {
    throw new ProtocolError(`frame announces ${expected} bytes and has ${message.byteLength}`);
  }
  return {
    metrics: parseMetrics(
      readJson(new Uint8Array(message, HEADER_BYTES, metricsEnd - HEADER_BYTES)),
    ),
    mesh: message.slice(metricsEnd),
    messageBytes: message.byteLength,
  };
}

/** Reads a frame's metrics from parsed JSON. */
export function parseMetrics(json: unknown): FrameMetrics {
  const metrics = asRecord(json);
  const stages = asRecord(metrics.stage_us);
  const consistency = asRecord(metrics.consistency);
  return {
    seq: asNumber(metrics.seq),
    captureTimeUs: asNumber(metrics.capture_time_us),
    tracking: asText(metrics.tracking),
    reset: asText(metrics.reset),
    input: parseMeshSize(metrics.input),
    output: parseMeshSize(metrics.output),
    surfaceDistance: {
      previous: parseStatistics(asRecord(metrics.surface_distance).previous),
      current: parseStatistics(asRecord(metrics.surface_distance).current),
    },
    consistency: {
      vertexPersistence: asNumber(consistency.vertex_persistence),
      edgePersistence: asNumber(consistency.edge_persistence),
    },
    bboxDiagonal: asNumber(metrics.bbox_diagonal),
    stages: Object.entries(stages).flatMap(([name, value]) => {
      const us = asNumber(value);
      return us === null || us < 0 ? [] : [{ name, us }];
    }),
    latencyUs: asNumber(metrics.latency_us),
  };
}

/** Parses one text message; `null` for types this player does not know. */
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

/** Parses the answer of `GET /v1/streams`, in the server's order. */
export function parseStreamList(json: unknown): StreamSummary[] {
  const { streams } = asRecord(json);
  if (!Array.isArray(streams)) return [];
  return streams.flatMap((item: unknown) => {
    const summary = asRecord(item);
    const stream = asText(summary.stream);
    if (stream === null) return [];
    const counters = asRecord(summary.counters);
    return [
      {
        stream,
        state: asText(summary.state),
        config: parseConfig(summary.config),
        published: asNumber(counters.published),
        dropped: asNumber(counters.dropped),
        subscribers: asNumber(summary.subscribers),
        latestSeq: asNumber(summary.latest_seq),
      },
    ];
  });
}

/** A distance as a percentage of the bounding-box diagonal, where both are known. */
export function percentOfDiagonal(
  distance: DistanceStatistics | null,
  diagonal: number | null,
): number | null {
  if (distance === null || diagonal === null || diagonal <= 0) return null;
  return (distance.mean / diagonal) * 100;
}

/** A share from 0 to 1 as a percentage, where it is known. */
export function percentOfShare(share: number | null): number | null {
  return share === null ? null : share * 100;
}

/** No clock that is roughly right is further off than this. */
const MAX_PLAUSIBLE_DELAY_US = 60e6;

/**
 * Capture to now in microseconds, or `null` if the two clocks cannot be the same time: many rigs
 * count from the beginning of a take instead of the Unix epoch.
 */
export function endToEndUs(captureTimeUs: number | null, nowMs: number): number | null {
  if (captureTimeUs === null) return null;
  const delay = nowMs * 1000 - captureTimeUs;
  return 0 <= delay && delay <= MAX_PLAUSIBLE_DELAY_US ? delay : null;
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

function parseConfig(value: unknown): StreamConfig {
  const config = asRecord(value);
  return {
    targetFaces: asNumber(config.target_faces),
    targetRatio: asNumber(config.target_ratio),
    tracking: asText(config.tracking),
  };
}

function parseMeshSize(value: unknown): MeshSize {
  const size = asRecord(value);
  return {
    vertices: asNumber(size.vertices),
    faces: asNumber(size.faces),
    bytes: asNumber(size.bytes),
  };
}

function parseStatistics(value: unknown): DistanceStatistics | null {
  const statistics = asRecord(value);
  const mean = asNumber(statistics.mean);
  return mean === null ? null : { mean, max: asNumber(statistics.max) };
}

function asRecord(value: unknown): Record<string, unknown> {
  return typeof value === "object" && value !== null ? (value as Record<string, unknown>) : {};
}

function asNumber(value: unknown): number | null {
  return typeof value === "number" && Number.isFinite(value) ? value : null;
}

function asText(value: unknown): string | null {
  return typeof value === "string" ? value : null;
}
