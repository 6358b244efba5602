import { expect, test } from "vitest";
import { NewestWins } from "../../src/newest";

/** A consumer whose every piece of work ends when the test says so. */
function slowConsumer() {
  const started: number[] = [];
  let finish = () => {};
  const queue = new NewestWins<number>((value) => {
    started.push(value);
    return new Promise((resolve) => {
      finish = resolve;
    });
  });
  const finishOne = async () => {
    finish();
    await new Promise((resolve) => setTimeout(resolve));
  };
  return { queue, started, finishOne };
}

test("a slow consumer gets the newest value next and skips those between", async () => {
  const { queue, started, finishOne } = slowConsumer();
  for (const value of [1, 2, 3, 4]) queue.offer(value);
  await finishOne();
  expect(started).toEqual([1, 4]);
  expect(queue.skipped).toBe(2);
});

test("a fast consumer gets every value", async () => {
  const { queue, started, finishOne } = slowConsumer();
  for (const value of [1, 2, 3]) {
    queue.offer(value);
    await finishOne();
  }
  expect(started).toEqual([1, 2, 3]);
  expect(queue.skipped).toBe(0);
});

test("a held queue goes on with the newest value once it is released", async () => {
  const { queue, started, finishOne } = slowConsumer();
  queue.hold();
  queue.offer(1);
  queue.offer(2);
  expect(started).toEqual([]);
  queue.release();
  await finishOne();
  expect(started).toEqual([2]);
});
