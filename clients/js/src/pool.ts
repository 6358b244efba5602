/** A few workers that decode meshes, so that nothing of that is done where the page is drawn. */

import workerSource from "worker-source";
import { type DecodedMesh, DecodeError } from "./worker/decode.js";
import type { WorkerAnswer, WorkerRequest, WorkerResult, WorkerTask } from "./worker/messages.js";

/** A decoder that cannot start never answers; nothing that fits in a frame takes this long. */
const TIMEOUT_MS = 20_000;
const MAX_WORKERS = 3;

export interface PoolOptions {
  /** One fewer than the machine has cores, at most three, if left out. */
  workers?: number | undefined;
  /** Where `draco_decoder.wasm` of this package is served; beside the module, if left out. */
  wasmUrl?: string | URL | undefined;
}

interface Pending {
  resolve(result: WorkerResult): void;
  reject(error: Error): void;
  timer: ReturnType<typeof setTimeout>;
}

export class DecoderPool {
  /** How many tasks can be in work at once. */
  readonly width: number;

  private readonly wasmUrl: string | URL;
  private workers: Promise<PooledWorker[]> | null = null;
  private closed = false;

  constructor(options: PoolOptions = {}) {
    const cores = globalThis.navigator?.hardwareConcurrency ?? 2;
    this.width = options.workers ?? Math.min(Math.max(cores - 1, 1), MAX_WORKERS);
    this.wasmUrl = options.wasmUrl ?? new URL("./draco_decoder.wasm", import.meta.url);
  }

  /** Fetches and compiles the decoder ahead of the first frame. */
  preload(): void {
    this.start().catch(() => undefined);
  }

  /**
   * Decodes one Draco mesh. `mesh` is handed to a worker and empty afterwards.
   *
   * @throws {DecodeError}
   */
  async decode(mesh: ArrayBuffer): Promise<DecodedMesh> {
    return (await this.perform({ kind: "decode", mesh }, [mesh])) as DecodedMesh;
  }

  /** From each point (x, y, z) to the surface of a mesh, in the mesh's unit. */
  async distances(
    points: Float32Array,
    surface: { positions: Float32Array; indices: Uint32Array },
  ): Promise<Float32Array<ArrayBuffer>> {
    const { positions, indices } = surface;
    const task: WorkerTask = { kind: "distances", points, positions, indices };
    return (await this.perform(task, [])) as Float32Array<ArrayBuffer>;
  }

  close(): void {
    this.closed = true;
    void this.workers?.then((workers) => {
      for (const worker of workers) worker.close();
    });
    this.workers = null;
  }

  private async perform(task: WorkerTask, transfer: Transferable[]): Promise<WorkerResult> {
    const workers = await this.start();
    const least = workers.reduce((a, b) => (b.load < a.load ? b : a));
    return least.perform(task, transfer);
  }

  private start(): Promise<PooledWorker[]> {
    if (this.closed) return Promise.reject(new DecodeError("the decoder is closed"));
    this.workers ??= this.spawn().catch((cause: unknown) => {
      // The next frame tries again.
      this.workers = null;
      throw new DecodeError("the Draco decoder could not be loaded", { cause });
    });
    return this.workers;
  }

  private async spawn(): Promise<PooledWorker[]> {
    const response = await fetch(this.wasmUrl);
    if (!response.ok) throw new Error(`${this.wasmUrl} answered ${response.status}`);
    const module = await WebAssembly.compile(await response.arrayBuffer());
    const url = URL.createObjectURL(new Blob([workerSource], { type: "text/javascript" }));
    const workers = Array.from({ length: this.width }, () => {
      const worker = new Worker(url);
      worker.postMessage({ kind: "start", module });
      return new PooledWorker(worker);
    });
    // Workers have fetched it by the time that they answer.
    void workers
      .at(-1)
      ?.perform({ kind: "distances", ...NOTHING }, [])
      .then(
        () => URL.revokeObjectURL(url),
        () => URL.revokeObjectURL(url),
      );
    return workers;
  }
}

const NOTHING = {
  points: new Float32Array(),
  positions: new Float32Array(),
  indices: new Uint32Array(),
};

/** One worker and what it has been asked. */
class PooledWorker {
  private readonly pending = new Map<number, Pending>();
  private nextId = 0;

  constructor(private readonly worker: Worker) {
    worker.onmessage = ({ data }: MessageEvent<WorkerAnswer>) => {
      this.settle(data.id, (pending) => {
        if ("error" in data) pending.reject(new DecodeError(data.error));
        else pending.resolve(data.result);
      });
    };
    worker.onerror = ({ message }) => this.fail(message || "the worker failed");
  }

  get load(): number {
    return this.pending.size;
  }

  perform(task: WorkerTask, transfer: Transferable[]): Promise<WorkerResult> {
    const id = this.nextId;
    this.nextId += 1;
    return new Promise((resolve, reject) => {
      const timer = setTimeout(() => {
        this.settle(id, () => reject(new DecodeError("the Draco decoder did not answer")));
      }, TIMEOUT_MS);
      this.pending.set(id, { resolve, reject, timer });
      const request: WorkerRequest = { ...task, id };
      this.worker.postMessage(request, transfer);
    });
  }

  close(): void {
    this.worker.terminate();
    this.fail("the decoder is closed");
  }

  private fail(message: string): void {
    for (const id of [...this.pending.keys()]) {
      this.settle(id, ({ reject }) => reject(new DecodeError(message)));
    }
  }

  private settle(id: number, how: (pending: Pending) => void): void {
    const pending = this.pending.get(id);
    if (pending === undefined) return;
    this.pending.delete(id);
    clearTimeout(pending.timer);
    how(pending);
  }
}
