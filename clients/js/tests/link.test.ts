/** Connections that break, and come back or do not. */

import { describe, expect, test } from "vitest";
import type { LinkState } from "../src/link.js";
import { Playback, type PlaybackOptions } from "../src/playback.js";
import { Server, type ServerOptions } from "../src/server.js";
import { Subscription, type SubscriptionOptions } from "../src/subscription.js";
import { pass, server, useFakeServer } from "./support/fake-server.js";
import { message, metricsWithImage } from "./support/frames.js";

useFakeServer();

const URL_OF_SERVER = "http://host";
const DEMO = { json: { streams: [{ stream: "demo" }] } };

function subscribe(options: Partial<SubscriptionOptions> = {}, access: ServerOptions = {}) {
  const states: LinkState[] = [];
  const frames: (number | null)[] = [];
  const images: (number[] | null)[] = [];
  const subscription = new Subscription(new Server(URL_OF_SERVER, access), "demo", {
    onState: (state) => states.push(state),
    onFrame: ({ metrics, texture }) => {
      frames.push(metrics.seq);
      images.push(texture === null ? null : [...texture]);
    },
    ...options,
  });
  subscription.start();
  const kinds = () => states.map(({ kind }) => kind);
  return { subscription, states, kinds, frames, images };
}

describe("a subscription", () => {
  test("hands out frames", async () => {
    server.answer = () => DEMO;
    const { frames, kinds } = subscribe({ maxFps: 10 });
    await pass();
    expect(server.socket.url.href).toBe("ws://host/v1/streams/demo/subscribe?max_fps=10");
    expect(server.socket.protocols).toEqual(["steadymesh.v1"]);
    server.socket.accepts();
    server.socket.says(message('{"seq":3}'));
    expect(frames).toEqual([3]);
    expect(kinds()).toEqual(["connecting", "open"]);
  });

  test("comes back after its connection breaks", async () => {
    server.answer = () => DEMO;
    const { kinds, frames } = subscribe();
    await pass();
    server.socket.accepts();
    server.socket.breaks();
    expect(kinds().at(-1)).toBe("reconnecting");
    expect(server.sockets.length).toBe(1);
    await pass(500);
    server.socket.accepts();
    server.socket.says(message('{"seq":9}'));
    expect(server.sockets.length).toBe(2);
    expect(kinds().at(-1)).toBe("open");
    expect(frames).toEqual([9]);
  });

  test("asks more and more rarely while nobody answers, until a hello", async () => {
    server.answer = () => null;
    const { states } = subscribe();
    await pass(60_000);
    const tries = server.requests.length;
    expect(tries).toBeGreaterThan(7);
    expect(tries).toBeLessThan(20);
    server.answer = () => DEMO;
    await pass(10_000);
    server.socket.accepts();
    server.socket.breaks();
    const last = states.at(-1);
    expect(last?.kind === "reconnecting" && last.retryAtMs - Date.now()).toBeLessThanOrEqual(500);
  });

  test("waits for a stream that is not there, and for one that was deleted", async () => {
    server.answer = () => ({ json: { streams: [] } });
    const { states } = subscribe();
    await pass();
    expect(states.at(-1)).toEqual({ kind: "absent", reason: null });
    expect(server.sockets).toEqual([]);
    server.answer = () => DEMO;
    await pass(2000);
    server.socket.accepts();
    server.socket.says({ type: "end", reason: "deleted" });
    server.socket.breaks(1000);
    expect(states.at(-1)).toEqual({ kind: "absent", reason: "deleted" });
  });

  test("stops where access is refused, and says why", async () => {
    server.answer = () => ({ status: 401, json: { status: 401, detail: "no token" } });
    const { states } = subscribe();
    await pass(60_000);
    expect(states.at(-1)).toEqual({ kind: "refused", status: 401, detail: "no token" });
    expect(server.requests.length).toBe(1);
  });

  test("gives up an incomprehensible connection and asks for another one rarely", async () => {
    server.answer = () => DEMO;
    const { states, frames } = subscribe();
    await pass();
    server.socket.accepts();
    server.socket.says(new ArrayBuffer(3));
    expect(server.socket.closedWith).toBe(4000);
    server.socket.breaks(4000);
    const last = states.at(-1);
    expect(last?.kind === "reconnecting" && last.retryAtMs - Date.now()).toBeGreaterThan(4000);
    expect(frames).toEqual([]);
  });

  test("is silent once it is closed", async () => {
    server.answer = () => DEMO;
    const { subscription, kinds, frames } = subscribe();
    await pass();
    const { socket } = server;
    socket.accepts();
    subscription.close();
    socket.says(message('{"seq":3}'));
    socket.breaks();
    await pass(60_000);
    expect(frames).toEqual([]);
    expect(kinds().at(-1)).toBe("closed");
    expect(server.sockets.length).toBe(1);
  });

  test("gives an image in a message to the frames that share it", async () => {
    server.answer = () => DEMO;
    const { images } = subscribe({ textures: "inline" });
    await pass();
    expect(server.socket.url.search).toBe("?textures=inline");
    server.socket.accepts();
    server.socket.says(message(metricsWithImage(1, "a"), [1, 2]));
    server.socket.says(message(metricsWithImage(2, "a")));
    expect(images).toEqual([
      [1, 2],
      [1, 2],
    ]);
  });
});

