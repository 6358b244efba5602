/** Work side by side, results in order. */

import { expect, test } from "vitest";
import { OrderedWork } from "../src/ordered.js";

/** Work that ends when the test says so. */
function bench(keep: "newest" | "all", width = 1) {
  const started: number[] = [];
  const delivered: number[] = [];
  const failed: number[] = [];
  const discarded: number[] = [];
  const ends = new Map<number, { resolve(): void; reject(): void }>();
  const work = new OrderedWork<number, number>({
    width,
    keep,
    work: (value) => {
      started.push(value);
      return new Promise((resolve, reject) => {
        ends.set(value, {
          resolve: () => resolve(value * 10),
          reject: () => reject(new Error("broken")),
        });
      });
    },
    deliver: (result) => delivered.push(result),
    failed: (_, value) => failed.push(value),
    discard: (result) => discarded.push(result),
  });
  const settle = () => new Promise((resolve) => setTimeout(resolve));
  const finish = async (value: number) => {
    ends.get(value)?.resolve();
    await settle();
  };
  const fail = async (value: number) => {
    ends.get(value)?.reject();
    await settle();
  };
  return { work, started, delivered, failed, discarded, finish, fail };
}

test("a slow consumer gets the newest value next and skips those between", async () => {
  const { work, started, finish } = bench("newest");
  for (const value of [1, 2, 3, 4]) work.offer(value);
  await finish(1);
  expect(started).toEqual([1, 4]);
  expect(work.skipped).toBe(2);
});

test("all values come to a consumer that wants all", async () => {
  const { work, delivered, finish } = bench("all");
  for (const value of [1, 2, 3]) work.offer(value);
  expect(work.waiting).toBe(2);
  for (const value of [1, 2, 3]) await finish(value);
  expect(delivered).toEqual([10, 20, 30]);
  expect(work.skipped).toBe(0);
});

test("results come in the order of the offers, whichever is done first", async () => {
  const { work, delivered, finish } = bench("newest", 2);
  work.offer(1);
  work.offer(2);
  await finish(2);
  expect(delivered).toEqual([]);
  await finish(1);
  expect(delivered).toEqual([10, 20]);
});

test("a value that fails does not stop those behind it", async () => {
  const { work, delivered, failed, finish, fail } = bench("newest", 2);
  work.offer(1);
  work.offer(2);
  await finish(2);
  await fail(1);
  expect(failed).toEqual([1]);
  expect(delivered).toEqual([20]);
});

test("what is in work when all is cleared is discarded", async () => {
  const { work, started, delivered, discarded, finish } = bench("newest");
  work.offer(1);
  work.offer(2);
  work.clear();
  await finish(1);
  expect(started).toEqual([1]);
  expect(delivered).toEqual([]);
  expect(discarded).toEqual([10]);
  work.offer(3);
  await finish(3);
  expect(delivered).toEqual([30]);
});

test("nothing begins while it is held, and the newest does afterwards", async () => {
  const { work, started } = bench("newest");
  work.hold();
  work.offer(1);
  work.offer(2);
  expect(started).toEqual([]);
  work.release();
  expect(started).toEqual([2]);
});
