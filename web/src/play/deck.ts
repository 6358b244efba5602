/** What plays: a live stream or a recording, under the same controls. */

import type { DecodedFrame, FrameMetrics, LinkState, StreamConfig } from "steadymesh";

/** Where a deck stands, in seconds on its own scale. */
export interface DeckPosition {
  startS: number;
  endS: number;
  atS: number;
  /** A live stream is shown as it comes in, not from what is held of it. */
  live: boolean;
  playing: boolean;
  speed: number;
}

export interface DeckNumbers {
  /** Of the frame that is shown. */
  metrics: FrameMetrics | null;
  config: StreamConfig | null;
  messageBytes: number | null;
  receivedPerSecond: number;
  shownPerSecond: number;
  bitsPerSecond: number;
  /** From capture to screen; `null` where the rig's clock cannot be the time of day. */
  endToEndUs: number | null;
  /** How long the buffer makes frames wait that came early. */
  waitMs: number | null;
  /** By the server, because this page was too slow. */
  skippedByServer: number;
  /** By this page, because decoding or drawing was too slow. */
  skippedHere: number;
}

export interface DeckEvents {
  /** A frame to be drawn now. It is to be given back by `release`. */
  onFrame(frame: DecodedFrame): void;
  /** A frame that came in, whether it is drawn or not. */
  onReceived(metrics: FrameMetrics): void;
  /** What there is of the time before, oldest first, up to the newest frame that came in. */
  onHeld(metrics: FrameMetrics[]): void;
  /** Frames before and after this have nothing to do with each other. */
  onBreak(): void;
  onState(state: LinkState): void;
}

export interface Deck {
  readonly kind: "live" | "recording";
  readonly state: LinkState;
  /** What is wrong with the newest frame. */
  readonly problem: string | null;
  /** Whether frames have come for a while, if they should. */
  readonly silentMs: number;
  readonly position: DeckPosition;
  readonly numbers: DeckNumbers;
  start(): void;
  /** To be called at every refresh of the screen. */
  tick(nowMs: number): void;
  play(): void;
  pause(): void;
  /** Goes so many frames on, or back, and stays there. */
  step(frames: number): void;
  seek(atS: number): void;
  setSpeed(speed: number): void;
  /** To the newest frame of a live stream. */
  goLive(): void;
  release(frame: DecodedFrame): void;
  /** Nobody looks at the page. */
  setHidden(hidden: boolean): void;
  close(): void;
}

/** No clock that is roughly right is further off than this. */
const MAX_PLAUSIBLE_DELAY_US = 60e6;

/**
 * Capture to now in microseconds, or `null` if the two clocks cannot be the same time: many rigs
 * count from the beginning of a take instead of the Unix epoch.
 */
export function endToEndUs(captureTimeUs: number | null, nowMs: number): number | null {
  if (captureTimeUs === null) return null;
  const delay = nowMs * 1000 - captureTimeUs;
  return 0 <= delay && delay <= MAX_PLAUSIBLE_DELAY_US ? delay : null;
}

export function describeError(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
