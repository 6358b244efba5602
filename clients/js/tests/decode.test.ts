/** Meshes as Draco's own encoder makes them, normals and distances. */

import createDecoder from "draco3d/draco_decoder_nodejs.js";
import { beforeAll, describe, expect, test } from "vitest";
import { DecodeError, type DracoModule, decodeMesh } from "../src/worker/decode.js";
import { distancesToSurface } from "../src/worker/distance.js";
import { vertexNormals } from "../src/worker/normals.js";
import { encodeMesh } from "./support/frames.js";

let draco: DracoModule;

beforeAll(async () => {
  draco = await createDecoder({});
});

/** A square in the plane z = 0, facing +z, of two triangles that share no point: a seam. */
const SQUARE = {
  positions: [0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 0, 0, 1, 1, 0, 0, 1, 0],
  faces: [0, 1, 2, 3, 4, 5],
  uvs: [0, 0, 1, 0, 1, 1, 0, 0.5, 0.5, 1, 0, 1],
  colors: [255, 0, 0, 0, 255, 0, 0, 0, 255, 9, 8, 7, 6, 5, 4, 3, 2, 1],
};

/** What a mesh has at each corner of each face, in an order of its own. */
function corners(values: ArrayLike<number>, size: number, indices: ArrayLike<number>): string[] {
  return Array.from(indices, (point) =>
    Array.from({ length: size }, (_, i) => (values[point * size + i] ?? 0).toFixed(2)).join(" "),
  ).sort();
}

describe("a mesh", () => {
  test("has positions, coordinates and colours at each corner as they were encoded", async () => {
    const { positions, uvs, colors, indices } = decodeMesh(draco, await encodeMesh(SQUARE));
    expect(indices.length).toBe(6);
    expect(corners(positions, 3, indices)).toEqual(corners(SQUARE.positions, 3, SQUARE.faces));
    expect(corners(uvs ?? [], 2, indices)).toEqual(corners(SQUARE.uvs, 2, SQUARE.faces));
    const rgba = SQUARE.colors.flatMap((value, i) => (i % 3 === 2 ? [value, 255] : [value]));
    expect(corners(colors ?? [], 4, indices)).toEqual(corners(rgba, 4, SQUARE.faces));
  });

  test("says which faces have the same material", async () => {
    const materials = [300, 300, 300, 7, 7, 7];
    const mesh = decodeMesh(draco, await encodeMesh({ ...SQUARE, materials }));
    const of = (face: number) =>
      [0, 1, 2].map((i) => mesh.materials?.[mesh.indices[3 * face + i] ?? 0]);
    expect([of(0), of(1)].sort()).toEqual([
      [300, 300, 300],
      [7, 7, 7],
    ]);
  });

  test("has the rig's normals, if it sends some", async () => {
    const normals = SQUARE.positions.map((_, i) => (i % 3 === 0 ? 1 : 0));
    const mesh = decodeMesh(draco, await encodeMesh({ ...SQUARE, normals }));
    expect(mesh.normals[0]).toBeCloseTo(1, 2);
    expect(mesh.normals[2]).toBeCloseTo(0, 2);
  });

  test("without attributes has none, and normals of its own", async () => {
    const { positions, faces } = SQUARE;
    const mesh = decodeMesh(draco, await encodeMesh({ positions, faces }));
    expect(mesh.uvs).toBeNull();
    expect(mesh.colors).toBeNull();
    expect(mesh.materials).toBeNull();
    expect([...mesh.normals.slice(0, 3)]).toEqual([0, 0, 1]);
  });

  test.each<[string, (bytes: Uint8Array) => Uint8Array]>([
    ["of other bytes", () => new TextEncoder().encode("this is no mesh")],
    ["that is cut off", (bytes) => bytes.slice(0, bytes.length / 2)],
    ["of no bytes", () => new Uint8Array()],
  ])("%s is refused", async (_, change) => {
    const bytes = change(await encodeMesh(SQUARE));
    expect(() => decodeMesh(draco, bytes)).toThrow(DecodeError);
  });
});

describe("normals", () => {
  test("are smooth over a seam: points at one position are one vertex", () => {
    // A ridge: two faces at a right angle that share an edge, but no point.
    const positions = new Float32Array([
      ...[0, 0, 0, 0, 1, 0, -1, 0, -1],
      ...[0, 0, 0, 1, 0, -1, 0, 1, 0],
    ]);
    const normals = vertexNormals(positions, new Uint32Array([0, 1, 2, 3, 4, 5]));
    expect([...normals.slice(0, 3)]).toEqual([...normals.slice(9, 12)]);
    // Of the face alone it would lean to a side.
    expect(normals[0]).toBeCloseTo(0, 6);
    expect(normals[2]).toBeCloseTo(1, 6);
  });

  test("of a face without area are zero instead of NaN", () => {
    const positions = new Float32Array([0, 0, 0, 1, 0, 0, 2, 0, 0]);
    const normals = vertexNormals(positions, new Uint32Array([0, 1, 2]));
    expect([...normals].every((value) => value === 0)).toBe(true);
  });
});

describe("distances", () => {
  const square = {
    positions: new Float32Array(SQUARE.positions),
    indices: new Uint32Array(SQUARE.faces),
  };

  test.each<[string, number[], number]>([
    ["above a face", [0.3, 0.6, 0.25], 0.25],
    ["on the surface", [0.5, 0.5, 0], 0],
    ["beside an edge", [0.5, -0.5, 0], 0.5],
    ["off a corner", [2, 2, 1], Math.sqrt(3)],
    ["far away", [0.5, 0.5, -100], 100],
  ])("%s are those to the nearest point", (_, point, expected) => {
    expect(distancesToSurface(new Float32Array(point), square)[0]).toBeCloseTo(expected, 5);
  });

  test("are those of a search through all faces", () => {
    // A wavy sheet, so that the nearest face is often not the one below.
    const side = 24;
    const positions: number[] = [];
    const indices: number[] = [];
    for (let y = 0; y < side; y += 1) {
      for (let x = 0; x < side; x += 1) {
        positions.push(x / side, y / side, 0.2 * Math.sin(x) * Math.cos(y * 0.7));
        if (x === 0 || y === 0) continue;
        const at = y * side + x;
        indices.push(at - side - 1, at - side, at, at - side - 1, at, at - 1);
      }
    }
    const sheet = {
      positions: new Float32Array(positions),
      indices: new Uint32Array(indices),
    };
    const points = new Float32Array(300).map((_, i) => ((i * 7919) % 1000) / 700 - 0.2);
    const found = distancesToSurface(points, sheet);
    const oneByOne = Array.from({ length: indices.length / 3 }, (_, face) =>
      distancesToSurface(points, {
        positions: sheet.positions,
        indices: sheet.indices.slice(face * 3, face * 3 + 3),
      }),
    );
    found.forEach((distance, i) => {
      const least = Math.min(...oneByOne.map((distances) => distances[i] as number));
      expect(distance).toBeCloseTo(least, 6);
    });
  });

  test("to a surface without faces are infinite", () => {
    const nothing = { positions: new Float32Array(), indices: new Uint32Array() };
    expect(distancesToSurface(new Float32Array([1, 2, 3]), nothing)[0]).toBe(Infinity);
  });
});
