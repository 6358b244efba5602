/**
 * A live stream: shown as it comes in, or, after a pause, a step or a seek, from what the server
 * still holds of it.
 */

import {
  type DecodedFrame,
  type DecoderPool,
  type EncodedFrame,
  type Frame,
  FrameDecoder,
  type FrameMetrics,
  type LinkState,
  OrderedWork,
  type Server,
  Subscription,
  type TextureStore,
} from "steadymesh";
import {
  type Deck,
  type DeckEvents,
  type DeckNumbers,
  type DeckPosition,
  describeError,
} from "./deck";
import { type HeldFrame, HeldFrames } from "./held";
import { JitterBuffer } from "./jitter";
import { Meters } from "./meters";

/** Held frames that are fetched ahead of their turn. */
const PREFETCH = 8;

type Arrival = EncodedFrame & { arrivalMs: number };

export class LiveDeck implements Deck {
  readonly kind = "live";
  state: LinkState = { kind: "connecting" };
  problem: string | null = null;
  /** What is added to a frame's own time, if another stream is shown beside this one. */
  sharedOffsetMs: (() => number | null) | null = null;

  private readonly decoder: FrameDecoder;
  private readonly subscription: Subscription;
  private readonly held: HeldFrames;
  private readonly meters = new Meters();
  private readonly jitter = new JitterBuffer<DecodedFrame>((frame) => this.release(frame));
  private readonly incoming: OrderedWork<Arrival, DecodedFrame>;
  private readonly again: OrderedWork<HeldFrame, DecodedFrame>;

  private live = true;
  private playing = true;
  private speed = 1;
  /** Of the frame that is shown or asked for. */
  private seq: number | null = null;
  /** While held frames are played: where on their scale. */
  private clockS = 0;
  private lastTickMs = 0;

  constructor(
    server: Server,
    stream: string,
    pool: DecoderPool,
    textures: TextureStore,
    private readonly events: DeckEvents,
  ) {
    this.decoder = new FrameDecoder(server, { stream }, pool, textures);
    this.held = new HeldFrames(server, stream);
    const failed = (error: unknown, { metrics }: { metrics: FrameMetrics }) => {
      this.problem = `Frame ${metrics.seq ?? ""} cannot be shown: ${describeError(error)}.`;
    };
    const discard = (frame: DecodedFrame) => this.release(frame);
    this.incoming = new OrderedWork<Arrival, DecodedFrame>({
      width: pool.width,
      keep: "newest",
      work: (frame) => this.decoder.decode(frame),
      deliver: (frame, { arrivalMs }) => this.enqueue(frame, arrivalMs),
      failed,
      discard,
    });
    this.again = new OrderedWork<HeldFrame, DecodedFrame>({
      width: pool.width,
      keep: "newest",
      work: async (frame) => this.decoder.decode(await this.held.fetch(frame)),
      deliver: (frame) => this.show(frame),
      failed,
      discard,
    });
    this.subscription = new Subscription(server, stream, {
      onState: (state) => this.onState(state),
      onControl: (message) => this.meters.control(message),
      onFrame: (frame) => this.onFrame(frame),
    });
  }

  start(): void {
    this.subscription.start();
  }

  close(): void {
    this.subscription.close();
    this.incoming.clear();
    this.again.clear();
    this.jitter.clear();
  }

  release(frame: DecodedFrame): void {
    this.decoder.release(frame);
  }

  get silentMs(): number {
    const { lastArrivalMs } = this.meters;
    return lastArrivalMs === null ? Infinity : performance.now() - lastArrivalMs;
  }

  get position(): DeckPosition {
    const first = this.held.at(0);
    const endS = this.held.newest?.atS ?? 0;
    const current = this.seq === null ? undefined : this.held.at(this.held.indexOf(this.seq));
    const { live, playing, speed } = this;
    const atS = live && playing ? endS : (current?.atS ?? endS);
    return { startS: first?.atS ?? 0, endS, atS, live, playing, speed };
  }

  get numbers(): DeckNumbers {
    const skipped = this.incoming.skipped + this.jitter.dropped;
    return this.meters.numbers(skipped, this.live ? this.jitter.waitMs : null);
  }

  /** From a frame's own time to when it is shown, if that can be compared with another stream's. */
  get offsetMs(): number | null {
    return this.live && this.jitter.hasCaptureTimes ? this.jitter.offsetMs : null;
  }

