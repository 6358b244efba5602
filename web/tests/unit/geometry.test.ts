import { expect, test } from "vitest";
import { boundsOf, expandCorners, vertexNormals } from "../../src/geometry";

test("bounds span all vertices, whatever their unit", () => {
  const positions = new Float32Array([1, -2, 3, -4, 5, -6]);
  expect(boundsOf(positions)).toEqual({ min: [-4, -2, -6], max: [1, 5, 3] });
});

test("a mesh without vertices has no bounds", () => {
  expect(boundsOf(new Float32Array())).toBeNull();
});

test("a flat square facing +z has normals of length one along +z", () => {
  const positions = new Float32Array([0, 0, 0, 3, 0, 0, 3, 3, 0, 0, 3, 0]);
  const indices = new Uint32Array([0, 1, 2, 0, 2, 3]);
  const normals = vertexNormals({ positions, indices });
  expect([...normals]).toEqual([0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1]);
});

test("a face without area leaves its normals at zero instead of NaN", () => {
  const positions = new Float32Array([0, 0, 0, 1, 0, 0, 2, 0, 0]);
  const normals = vertexNormals({ positions, indices: new Uint32Array([0, 1, 2]) });
  expect([...normals].every((value) => value === 0)).toBe(true);
});

test("corners come in face order, and the rest of the buffer stays as it was", () => {
  const source = new Float32Array([0, 0, 0, 1, 1, 1, 2, 2, 2]);
  const target = new Float32Array(12).fill(9);
  expandCorners(source, new Uint32Array([2, 0, 1]), target);
  expect([...target]).toEqual([2, 2, 2, 0, 0, 0, 1, 1, 1, 9, 9, 9]);
});
