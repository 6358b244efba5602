/** One request each: lists, metrics, single frames and images of a server. */

import { type Place, pathOf } from "./address.js";
import { asNumber, asRecord, asText } from "./json.js";
import {
  parseMetricsList,
  parseRecordedFrames,
  parseRecording,
  parseRecordingList,
  parseStreamList,
  type RecordedFrames,
  type RecordingSummary,
  type StreamSummary,
} from "./lists.js";
import { SUBPROTOCOL } from "./message.js";
import { type FrameMetrics, parseMetrics } from "./metrics.js";

const TIMEOUT_MS = 15_000;

/** A token, or a function that gives one that has not expired. */
export type Token = string | (() => string | null | Promise<string | null>);

export interface ServerOptions {
  token?: Token | undefined;
  /** Opens WebSockets by a ticket, so that the token is sent in the header of a request only. */
  tickets?: boolean | undefined;
}

/** The server answered, and refused. */
export class ProblemError extends Error {
  override name = "ProblemError";
  constructor(
    readonly status: number,
    /** Such as `no-stream`; `null` if whoever answered does not say. */
    readonly kind: string | null,
    message: string,
  ) {
    super(message);
  }
}

export class Server {
  /** With no slash at its end. */
  readonly url: string;

  constructor(
    url: string | URL,
    private readonly options: ServerOptions = {},
  ) {
    this.url = new URL(url, globalThis.location?.href).href.replace(/\/+$/, "");
  }

  async streams(): Promise<StreamSummary[]> {
    return parseStreamList(await this.json("/v1/streams"));
  }

  /** @throws {ProblemError} with status 404 if the server keeps no recordings. */
  async recordings(stream?: string): Promise<RecordingSummary[]> {
    const query = stream === undefined ? "" : `?stream=${encodeURIComponent(stream)}`;
    return parseRecordingList(await this.json(`/v1/recordings${query}`));
  }

  async recording(stream: string, id: string): Promise<RecordingSummary | null> {
    return parseRecording(await this.json(pathOf({ stream, recording: id })));
  }

  /** Of the newest frames that a live stream still holds, oldest first. */
  async metrics(stream: string, last: number): Promise<FrameMetrics[]> {
    return parseMetricsList(await this.json(`${pathOf({ stream })}/metrics?last=${last}`));
  }

  /** Of one frame. */
  async frameMetrics(place: Place, seq: number | "latest"): Promise<FrameMetrics> {
    return parseMetrics(await this.json(`${pathOf(place)}/frames/${seq}/metrics`));
  }

  /** The recorded frames from a number or a time on, at most `limit` (1,000). */
  async recordedFrames(
    stream: string,
    recording: string,
    from: { seq?: number; timeUs?: number } = {},
    limit = 1000,
  ): Promise<RecordedFrames> {
    const query = new URLSearchParams({ track: "output", limit: String(limit) });
    if (from.timeUs !== undefined) query.set("from_us", String(Math.round(from.timeUs)));
    else query.set("from_seq", String(from.seq ?? 0));
    return parseRecordedFrames(await this.json(`${pathOf({ stream, recording })}/frames?${query}`));
  }

  /** One frame's mesh, compressed by Draco. */
  async mesh(place: Place, seq: number | "latest"): Promise<ArrayBuffer> {
    return (await this.file(`${pathOf(place)}/frames/${seq}.drc`)).buffer;
  }

  /** An image's file, by its id. It never changes, and the browser keeps it. */
  async texture(place: Place, id: string): Promise<Uint8Array<ArrayBuffer>> {
    return this.file(`${pathOf(place)}/textures/${encodeURIComponent(id)}`);
  }

  /** The image's file of one frame: images of recordings have no address of their own. */
  async frameTexture(place: Place, seq: number | "latest"): Promise<Uint8Array<ArrayBuffer>> {
    return this.file(`${pathOf(place)}/frames/${seq}/texture`);
  }

  /**
   * Opens a WebSocket below a place.
   *
   * A page can set no headers on it: a token goes into the list of subprotocols, or is exchanged
   * for a ticket first.
   */
  async socket(place: Place, route: string, query: URLSearchParams): Promise<WebSocket> {
    const url = new URL(`${this.url}${pathOf(place)}/${route}`);
    url.protocol = url.protocol.replace(/^http/, "ws");
    url.search = query.toString();
    const protocols = [SUBPROTOCOL];
    const token = await this.token();
    if (token !== null && this.options.tickets === true) {
      url.searchParams.set("ticket", await this.ticket(place.stream));
    } else if (token !== null) {
      protocols.push(`bearer.${token}`);
    }
    const socket = new WebSocket(url, protocols);
    socket.binaryType = "arraybuffer";
    return socket;
  }

  /** Whether another try may have another token. */
  get renewsToken(): boolean {
    return typeof this.options.token === "function";
  }

  private async ticket(stream: string): Promise<string> {
    const response = await this.request("/v1/tickets", {
      method: "POST",
      body: JSON.stringify({ stream, scope: "subscribe" }),
      headers: { "Content-Type": "application/json" },
    });
    const ticket = asText(asRecord(await response.json()).ticket);
    if (ticket === null) throw new ProblemError(response.status, null, "the server gave no ticket");
    return ticket;
  }

  private async json(path: string): Promise<unknown> {
    const response = await this.request(path, { cache: "no-store" });
    return response.json();
  }

  private async file(path: string): Promise<Uint8Array<ArrayBuffer>> {
    const response = await this.request(path, {});
    return new Uint8Array(await response.arrayBuffer());
  }

  /** @throws {ProblemError} if the server refuses, another error if nobody answers. */
  private async request(path: string, init: RequestInit): Promise<Response> {
    const headers = new Headers(init.headers);
    const token = await this.token();
    if (token !== null) headers.set("Authorization", `Bearer ${token}`);
    const signal = AbortSignal.timeout(TIMEOUT_MS);
    const response = await fetch(`${this.url}${path}`, { ...init, headers, signal });
    if (!response.ok) throw await problem(response);
    return response;
  }

  private async token(): Promise<string | null> {
    const { token } = this.options;
    return (typeof token === "function" ? await token() : token) ?? null;
  }
}

async function problem(response: Response): Promise<ProblemError> {
  const document = asRecord(await response.json().catch(() => null));
  const status = asNumber(document.status) ?? response.status;
  const kind = asText(document.type)?.replace(/^urn:steadymesh:problem:/, "") ?? null;
  const detail = asText(document.detail) ?? asText(document.title);
  return new ProblemError(status, kind, detail ?? `the server answered ${response.status}`);
}
