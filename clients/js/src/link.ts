/** A WebSocket with frames that comes back by itself. */

import { retryDelayMs } from "./backoff.js";
import {
  type ControlMessage,
  type Frame,
  ProtocolError,
  parseControl,
  parseFrame,
} from "./message.js";
import { ProblemError } from "./server.js";

export type LinkState =
  | { kind: "connecting" }
  | { kind: "open" }
  /** There is no such stream (any more); asked again every two seconds. */
  | { kind: "absent"; reason: string | null }
  | { kind: "reconnecting"; retryAtMs: number }
  /** There is no access without another token. */
  | { kind: "refused"; status: number; detail: string }
  /** The recording is over. */
  | { kind: "finished" }
  | { kind: "closed" };

export interface LinkHandlers {
  onState?(state: LinkState): void;
  onControl?(message: ControlMessage): void;
  onFrame(frame: Frame): void;
}

/** What is at the other end. */
export interface LinkTarget {
  /** @throws {ProblemError} if the server refuses to say, another error if nobody answers. */
  exists(): Promise<boolean>;
  open(): Promise<WebSocket>;
  /** Whether another token may help. */
  readonly renewsToken: boolean;
}

const ABSENT_POLL_MS = 2000;
/** Where the backoff goes on after a frame that could not be read. */
const INCOMPREHENSIBLE_ATTEMPT = 5;
/** From the range that RFC 6455 leaves to applications. */
const CLOSE_INCOMPREHENSIBLE = 4000;
const CLOSE_TOKEN_EXPIRED = 4401;

export class Link {
  private socket: WebSocket | null = null;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private attempt = 0;
  private endReason: string | null = null;
  /** Of the connection that counts: what others still say is not heard. */
  private generation = 0;

  constructor(
    private readonly target: LinkTarget,
    private readonly handlers: LinkHandlers,
  ) {}

  /** Connects, or connects anew. */
  start(): void {
    this.drop();
    this.endReason = null;
    this.handlers.onState?.({ kind: "connecting" });
    globalThis.addEventListener?.("online", this.retryNow);
    void this.connect(this.generation);
  }

  close(): void {
    this.drop();
    globalThis.removeEventListener?.("online", this.retryNow);
    this.handlers.onState?.({ kind: "closed" });
  }

  /** Whether it was sent: nothing is while there is no connection. */
  send(message: unknown): boolean {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  private drop(): void {
    this.generation += 1;
    clearTimeout(this.timer);
    this.timer = undefined;
    this.socket?.close(1000);
    this.socket = null;
  }

  private readonly retryNow = (): void => {
    if (this.timer === undefined) return;
    clearTimeout(this.timer);
    void this.connect(this.generation);
  };

  /**
   * Asks for the place first: a WebSocket to a stream that does not exist would fail without a
   * reason that a page can read.
   */
  private async connect(generation: number): Promise<void> {
    this.timer = undefined;
    let found: boolean | unknown;
    try {
      found = await this.target.exists();
    } catch (error) {
      found = error;
    }
    if (generation !== this.generation) return;
    if (found === false) this.waitForPlace();
    else if (found instanceof ProblemError && (found.status === 401 || found.status === 403)) {
      this.handlers.onState?.({ kind: "refused", status: found.status, detail: found.message });
    } else if (found === true || found instanceof ProblemError) await this.open(generation);
    else this.retryLater();
  }

  private async open(generation: number): Promise<void> {
    const socket = await this.target.open().catch(() => null);
    if (generation !== this.generation) {
      socket?.close(1000);
      return;
    }
    if (socket === null) {
      this.retryLater();
      return;
    }
    this.socket = socket;
    const counts = () => generation === this.generation;
    socket.onopen = () => {
      if (!counts()) return;
      this.endReason = null;
      this.handlers.onState?.({ kind: "open" });
    };
    socket.onmessage = ({ data }: MessageEvent<string | ArrayBuffer>) => {
      if (counts()) this.receive(socket, data);
    };
    socket.onclose = ({ code }) => {
      if (!counts()) return;
      this.socket = null;
      this.closed(code);
    };
  }

  private receive(socket: WebSocket, data: string | ArrayBuffer): void {
    if (typeof data === "string") {
      const message = parseControl(data);
      if (message === null) return;
      // Only a hello proves that the server serves us; a bare handshake may come from a proxy.
      if (message.type === "hello") this.attempt = 0;
      if (message.type === "end") this.endReason = message.reason;
      this.handlers.onControl?.(message);
      return;
    }
    let frame: Frame;
    try {
      frame = parseFrame(data);
    } catch (error) {
      if (!(error instanceof ProtocolError)) throw error;
      // Reading on would not help, and a server that speaks another version is asked rarely.
      this.attempt = Math.max(this.attempt, INCOMPREHENSIBLE_ATTEMPT);
      socket.close(CLOSE_INCOMPREHENSIBLE, error.message.slice(0, 120));
      return;
    }
    this.handlers.onFrame(frame);
  }

  private closed(code: number): void {
    if (this.endReason === "finished") this.handlers.onState?.({ kind: "finished" });
    else if (this.endReason === "deleted") this.waitForPlace();
    else if (code === CLOSE_TOKEN_EXPIRED && !this.target.renewsToken) {
      this.handlers.onState?.({ kind: "refused", status: 401, detail: "the token has expired" });
    } else this.retryLater();
  }

  private waitForPlace(): void {
    this.attempt = 0;
    this.handlers.onState?.({ kind: "absent", reason: this.endReason });
    this.schedule(ABSENT_POLL_MS);
  }

  private retryLater(): void {
    const delay = retryDelayMs(this.attempt, Math.random());
    this.attempt += 1;
    this.handlers.onState?.({ kind: "reconnecting", retryAtMs: Date.now() + delay });
    this.schedule(delay);
  }

  private schedule(delayMs: number): void {
    const { generation } = this;
    this.timer = setTimeout(() => void this.connect(generation), delayMs);
  }
}
