import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";
import { defineConfig, type Plugin } from "vite";
import { bundleWorker } from "../clients/js/worker-bundle.mjs";

const packages = fileURLToPath(new URL("node_modules", import.meta.url));
const client = fileURLToPath(new URL("../clients/js/src/index.ts", import.meta.url));
const decoder = join(
  dirname(createRequire(import.meta.url).resolve("draco3d")),
  "draco_decoder.wasm",
);
/** Where the server has the decoder: a name without a hash. */
const DECODER_PATH = "/draco/draco_decoder.wasm";
const WORKER = "worker-source";

/**
 * Builds the page on the sources of `clients/js`, as that package's own build does: the worker is
 * bundled into the script as text, and Draco's WebAssembly lies beside it.
 */
function steadymesh(): Plugin {
  return {
    name: "steadymesh",
    enforce: "pre",
    resolveId: (id) => (id === WORKER ? `\0${WORKER}` : null),
    async load(id) {
      if (id !== `\0${WORKER}`) return null;
      return `export default ${JSON.stringify(await bundleWorker(build, [packages]))};`;
    },
    transform(code, id) {
      if (!id.endsWith("/clients/js/src/pool.ts")) return null;
      const beside = 'new URL("./draco_decoder.wasm", import.meta.url)';
      if (!code.includes(beside)) this.error(`${id} does not say where its decoder is`);
      return { code: code.replace(beside, JSON.stringify(DECODER_PATH)), map: null };
    },
    configureServer(server) {
      server.middlewares.use(DECODER_PATH, async (_request, response) => {
        response.setHeader("Content-Type", "application/wasm");
        response.end(await readFile(decoder));
      });
    },
    async generateBundle() {
      const source = await readFile(decoder);
      this.emitFile({ type: "asset", fileName: DECODER_PATH.slice(1), source });
    },
  };
}

const server = process.env.STEADYMESH_URL ?? "http://127.0.0.1:8080";

export default defineConfig({
  base: "/",
  plugins: [steadymesh()],
  resolve: { alias: { steadymesh: client } },
  // Nothing may become a data: URL: the page runs under a strict Content-Security-Policy.
  build: { target: "es2022", assetsInlineLimit: 0, chunkSizeWarningLimit: 800 },
  server: {
    proxy: { "/v1": { target: server, ws: true } },
    fs: { allow: [".", "../clients/js"] },
  },
});
