// Refined camera poses in the page, beside the given ones.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import type { Browser } from "playwright-core";
import { data, difference, launch, open, pixels, quadlift } from "./browser.ts";

let browser: Browser;

before(async () => {
  browser = await launch();
  const synth = ["--objects", "12", "--views", "8", "--trajectory", "street", "--noise", "box:0.01", "--pose-noise", "0.5"];
  quadlift("synth", "-q", "-o", "scene.json", ...synth);
  quadlift("localize", "-q", "scene.json", "--refine-poses=independent", "--report", "refined.html");
  quadlift("localize", "-q", "scene.json", "--report", "given.html");
});

after(async () => browser.close());

test("given cameras are drawn beside the refined ones, and a switch takes them away", async () => {
  const { page, problems } = await open(browser, "refined.html");
  await page.getByRole("button", { name: "Everything" }).click();
  await page.waitForTimeout(500);
  const shown = await pixels(page, page.locator(".stage"));
  await page.getByRole("checkbox", { name: "given poses" }).uncheck();
  const without = await pixels(page, page.locator(".stage"));
  const changed = difference(shown, without);
  assert.ok(changed > 100, `${changed} pixels differ`);
  assert.deepEqual(problems, []);
  await page.close();
});

test("frame and overview say how far the cameras were moved", async () => {
  const report = data("refined.html");
  const [first, second] = [report.frames[0]?.given, report.frames[1]?.given];
  assert.ok(first !== undefined && second !== undefined);
  const { page } = await open(browser, "refined.html");
  const moved = page.locator(".picture .moved");
  const text = /^moved by ([0-9.e-]+) units, ([0-9.e-]+) deg$/;
  for (const given of [first, second]) {
    const found = text.exec((await moved.textContent()) ?? "");
    assert.ok(found !== null, (await moved.textContent()) ?? "");
    assert.ok(Math.abs(Number(found[1]) / given.shift - 1) < 6e-3, found[1]);
    assert.ok(Math.abs(Number(found[2]) / ((180 / Math.PI) * given.angle) - 1) < 6e-3, found[2]);
    await page.locator(".frame").nth(1).click();
  }
  const line = report.overview.find(([name]) => name === "poses refined")?.[1] ?? "";
  assert.match(line, /^8 of 8 frames, median [0-9.]+ units, [0-9.]+ deg$/);
  assert.ok((await page.locator(".overview").textContent())?.includes(line), "the overview is shown");
  await page.close();
});

test("pages of results without refined poses say nothing of them", async () => {
  assert.ok(data("given.html").frames.every((frame) => !("given" in frame)));
  const { page } = await open(browser, "given.html");
  assert.equal(await page.getByRole("checkbox", { name: "given poses" }).count(), 0);
  assert.ok(await page.locator(".picture .moved").isHidden());
  await page.close();
});
