/** A live stream: every frame as it comes out, the newest one first. */

import { InlineTextures } from "./inline.js";
import { Link, type LinkHandlers } from "./link.js";
import type { Server } from "./server.js";

/**
 * How images come: by a request of their own that is answered once for each image (`reference`), in
 * the messages (`inline`), or not at all (`none`).
 */
export type TextureMode = "reference" | "inline" | "none";

export interface SubscriptionOptions extends LinkHandlers {
  /** Frames a second at most, the newest ones; every frame if left out. */
  maxFps?: number | undefined;
  /** `reference`, if left out. */
  textures?: TextureMode | undefined;
}

/** The parameter of `textures`: what the server does by itself is not asked for. */
export function addTextureMode(query: URLSearchParams, mode: TextureMode | undefined): void {
  if (mode === "inline" || mode === "none") query.set("textures", mode);
}

export class Subscription {
  private readonly link: Link;
  private readonly images = new InlineTextures();

  constructor(server: Server, stream: string, options: SubscriptionOptions) {
    const query = new URLSearchParams();
    if (options.maxFps !== undefined) query.set("max_fps", String(options.maxFps));
    addTextureMode(query, options.textures);
    const target = {
      exists: async () => (await server.streams()).some((summary) => summary.stream === stream),
      open: () => server.socket({ stream }, "subscribe", query),
      renewsToken: server.renewsToken,
    };
    this.link = new Link(target, {
      ...options,
      onState: (state) => {
        if (state.kind === "open") this.images.reset();
        options.onState?.(state);
      },
      onFrame: (frame) => options.onFrame(this.images.attach(frame)),
    });
  }

  start(): void {
    this.link.start();
  }

  close(): void {
    this.link.close();
  }
}
