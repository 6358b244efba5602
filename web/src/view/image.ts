/** The frame's image on the graphics card. It is uploaded when it is another one than before. */

import type { FrameTexture } from "steadymesh";
import {
  LinearFilter,
  LinearMipmapLinearFilter,
  SRGBColorSpace,
  Texture,
  type WebGLRenderer,
} from "three";

const ANISOTROPY = 4;

export class ImageSlot {
  texture: Texture | null = null;
  private shown: ImageBitmap | null = null;
  private size = { width: 0, height: 0 };

  constructor(private readonly renderer: WebGLRenderer) {}

  /** Whether it can be shown. */
  show(image: FrameTexture | null): boolean {
    if (image === null || image.image === null) {
      this.clear();
      return false;
    }
    if (this.shown === image.image) return true;
    const { width, height } = image.image;
    // An image of the same size goes into the same storage.
    if (this.size.width !== width || this.size.height !== height) this.clear();
    this.texture ??= this.create();
    this.texture.image = image.image;
    this.texture.needsUpdate = true;
    this.shown = image.image;
    this.size = { width, height };
    return true;
  }

  clear(): void {
    this.texture?.dispose();
    this.texture = null;
    this.shown = null;
  }

  private create(): Texture {
    const texture = new Texture();
    texture.colorSpace = SRGBColorSpace;
    // The rows of a frame's image come from the bottom up already.
    texture.flipY = false;
    texture.generateMipmaps = true;
    texture.minFilter = LinearMipmapLinearFilter;
    texture.magFilter = LinearFilter;
    texture.anisotropy = Math.min(ANISOTROPY, this.renderer.capabilities.getMaxAnisotropy());
    return texture;
  }
}
