import { fileURLToPath } from "node:url";
import { defineConfig } from "vitest/config";

const client = fileURLToPath(new URL("../clients/js/src/index.ts", import.meta.url));

export default defineConfig({
  test: { include: ["tests/unit/**/*.test.ts"] },
  resolve: {
    alias: {
      steadymesh: client,
      // No test starts a worker.
      "worker-source": fileURLToPath(new URL("tests/unit/no-worker.ts", import.meta.url)),
    },
  },
});
