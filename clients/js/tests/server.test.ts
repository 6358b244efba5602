/** Single requests, and frames that are made of several. */

import { expect, test } from "vitest";
import { FrameDecoder } from "../src/frames.js";
import type { DecoderPool } from "../src/pool.js";
import { ProblemError, Server } from "../src/server.js";
import { TextureStore } from "../src/textures.js";
import { type DecodedMesh, DecodeError } from "../src/worker/decode.js";
import { pass, server, useFakeServer } from "./support/fake-server.js";

useFakeServer();

const IMAGE = { id: "ab", media_type: "image/png" };

/** A decoder without workers, which refuses empty meshes. */
function decoder(place: { stream: string; recording?: string }) {
  const pool = {
    decode: async (mesh: ArrayBuffer) => {
      if (mesh.byteLength === 0) throw new DecodeError("empty");
      return {} as DecodedMesh;
    },
  } as DecoderPool;
  const textures = new TextureStore({ decode: async () => null });
  return new FrameDecoder(new Server("http://host"), place, pool, textures);
}

test("what the server refuses says its kind and its reason", async () => {
  server.answer = () => ({
    status: 404,
    json: { type: "urn:steadymesh:problem:no-stream", status: 404, detail: "there is none" },
  });
  const asked = new Server("http://host/").metrics("demo", 3);
  await expect(asked).rejects.toThrow(ProblemError);
  await expect(asked).rejects.toMatchObject({ status: 404, kind: "no-stream" });
  expect(server.requests[0]?.path).toBe("/v1/streams/demo/metrics?last=3");
});

test("a held frame is fetched with its image", async () => {
  server.answer = (path) =>
    path.endsWith("/metrics")
      ? { json: { seq: 7, texture: IMAGE } }
      : { body: new Uint8Array([1, 2, 3]) };
  const frame = await decoder({ stream: "demo" }).fetch("latest");
  expect(server.requests.map(({ path }) => path)).toEqual([
    "/v1/streams/demo/frames/latest/metrics",
    "/v1/streams/demo/frames/7.drc",
    "/v1/streams/demo/textures/ab",
  ]);
  expect(frame.texture?.bytes).toEqual(new Uint8Array([1, 2, 3]));
  expect(frame.fetchedBytes).toBe(3);
});

test("an image of a recording is that of its frame", async () => {
  server.answer = (path) =>
    path.endsWith("/metrics")
      ? { json: { seq: 7, texture: IMAGE } }
      : { body: new Uint8Array([1]) };
  await decoder({ stream: "demo", recording: "x" }).fetch(7);
  expect(server.requests.at(-1)?.path).toBe("/v1/recordings/demo/x/frames/7/texture");
});

test("a frame whose image cannot be had is a frame all the same", async () => {
  server.answer = (path) =>
    path.endsWith("/metrics")
      ? { json: { seq: 7, texture: IMAGE } }
      : path.endsWith(".drc")
        ? { body: new Uint8Array([1]) }
        : { status: 404 };
  const decoding = decoder({ stream: "demo" });
  const frame = await decoding.fetch(7);
  expect(frame.texture).toBeNull();
  expect(decoding.failedTextures).toBe(1);
});

test("a mesh that cannot be decoded is an error, whatever its image is", async () => {
  server.answer = (path) =>
    path.endsWith("/metrics")
      ? { json: { seq: 7, texture: IMAGE } }
      : { body: new Uint8Array(path.endsWith(".drc") ? 0 : 1) };
  await expect(decoder({ stream: "demo" }).fetch(7)).rejects.toThrow(DecodeError);
  await pass();
});
