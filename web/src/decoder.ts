/** Draco's own WebAssembly decoder, in a worker, through three's DRACOLoader. */

import { DRACOLoader } from "three/addons/loaders/DRACOLoader.js";
import type { DecodedMesh } from "./geometry";

/** A decoder that cannot start never answers; nothing that fits in a frame takes this long. */
const TIMEOUT_MS = 20_000;

/** A mesh that Draco refused, or a decoder that did not answer. */
export class DecodeError extends Error {
  override name = "DecodeError";
}

export class MeshDecoder {
  // One worker: frames are decoded one after another, and come out in order.
  private readonly loader = new DRACOLoader().setDecoderPath("/draco/").setWorkerLimit(1);

  /** Fetches and compiles the decoder ahead of the first frame. */
  preload(): void {
    this.loader.preload();
  }

  /**
   * Decodes one Draco mesh. `mesh` is handed to the worker and empty afterwards.
   *
   * @throws {DecodeError}
   */
  async decode(mesh: ArrayBuffer): Promise<DecodedMesh> {
    const geometry = await this.parse(mesh);
    const positions = geometry.getAttribute("position")?.array;
    const indices = geometry.getIndex()?.array;
    // The geometry itself is never drawn, so nothing of it is on the graphics card.
    if (!(positions instanceof Float32Array) || !(indices instanceof Uint32Array)) {
      throw new DecodeError("the frame is not a triangle mesh");
    }
    return { positions, indices };
  }

  dispose(): void {
    this.loader.dispose();
  }

  private parse(mesh: ArrayBuffer): ReturnType<DRACOLoader["loadAsync"]> {
    return new Promise((resolve, reject) => {
      const timer = setTimeout(
        () => reject(new DecodeError("the Draco decoder did not answer")),
        TIMEOUT_MS,
      );
      const settle = () => clearTimeout(timer);
      this.loader.parse(
        mesh,
        (geometry) => {
          settle();
          resolve(geometry);
        },
        (cause) => {
          settle();
          reject(new DecodeError("the frame could not be decoded", { cause }));
        },
      );
    });
  }
}
