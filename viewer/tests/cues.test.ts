// Depths and 3D boxes of detections in the page.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import type { Browser } from "playwright-core";
import { data, difference, launch, open, pixels, quadlift } from "./browser.ts";

let browser: Browser;

before(async () => {
  browser = await launch();
  const cues = ["--cues", "depth,box3d", "--cue-noise", "box3d-outliers:0"];
  quadlift("synth", "-q", "-o", "cues.json", "--objects", "6", "--views", "8", "--noise", "box:0.03", ...cues);
  quadlift("localize", "-q", "cues.json", "--report", "cues.html");
  quadlift("synth", "-q", "-o", "plain.json", "--objects", "6", "--views", "8", "--noise", "box:0.03");
  quadlift("localize", "-q", "plain.json", "--report", "plain.html");
});

after(async () => browser.close());

test("3D boxes are drawn, and a switch takes them away", async () => {
  const { page, problems } = await open(browser, "cues.html");
  const shown = await pixels(page, page.locator(".sheet"));
  await page.getByRole("checkbox", { name: "3D boxes" }).uncheck();
  const without = await pixels(page, page.locator(".sheet"));
  const changed = difference(shown, without);
  assert.ok(changed > 500, `${changed} pixels differ`);
  assert.deepEqual(problems, []);
  await page.close();
});

test("depths stand beside those of the estimates, which their scale tells", async () => {
  const report = data("cues.html");
  const ratios = report.frames.flatMap(({ detections }) => detections.depths.map(([, , ratio]) => ratio ?? NaN));
  assert.equal(ratios.length, 48);
  const middle = ratios.sort((a, b) => a - b)[24] ?? NaN;
  // `synth` makes all depths 10 % too large.
  assert.ok(Math.abs(middle - 1.1) < 0.03, `${middle}`);
  const scale = report.overview.find(([name]) => name === "depths of depth");
  assert.ok(scale?.[1].startsWith("1."), JSON.stringify(report.overview));
  const { page } = await open(browser, "cues.html");
  const titles = await page.locator("table[aria-label='Detections of this frame'] th").allTextContents();
  assert.ok(titles.some((title) => title.startsWith("depth / estimate")), titles.join());
  await page.close();
});

test("pages of scenes without them say nothing of them", async () => {
  const { page } = await open(browser, "plain.html");
  assert.equal(await page.getByRole("checkbox", { name: "3D boxes" }).count(), 0);
  const titles = await page.locator("table[aria-label='Detections of this frame'] th").allTextContents();
  assert.ok(!titles.some((title) => title.startsWith("depth")), titles.join());
  await page.close();
});
