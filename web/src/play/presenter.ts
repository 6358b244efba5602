/**
 * Draws a deck's frames, and lets the one before go. In the view of changes a frame waits until
 * its distances to the frame before are known; if another one comes meanwhile, it is left out.
 */

import type { DecodedFrame, DecodedMesh, DecoderPool } from "steadymesh";

export class Presenter {
  /** Frames that were not drawn because their distances took too long. */
  skipped = 0;

  private shown: DecodedFrame | null = null;
  /** What was shown before that. */
  private before: DecodedMesh | null = null;
  private waiting: DecodedFrame | null = null;
  private busy = false;
  private measuring = false;
  private closed = false;

  constructor(
    private readonly pool: DecoderPool,
    private readonly draw: (frame: DecodedFrame, change: Float32Array | null) => void,
    private readonly release: (frame: DecodedFrame) => void,
  ) {}

  /** Whether changes are measured. */
  set measuresChange(on: boolean) {
    const { shown, before } = this;
    // What stands still has changed, too.
    if (on && !this.measuring && !this.busy && shown !== null && before !== null) {
      void this.showChange(shown, before);
    }
    this.measuring = on;
  }

  show(frame: DecodedFrame): void {
    if (this.closed) {
      this.release(frame);
    } else if (this.busy) {
      if (this.waiting !== null) {
        this.skipped += 1;
        this.release(this.waiting);
      }
      this.waiting = frame;
    } else if (this.measuring && this.shown !== null) {
      void this.showChange(frame, this.shown.mesh);
    } else {
      this.present(frame, null);
    }
  }

  close(): void {
    this.closed = true;
    for (const frame of [this.shown, this.waiting]) if (frame !== null) this.release(frame);
    this.shown = this.waiting = null;
  }

  private async showChange(frame: DecodedFrame, before: DecodedMesh): Promise<void> {
    this.busy = true;
    // `close` gives back what is shown.
    const again = frame === this.shown;
    const change = await this.pool.distances(frame.mesh.positions, before).catch(() => null);
    this.busy = false;
    if (this.closed) {
      if (!again) this.release(frame);
      return;
    }
    this.present(frame, change);
    const next = this.waiting;
    this.waiting = null;
    if (next !== null) this.show(next);
  }

  private present(frame: DecodedFrame, change: Float32Array | null): void {
    const last = this.shown;
    this.shown = frame;
    this.draw(frame, change);
    if (last === null || last === frame) return;
    this.before = last.mesh;
    this.release(last);
  }
}
