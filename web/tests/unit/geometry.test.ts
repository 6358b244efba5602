/** Arrays on their way to the graphics card. */

import { expect, test } from "vitest";
import { areAlike, boundsOf, diagonalOf, expandCorners } from "../../src/view/geometry";

test("bounds span all vertices, whatever their unit", () => {
  const positions = new Float32Array([1, -2, 3, -4, 5, -6]);
  expect(boundsOf(positions)).toEqual({ min: [-4, -2, -6], max: [1, 5, 3] });
});

test("a mesh without vertices has no bounds", () => {
  expect(boundsOf(new Float32Array())).toBeNull();
});

test("a diagonal is that of the box", () => {
  expect(diagonalOf({ min: [0, 0, 0], max: [2, 3, 6] })).toBe(7);
});

test("boxes of one figure are alike, those of another size or place are not", () => {
  const box = { min: [0, 0, 0], max: [1, 2, 1] } as const;
  const moved = (by: number, scale = 1) => ({
    min: [by, 0, 0] as [number, number, number],
    max: [by + scale, 2 * scale, scale] as [number, number, number],
  });
  const first = { min: [...box.min], max: [...box.max] } as ReturnType<typeof moved>;
  expect(areAlike(first, moved(0.1))).toBe(true);
  expect(areAlike(first, moved(5))).toBe(false);
  expect(areAlike(first, moved(0, 1000))).toBe(false);
});

test("corners come in face order, and the rest of the buffer stays as it was", () => {
  const source = new Float32Array([0, 0, 0, 1, 1, 1, 2, 2, 2]);
  const target = new Float32Array(12).fill(9);
  expandCorners(source, 3, new Uint32Array([2, 0, 1]), target);
  expect([...target]).toEqual([2, 2, 2, 0, 0, 0, 1, 1, 1, 9, 9, 9]);
});

test("an index that is out of range reads as zero", () => {
  const target = new Float32Array(2).fill(9);
  expandCorners(new Float32Array([5, 5]), 2, new Uint32Array([7]), target);
  expect([...target]).toEqual([0, 0]);
});
