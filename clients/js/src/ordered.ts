/**
 * Work that is done side by side and comes out in order.
 *
 * `newest`: at most `width` values are in work and one more waits; a newer one takes the place of the
 * one that waits. A slow consumer skips values and never falls behind. `all`: every value waits for
 * its turn, and whoever brings them has to look at `waiting`.
 */
export class OrderedWork<In, Out> {
  /** Values that were replaced before their turn came. */
  skipped = 0;

  private queue: In[] = [];
  private inWork = 0;
  private held = false;
  /** What is in work belongs to this one; what an older one began is not delivered. */
  private generation = 0;
  private last: Promise<void> = Promise.resolve();

  constructor(
    private readonly options: {
      width: number;
      keep: "newest" | "all";
      work(value: In): Promise<Out>;
      /** In the order of the offers. */
      deliver(result: Out, value: In): void;
      failed(error: unknown, value: In): void;
      /** Called with results that nobody wants any more. */
      discard?(result: Out): void;
    },
  ) {}

  offer(value: In): void {
    if (this.options.keep === "newest" && this.queue.length > 0) {
      this.skipped += this.queue.length;
      this.queue = [];
    }
    this.queue.push(value);
    this.begin();
  }

  /** Values that are not in work yet. */
  get waiting(): number {
    return this.queue.length;
  }

  /** Begins nothing until `release`. */
  hold(): void {
    this.held = true;
  }

  release(): void {
    this.held = false;
    this.begin();
  }

  /** Forgets what waits, and what is in work. */
  clear(): void {
    this.queue = [];
    this.generation += 1;
  }

  private begin(): void {
    while (!this.held && this.inWork < this.options.width) {
      const value = this.queue.shift();
      if (value === undefined) return;
      this.inWork += 1;
      const { generation } = this;
      const result = this.options.work(value);
      // Someone listens before its turn comes, or a failure would count as unhandled.
      result.catch(() => undefined);
      this.last = this.last.then(() => this.finish(result, value, generation));
    }
  }

  private async finish(result: Promise<Out>, value: In, generation: number): Promise<void> {
    try {
      const out = await result;
      if (generation === this.generation) this.options.deliver(out, value);
      else this.options.discard?.(out);
    } catch (error) {
      if (generation === this.generation) this.options.failed(error, value);
    } finally {
      this.inWork -= 1;
      this.begin();
    }
  }
}