  play(): void {
    this.playing = true;
    if (this.live) return;
    if (this.seq === null || this.seq >= (this.held.newest?.seq ?? -1)) this.goLive();
    else this.clockS = this.position.atS;
  }

  pause(): void {
    this.leaveLive();
    this.playing = false;
  }

  step(frames: number): void {
    this.pause();
    if (this.seq === null) return;
    const last = Math.max(0, this.held.length - 1);
    this.showHeld(Math.min(Math.max(this.held.indexOf(this.seq) + frames, 0), last));
  }

  seek(atS: number): void {
    this.leaveLive();
    this.clockS = atS;
    this.showHeld(this.held.indexAt(atS));
  }

  setSpeed(speed: number): void {
    this.speed = speed;
    // More slowly than it comes in is from what is held.
    if (speed < 1 && this.live) this.leaveLive();
    this.clockS = this.position.atS;
  }

  goLive(): void {
    this.again.clear();
    this.jitter.clear();
    this.live = this.playing = true;
    this.speed = 1;
    const { newest } = this.held;
    // Shown at once, should no other one come for a while.
    if (newest !== undefined && newest.seq !== this.seq) this.again.offer(newest);
  }

  /** Shows what is nearest to another stream's frame, and stays there. */
  follow(metrics: FrameMetrics): void {
    const frame = this.held.nearestTo(metrics);
    this.leaveLive();
    this.playing = false;
    if (frame !== undefined && frame.seq !== this.seq) this.showHeld(this.held.indexOf(frame.seq));
  }

  setHidden(hidden: boolean): void {
    if (hidden) this.incoming.hold();
    else {
      this.jitter.clear();
      this.incoming.release();
    }
  }

  tick(nowMs: number): void {
    const seconds = Math.min((nowMs - this.lastTickMs) / 1000, 0.25);
    this.lastTickMs = nowMs;
    if (this.live) {
      const offset = this.sharedOffsetMs?.() ?? this.jitter.offsetMs;
      const frame = this.jitter.take(performance.now(), offset);
      if (frame !== null) this.show(frame);
    } else if (this.playing) this.advance(seconds * this.speed);
  }

  private onFrame(frame: Frame): void {
    this.meters.receive(frame.messageBytes);
    this.held.add(frame);
    if (!this.live) return;
    this.events.onReceived(frame.metrics);
    this.incoming.offer({ ...frame, arrivalMs: performance.now() });
  }

  private onState(state: LinkState): void {
    if (this.state.kind === "open" && state.kind !== "open") {
      this.meters.disconnect();
      this.events.onBreak();
    }
    this.state = state;
    if (state.kind === "open") void this.refreshHeld();
    this.events.onState(state);
  }

  private async refreshHeld(): Promise<void> {
    await this.held.refresh();
    this.events.onHeld(this.held.metrics);
    // Their scale is another one now.
    if (!this.live) this.clockS = this.position.atS;
  }

  private enqueue(frame: DecodedFrame, arrivalMs: number): void {
    this.meters.receiveImage(frame.fetchedBytes);
    const { seq, captureTimeUs } = frame.metrics;
    if (!this.live) {
      this.release(frame);
      return;
    }
    const captureMs = captureTimeUs === null ? null : captureTimeUs / 1000;
    this.jitter.push(frame, { seq: seq ?? 0, captureMs, arrivalMs });
  }

  private show(frame: DecodedFrame): void {
    this.problem = null;
    this.seq = frame.metrics.seq;
    this.meters.show(frame, this.live);
    this.events.onFrame(frame);
  }

  private leaveLive(): void {
    if (!this.live) return;
    this.live = false;
    this.incoming.clear();
    this.jitter.clear();
    this.clockS = this.position.atS;
  }

  private showHeld(index: number): void {
    const frame = this.held.at(index);
    if (frame === undefined) return;
    this.seq = frame.seq;
    this.again.offer(frame);
  }

  /** Plays on from what is held, up to the live edge. */
  private advance(seconds: number): void {
    this.clockS += seconds;
    const newest = this.held.newest;
    if (newest !== undefined && this.clockS > newest.atS && this.speed >= 1) {
      this.goLive();
      return;
    }
    const index = this.held.indexAt(this.clockS);
    this.held.prefetch(index + 1, PREFETCH);
    if (this.held.at(index)?.seq !== this.seq) this.showHeld(index);
  }
}
