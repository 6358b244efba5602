/** What a deck counts. */

import type { ControlMessage, DecodedFrame, FrameMetrics, StreamConfig } from "steadymesh";
import { RateMeter } from "../base/rate";
import { type DeckNumbers, endToEndUs } from "./deck";

export class Meters {
  lastArrivalMs: number | null = null;

  private readonly received = new RateMeter();
  private readonly shown = new RateMeter();
  private config: StreamConfig | null = null;
  private metrics: FrameMetrics | null = null;
  private messageBytes: number | null = null;
  private endToEnd: number | null = null;
  private skippedByServer = 0;

  control(message: ControlMessage): void {
    if (message.type === "hello") this.config = message.config;
    if (message.type === "skipped") this.skippedByServer += message.missed;
  }

  receive(bytes: number): void {
    this.lastArrivalMs = performance.now();
    this.received.add(this.lastArrivalMs, bytes);
  }

  show(frame: DecodedFrame, live: boolean): void {
    this.shown.add(performance.now(), 0);
    this.metrics = frame.metrics;
    this.messageBytes = frame.messageBytes;
    this.endToEnd = live ? endToEndUs(frame.metrics.captureTimeUs, Date.now()) : null;
  }

  /** An image that was fetched for a frame. */
  receiveImage(bytes: number): void {
    this.received.addBytes(bytes);
  }

  disconnect(): void {
    this.received.clear();
  }

  numbers(skippedHere: number, waitMs: number | null): DeckNumbers {
    const nowMs = performance.now();
    const { perSecond, bitsPerSecond } = this.received.measure(nowMs);
    return {
      metrics: this.metrics,
      config: this.config,
      messageBytes: this.messageBytes,
      receivedPerSecond: perSecond,
      shownPerSecond: this.shown.measure(nowMs).perSecond,
      bitsPerSecond,
      endToEndUs: this.endToEnd,
      waitMs,
      skippedByServer: this.skippedByServer,
      skippedHere,
    };
  }
}
