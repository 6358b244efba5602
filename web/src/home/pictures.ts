/** Which picture is drawn when: one after the other, those that move again after a while. */

import type { CardContent } from "./cards";
import type { draw as Draw } from "./draw";

/** A live stream's picture is not older than this, unless the stream stands still. */
const FRESH_MS = 6000;

export class Pictures {
  private readonly drawn = new Map<string, { seq: number; atMs: number }>();
  private readonly waiting = new Map<string, { content: CardContent; canvas: HTMLCanvasElement }>();
  private busy = false;

  want(content: CardContent, canvas: HTMLCanvasElement): void {
    const { key, picture } = content;
    if (picture === null) return;
    const last = this.drawn.get(key);
    if (last !== undefined) {
      const isFresh = performance.now() - last.atMs < FRESH_MS;
      if (!picture.changes || isFresh || last.seq === picture.seq) return;
    }
    this.waiting.set(key, { content, canvas });
    if (!this.busy) void this.work();
  }

  forget(key: string): void {
    this.drawn.delete(key);
    this.waiting.delete(key);
  }

  private async work(): Promise<void> {
    this.busy = true;
    // three.js is loaded only where it is needed.
    const draw: typeof Draw | null = await import("./draw").then(
      (module) => module.draw,
      () => null,
    );
    for (const [key, { content, canvas }] of this.waiting) {
      this.waiting.delete(key);
      if (content.picture === null || draw === null) continue;
      this.drawn.set(key, { seq: content.picture.seq, atMs: performance.now() });
      const isThere = await draw(content.picture, canvas).catch(() => false);
      canvas.classList.toggle("drawn", isThere);
    }
    this.busy = false;
  }
}
