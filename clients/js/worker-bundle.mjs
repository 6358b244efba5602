/** The worker as one script, for whoever builds the package or a page on its sources. */

import { join } from "node:path";
import { fileURLToPath } from "node:url";

const here = fileURLToPath(new URL(".", import.meta.url));

/**
 * Bundles the worker with Draco's decoder by esbuild's `build`. `nodePaths` are folders of packages
 * besides the usual ones.
 */
export async function bundleWorker(build, nodePaths = []) {
  const { outputFiles } = await build({
    entryPoints: [join(here, "src/worker/worker.ts")],
    bundle: true,
    format: "iife",
    platform: "browser",
    target: "es2022",
    minify: true,
    write: false,
    nodePaths,
    // Draco's script looks for these under Node only.
    external: ["node:*", "fs", "path"],
  });
  return outputFiles[0].text;
}
