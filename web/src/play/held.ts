/** What the server still holds of a live stream, and what of that has been received already. */

import type { EncodedFrame, FrameMetrics, Server } from "steadymesh";

/** As many as a server holds, unless it is configured otherwise. */
export const HELD_FRAMES = 300;
/** Of meshes that are kept here; older ones are fetched again. */
const MAX_KEPT_BYTES = 48 << 20;
const DEFAULT_INTERVAL_S = 1 / 30;
/** A rig that was silent for longer is not waited for when its frames are played again. */
const MAX_GAP_S = 2;

export interface HeldFrame {
  seq: number;
  metrics: FrameMetrics;
  /** Seconds on a scale of its own, ascending. */
  atS: number;
  mesh: ArrayBuffer | null;
}

export class HeldFrames {
  private frames: HeldFrame[] = [];
  private keptBytes = 0;

  constructor(
    private readonly server: Server,
    private readonly stream: string,
  ) {}

  get length(): number {
    return this.frames.length;
  }

  at(index: number): HeldFrame | undefined {
    return this.frames[index];
  }

  get metrics(): FrameMetrics[] {
    return this.frames.map(({ metrics }) => metrics);
  }

  get newest(): HeldFrame | undefined {
    return this.frames.at(-1);
  }

  /** A frame that has just been received. */
  add(frame: EncodedFrame): void {
    const { seq } = frame.metrics;
    if (seq === null) return;
    const newest = this.newest?.seq ?? -1;
    // The first frame of another connection is here already.
    if (seq === newest) return;
    // Another stream of the same name.
    if (seq < newest) this.clear();
    this.append(frame.metrics, seq, frame.mesh.slice(0));
    this.trim();
  }

  /** Asks the server what it holds of the time before this page was opened. */
  async refresh(): Promise<void> {
    const metrics = await this.server.metrics(this.stream, HELD_FRAMES).catch(() => []);
    const known = new Map(this.frames.map((frame) => [frame.seq, frame]));
    const listed = new Map(metrics.flatMap((one) => (one.seq === null ? [] : [[one.seq, one]])));
    const newest = metrics.at(-1)?.seq ?? null;
    if (newest === null) return;
    // What has arrived while the answer was on its way is not in it.
    for (const frame of this.frames) if (frame.seq > newest) listed.set(frame.seq, frame.metrics);
    this.clear();
    for (const [seq, one] of [...listed].sort(([a], [b]) => a - b)) {
      this.append(one, seq, known.get(seq)?.mesh ?? null);
    }
    this.trim();
  }

  clear(): void {
    this.frames = [];
    this.keptBytes = 0;
  }

  /** The last frame that is not later than this; 0 if all are. */
  indexAt(atS: number): number {
    let low = 0;
    let high = this.frames.length;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if ((this.frames[middle]?.atS ?? 0) <= atS) low = middle;
      else high = middle;
    }
    return low;
  }

  /** The frame of this number, or the next one; the newest if there is none. */
  indexOf(seq: number): number {
    const index = this.frames.findIndex((frame) => frame.seq >= seq);
    return index === -1 ? Math.max(0, this.frames.length - 1) : index;
  }

  /** The frame nearest to another stream's, by time of capture, else by number. */
  nearestTo(metrics: FrameMetrics): HeldFrame | undefined {
    const wanted = metrics.captureTimeUs;
    const away = (frame: HeldFrame) =>
      wanted !== null && frame.metrics.captureTimeUs !== null
        ? Math.abs(frame.metrics.captureTimeUs - wanted)
        : Math.abs(frame.seq - (metrics.seq ?? 0));
    let best = this.frames[0];
    for (const frame of this.frames) if (best && away(frame) < away(best)) best = frame;
    return best;
  }

  /**
   * A frame to be decoded: by what was received, else from the server. A frame that the server
   * does not hold any more is forgotten.
   */
  async fetch(held: HeldFrame): Promise<EncodedFrame> {
    if (held.mesh === null) {
      try {
        const mesh = await this.server.mesh({ stream: this.stream }, held.seq);
        this.keep(held, mesh);
      } catch (error) {
        this.frames = this.frames.filter((frame) => frame !== held);
        throw error;
      }
    }
    const mesh = held.mesh?.slice(0) ?? new ArrayBuffer(0);
    return { metrics: held.metrics, mesh, texture: null, messageBytes: mesh.byteLength };
  }

  /** Fetches what will be wanted next. */
  prefetch(from: number, count: number): void {
    for (const held of this.frames.slice(from, from + count)) {
      if (held.mesh === null) this.fetch(held).catch(() => undefined);
    }
  }

  private append(metrics: FrameMetrics, seq: number, mesh: ArrayBuffer | null): void {
    const before = this.newest;
    const atS = before === undefined ? 0 : before.atS + gapS(before, metrics, seq);
    const frame: HeldFrame = { seq, metrics, atS, mesh: null };
    this.frames.push(frame);
    if (mesh !== null) this.keep(frame, mesh);
  }

  private keep(frame: HeldFrame, mesh: ArrayBuffer): void {
    frame.mesh = mesh;
    this.keptBytes += mesh.byteLength;
    for (const oldest of this.frames) {
      if (this.keptBytes <= MAX_KEPT_BYTES) break;
      if (oldest === frame) continue;
      this.keptBytes -= oldest.mesh?.byteLength ?? 0;
      oldest.mesh = null;
    }
  }

  private trim(): void {
    const excess = this.frames.splice(0, Math.max(0, this.frames.length - HELD_FRAMES));
    for (const { mesh } of excess) this.keptBytes -= mesh?.byteLength ?? 0;
  }
}

/** From one frame to the next as they were captured, or as frames usually are. */
function gapS(before: HeldFrame, metrics: FrameMetrics, seq: number): number {
  const start = before.metrics.captureTimeUs;
  const end = metrics.captureTimeUs;
  if (start === null || end === null) return (seq - before.seq) * DEFAULT_INTERVAL_S;
  const gap = (end - start) / 1e6;
  return gap > 0 && gap <= MAX_GAP_S ? gap : DEFAULT_INTERVAL_S;
}
