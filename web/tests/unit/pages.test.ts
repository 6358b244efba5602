/** Addresses, cards and keys. */

import type { StreamSummary } from "steadymesh";
import { expect, test } from "vitest";
import { pageOf, placeOfPage } from "../../src/base/place";
import { recordingCards } from "../../src/home/recordings";
import { streamCards } from "../../src/home/streams";
import { type Actions, commands } from "../../src/ui/commands";

test("the address names a stream, a recording, or the lists", () => {
  const place = (path: string) => placeOfPage(new URL(path, "http://host"));
  expect(place("/watch/demo?rotate=0")).toEqual({ stream: "demo" });
  expect(place("/watch/demo?recording=x1")).toEqual({ stream: "demo", recording: "x1" });
  expect(place("/")).toBeNull();
  expect(pageOf({ stream: "demo" }, "demo-off")).toBe("/watch/demo?beside=demo-off");
  expect(place(pageOf({ stream: "a", recording: "x1" }))).toEqual({ stream: "a", recording: "x1" });
});

test("a stream without tracking and its tracked twin are offered side by side", () => {
  const summary = (stream: string, tracking: string): StreamSummary => ({
    stream,
    state: "live",
    config: { targetFaces: 4000, targetRatio: null, tracking },
    published: 1,
    dropped: 0,
    subscribers: 0,
    latestSeq: 1,
  });
  const streams = [
    summary("a", "robust"),
    summary("a-off", "off"),
    summary("b-off", "off"),
    summary("c-robust", "robust"),
  ];
  const hrefs = streamCards(streams).map(({ href }) => href);
  expect(hrefs.slice(4)).toEqual(["/watch/a-off?beside=a"]);
});

test("recordings are listed newest first, and those that cannot be played are not", () => {
  const recording = (id: string, startedUs: number, frames: number | null) => ({
    stream: "demo",
    id,
    state: "complete",
    startedUs,
    config: { targetFaces: null, targetRatio: null, tracking: null },
    output:
      frames === null
        ? null
        : { frames, bytes: 9, firstSeq: 0, lastSeq: 1, firstTimeUs: 0, lastTimeUs: 90_000_000 },
  });
  const cards = recordingCards([
    recording("old", 1, 5),
    recording("raw", 2, null),
    recording("empty", 3, 0),
    recording("new", 4, 7),
  ]);
  expect(cards.map(({ key }) => key)).toEqual(["demo/new", "demo/old"]);
  expect(cards[0]?.facts).toContain("1:30.0");
});

test("no key does two things, and each is on the help sheet", () => {
  const list = commands({} as Actions);
  const keys = list.flatMap((command) => command.keys);
  expect(new Set(keys).size).toBe(keys.length);
  expect(list.every(({ shown, does }) => shown.length > 0 && does !== "")).toBe(true);
});
