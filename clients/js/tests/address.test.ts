/** Addresses, and how long to wait before another try. */

import { describe, expect, test } from "vitest";
import { AddressError, parseAddress, pathOf } from "../src/address.js";
import { retryDelayMs } from "../src/backoff.js";

describe("an address", () => {
  test.each<[string, string, object]>([
    ["http://host:1/v1/streams/demo", "http://host:1/", { stream: "demo" }],
    ["https://host/watch/demo?x=1", "https://host/", { stream: "demo" }],
    ["http://host/demo", "http://host/", { stream: "demo" }],
    ["ws://host/v1/streams/demo/", "http://host/", { stream: "demo" }],
    ["https://host/below/v1/streams/demo", "https://host/below", { stream: "demo" }],
    ["http://host/v1/recordings/demo/x1", "http://host/", { stream: "demo", recording: "x1" }],
  ])("%s names a server and a place", (address, server, place) => {
    const parsed = parseAddress(address);
    expect(parsed.server.href).toBe(server);
    expect(parsed.place).toEqual(place);
  });

  test("may be relative to a page", () => {
    const { server, place } = parseAddress("/v1/streams/demo", "https://host/somewhere");
    expect(server.href).toBe("https://host/");
    expect(place).toEqual({ stream: "demo" });
  });

  test.each(["http://host/", "http://host/a/b", "not an address"])("%s is refused", (address) => {
    expect(() => parseAddress(address)).toThrow(AddressError);
  });

  test("is made of a place's names, escaped", () => {
    expect(pathOf({ stream: "a/b" })).toBe("/v1/streams/a%2Fb");
    expect(pathOf({ stream: "a", recording: "x" })).toBe("/v1/recordings/a/x");
  });
});

test("retries wait twice as long each time, up to ten seconds", () => {
  expect([0, 1, 2, 3].map((attempt) => retryDelayMs(attempt, 1))).toEqual([500, 1000, 2000, 4000]);
  expect(retryDelayMs(40, 1)).toBe(10_000);
  expect(retryDelayMs(0, 0)).toBe(250);
});
