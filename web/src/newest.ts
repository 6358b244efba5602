/**
 * Newest wins: one value is being worked on, at most one more waits, and a newer one takes the
 * place of the one that waits. A slow consumer therefore skips values and never falls behind.
 */
export class NewestWins<T> {
  /** Values that were replaced before their turn came. */
  skipped = 0;

  private waiting: { value: T } | null = null;
  private busy = false;
  private held = false;

  /** `work` must not reject; it answers for its own errors. */
  constructor(private readonly work: (value: T) => Promise<void>) {}

  offer(value: T): void {
    if (this.waiting !== null) this.skipped += 1;
    this.waiting = { value };
    void this.drain();
  }

  /** Lets the value in work finish and keeps the newest of those that follow until `release`. */
  hold(): void {
    this.held = true;
  }

  release(): void {
    this.held = false;
    void this.drain();
  }

  private async drain(): Promise<void> {
    if (this.busy) return;
    this.busy = true;
    while (this.waiting !== null && !this.held) {
      const { value } = this.waiting;
      this.waiting = null;
      await this.work(value);
    }
    this.busy = false;
  }
}
