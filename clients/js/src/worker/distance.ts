/** Distances from points to a surface. */

/** Cells along the longest side at most; larger cells hold more faces each. */
const MAX_CELLS = 96;

/** The triangles of a mesh by the cells of a regular grid that their boxes touch. */
export class SurfaceGrid {
  private readonly origin: [number, number, number];
  private readonly size: [number, number, number];
  private readonly cell: number;
  /** Faces of cell i are `faces[start[i]]` up to `faces[start[i + 1]]`. */
  private readonly start: Uint32Array;
  private readonly faces: Uint32Array;
  /** The query that has looked at a face last. */
  private readonly seen: Uint32Array;
  private query = 0;

  constructor(
    private readonly positions: Float32Array,
    private readonly indices: Uint32Array,
  ) {
    const { min, max } = bounds(positions);
    const extent = Math.max(max[0] - min[0], max[1] - min[1], max[2] - min[2]);
    const wanted = meanEdge(positions, indices) * 1.5;
    this.cell = Math.max(wanted, extent / MAX_CELLS) || 1;
    this.origin = min;
    const cells = (axis: 0 | 1 | 2) => Math.floor((max[axis] - min[axis]) / this.cell) + 1;
    this.size = [cells(0), cells(1), cells(2)];
    this.seen = new Uint32Array(Math.floor(indices.length / 3));
    const counts = new Uint32Array(this.size[0] * this.size[1] * this.size[2] + 1);
    this.eachPair((cell) => {
      counts[cell + 1] = (counts[cell + 1] as number) + 1;
    });
    for (let i = 1; i < counts.length; i += 1) {
      counts[i] = (counts[i] as number) + (counts[i - 1] as number);
    }
    this.start = counts;
    this.faces = new Uint32Array(counts[counts.length - 1] as number);
    const next = counts.slice();
    this.eachPair((cell, face) => {
      const at = next[cell] as number;
      this.faces[at] = face;
      next[cell] = at + 1;
    });
  }

  /** From a point to the nearest face; infinite without faces. */
  distance(x: number, y: number, z: number): number {
    this.query += 1;
    const cx = this.cellOf(x, 0);
    const cy = this.cellOf(y, 1);
    const cz = this.cellOf(z, 2);
    const farthest = Math.max(...this.size);
    let best = Infinity;
    for (let radius = 0; radius <= farthest; radius += 1) {
      for (let dx = -radius; dx <= radius; dx += 1) {
        for (let dy = -radius; dy <= radius; dy += 1) {
          const border = Math.abs(dx) === radius || Math.abs(dy) === radius;
          const step = border || radius === 0 ? 1 : 2 * radius;
          for (let dz = -radius; dz <= radius; dz += step) {
            best = this.nearestIn(cx + dx, cy + dy, cz + dz, x, y, z, best);
          }
        }
      }
      // Cells farther out are at least so far away.
      if (best <= (radius * this.cell) ** 2) break;
    }
    return Math.sqrt(best);
  }

  private nearestIn(
    cx: number,
    cy: number,
    cz: number,
    x: number,
    y: number,
    z: number,
    best: number,
  ): number {
    const [sx, sy, sz] = this.size;
    if (cx < 0 || cy < 0 || cz < 0 || cx >= sx || cy >= sy || cz >= sz) return best;
    const cell = (cz * sy + cy) * sx + cx;
    let least = best;
    for (let i = this.start[cell] as number; i < (this.start[cell + 1] as number); i += 1) {
      const face = this.faces[i] as number;
      if (this.seen[face] === this.query) continue;
      this.seen[face] = this.query;
      const squared = squaredDistance(this.positions, this.indices, face * 3, x, y, z);
      if (squared < least) least = squared;
    }
    return least;
  }

  /** Every face with every cell that its box touches. */
  private eachPair(visit: (cell: number, face: number) => void): void {
    const [sx, sy] = this.size;
    const low = [0, 0, 0];
    const high = [0, 0, 0];
    for (let face = 0; face * 3 + 2 < this.indices.length; face += 1) {
      for (const axis of [0, 1, 2] as const) {
        const value = (corner: number) =>
          this.positions[(this.indices[face * 3 + corner] as number) * 3 + axis] ?? 0;
        const [a, b, c] = [value(0), value(1), value(2)];
        low[axis] = this.cellOf(Math.min(a, b, c), axis);
        high[axis] = this.cellOf(Math.max(a, b, c), axis);
      }
      for (let z = low[2] as number; z <= (high[2] as number); z += 1) {
        for (let y = low[1] as number; y <= (high[1] as number); y += 1) {
          for (let x = low[0] as number; x <= (high[0] as number); x += 1) {
            visit((z * sy + y) * sx + x, face);
          }
        }
      }
    }
  }

