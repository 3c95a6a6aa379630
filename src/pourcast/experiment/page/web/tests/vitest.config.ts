import { defineConfig } from "vitest/config";

export default defineConfig({
  test: {
    environment: "happy-dom",
    setupFiles: ["setup.ts"],
    unstubGlobals: true,
    restoreMocks: true,
    testTimeout: 60_000, // [ms] What hangs fails; what is slow on a busy machine doesn't.
  },
});
