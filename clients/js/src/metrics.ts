/** A frame's metrics, as the server measured them. What it did not measure is `null`. */

import { asNumber, asRecord, asText } from "./json.js";

/** One-sided distances in the mesh's own unit. */
export interface DistanceStatistics {
  mean: number;
  max: number | null;
}

export interface DistancePair {
  /** To the registered frame before; `null` for a first frame, after a reset and unregistered. */
  previous: DistanceStatistics | null;
  /** To the frame itself. */
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

/** Points are vertices as delivered: a vertex on a texture's seam is several of them. */
export interface OutputSize extends MeshSize {
  points: number | null;
}

/** The image that belongs to a frame. Frames that share one have the same id. */
export interface TextureReference {
  id: string;
  /** Such as `image/jpeg`; `image/ktx2` is not decoded by browsers. */
  mediaType: string;
  bytes: number | null;
  width: number | null;
  height: number | null;
  /** Whether the server encoded it anew. */
  encoded: boolean;
}

export interface FrameMetrics {
  seq: number | null;
  /** Microseconds since the Unix epoch by the rig's clock, where the rig says so. */
  captureTimeUs: number | null;
  tracking: string | null;
  /** How much of the processing the frame got: `full`, or less under load. */
  quality: string | null;
  /** Why it was treated as a first frame although there is one before. */
  reset: string | null;
  input: MeshSize;
  output: OutputSize;
  texture: TextureReference | null;
  surfaceDistance: DistancePair;
  consistency: Consistency;
  /** In the mesh's own unit. */
  bboxDiagonal: number | null;
  /** Time of each pipeline stage, in the server's order. */
  stages: { name: string; us: number }[];
  /** From the frame's arrival at the server to its publication. */
  latencyUs: number | null;
}

/** Reads a frame's metrics from parsed JSON; unknown fields are ignored. */
export function parseMetrics(json: unknown): FrameMetrics {
  const metrics = asRecord(json);
  const distance = asRecord(metrics.surface_distance);
  const consistency = asRecord(metrics.consistency);
  return {
    seq: asNumber(metrics.seq),
    captureTimeUs: asNumber(metrics.capture_time_us),
    tracking: asText(metrics.tracking),
    quality: asText(metrics.quality),
    reset: asText(metrics.reset),
    input: parseMeshSize(metrics.input),
    output: {
      ...parseMeshSize(metrics.output),
      points: asNumber(asRecord(metrics.output).points),
    },
    texture: parseTexture(metrics.texture),
    surfaceDistance: {
      previous: parseStatistics(distance.previous),
      current: parseStatistics(distance.current),
    },
    consistency: {
      vertexPersistence: asNumber(consistency.vertex_persistence),
      edgePersistence: asNumber(consistency.edge_persistence),
    },
    bboxDiagonal: asNumber(metrics.bbox_diagonal),
    stages: Object.entries(asRecord(metrics.stage_us)).flatMap(([name, value]) => {
      const us = asNumber(value);
      return us === null || us < 0 ? [] : [{ name, us }];
    }),
    latencyUs: asNumber(metrics.latency_us),
  };
}

function parseTexture(value: unknown): TextureReference | null {
  const texture = asRecord(value);
  const id = asText(texture.id);
  const mediaType = asText(texture.media_type);
  // It becomes part of an address.
  if (id === null || mediaType === null || !/^[0-9a-zA-Z]{1,128}$/.test(id)) return null;
  return {
    id,
    mediaType,
    bytes: asNumber(texture.bytes),
    width: asNumber(texture.width),
    height: asNumber(texture.height),
    encoded: texture.encoded === true,
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
