import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { basename, dirname, join } from "node:path";
import { defineConfig, type Plugin } from "vite";

/** What three's DRACOLoader fetches at run time from `/draco/`. */
const DECODER_FILES = ["draco_wasm_wrapper.js", "draco_decoder.wasm"];

/**
 * Puts Draco's decoder, as three ships it, under `/draco/`.
 *
 * three refers to its decoders by `new URL(…, import.meta.url)`, which Vite would answer by
 * emitting all five of them, among them a 500 kB fallback that is never used.
 */
function dracoDecoder(): Plugin {
  const require = createRequire(import.meta.url);
  const folder = join(dirname(require.resolve("three")), "../examples/jsm/libs/draco");
  return {
    name: "draco-decoder",
    transform(code, id) {
      if (!id.includes("DRACOLoader")) return null;
      const reference = /new URL\(\s*'[^']*\/([^/']+)',\s*import\.meta\.url\s*\)\.toString\(\)/g;
      return { code: code.replace(reference, "'/draco/$1'"), map: null };
    },
    configureServer(server) {
      server.middlewares.use("/draco", async (request, response, next) => {
        const file = basename(request.url ?? "");
        if (!DECODER_FILES.includes(file)) return next();
        const type = file.endsWith(".wasm") ? "application/wasm" : "text/javascript";
        response.setHeader("Content-Type", type);
        response.end(await readFile(join(folder, file)));
      });
    },
    async generateBundle() {
      for (const file of DECODER_FILES) {
        const source = await readFile(join(folder, file));
        this.emitFile({ type: "asset", fileName: `draco/${file}`, source });
      }
    },
  };
}

const server = process.env.STEADYMESH_URL ?? "http://127.0.0.1:8080";

export default defineConfig({
  base: "/",
  plugins: [dracoDecoder()],
  // Nothing may become a data: URL: the page runs under a strict Content-Security-Policy.
  build: { target: "es2022", assetsInlineLimit: 0, chunkSizeWarningLimit: 800 },
  server: { proxy: { "/v1": { target: server, ws: true } } },
});
