/** Cards of live streams, and of pairs of them that are worth comparing. */

import type { StreamConfig, StreamSummary } from "steadymesh";
import { count } from "../base/format";
import { pageOf } from "../base/place";
import type { CardContent } from "./cards";

export function streamCards(streams: StreamSummary[]): CardContent[] {
  return [...streams.map(streamCard), ...pairsOf(streams).map(pairCard)];
}

function streamCard(summary: StreamSummary): CardContent {
  const { stream, config, latestSeq } = summary;
  return {
    key: stream,
    href: pageOf({ stream }),
    name: stream,
    state: stateOf(summary),
    facts: [
      describeTarget(config),
      config.tracking === null ? null : `${config.tracking} tracking`,
      summary.published === null ? null : `${count(summary.published)} frames`,
      summary.subscribers === null ? null : `${count(summary.subscribers)} watching`,
    ].filter((fact) => fact !== null),
    picture: latestSeq === null ? null : { place: { stream }, seq: latestSeq, changes: true },
  };
}

interface Pair {
  off: StreamSummary;
  tracked: StreamSummary;
}

/** One capture without tracking and with it, by their names: `demo-off` beside `demo-robust` or `demo`. */
export function pairsOf(streams: StreamSummary[]): Pair[] {
  return streams.flatMap((off) => {
    if (off.config.tracking !== "off") return [];
    const base = baseOf(off.stream);
    const tracked = streams.find(
      ({ stream, config }) => config.tracking === "robust" && baseOf(stream) === base,
    );
    return tracked === undefined ? [] : [{ off, tracked }];
  });
}

function baseOf(stream: string): string {
  return stream.replace(/-?(off|robust)$/, "");
}

function pairCard({ off, tracked }: Pair): CardContent {
  const { latestSeq } = tracked;
  const place = { stream: tracked.stream };
  return {
    key: `${off.stream} ${tracked.stream}`,
    href: pageOf({ stream: off.stream }, tracked.stream),
    name: `${off.stream} beside ${tracked.stream}`,
    state: stateOf(tracked),
    facts: ["without tracking, and with it"],
    picture: latestSeq === null ? null : { place, seq: latestSeq, changes: true },
  };
}

function stateOf({ state }: StreamSummary): CardContent["state"] {
  const isLive = state === null || state === "live";
  return { text: state ?? "live", kind: isLive ? "live" : "idle" };
}

function describeTarget(config: StreamConfig): string | null {
  if (config.targetFaces !== null) return `${count(config.targetFaces)} faces`;
  if (config.targetRatio !== null) return `${(config.targetRatio * 100).toPrecision(2)} % of faces`;
  return null;
}