  private cellOf(value: number, axis: 0 | 1 | 2): number {
    const cell = Math.floor((value - this.origin[axis]) / this.cell);
    return Math.min(Math.max(cell, 0), this.size[axis] - 1);
  }
}

/** From each point to the surface, in the mesh's unit. */
export function distancesToSurface(
  points: Float32Array,
  surface: { positions: Float32Array; indices: Uint32Array },
): Float32Array<ArrayBuffer> {
  const grid = new SurfaceGrid(surface.positions, surface.indices);
  const distances = new Float32Array(Math.floor(points.length / 3));
  for (let i = 0; i < distances.length; i += 1) {
    const [x, y, z] = [points[i * 3], points[i * 3 + 1], points[i * 3 + 2]];
    distances[i] = grid.distance(x as number, y as number, z as number);
  }
  return distances;
}

type Triple = [number, number, number];

function bounds(positions: Float32Array): { min: Triple; max: Triple } {
  const min: Triple = [Infinity, Infinity, Infinity];
  const max: Triple = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i + 2 < positions.length; i += 3) {
    for (const axis of [0, 1, 2] as const) {
      const value = positions[i + axis] as number;
      if (value < min[axis]) min[axis] = value;
      if (value > max[axis]) max[axis] = value;
    }
  }
  const finite = [...min, ...max].every(Number.isFinite);
  return finite ? { min, max } : { min: [0, 0, 0], max: [0, 0, 0] };
}

function meanEdge(positions: Float32Array, indices: Uint32Array): number {
  let sum = 0;
  for (let i = 0; i + 1 < indices.length; i += 3) {
    const a = (indices[i] as number) * 3;
    const b = (indices[i + 1] as number) * 3;
    const along = (axis: number) => (positions[a + axis] ?? 0) - (positions[b + axis] ?? 0);
    sum += Math.hypot(along(0), along(1), along(2));
  }
  return indices.length === 0 ? 0 : sum / (indices.length / 3);
}

/** Of a point and the triangle whose corners are `indices[at]` and the two after it. */
function squaredDistance(
  positions: Float32Array,
  indices: Uint32Array,
  at: number,
  x: number,
  y: number,
  z: number,
): number {
  const a = (indices[at] as number) * 3;
  const b = (indices[at + 1] as number) * 3;
  const c = (indices[at + 2] as number) * 3;
  const p = positions;
  const ax = p[a] as number;
  const ay = p[a + 1] as number;
  const az = p[a + 2] as number;
  const ux = (p[b] as number) - ax;
  const uy = (p[b + 1] as number) - ay;
  const uz = (p[b + 2] as number) - az;
  const vx = (p[c] as number) - ax;
  const vy = (p[c + 1] as number) - ay;
  const vz = (p[c + 2] as number) - az;
  const wx = x - ax;
  const wy = y - ay;
  const wz = z - az;
  const uu = ux * ux + uy * uy + uz * uz;
  const uv = ux * vx + uy * vy + uz * vz;
  const vv = vx * vx + vy * vy + vz * vz;
  const wu = wx * ux + wy * uy + wz * uz;
  const wv = wx * vx + wy * vy + wz * vz;
  const area = uu * vv - uv * uv;
  if (area > 0) {
    const s = (vv * wu - uv * wv) / area;
    const t = (uu * wv - uv * wu) / area;
    if (s >= 0 && t >= 0 && s + t <= 1) {
      // Right above the face.
      return squared(wx - s * ux - t * vx, wy - s * uy - t * vy, wz - s * uz - t * vz);
    }
  }
  const alongU = segment(wx, wy, wz, ux, uy, uz, uu);
  const alongV = segment(wx, wy, wz, vx, vy, vz, vv);
  const alongThird = segment(
    wx - ux,
    wy - uy,
    wz - uz,
    vx - ux,
    vy - uy,
    vz - uz,
    uu + vv - 2 * uv,
  );
  return Math.min(alongU, alongV, alongThird);
}

/** Of the point w and the edge from the origin to d, whose squared length is `dd`. */
function segment(
  wx: number,
  wy: number,
  wz: number,
  dx: number,
  dy: number,
  dz: number,
  dd: number,
): number {
  const along = dd > 0 ? (wx * dx + wy * dy + wz * dz) / dd : 0;
  const t = Math.min(Math.max(along, 0), 1);
  return squared(wx - t * dx, wy - t * dy, wz - t * dz);
}

function squared(x: number, y: number, z: number): number {
  return x * x + y * y + z * z;
}
