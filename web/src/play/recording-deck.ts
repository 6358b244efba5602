/** A recording, which the server plays: it keeps the time, and this shows what comes. */

import {
  type DecodedFrame,
  type DecoderPool,
  type EncodedFrame,
  type Frame,
  FrameDecoder,
  type LinkState,
  OrderedWork,
  Playback,
  type RecordingSummary,
  type Server,
  type TextureStore,
} from "steadymesh";
import {
  type Deck,
  type DeckEvents,
  type DeckNumbers,
  type DeckPosition,
  describeError,
} from "./deck";
import { JitterBuffer } from "./jitter";
import { Meters } from "./meters";

/** How often a recording that goes on is asked for its length. */
const GROWTH_POLL_MS = 4000;
/** How far back the frame before is looked for: numbers may have gaps. */
const LOOK_BACK = 200;

type Arrival = EncodedFrame & { arrivalMs: number };

export class RecordingDeck implements Deck {
  readonly kind = "recording";
  state: LinkState = { kind: "connecting" };
  problem: string | null = null;
  summary: RecordingSummary | null = null;

  private readonly decoder: FrameDecoder;
  private readonly playback: Playback;
  private readonly meters = new Meters();
  private readonly jitter = new JitterBuffer<DecodedFrame>((frame) => this.release(frame));
  private readonly incoming: OrderedWork<Arrival, DecodedFrame>;
  private readonly growth: ReturnType<typeof setInterval>;
  private seq: number | null = null;
  private atUs: number | null = null;
  private speed = 1;

  constructor(
    private readonly server: Server,
    private readonly stream: string,
    private readonly recording: string,
    pool: DecoderPool,
    textures: TextureStore,
    private readonly events: DeckEvents,
  ) {
    this.decoder = new FrameDecoder(server, { stream, recording }, pool, textures);
    this.incoming = new OrderedWork({
      width: pool.width,
      keep: "newest",
      work: (frame) => this.decoder.decode(frame),
      deliver: (frame, { arrivalMs }) => this.enqueue(frame, arrivalMs),
      failed: (error, { metrics }) => {
        this.problem = `Frame ${metrics.seq ?? ""} cannot be shown: ${describeError(error)}.`;
      },
      discard: (frame) => this.release(frame),
    });
    this.playback = new Playback(server, stream, recording, {
      onState: (state) => this.onState(state),
      onControl: (message) => this.meters.control(message),
      onFrame: (frame) => this.onFrame(frame),
    });
    this.growth = setInterval(() => {
      if (this.summary === null || this.summary.state === "recording") void this.refresh();
    }, GROWTH_POLL_MS);
  }

  start(): void {
    void this.refresh();
    this.playback.start();
  }

  close(): void {
    clearInterval(this.growth);
    this.playback.close();
    this.forget();
  }

  release(frame: DecodedFrame): void {
    this.decoder.release(frame);
  }

  /** The server keeps quiet where the rig did. */
  get silentMs(): number {
    return this.meters.lastArrivalMs === null ? Infinity : 0;
  }

  get position(): DeckPosition {
    const track = this.summary?.output;
    const startUs = track?.firstTimeUs ?? this.atUs ?? 0;
    const endUs = Math.max(track?.lastTimeUs ?? startUs, this.atUs ?? startUs);
    const playing = !this.playback.isPaused && this.state.kind !== "finished";
    return {
      startS: 0,
      endS: (endUs - startUs) / 1e6,
      atS: ((this.atUs ?? startUs) - startUs) / 1e6,
      live: false,
      playing,
      speed: this.speed,
    };
  }

  get numbers(): DeckNumbers {
    return this.meters.numbers(this.incoming.skipped + this.jitter.dropped, this.jitter.waitMs);
  }

  play(): void {
    this.playback.resume();
    // At its end it begins anew.
    if (this.state.kind === "finished") this.seek(0);
  }

  pause(): void {
    this.playback.pause();
    this.forget();
  }

  step(frames: number): void {
    this.pause();
    if (this.seq === null) return;
    if (frames > 0) this.playback.seek({ seq: this.seq + 1 });
    else void this.stepBack(this.seq);
  }

  seek(atS: number): void {
    const startUs = this.summary?.output?.firstTimeUs ?? 0;
    this.forget();
    this.events.onBreak();
    this.atUs = startUs + atS * 1e6;
    this.playback.seek({ timeUs: this.atUs });
  }

  setSpeed(speed: number): void {
    this.speed = speed;
    this.forget();
    this.playback.setSpeed(speed);
  }

  goLive(): void {}

  setHidden(hidden: boolean): void {
    if (hidden) this.incoming.hold();
    else {
      this.jitter.clear();
      this.incoming.release();
    }
  }

  tick(): void {
    const frame = this.jitter.take(performance.now());
    if (frame !== null) this.show(frame);
  }

  private async refresh(): Promise<void> {
    try {
      this.summary = await this.server.recording(this.stream, this.recording);
    } catch {
      // The connection says what is wrong.
    }
  }

  private async stepBack(seq: number): Promise<void> {
    const from = { seq: Math.max(0, seq - LOOK_BACK) };
    const list = await this.server
      .recordedFrames(this.stream, this.recording, from, LOOK_BACK)
      .catch(() => null);
    const before = list?.frames.filter((frame) => frame.seq < seq).at(-1);
    if (before !== undefined) this.playback.seek({ seq: before.seq });
  }

  /** What is on its way is not of the place that is wanted. */
  private forget(): void {
    this.incoming.clear();
    this.jitter.clear();
  }

  private onFrame(frame: Frame): void {
    this.meters.receive(frame.messageBytes);
    this.events.onReceived(frame.metrics);
    this.incoming.offer({ ...frame, arrivalMs: performance.now() });
  }

  private onState(state: LinkState): void {
    if (state.kind === "reconnecting") this.meters.disconnect();
    this.state = state;
    this.events.onState(state);
  }

  private enqueue(frame: DecodedFrame, arrivalMs: number): void {
    this.meters.receiveImage(frame.fetchedBytes);
    const { seq, captureTimeUs } = frame.metrics;
    if (this.playback.isPaused || this.speed === 0) {
      this.show(frame);
      return;
    }
    const captureMs = captureTimeUs === null ? null : captureTimeUs / 1000 / this.speed;
    this.jitter.push(frame, { seq: seq ?? 0, captureMs, arrivalMs });
  }

  private show(frame: DecodedFrame): void {
    const { seq, captureTimeUs } = frame.metrics;
    this.problem = null;
    this.seq = seq;
    this.atUs = captureTimeUs ?? this.timeOf(seq);
    this.meters.show(frame, false);
    this.events.onFrame(frame);
  }

  /** About, where the rig gives no times. */
  private timeOf(seq: number | null): number | null {
    const track = this.summary?.output;
    if (!track || seq === null) return this.atUs;
    const { firstSeq, lastSeq, firstTimeUs, lastTimeUs } = track;
    if (firstSeq === null || lastSeq === null || firstTimeUs === null || lastTimeUs === null) {
      return this.atUs;
    }
    const share = (seq - firstSeq) / Math.max(1, lastSeq - firstSeq);
    return firstTimeUs + share * (lastTimeUs - firstTimeUs);
  }
}
