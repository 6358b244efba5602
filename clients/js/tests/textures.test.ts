/** Images: loaded once, let go in time. */

import { describe, expect, test } from "vitest";
import { InlineTextures } from "../src/inline.js";
import { parseFrame } from "../src/message.js";
import { TextureStore } from "../src/textures.js";
import { message, metricsWithImage } from "./support/frames.js";

/** A store whose images are objects that know whether they were closed. */
function bench(keep = 0) {
  const loaded: string[] = [];
  const closed: string[] = [];
  const store = new TextureStore({
    keep,
    decode: async ([name]) =>
      ({ close: () => closed.push(String(name)) }) as unknown as ImageBitmap,
  });
  const acquire = (id: string) =>
    store.acquire(id, "image/png", async () => {
      loaded.push(id);
      return new Uint8Array([Number(id)]);
    });
  return { store, acquire, loaded, closed };
}

const settle = () => new Promise((resolve) => setTimeout(resolve));

describe("images", () => {
  test("are loaded once, however many frames have them", async () => {
    const { acquire, loaded } = bench();
    const [first, second] = await Promise.all([acquire("1"), acquire("1")]);
    expect(second).toBe(first);
    expect(loaded).toEqual(["1"]);
  });

  test("are closed when the last frame lets them go", async () => {
    const { store, acquire, closed } = bench();
    const image = await acquire("1");
    await acquire("1");
    store.release(image);
    await settle();
    expect(closed).toEqual([]);
    store.release(image);
    await settle();
    expect(closed).toEqual(["1"]);
  });

  test("are kept for a while, those that were wanted last", async () => {
    const { store, acquire, loaded, closed } = bench(1);
    store.release(await acquire("1"));
    store.release(await acquire("2"));
    await settle();
    expect(closed).toEqual(["1"]);
    store.release(await acquire("2"));
    expect(loaded).toEqual(["1", "2"]);
  });

  test("that could not be loaded are tried again", async () => {
    const { store, acquire, loaded } = bench();
    const failing = store.acquire("1", "image/png", () => Promise.reject(new Error("gone")));
    await expect(failing).rejects.toThrow("gone");
    await acquire("1");
    expect(loaded).toEqual(["1"]);
  });
});

describe("images in messages", () => {
  const frame = (seq: number, id: string, image?: number[]) =>
    parseFrame(message(metricsWithImage(seq, id), image));

  test("belong to the frames after theirs that name them", () => {
    const images = new InlineTextures();
    images.attach(frame(1, "a", [7]));
    expect([...(images.attach(frame(2, "a")).texture ?? [])]).toEqual([7]);
    expect(images.attach(frame(3, "b")).texture).toBeNull();
  });

  test("are not those of an earlier connection", () => {
    const images = new InlineTextures();
    images.attach(frame(1, "a", [7]));
    images.reset();
    expect(images.attach(frame(2, "a")).texture).toBeNull();
  });
});
