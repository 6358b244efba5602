/** A subscription to one stream: a WebSocket that comes back by itself. */

import {
  type ControlMessage,
  type Frame,
  ProtocolError,
  parseControl,
  parseFrame,
  SUBPROTOCOL,
} from "./protocol";
import { fetchStreams } from "./streams";

export type ConnectionState =
  | { kind: "connecting" }
  | { kind: "open" }
  /** The server has no such stream (any more); asked again every two seconds. */
  | { kind: "absent"; reason: string | null }
  | { kind: "reconnecting"; retryAtMs: number };

export interface SubscriptionHandlers {
  onState(state: ConnectionState): void;
  onControl(message: ControlMessage): void;
  onFrame(frame: Frame): void;
}

const FIRST_RETRY_MS = 500;
const MAX_RETRY_MS = 10_000;
const ABSENT_POLL_MS = 2000;
/** Where the backoff goes on after a frame that could not be read. */
const INCOMPREHENSIBLE_ATTEMPT = 5;
/** From the range that RFC 6455 leaves to applications. */
const CLOSE_INCOMPREHENSIBLE = 4000;

/**
 * Delay before retry number `attempt` (from 0): doubling, capped, and spread over its upper half
 * so that the readers of a restarted server do not return all at once. `random` is in [0, 1).
 */
export function retryDelayMs(attempt: number, random: number): number {
  const ceiling = Math.min(MAX_RETRY_MS, FIRST_RETRY_MS * 2 ** attempt);
  return ceiling * (0.5 + random / 2);
}

export class Subscription {
  private socket: WebSocket | null = null;
  private timer: number | undefined;
  private attempt = 0;
  private endReason: string | null = null;
  private stopped = false;

  constructor(
    private readonly stream: string,
    private readonly handlers: SubscriptionHandlers,
  ) {}

  start(): void {
    this.handlers.onState({ kind: "connecting" });
    window.addEventListener("online", this.retryNow);
    void this.connect();
  }

  stop(): void {
    this.stopped = true;
    window.removeEventListener("online", this.retryNow);
    clearTimeout(this.timer);
    this.socket?.close(1000);
  }

  private readonly retryNow = (): void => {
    if (this.timer === undefined) return;
    clearTimeout(this.timer);
    void this.connect();
  };

  /**
   * Asks for the list first: a WebSocket to a stream that does not exist would fail without a
   * reason that a page can read.
   */
  private async connect(): Promise<void> {
    this.timer = undefined;
    const exists = await this.streamExists();
    if (this.stopped) return;
    if (exists === "yes") this.open();
    else if (exists === "no") this.waitForStream();
    else this.retryLater();
  }

  private waitForStream(): void {
    this.attempt = 0;
    this.handlers.onState({ kind: "absent", reason: this.endReason });
    this.timer = window.setTimeout(() => void this.connect(), ABSENT_POLL_MS);
  }

  private async streamExists(): Promise<"yes" | "no" | "unreachable"> {
    try {
      const streams = await fetchStreams();
      return streams.some(({ stream }) => stream === this.stream) ? "yes" : "no";
    } catch (error) {
      // Somebody may be allowed to watch and not to list.
      return error instanceof Error && error.name === "ListError" ? "yes" : "unreachable";
    }
  }

  private open(): void {
    const path = `/v1/streams/${encodeURIComponent(this.stream)}/subscribe`;
    const url = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}${path}`;
    const socket = new WebSocket(url, SUBPROTOCOL);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => {
      this.endReason = null;
      this.handlers.onState({ kind: "open" });
    };
    socket.onmessage = (event: MessageEvent<string | ArrayBuffer>) => this.receive(event.data);
    socket.onclose = () => {
      this.socket = null;
      if (!this.stopped) this.retryLater();
    };
  }

  private receive(data: string | ArrayBuffer): void {
    if (typeof data === "string") {
      const message = parseControl(data);
      if (message === null) return;
      // Only a hello proves that the server serves us; a bare handshake may come from a proxy.
      if (message.type === "hello") this.attempt = 0;
      if (message.type === "end") this.endReason = message.reason;
      this.handlers.onControl(message);
      return;
    }
    try {
      this.handlers.onFrame(parseFrame(data));
    } catch (error) {
      if (!(error instanceof ProtocolError)) throw error;
      // Reading on would not help, and a server that speaks another version is asked rarely.
      this.attempt = Math.max(this.attempt, INCOMPREHENSIBLE_ATTEMPT);
      this.socket?.close(CLOSE_INCOMPREHENSIBLE, error.message.slice(0, 120));
    }
  }

  private retryLater(): void {
    if (this.endReason === "deleted") {
      this.waitForStream();
      return;
    }
    const delay = retryDelayMs(this.attempt, Math.random());
    this.attempt += 1;
    this.handlers.onState({ kind: "reconnecting", retryAtMs: Date.now() + delay });
    this.timer = window.setTimeout(() => void this.connect(), delay);
  }
}
