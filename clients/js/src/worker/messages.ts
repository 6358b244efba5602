/** What is said between the page and a worker. */

import type { DecodedMesh } from "./decode.js";

export type WorkerTask =
  | { kind: "decode"; mesh: ArrayBuffer }
  | { kind: "distances"; points: Float32Array; positions: Float32Array; indices: Uint32Array };

/** The first message to a worker. */
export interface WorkerStart {
  kind: "start";
  module: WebAssembly.Module;
}

export type WorkerRequest = WorkerTask & { id: number };

export type WorkerResult = DecodedMesh | Float32Array<ArrayBuffer>;

export type WorkerAnswer = { id: number; result: WorkerResult } | { id: number; error: string };
