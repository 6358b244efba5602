/** Everything at once: an address in, frames that can be drawn out. */

import { parseAddress } from "./address.js";
import { type DecodedFrame, FrameDecoder } from "./frames.js";
import type { LinkState } from "./link.js";
import type { ControlMessage, Frame } from "./message.js";
import type { FrameMetrics } from "./metrics.js";
import { OrderedWork } from "./ordered.js";
import { Playback, type Position } from "./playback.js";
import { DecoderPool, type PoolOptions } from "./pool.js";
import { Server, type ServerOptions } from "./server.js";
import { Subscription, type TextureMode } from "./subscription.js";
import { TextureStore } from "./textures.js";

/** A recording that is played without leaving frames out pauses at so many that wait… */
const CROWDED = 24;
/** …and goes on at so many. */
const ROOMY = 6;

export interface SessionOptions extends ServerOptions {
  /** Called for one frame after the other. Its image is there until the next call has returned. */
  onFrame(frame: DecodedFrame): void;
  onState?(state: LinkState): void;
  onControl?(message: ControlMessage): void;
  /** A frame that could not be decoded. */
  onError?(error: unknown): void;
  textures?: TextureMode | undefined;
  decoder?: PoolOptions | undefined;
}

export interface WatchOptions extends SessionOptions {
  /** Frames a second at most. */
  maxFps?: number | undefined;
}

export interface PlayOptions extends SessionOptions {
  from?: Position | undefined;
  speed?: number | undefined;
  paused?: boolean | undefined;
  /** Whether a slow page skips frames (`newest`, if left out), or slows the playback (`all`). */
  frames?: "newest" | "all" | undefined;
}

/** A stream that is watched. */
export interface WatchSession {
  /** Frames that were left out because decoding was too slow, and by the server for the same. */
  readonly skipped: number;
  /**
   * One frame by its number: any of a recording, or one of those that the server still holds of a
   * stream (`held`). Its image stays until it is given back by `release`.
   *
   * @throws {ProblemError} with status 404 if there is no such frame (any more).
   */
  frame(seq: number | "latest"): Promise<DecodedFrame>;
  release(frame: DecodedFrame): void;
  close(): void;
}

/** A stream that is watched live. */
export interface LiveSession extends WatchSession {
  /** The metrics of the newest frames that the server still holds, oldest first. */
  held(last?: number): Promise<FrameMetrics[]>;
}

/** A recording that is played. */
export interface PlaySession extends WatchSession {
  seek(position: Position): void;
  pause(): void;
  resume(): void;
  setSpeed(speed: number): void;
}

/**
 * Watches a live stream: `http://host/v1/streams/demo`, `…/watch/demo`, or a relative address. It
 * comes back by itself until it is closed.
 */
export function watch(address: string | URL, options: WatchOptions): LiveSession {
  const { server: url, place } = parseAddress(address);
  const server = new Server(url, options);
  const frames = new Receiver(server, place, options, "newest");
  const subscription = new Subscription(server, place.stream, {
    maxFps: options.maxFps,
    textures: options.textures,
    ...frames.handlers,
  });
  subscription.start();
  return {
    get skipped() {
      return frames.skipped;
    },
    held: (last = 300) => server.metrics(place.stream, last),
    frame: (seq) => frames.fetch(seq),
    release: (frame) => frames.release(frame),
    close() {
      subscription.close();
      frames.close();
    },
  };
}

/** Plays a recording: `http://host/v1/recordings/demo/20261129T215703Z-3f9a`. */
export function play(address: string | URL, options: PlayOptions): PlaySession {
  const { server: url, place } = parseAddress(address);
  const server = new Server(url, options);
  let paused = options.paused ?? false;
  let crowded = false;
  const keep = options.frames ?? "newest";
  const frames = new Receiver(server, place, options, keep, (waiting) => {
    if (keep === "newest") return;
    if (!crowded && waiting >= CROWDED) {
      crowded = true;
      playback.pause();
    } else if (crowded && waiting <= ROOMY) {
      crowded = false;
      if (!paused) playback.resume();
    }
  });
  const playback: Playback = new Playback(server, place.stream, place.recording ?? "", {
    from: options.from,
    speed: options.speed,
    paused: options.paused,
    textures: options.textures,
    ...frames.handlers,
  });
  playback.start();
  return {
    get skipped() {
      return frames.skipped;
    },
    frame: (seq) => frames.fetch(seq),
    release: (frame) => frames.release(frame),
    seek(position) {
      frames.clear();
      crowded = false;
      playback.seek(position);
      if (!paused && playback.isPaused) playback.resume();
    },
    pause() {
      paused = true;
      playback.pause();
    },
    resume() {
      paused = false;
      if (!crowded) playback.resume();
    },
    setSpeed: (speed) => playback.setSpeed(speed),
    close() {
      playback.close();
      frames.close();
    },
  };
}

/** Decodes what arrives and hands it on, one frame's image after the other's. */
class Receiver {
  readonly handlers = {
    onFrame: (frame: Frame) => {
      this.work.offer(frame);
      this.onWaiting(this.work.waiting);
    },
    onControl: (message: ControlMessage) => {
      if (message.type === "skipped") this.missed += message.missed;
      this.options.onControl?.(message);
    },
    onState: (state: LinkState) => this.options.onState?.(state),
  };

  private readonly pool: DecoderPool;
  private readonly textures = new TextureStore();
  private readonly decoder: FrameDecoder;
  private readonly work: OrderedWork<Frame, DecodedFrame>;
  private shown: DecodedFrame | null = null;
  private missed = 0;

  constructor(
    server: Server,
    place: { stream: string; recording?: string },
    private readonly options: SessionOptions,
    keep: "newest" | "all",
    private readonly onWaiting: (waiting: number) => void = () => undefined,
  ) {
    this.pool = new DecoderPool(options.decoder);
    this.pool.preload();
    this.decoder = new FrameDecoder(server, place, this.pool, this.textures, options.textures);
    this.work = new OrderedWork({
      width: this.pool.width,
      keep,
      work: (frame) => this.decoder.decode(frame),
      deliver: (frame) => this.deliver(frame),
      failed: (error) => options.onError?.(error),
      discard: (frame) => this.decoder.release(frame),
    });
  }

  get skipped(): number {
    return this.missed + this.work.skipped;
  }

  fetch(seq: number | "latest"): Promise<DecodedFrame> {
    return this.decoder.fetch(seq);
  }

  release(frame: DecodedFrame): void {
    this.decoder.release(frame);
  }

  clear(): void {
    this.work.clear();
  }

  close(): void {
    this.work.clear();
    this.pool.close();
    this.textures.close();
  }

  private deliver(frame: DecodedFrame): void {
    const before = this.shown;
    this.shown = frame;
    this.options.onFrame(frame);
    if (before !== null) this.decoder.release(before);
    this.onWaiting(this.work.waiting);
  }
}
