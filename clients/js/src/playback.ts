/** A recording that is played: at any speed, from any place, with pauses. */

import { InlineTextures } from "./inline.js";
import { Link, type LinkHandlers, type LinkState } from "./link.js";
import { ProblemError, type Server } from "./server.js";
import { addTextureMode, type TextureMode } from "./subscription.js";

/** A place in a recording: a frame's number, or a time in microseconds since 1970. */
export type Position = { seq: number } | { timeUs: number };

export interface PlaybackOptions extends LinkHandlers {
  /** Where to begin; at its first frame, if left out. */
  from?: Position | undefined;
  /** 1, if left out, is the speed at which it was captured; 0 is as fast as the connection. */
  speed?: number | undefined;
  /** Whether it begins with a pause, after one frame. */
  paused?: boolean | undefined;
  /** `reference`, if left out. */
  textures?: TextureMode | undefined;
}

export class Playback {
  private readonly link: Link;
  private readonly images = new InlineTextures();
  private state: LinkState = { kind: "closed" };
  /** Where another connection begins. */
  private next: Position | null;
  private speed: number;
  private paused: boolean;

  constructor(
    server: Server,
    stream: string,
    recording: string,
    private readonly options: PlaybackOptions,
  ) {
    this.next = options.from ?? null;
    this.speed = options.speed ?? 1;
    this.paused = options.paused ?? false;
    const target = {
      exists: () => exists(server, stream, recording),
      open: () => server.socket({ stream, recording }, "play", this.query()),
      renewsToken: server.renewsToken,
    };
    this.link = new Link(target, {
      ...options,
      onState: (state) => this.onState(state),
      onFrame: (frame) => {
        const { seq } = frame.metrics;
        if (seq !== null) this.next = { seq: seq + 1 };
        options.onFrame(this.images.attach(frame));
      },
    });
  }

  start(): void {
    this.link.start();
  }

  close(): void {
    this.link.close();
  }

  get isPaused(): boolean {
    return this.paused;
  }

  /** Goes on at the first frame at this place or behind it; paused, it shows that one frame. */
  seek(position: Position): void {
    this.next = position;
    if (this.state.kind === "finished") this.link.start();
    else this.link.send({ type: "seek", ...wire(position) });
  }

  pause(): void {
    this.paused = true;
    this.link.send({ type: "pause" });
  }

  resume(): void {
    this.paused = false;
    this.link.send({ type: "resume" });
  }

  setSpeed(speed: number): void {
    this.speed = speed;
    this.link.send({ type: "speed", speed });
  }

  private query(): URLSearchParams {
    const query = new URLSearchParams({ speed: String(this.speed) });
    if (this.next !== null) {
      for (const [name, value] of Object.entries(wire(this.next))) {
        query.set(`from_${name.replace("time_", "")}`, String(value));
      }
    }
    addTextureMode(query, this.options.textures);
    return query;
  }

  private onState(state: LinkState): void {
    this.state = state;
    if (state.kind === "open") {
      this.images.reset();
      // The first frame comes all the same.
      if (this.paused) this.link.send({ type: "pause" });
    }
    this.options.onState?.(state);
  }
}

/** As the server takes it: whole numbers. */
function wire(position: Position): { seq: number } | { time_us: number } {
  return "seq" in position
    ? { seq: Math.max(0, Math.round(position.seq)) }
    : { time_us: Math.max(0, Math.round(position.timeUs)) };
}

async function exists(server: Server, stream: string, recording: string): Promise<boolean> {
  try {
    return (await server.recording(stream, recording)) !== null;
  } catch (error) {
    if (error instanceof ProblemError && error.status === 404) return false;
    throw error;
  }
}
