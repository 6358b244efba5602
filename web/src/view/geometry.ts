/** Plain arrays on their way to the graphics card. */

export interface Bounds {
  min: [number, number, number];
  max: [number, number, number];
}

/** Bounds of all vertices, or `null` without a finite one. */
export function boundsOf(positions: Float32Array): Bounds | null {
  const min: Bounds["min"] = [Infinity, Infinity, Infinity];
  const max: Bounds["max"] = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i + 2 < positions.length; i += 3) {
    for (const axis of [0, 1, 2] as const) {
      const value = positions[i + axis] as number;
      if (value < min[axis]) min[axis] = value;
      if (value > max[axis]) max[axis] = value;
    }
  }
  return [...min, ...max].every(Number.isFinite) ? { min, max } : null;
}

/** The length of a box's diagonal. */
export function diagonalOf({ min, max }: Bounds): number {
  return Math.hypot(max[0] - min[0], max[1] - min[1], max[2] - min[2]);
}

/** Whether the two boxes are of one thing: much the same size, at much the same place. */
export function areAlike(a: Bounds, b: Bounds): boolean {
  const reference = diagonalOf(a);
  const ratio = diagonalOf(b) / reference;
  const apart = Math.hypot(
    ...[0, 1, 2].map((i) => {
      const axis = i as 0 | 1 | 2;
      return (a.min[axis] + a.max[axis] - b.min[axis] - b.max[axis]) / 2;
    }),
  );
  return ratio > 0.5 && ratio < 2 && apart < reference / 2;
}

/**
 * Writes `source` (`size` values a vertex) into `target` once per face corner, in face order.
 *
 * Corners of their own let the shader know a fragment's place in its face from the vertex number,
 * which draws clean edges without a second mesh. `target` must hold `size` values per index.
 */
export function expandCorners(
  source: Float32Array | Uint8Array,
  size: 1 | 2 | 3 | 4,
  indices: Uint32Array,
  target: Float32Array | Uint8Array,
): void {
  let to = 0;
  for (let corner = 0; corner < indices.length; corner += 1) {
    let from = (indices[corner] as number) * size;
    // Zero outside the array: a decoded index is not trusted to be in range.
    for (let i = 0; i < size; i += 1) target[to++] = source[from++] ?? 0;
  }
}
