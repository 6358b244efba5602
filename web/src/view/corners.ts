/** The mesh's buffers on the graphics card: one entry for every corner of every face. */

import { BufferAttribute, BufferGeometry, DynamicDrawUsage } from "three";
import { expandCorners } from "./geometry";

/** What a surface can have, besides positions. */
export interface CornerValues {
  positions: Float32Array;
  normals: Float32Array | null;
  uvs: Float32Array | null;
  colors: Uint8Array | null;
  /** One value a point. */
  change: Float32Array | null;
}

const LAYOUT = [
  { name: "position", of: "positions", size: 3, bytes: false },
  { name: "normal", of: "normals", size: 3, bytes: false },
  { name: "uv", of: "uvs", size: 2, bytes: false },
  { name: "tint", of: "colors", size: 4, bytes: true },
  { name: "change", of: "change", size: 1, bytes: false },
] as const;

/** Buffers grow by half and are kept; a smaller mesh uses their beginning. */
export class CornerBuffers {
  geometry = new BufferGeometry();
  private capacity = 0;

  /** Fills what there are values for. The geometry may be another one afterwards. */
  fill(values: CornerValues, indices: Uint32Array): void {
    if (indices.length > this.capacity) {
      this.geometry.dispose();
      this.geometry = new BufferGeometry();
      this.capacity = Math.ceil(indices.length * 1.5);
    }
    for (const { name, of, size, bytes } of LAYOUT) {
      const source = values[of];
      if (source === null) continue;
      const attribute = this.attribute(name, size, bytes);
      expandCorners(source, size, indices, attribute.array as Float32Array | Uint8Array);
      attribute.clearUpdateRanges();
      attribute.addUpdateRange(0, indices.length * size);
      attribute.needsUpdate = true;
    }
    this.geometry.setDrawRange(0, indices.length);
  }

  dispose(): void {
    this.geometry.dispose();
  }

  private attribute(name: string, size: number, bytes: boolean): BufferAttribute {
    const existing = this.geometry.getAttribute(name);
    if (existing instanceof BufferAttribute) return existing;
    const length = this.capacity * size;
    const made = new BufferAttribute(
      bytes ? new Uint8Array(length) : new Float32Array(length),
      size,
      bytes,
    ).setUsage(DynamicDrawUsage);
    this.geometry.setAttribute(name, made);
    return made;
  }
}
