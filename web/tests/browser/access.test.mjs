/** A server that wants a token: the player asks for one, and keeps it as long as its tab. */

import assert from "node:assert/strict";
import { createHash } from "node:crypto";
import { after, before, test } from "node:test";
import { Bench, frameNumber, PATIENCE_MS, statusBecomes } from "./support.mjs";

const TOKEN = "a-token-for-this-test-of-the-player-only";

let bench;
let page;

before(async () => {
  const hash = createHash("sha256").update(TOKEN).digest("hex");
  bench = await Bench.open({
    settings: `[[auth.tokens]]\nname = "test"\nhash = "sha256:${hash}"\nscopes = ["publish", "subscribe"]\n`,
  });
  await bench.publish("demo", { fps: 4, token: TOKEN });
  page = await bench.page("/watch/demo", { width: 700, height: 500 });
});

after(() => bench?.close());

test("the watch page asks for the token and goes on with it", async () => {
  await statusBecomes(page, "No access");
  await page.getByLabel("Token").fill(TOKEN);
  await page.getByRole("button", { name: "Use it" }).click();
  await statusBecomes(page, "Live");
  await frameNumber(page);
});

test("the list has the token, too", async () => {
  await page.getByRole("link", { name: "All streams" }).click();
  await page.locator('a[href="/watch/demo"]').waitFor({ timeout: PATIENCE_MS });
});

test("another tab asks again, a wrong token is refused", async () => {
  const other = await bench.page("/", { width: 700, height: 500 });
  await other.getByText("This server wants a token.").waitFor({ timeout: PATIENCE_MS });
  await other.getByLabel("Token").fill("wrong");
  await other.getByRole("button", { name: "Use it" }).click();
  await other.waitForLoadState();
  await other.getByText("This server wants a token.").waitFor({ timeout: PATIENCE_MS });
  assert.equal(await other.locator(".cards a").count(), 0);
  await other.context().close();
});

test("the console says only that access was refused", () => {
  assert.ok(bench.consoleErrors.length > 0);
  assert.deepEqual(
    bench.consoleErrors.filter((text) => !text.includes("401")),
    [],
  );
});
