/** Normals of meshes that have none. */

/**
 * The sum of the face normals around each vertex, weighted by area, at length one. Points with
 * bitwise the same position are one vertex, so that a texture's seam does not show. A vertex
 * without a face of positive area gets a zero normal.
 */
export function vertexNormals(
  positions: Float32Array,
  indices: Uint32Array,
): Float32Array<ArrayBuffer> {
  const vertexOf = weld(positions);
  const sums = new Float64Array(positions.length);
  const p = positions;
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
    for (let corner = i; corner < i + 3; corner += 1) {
      const to = (vertexOf[indices[corner] as number] ?? 0) * 3;
      sums[to] = at(sums, to) + nx;
      sums[to + 1] = at(sums, to + 1) + ny;
      sums[to + 2] = at(sums, to + 2) + nz;
    }
  }
  const normals = new Float32Array(positions.length);
  for (let point = 0; point < vertexOf.length; point += 1) {
    const from = (vertexOf[point] as number) * 3;
    const length = Math.hypot(at(sums, from), at(sums, from + 1), at(sums, from + 2));
    if (length === 0) continue;
    for (let axis = 0; axis < 3; axis += 1) {
      normals[point * 3 + axis] = at(sums, from + axis) / length;
    }
  }
  return normals;
}

/** For each point, the first one that has bitwise the same position. */
export function weld(positions: Float32Array): Uint32Array<ArrayBuffer> {
  const count = Math.floor(positions.length / 3);
  const bits = new Uint32Array(positions.buffer, positions.byteOffset, positions.length);
  const first = new Uint32Array(count);
  let size = 1;
  while (size < count * 2) size *= 2;
  // Open addressing; 0 is free, else the point's number and one.
  const table = new Uint32Array(size);
  for (let point = 0; point < count; point += 1) {
    const x = bits[point * 3] as number;
    const y = bits[point * 3 + 1] as number;
    const z = bits[point * 3 + 2] as number;
    let slot = hash(x, y, z) & (size - 1);
    for (;;) {
      const entry = table[slot] as number;
      if (entry === 0) {
        table[slot] = point + 1;
        first[point] = point;
        break;
      }
      const other = (entry - 1) * 3;
      if (bits[other] === x && bits[other + 1] === y && bits[other + 2] === z) {
        first[point] = entry - 1;
        break;
      }
      slot = (slot + 1) & (size - 1);
    }
  }
  return first;
}

/** Mixes the high bits down: coordinates of a quantized mesh differ in those only. */
function hash(x: number, y: number, z: number): number {
  let h = Math.imul(x, 0x9e3779b1) ^ Math.imul(y, 0x85ebca77) ^ Math.imul(z, 0xc2b2ae3d);
  h = Math.imul(h ^ (h >>> 15), 0x2c1b3c6d);
  return h ^ (h >>> 13);
}

/** Zero outside the array: a decoded index is not trusted to be in range. */
function at(values: Float32Array | Float64Array, index: number): number {
  return values[index] ?? 0;
}
