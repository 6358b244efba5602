/**
 * Writes `dist/`: one module, and Draco's WebAssembly beside it.
 *
 * The worker is bundled first and goes into the module as text, so that whoever uses the package
 * has no second script to place, and a policy of `worker-src blob:` is enough.
 */

import { copyFile, rm } from "node:fs/promises";
import { createRequire } from "node:module";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";
import { bundleWorker } from "./worker-bundle.mjs";

const here = fileURLToPath(new URL(".", import.meta.url));
const draco = dirname(createRequire(import.meta.url).resolve("draco3d"));

/** Answers `import … from "worker-source"`. */
const workerSource = {
  name: "worker-source",
  setup({ onResolve, onLoad }) {
    onResolve({ filter: /^worker-source$/ }, ({ path }) => ({ path, namespace: "worker" }));
    onLoad({ filter: /.*/, namespace: "worker" }, async () => ({
      contents: await bundleWorker(build),
      loader: "text",
    }));
  },
};

await rm(join(here, "dist"), { recursive: true, force: true });
await build({
  entryPoints: [join(here, "src/index.ts")],
  outfile: join(here, "dist/index.js"),
  bundle: true,
  format: "esm",
  platform: "browser",
  target: "es2022",
  plugins: [workerSource],
});
await copyFile(join(draco, "draco_decoder.wasm"), join(here, "dist/draco_decoder.wasm"));
