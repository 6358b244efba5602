/** What a server lists: streams, recordings, and the frames of a recording. */

import { asList, asNumber, asRecord, asText } from "./json.js";
import { type FrameMetrics, parseMetrics } from "./metrics.js";

export interface StreamConfig {
  targetFaces: number | null;
  targetRatio: number | null;
  tracking: string | null;
}

export interface StreamSummary {
  stream: string;
  /** `live`, or `idle` without frames for a while. */
  state: string | null;
  config: StreamConfig;
  published: number | null;
  dropped: number | null;
  subscribers: number | null;
  latestSeq: number | null;
}

/** What there is of one sequence of frames. Times are in microseconds since 1970. */
export interface TrackSummary {
  frames: number;
  bytes: number | null;
  firstSeq: number | null;
  lastSeq: number | null;
  firstTimeUs: number | null;
  lastTimeUs: number | null;
}

export interface RecordingSummary {
  stream: string;
  id: string;
  /** `recording`, `complete` or `interrupted`. */
  state: string | null;
  startedUs: number | null;
  config: StreamConfig;
  /** What can be played; `null` if only raw frames were recorded. */
  output: TrackSummary | null;
}

/** What is known of a recorded frame without its body. */
export interface RecordedFrame {
  seq: number;
  /** When it was captured, or stored if the rig did not say, in microseconds since 1970. */
  timeUs: number | null;
}

export interface RecordedFrames {
  frames: RecordedFrame[];
  /** Whether there are more after these. */
  more: boolean;
}

export function parseConfig(value: unknown): StreamConfig {
  const config = asRecord(value);
  return {
    targetFaces: asNumber(config.target_faces),
    targetRatio: asNumber(config.target_ratio),
    tracking: asText(config.tracking),
  };
}

/** The answer of `GET /v1/streams`, in the server's order. */
export function parseStreamList(json: unknown): StreamSummary[] {
  return asList(asRecord(json).streams).flatMap((item) => {
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

/** The answer of `GET /v1/recordings`, in the server's order. */
export function parseRecordingList(json: unknown): RecordingSummary[] {
  return asList(asRecord(json).recordings).flatMap((item) => parseRecording(item) ?? []);
}

/** One recording; `null` if it has no name. */
export function parseRecording(json: unknown): RecordingSummary | null {
  const summary = asRecord(json);
  const stream = asText(summary.stream);
  const id = asText(summary.id);
  if (stream === null || id === null) return null;
  return {
    stream,
    id,
    state: asText(summary.state),
    startedUs: asNumber(summary.started_us),
    config: parseConfig(summary.config),
    output: parseTrack(summary.output),
  };
}

/** The answer of `GET …/{id}/frames`. */
export function parseRecordedFrames(json: unknown): RecordedFrames {
  const { frames, more } = asRecord(json);
  return {
    frames: asList(frames).flatMap((item) => {
      const frame = asRecord(item);
      const seq = asNumber(frame.seq);
      const timeUs = asNumber(frame.capture_time_us) ?? asNumber(frame.stored_us);
      return seq === null ? [] : [{ seq, timeUs }];
    }),
    more: more === true,
  };
}

/** The answer of `GET …/metrics?last=`, oldest first. */
export function parseMetricsList(json: unknown): FrameMetrics[] {
  return asList(asRecord(json).frames).map(parseMetrics);
}

function parseTrack(value: unknown): TrackSummary | null {
  const track = asRecord(value);
  const frames = asNumber(track.frames);
  if (frames === null) return null;
  return {
    frames,
    bytes: asNumber(track.bytes),
    firstSeq: asNumber(track.first_seq),
    lastSeq: asNumber(track.last_seq),
    firstTimeUs: asNumber(track.first_time_us),
    lastTimeUs: asNumber(track.last_time_us),
  };
}
