/**
 * Frames come unevenly and are shown evenly: each waits until it is as late as the late ones.
 *
 * A frame's own time is when it was captured, or what its number says where the rig gives no time. How
 * late it comes after that time is its lag; the buffer's delay is what the lag of nearly all of the
 * last frames stays below.
 */

const WINDOW = 90;
const PERCENTILE = 0.95;
const MAX_DELAY_MS = 250;
/** How fast the delay goes down again, per frame. It goes up at once. */
const RELAXATION = 0.03;
/** A lag so far from the others is another clock or a rig that had stopped. */
const BREAK_MS = 1500;
/** Frames that may wait; over it the oldest is left out. */
const MAX_WAITING = 60;
const DEFAULT_INTERVAL_MS = 1000 / 30;

/** What the buffer knows of a frame; times in milliseconds. */
export interface Timing {
  seq: number;
  captureMs: number | null;
  arrivalMs: number;
}

export class JitterBuffer<T> {
  /** Frames that were left out because a newer one was due. */
  dropped = 0;

  private waiting: { value: T; timing: Timing }[] = [];
  private samples: Timing[] = [];
  private delayMs = 0;
  private baseMs = 0;

  /** `discard` is called with what is never shown. */
  constructor(private readonly discard: (value: T) => void) {}

  push(value: T, timing: Timing): void {
    this.measure(timing);
    this.waiting.push({ value, timing });
    if (this.waiting.length > MAX_WAITING) this.leaveOut(1);
  }

  /**
   * The newest frame that is due at this time, if there is one. `offsetMs` is what is added to a
   * frame's own time; the buffer's own, if left out.
   */
  take(nowMs: number, offsetMs = this.offsetMs): T | null {
    let due = 0;
    for (const { timing } of this.waiting) {
      if (this.ownTimeMs(timing) + offsetMs > nowMs) break;
      due += 1;
    }
    if (due === 0) return null;
    this.leaveOut(due - 1);
    return this.waiting.shift()?.value ?? null;
  }

  /** From a frame's own time to when it is shown. */
  get offsetMs(): number {
    return this.baseMs + this.delayMs;
  }

  /** How long a frame that came without any delay waits. */
  get waitMs(): number {
    return this.delayMs;
  }

  /** Whether frames have times of their own, which can be compared with another stream's. */
  get hasCaptureTimes(): boolean {
    return this.samples.length > 0 && this.samples.every(({ captureMs }) => captureMs !== null);
  }

  /** Forgets what waits and what is known of lags. */
  clear(): void {
    for (const { value } of this.waiting) this.discard(value);
    this.waiting = [];
    this.samples = [];
    this.delayMs = 0;
  }

  private leaveOut(count: number): void {
    for (const { value } of this.waiting.splice(0, count)) {
      this.dropped += 1;
      this.discard(value);
    }
  }

  private measure(timing: Timing): void {
    const before = this.samples.at(-1);
    const lag = timing.arrivalMs - this.ownTimeMs(timing);
    const broken =
      before !== undefined &&
      (timing.seq <= before.seq ||
        (timing.captureMs === null) !== (before.captureMs === null) ||
        Math.abs(lag - this.baseMs) > BREAK_MS);
    if (broken) {
      this.samples = [];
      // What waits has times of the old kind: it is shown next.
      this.leaveOut(Math.max(0, this.waiting.length - 1));
    }
    this.samples.push(timing);
    if (this.samples.length > WINDOW) this.samples.shift();
    const lags = this.samples
      .map((sample) => sample.arrivalMs - this.ownTimeMs(sample))
      .sort((a, b) => a - b);
    this.baseMs = lags[0] ?? 0;
    const high = lags[Math.floor((lags.length - 1) * PERCENTILE)] ?? this.baseMs;
    const wanted = Math.min(high - this.baseMs, MAX_DELAY_MS);
    this.delayMs =
      wanted > this.delayMs || broken
        ? wanted
        : this.delayMs + (wanted - this.delayMs) * RELAXATION;
  }

  private ownTimeMs({ seq, captureMs }: Timing): number {
    return captureMs ?? seq * this.intervalMs();
  }

  /** Between two frames, where only their numbers say something. */
  private intervalMs(): number {
    const first = this.samples[0];
    const last = this.samples.at(-1);
    if (first === undefined || last === undefined || last.seq <= first.seq) {
      return DEFAULT_INTERVAL_MS;
    }
    return (last.arrivalMs - first.arrivalMs) / (last.seq - first.seq);
  }
}
