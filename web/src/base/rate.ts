/** Frame rate and bit rate over a sliding window. */

const WINDOW_MS = 2000;

export class RateMeter {
  private readonly samples: { atMs: number; bytes: number }[] = [];

  add(atMs: number, bytes: number): void {
    this.samples.push({ atMs, bytes });
    this.forget(atMs);
  }

  /** What came besides the newest frame. */
  addBytes(bytes: number): void {
    const newest = this.samples.at(-1);
    if (newest !== undefined) newest.bytes += bytes;
  }

  clear(): void {
    this.samples.length = 0;
  }

  /** Both are 0 until two samples lie within the last two seconds. */
  measure(nowMs: number): { perSecond: number; bitsPerSecond: number } {
    this.forget(nowMs);
    const first = this.samples[0];
    const last = this.samples.at(-1);
    if (first === undefined || last === undefined || last.atMs <= first.atMs) {
      return { perSecond: 0, bitsPerSecond: 0 };
    }
    // The first sample opens the span; what it carried arrived before it.
    const seconds = (last.atMs - first.atMs) / 1000;
    const bytes = this.samples.reduce((sum, sample) => sum + sample.bytes, -first.bytes);
    return {
      perSecond: (this.samples.length - 1) / seconds,
      bitsPerSecond: (bytes * 8) / seconds,
    };
  }

  private forget(nowMs: number): void {
    const fresh = this.samples.findIndex((sample) => nowMs - sample.atMs <= WINDOW_MS);
    this.samples.splice(0, fresh === -1 ? this.samples.length : fresh);
  }
}
