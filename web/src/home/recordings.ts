/** Cards of recordings. */

import type { RecordingSummary } from "steadymesh";
import { bytes, clock, count } from "../base/format";
import { pageOf } from "../base/place";
import type { CardContent } from "./cards";

const date = new Intl.DateTimeFormat(undefined, { dateStyle: "medium", timeStyle: "short" });

/** The newest first. Recordings of raw frames alone cannot be played. */
export function recordingCards(recordings: RecordingSummary[]): CardContent[] {
  return recordings
    .filter(({ output }) => output !== null && output.frames > 0)
    .sort((a, b) => (b.startedUs ?? 0) - (a.startedUs ?? 0))
    .map(recordingCard);
}

function recordingCard({ stream, id, state, startedUs, output }: RecordingSummary): CardContent {
  const place = { stream, recording: id };
  const lengthUs =
    output?.firstTimeUs != null && output.lastTimeUs !== null
      ? output.lastTimeUs - output.firstTimeUs
      : null;
  const firstSeq = output?.firstSeq ?? null;
  return {
    key: `${stream}/${id}`,
    href: pageOf(place),
    name: stream,
    state: { text: state ?? "recorded", kind: state === "recording" ? "live" : "idle" },
    facts: [
      startedUs === null ? null : date.format(startedUs / 1000),
      lengthUs === null ? null : clock(lengthUs / 1e6),
      output === null ? null : `${count(output.frames)} frames`,
      output?.bytes == null ? null : bytes(output.bytes),
    ].filter((fact) => fact !== null),
    picture: firstSeq === null ? null : { place, seq: firstSeq, changes: false },
  };
}
