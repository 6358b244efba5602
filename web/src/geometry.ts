/** Triangle geometry on plain arrays, without a renderer. */

/** Positions are xyz triples; three indices make a face. Lengths are in the mesh's own unit. */
export interface DecodedMesh {
  positions: Float32Array;
  indices: Uint32Array;
}

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

/**
 * Vertex normals: the sum of the face normals around each vertex, weighted by area, at length 1.
 * A vertex without a face of positive area gets a zero normal.
 */
export function vertexNormals({ positions, indices }: DecodedMesh): Float32Array {
  const p = positions;
  const normals = new Float32Array(p.length);
  for (let i = 0; i + 2 < indices.length; i += 3) {
    const a = (indices[i] as number) * 3;
    const b = (indices[i + 1] as number) * 3;
    const c = (indices[i + 2] as number) * 3;
    const ux = at(p, b) - at(p, a);
    const uy = at(p, b + 1) - at(p, a + 1);
    const uz = at(p, b + 2) - at(p, a + 2);
    const vx = at(p, c) - at(p, a);
    const vy = at(p, c + 1) - at(p, a + 1);
    const vz = at(p, c + 2) - at(p, a + 2);
    const nx = uy * vz - uz * vy;
    const ny = uz * vx - ux * vz;
    const nz = ux * vy - uy * vx;
    for (const corner of [a, b, c]) {
      normals[corner] = at(normals, corner) + nx;
      normals[corner + 1] = at(normals, corner + 1) + ny;
      normals[corner + 2] = at(normals, corner + 2) + nz;
    }
  }
  for (let i = 0; i + 2 < normals.length; i += 3) {
    const length = Math.hypot(at(normals, i), at(normals, i + 1), at(normals, i + 2));
    if (length === 0) continue;
    for (let axis = 0; axis < 3; axis += 1) normals[i + axis] = at(normals, i + axis) / length;
  }
  return normals;
}

/**
 * Writes `source` (xyz per vertex) into `target` once per face corner, in face order.
 *
 * Corners of their own let the shader know a fragment's place in its face from the vertex number,
 * which draws clean edges without a second mesh. `target` must hold three values per index.
 */
export function expandCorners(
  source: Float32Array,
  indices: Uint32Array,
  target: Float32Array,
): void {
  for (let corner = 0; corner < indices.length; corner += 1) {
    const from = (indices[corner] as number) * 3;
    const to = corner * 3;
    target[to] = at(source, from);
    target[to + 1] = at(source, from + 1);
    target[to + 2] = at(source, from + 2);
  }
}

/** Zero outside the array: a decoded index is not trusted to be in range. */
function at(values: Float32Array, index: number): number {
  return values[index] ?? 0;
}
