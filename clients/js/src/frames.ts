/** Messages to frames that can be drawn: the mesh by a worker, the image by the browser. */

import type { Place } from "./address.js";
import type { Frame } from "./message.js";
import type { FrameMetrics } from "./metrics.js";
import type { DecoderPool } from "./pool.js";
import type { Server } from "./server.js";
import type { TextureMode } from "./subscription.js";
import type { FrameTexture, TextureStore } from "./textures.js";
import type { DecodedMesh } from "./worker/decode.js";

export interface DecodedFrame {
  metrics: FrameMetrics;
  mesh: DecodedMesh;
  /** `null` if the frame has no image, or it could not be had. The same object for the same image. */
  texture: FrameTexture | null;
  /** Size of the whole message. */
  messageBytes: number;
  /** What was fetched for the image besides; 0 if it was here already, or came in the message. */
  fetchedBytes: number;
}

/** What is to be decoded: a message, or a mesh that was fetched. */
export type EncodedFrame = Pick<Frame, "metrics" | "mesh" | "texture" | "messageBytes">;

export class FrameDecoder {
  /** Images that could not be fetched or decoded. */
  failedTextures = 0;

  constructor(
    private readonly server: Server,
    private readonly place: Place,
    private readonly pool: DecoderPool,
    private readonly textures: TextureStore,
    private readonly mode: TextureMode = "reference",
  ) {}

  /**
   * Decodes a frame; its mesh's buffer is empty afterwards. A frame without its image is a frame
   * all the same.
   *
   * @throws {DecodeError} if the mesh cannot be decoded.
   */
  async decode(frame: EncodedFrame): Promise<DecodedFrame> {
    const { metrics, messageBytes } = frame;
    let fetchedBytes = 0;
    const [mesh, texture] = await Promise.allSettled([
      this.pool.decode(frame.mesh),
      this.texture(frame, (bytes) => {
        fetchedBytes = bytes;
      }),
    ]);
    const image = texture.status === "fulfilled" ? texture.value : null;
    if (mesh.status === "rejected") {
      if (image !== null) this.textures.release(image);
      throw mesh.reason;
    }
    return { metrics, mesh: mesh.value, texture: image, messageBytes, fetchedBytes };
  }

  /**
   * Fetches and decodes one frame: of a recording, or one that the server still holds of a stream.
   *
   * @throws {ProblemError} with status 404 if it does not hold it any more.
   */
  async fetch(seq: number | "latest"): Promise<DecodedFrame> {
    const metrics = await this.server.frameMetrics(this.place, seq);
    // The latest is another one by now.
    const mesh = await this.server.mesh(this.place, metrics.seq ?? seq);
    return this.decode({ metrics, mesh, texture: null, messageBytes: mesh.byteLength });
  }

  /** The frame is not drawn any more. */
  release({ texture }: DecodedFrame): void {
    if (texture !== null) this.textures.release(texture);
  }

  private async texture(
    { metrics, texture: bytes }: EncodedFrame,
    onFetched: (bytes: number) => void,
  ): Promise<FrameTexture | null> {
    const reference = metrics.texture;
    if (reference === null || this.mode === "none") return null;
    const { id, mediaType } = reference;
    try {
      return await this.textures.acquire(id, mediaType, async () => {
        if (bytes !== null) return bytes;
        const fetched =
          this.place.recording === undefined || metrics.seq === null
            ? await this.server.texture(this.place, id)
            : await this.server.frameTexture(this.place, metrics.seq);
        onFetched(fetched.length);
        return fetched;
      });
    } catch {
      this.failedTextures += 1;
      return null;
    }
  }
}
