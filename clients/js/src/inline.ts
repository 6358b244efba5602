/** Images that come inside messages, by the frames that they belong to. */

import type { Frame } from "./message.js";

/**
 * Images that come inside messages: one is sent once, with the first frame that it belongs to, and
 * belongs to those that follow and name it, too. Nothing else says so if the first is skipped.
 */
export class InlineTextures {
  private last: { id: string; bytes: Uint8Array<ArrayBuffer> } | null = null;

  /** Another connection begins: the server knows nothing of what was sent before. */
  reset(): void {
    this.last = null;
  }

  /** The frame with its image, if that came on this connection. */
  attach(frame: Frame): Frame {
    const id = frame.metrics.texture?.id;
    if (id === undefined) return frame;
    if (frame.texture !== null) this.last = { id, bytes: frame.texture };
    return this.last?.id === id ? { ...frame, texture: this.last.bytes } : frame;
  }
}
