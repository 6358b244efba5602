/** The numbers of the stream that is shown. */

import type { StreamConfig, TextureReference } from "steadymesh";
import { element } from "../base/dom";
import * as format from "../base/format";
import type { DeckNumbers } from "../play/deck";

const LABELS = {
  fps: "Frame rate",
  bytes: "Frame size",
  bitrate: "Bit rate",
  latency: "Latency",
  endToEnd: "End to end",
  buffer: "Buffer",
  faces: "Faces",
  vertices: "Vertices",
  texture: "Image",
  seq: "Frame",
  dropped: "Dropped",
  tracking: "Tracking",
} as const;

type Name = keyof typeof LABELS;

/** A value, and what stands under it. */
type Cell = [string, string];

export class Stats {
  readonly root = element("dl", { className: "stats" });
  private readonly views = new Map<Name, { value: HTMLElement; note: HTMLElement }>();

  constructor() {
    for (const name of Object.keys(LABELS) as Name[]) {
      const value = element("dd", { className: "value" }, [format.UNKNOWN]);
      value.dataset.stat = name;
      const note = element("dd", { className: "note" });
      this.views.set(name, { value, note });
      this.root.append(element("div", {}, [element("dt", {}, [LABELS[name]]), value, note]));
    }
  }

  update(numbers: DeckNumbers): void {
    for (const [name, [value, note]] of Object.entries(cellsOf(numbers)) as [Name, Cell][]) {
      const view = this.views.get(name);
      if (view === undefined) continue;
      if (view.value.textContent !== value) view.value.textContent = value;
      if (view.note.textContent !== note) view.note.textContent = note;
    }
  }
}

function cellsOf(numbers: DeckNumbers): Record<Name, Cell> {
  const { metrics, config } = numbers;
  const { input, output } = metrics ?? {};
  const dropped = numbers.skippedByServer + numbers.skippedHere;
  return {
    fps: [
      format.frameRate(numbers.receivedPerSecond),
      `${numbers.shownPerSecond.toFixed(1)} shown`,
    ],
    bytes: [
      format.bytes(numbers.messageBytes),
      prefixed("from ", format.bytes(input?.bytes ?? null)),
    ],
    bitrate: [format.bitRate(numbers.bitsPerSecond), "received"],
    latency: [format.duration(metrics?.latencyUs ?? null), "in the server"],
    endToEnd: [
      format.duration(numbers.endToEndUs),
      numbers.endToEndUs === null ? "not known" : "capture to screen",
    ],
    buffer: [
      format.duration(numbers.waitMs === null ? null : numbers.waitMs * 1000),
      "against jitter",
    ],
    faces: [
      format.count(output?.faces ?? null),
      prefixed("of ", format.count(input?.faces ?? null)),
    ],
    vertices: [
      format.count(output?.vertices ?? null),
      prefixed("of ", format.count(input?.vertices ?? null)),
    ],
    texture: imageCell(metrics?.texture ?? null),
    seq: [format.count(metrics?.seq ?? null), metrics?.quality ?? ""],
    dropped: [format.count(dropped), `${format.count(numbers.skippedByServer)} on the way`],
    tracking: [
      metrics?.tracking ?? config?.tracking ?? format.UNKNOWN,
      metrics?.reset != null ? "reset: a first frame" : describeTarget(config),
    ],
  };
}

function imageCell(texture: TextureReference | null): Cell {
  if (texture === null) return [format.UNKNOWN, "none"];
  const { width, height, mediaType, bytes } = texture;
  const size = width === null || height === null ? "?" : `${width}×${height}`;
  return [size, `${format.bytes(bytes)} ${mediaType.replace(/^image\//, "")}`];
}

function describeTarget(config: StreamConfig | null): string {
  if (config?.targetFaces != null) return `target ${format.count(config.targetFaces)}`;
  if (config?.targetRatio != null) return `target ${(config.targetRatio * 100).toPrecision(2)} %`;
  return "";
}

function prefixed(prefix: string, text: string): string {
  return text === format.UNKNOWN ? "" : prefix + text;
}
