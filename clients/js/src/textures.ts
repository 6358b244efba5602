/** Images of frames: each is fetched and decoded once, and let go when no frame has it. */

/** An image, shared by all frames that have it. */
export interface FrameTexture {
  id: string;
  mediaType: string;
  /**
   * Its rows from the bottom up, so that it can be uploaded as it is and fits the mesh's u and v;
   * `null` where the browser does not decode it, as for `image/ktx2`.
   */
  image: ImageBitmap | null;
  /** The file. */
  bytes: Uint8Array<ArrayBuffer>;
}

/** Makes an image of a file, or `null` if the type is none of a browser's. */
export type ImageDecoder = (
  bytes: Uint8Array<ArrayBuffer>,
  mediaType: string,
) => Promise<ImageBitmap | null>;

export interface TextureStoreOptions {
  /** How many images that no frame has are kept, in case they are wanted again. */
  keep?: number;
  decode?: ImageDecoder;
}

interface Entry {
  texture: Promise<FrameTexture>;
  users: number;
}

export class TextureStore {
  private readonly entries = new Map<string, Entry>();
  private readonly keep: number;
  private readonly decodeImage: ImageDecoder;

  constructor(options: TextureStoreOptions = {}) {
    this.keep = options.keep ?? 2;
    this.decodeImage = options.decode ?? decodeImage;
  }

  /** The image, by `load` if it is not here. To be released once for each time it was asked for. */
  async acquire(
    id: string,
    mediaType: string,
    load: () => Promise<Uint8Array<ArrayBuffer>>,
  ): Promise<FrameTexture> {
    let entry = this.entries.get(id);
    if (entry === undefined) {
      entry = { texture: this.load(id, mediaType, load), users: 0 };
      // What cannot be had now may be there the next time.
      entry.texture.catch(() => this.entries.delete(id));
    }
    // The newest at the end.
    this.entries.delete(id);
    this.entries.set(id, entry);
    entry.users += 1;
    return entry.texture;
  }

  release({ id }: FrameTexture): void {
    const entry = this.entries.get(id);
    if (entry === undefined || entry.users === 0) return;
    entry.users -= 1;
    this.forget(this.keep);
  }

  /** Lets all go, whoever has them. */
  close(): void {
    for (const entry of this.entries.values()) entry.users = 0;
    this.forget(0);
  }

  private forget(keep: number): void {
    const unused = [...this.entries].filter(([, { users }]) => users === 0);
    for (const [id, entry] of unused.slice(0, Math.max(0, unused.length - keep))) {
      this.entries.delete(id);
      void entry.texture.then(
        ({ image }) => image?.close(),
        () => undefined,
      );
    }
  }

  private async load(
    id: string,
    mediaType: string,
    load: () => Promise<Uint8Array<ArrayBuffer>>,
  ): Promise<FrameTexture> {
    const bytes = await load();
    return { id, mediaType, image: await this.decodeImage(bytes, mediaType), bytes };
  }
}

/** By the browser, outside the thread that draws. */
async function decodeImage(
  bytes: Uint8Array<ArrayBuffer>,
  mediaType: string,
): Promise<ImageBitmap | null> {
  if (mediaType === "image/ktx2" || typeof createImageBitmap === "undefined") return null;
  return createImageBitmap(new Blob([bytes], { type: mediaType }), {
    imageOrientation: "flipY",
    premultiplyAlpha: "none",
    colorSpaceConversion: "none",
  });
}
