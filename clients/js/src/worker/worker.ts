/** The worker: one task after another, each answered under its number. */

import createDecoder from "draco3d/draco_decoder_nodejs.js";
import { type DracoModule, decodeMesh } from "./decode.js";
import { distancesToSurface } from "./distance.js";
import type {
  WorkerAnswer,
  WorkerRequest,
  WorkerResult,
  WorkerStart,
  WorkerTask,
} from "./messages.js";

const scope = globalThis as unknown as {
  onmessage: ((event: MessageEvent<WorkerStart | WorkerRequest>) => void) | null;
  postMessage(answer: WorkerAnswer, transfer: Transferable[]): void;
};

let decoder: Promise<DracoModule> | null = null;

scope.onmessage = ({ data }) => {
  if (data.kind === "start") decoder = instantiate(data.module);
  else void answer(data);
};

async function answer(request: WorkerRequest): Promise<void> {
  const { id } = request;
  try {
    const result = await perform(request);
    const arrays = result instanceof Float32Array ? [result] : Object.values(result);
    const transfer = arrays.filter((array) => array !== null).map(({ buffer }) => buffer);
    scope.postMessage({ id, result }, transfer);
  } catch (error) {
    scope.postMessage({ id, error: error instanceof Error ? error.message : String(error) }, []);
  }
}

async function perform(task: WorkerTask): Promise<WorkerResult> {
  if (task.kind === "distances") return distancesToSurface(task.points, task);
  if (decoder === null) throw new Error("the decoder was not started");
  return decodeMesh(await decoder, new Uint8Array(task.mesh));
}

/** Draco's script with a module that the page has compiled once for all workers. */
async function instantiate(module: WebAssembly.Module): Promise<DracoModule> {
  return createDecoder({
    instantiateWasm(imports, receive) {
      void WebAssembly.instantiate(module, imports).then(receive);
      return {};
    },
  });
}