describe("a token", () => {
  test("goes into requests and into the list of subprotocols", async () => {
    server.answer = () => DEMO;
    subscribe({}, { token: "secret" });
    await pass();
    expect(server.requests[0]?.authorization).toBe("Bearer secret");
    expect(server.socket.protocols).toEqual(["steadymesh.v1", "bearer.secret"]);
    expect(server.socket.url.href).not.toContain("secret");
  });

  test("is exchanged for a ticket, if that is wanted", async () => {
    server.answer = (path) =>
      path === "/v1/tickets" ? { status: 201, json: { ticket: "t1" } } : DEMO;
    subscribe({}, { token: async () => "secret", tickets: true });
    await pass();
    expect(server.socket.url.searchParams.get("ticket")).toBe("t1");
    expect(server.socket.protocols).toEqual(["steadymesh.v1"]);
  });

  test("that has expired is asked for again, where it comes from a function", async () => {
    server.answer = () => DEMO;
    const tokens = ["old", "old", "new", "new"];
    const { kinds } = subscribe({}, { token: () => tokens.shift() ?? null });
    await pass();
    server.socket.accepts();
    server.socket.breaks(4401);
    await pass(1000);
    expect(server.sockets.length).toBe(2);
    expect(server.sockets.map(({ protocols }) => protocols[1])).toEqual([
      "bearer.old",
      "bearer.new",
    ]);
    expect(kinds()).not.toContain("refused");
  });

  test("that has expired ends the connection, where it is a constant", async () => {
    server.answer = () => DEMO;
    const { kinds } = subscribe({}, { token: "secret" });
    await pass();
    server.socket.accepts();
    server.socket.breaks(4401);
    await pass(60_000);
    expect(kinds().at(-1)).toBe("refused");
    expect(server.sockets.length).toBe(1);
  });
});

describe("a playback", () => {
  const RECORDING = { json: { stream: "demo", id: "x" } };

  function play(options: Partial<PlaybackOptions> = {}) {
    server.answer = () => RECORDING;
    const states: string[] = [];
    const playback = new Playback(new Server(URL_OF_SERVER), "demo", "x", {
      onState: ({ kind }) => states.push(kind),
      onFrame: () => undefined,
      ...options,
    });
    playback.start();
    return { playback, states };
  }

  test("begins where and how fast it should", async () => {
    play({ from: { timeUs: 5.4 }, speed: 0.5 });
    await pass();
    expect(server.socket.url.href).toBe("ws://host/v1/recordings/demo/x/play?speed=0.5&from_us=5");
  });

  test("says what is wanted", async () => {
    const { playback } = play();
    await pass();
    server.socket.accepts();
    playback.seek({ seq: 41 });
    playback.pause();
    playback.resume();
    playback.setSpeed(2);
    expect(server.socket.sent).toEqual([
      { type: "seek", seq: 41 },
      { type: "pause" },
      { type: "resume" },
      { type: "speed", speed: 2 },
    ]);
  });

  test("goes on behind its last frame when its connection breaks, as it was", async () => {
    const { playback } = play();
    await pass();
    server.socket.accepts();
    playback.setSpeed(2);
    playback.pause();
    server.socket.says(message('{"seq":41}'));
    server.socket.breaks();
    await pass(1000);
    expect(server.socket.url.search).toBe("?speed=2&from_seq=42");
    server.socket.accepts();
    expect(server.socket.sent).toEqual([{ type: "pause" }]);
  });

  test("is finished at the end, and starts again by a seek", async () => {
    const { playback, states } = play();
    await pass();
    server.socket.accepts();
    server.socket.says({ type: "end", reason: "finished" });
    server.socket.breaks(1000);
    await pass(60_000);
    expect(states.at(-1)).toBe("finished");
    expect(server.sockets.length).toBe(1);
    playback.seek({ seq: 0 });
    await pass();
    expect(server.socket.url.search).toBe("?speed=1&from_seq=0");
  });
});
