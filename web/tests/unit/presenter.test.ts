/** Which frames are drawn, and which are given back. */

import type { DecodedFrame, DecoderPool } from "steadymesh";
import { expect, test } from "vitest";
import { Presenter } from "../../src/play/presenter";

const CHANGE = new Float32Array([1]);

function bench() {
  const drawn: [number, Float32Array | null][] = [];
  const released: number[] = [];
  const answers: (() => void)[] = [];
  const pool = {
    distances: () =>
      new Promise((resolve) => {
        answers.push(() => resolve(CHANGE));
      }),
  } as unknown as DecoderPool;
  const presenter = new Presenter(
    pool,
    (frame, change) => drawn.push([frame.messageBytes, change]),
    (frame) => released.push(frame.messageBytes),
  );
  const show = (number: number) =>
    presenter.show({ messageBytes: number, mesh: { positions: [] } } as unknown as DecodedFrame);
  const answer = async () => {
    answers.shift()?.();
    await new Promise((resolve) => setTimeout(resolve));
  };
  return { presenter, show, answer, drawn, released };
}

test("each frame is given back when the next one is drawn", () => {
  const { show, drawn, released } = bench();
  for (const number of [1, 2, 3]) show(number);
  expect(drawn.map(([number]) => number)).toEqual([1, 2, 3]);
  expect(released).toEqual([1, 2]);
});

test("a frame waits for its changes, and the newest one is next", async () => {
  const { presenter, show, answer, drawn, released } = bench();
  presenter.measuresChange = true;
  for (const number of [1, 2, 3, 4]) show(number);
  expect(drawn).toEqual([[1, null]]);
  await answer();
  await answer();
  expect(drawn.map(([number]) => number)).toEqual([1, 2, 4]);
  expect(drawn[2]?.[1]).toBe(CHANGE);
  expect(presenter.skipped).toBe(1);
  expect(released.sort()).toEqual([1, 2, 3]);
});

test("a frame that stands still shows its changes when they are asked for", async () => {
  const { presenter, show, answer, drawn } = bench();
  show(1);
  show(2);
  presenter.measuresChange = true;
  await answer();
  expect(drawn.at(-1)).toEqual([2, CHANGE]);
});

test("everything is given back at the end, once", async () => {
  const { presenter, show, answer, released } = bench();
  show(1);
  presenter.measuresChange = true;
  show(2);
  show(3);
  presenter.close();
  await answer();
  expect(released.sort()).toEqual([1, 2, 3]);
});
