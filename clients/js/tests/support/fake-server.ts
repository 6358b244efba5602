/** A server in the place of `fetch` and `WebSocket`, on a clock that the test moves. */

import { afterEach, beforeEach, vi } from "vitest";

export interface Answer {
  status?: number;
  json?: unknown;
  body?: Uint8Array<ArrayBuffer>;
}

export class FakeSocket {
  static readonly OPEN = 1;
  readyState = 0;
  binaryType = "";
  closedWith: number | null = null;
  readonly sent: unknown[] = [];
  onopen: (() => void) | null = null;
  onmessage: ((event: { data: unknown }) => void) | null = null;
  onclose: ((event: { code: number }) => void) | null = null;

  constructor(
    readonly url: URL,
    readonly protocols: string[],
  ) {
    server.sockets.push(this);
  }

  send(text: string): void {
    this.sent.push(JSON.parse(text));
  }

  close(code: number): void {
    this.closedWith = code;
    this.readyState = 3;
  }

  /** What the server does. */
  accepts(hello = true): void {
    this.readyState = FakeSocket.OPEN;
    this.onopen?.();
    if (hello) this.says({ type: "hello", stream: "demo", latest_seq: 1, config: {} });
  }

  says(message: object | ArrayBuffer): void {
    this.onmessage?.({ data: message instanceof ArrayBuffer ? message : JSON.stringify(message) });
  }

  breaks(code = 1006): void {
    this.readyState = 3;
    this.onclose?.({ code });
  }
}

class FakeServer {
  sockets: FakeSocket[] = [];
  requests: { path: string; authorization: string | null }[] = [];
  /** By path without the query. `null` is a server that does not answer. */
  answer: (path: string) => Answer | null = () => ({ status: 404 });

  get socket(): FakeSocket {
    const newest = this.sockets.at(-1);
    if (newest === undefined) throw new Error("nobody has connected");
    return newest;
  }
}

export let server = new FakeServer();

/** To be called by a test file that wants it. */
export function useFakeServer(): void {
  beforeEach(() => {
    vi.useFakeTimers();
    server = new FakeServer();
    vi.stubGlobal("WebSocket", FakeSocket);
    vi.stubGlobal("fetch", async (input: string, init: RequestInit) => {
      const { pathname, search } = new URL(input);
      const authorization = new Headers(init.headers).get("Authorization");
      server.requests.push({ path: pathname + search, authorization });
      const answer = server.answer(pathname);
      if (answer === null) throw new TypeError("fetch failed");
      const { status = 200, json, body } = answer;
      return new Response(body ?? JSON.stringify(json ?? {}), { status });
    });
  });
  afterEach(() => {
    vi.unstubAllGlobals();
    vi.useRealTimers();
  });
}

/** Lets promises go on, and timers of so many milliseconds. */
export function pass(ms = 0): Promise<unknown> {
  return vi.advanceTimersByTimeAsync(ms);
}
