// The 3D view shows objects well: it flies to them, nothing hides them, they are smooth and lit from above; and their
// sizes can be compared in every width.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import * as THREE from "three";
import { BodyLayer, roundsFor, unitGeometry } from "../src/bodies3d.ts";
import type { Body, Report } from "../src/data.ts";
import { skyLight } from "../src/surroundings3d.ts";
import { extents, lengths, objectName, position } from "../src/words.ts";
import { data, launch, open, pixels, quadlift } from "./browser.ts";

let browser: Browser;

before(async () => {
  browser = await launch();
  quadlift("demo", "-q", "--out", "demo", "--report", "demo.html");
});

after(async () => browser.close());

const select = (page: Page, k: number): Promise<void> =>
  page.locator("table[aria-label=Objects] tbody tr").nth(k).click();

/** Where the label of the selected object stands in the 3D view, as shares of its size. */
async function place(page: Page): Promise<[number, number]> {
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  const [stage, label] = await Promise.all([".stage", ".labels .chosen"].map((at) => page.locator(at).boundingBox()));
  return [(label!.x - stage!.x) / stage!.width, (label!.y - stage!.y) / stage!.height];
}

test("the 3D view flies to an object that is selected while another one is looked at, or is not in sight", async () => {
  const { page, problems } = await open(browser, "demo.html");
  await select(page, 0);
  const far = await place(page);
  await select(page, 3);
  await select(page, 0);
  assert.deepEqual(await place(page), far, "what is in sight is not flown to");
  await page.locator(".details").getByRole("button", { name: "Focus" }).click();
  for (const k of [3, 8]) {
    await select(page, k);
    const [x, y] = await place(page);
    assert.ok(x > 0.25 && x < 0.75 && y > 0.05 && y < 0.95, `${objectName(data("demo.html"), k)}: ${x}, ${y}`);
  }
  // Turned away by dragging with the right button: the object leaves the view, and comes back when it is selected.
  const box = (await page.locator(".stage").boundingBox())!;
  await page.keyboard.press("Escape");
  await page.mouse.move(box.x + 20, box.y + 300);
  await page.mouse.down({ button: "right" });
  await page.mouse.move(box.x + box.width - 20, box.y + 300, { steps: 6 });
  await page.mouse.up({ button: "right" });
  await select(page, 8);
  const [x] = await place(page);
  assert.ok(x > 0.25 && x < 0.75, `${x}`);
  assert.deepEqual(problems, []);
  await page.close();
});

test("the image of the selected frame hides no bodies", async () => {
  const { page } = await open(browser, "demo.html");
  await select(page, 3);
  for (const layer of ["names", "grid", "path"]) {
    await page.locator(".space").getByRole("checkbox", { name: layer }).uncheck();
  }
  await page.waitForTimeout(300);
  const stage = page.locator(".stage");
  const shown = await pixels(page, stage);
  await page.locator(".space").getByRole("checkbox", { name: "cameras" }).uncheck();
  const without = await pixels(page, stage);
  // Pixels of bodies that are quite different with the image. Its frame and the lines of cameras are some, too.
  let hidden = 0;
  for (let k = 0; k < shown.data.length; k += 4) {
    const rgb = [0, 1, 2].map((c) => without.data[k + c]!);
    const isBody = Math.max(...rgb) - Math.min(...rgb) > 25;
    if (isBody && rgb.some((x, c) => Math.abs(x - shown.data[k + c]!) > 60)) hidden += 1;
  }
  assert.ok(hidden < 1500, `${hidden} pixels of bodies are hidden`);
  await page.close();
});

test("lengths of the selected object stand beside it, also from near", async () => {
  const { page } = await open(browser, "demo.html", { hash: `#object=${data("demo.html").objects[3]!.id}` });
  await page.locator(".details").getByRole("button", { name: "Focus" }).click();
  await page.waitForTimeout(300);
  const stage = page.locator(".stage");
  const box = (await stage.boundingBox())!;
  const labels = await page.locator(".labels .plain", { hasText: / m$/ }).evaluateAll((spans) => spans.map((span) => {
    const { left, top, width: w, height: h } = span.getBoundingClientRect();
    return { text: span.textContent, left, top, w, h, isShown: getComputedStyle(span).visibility === "visible" };
  }));
  await page.locator(".labels").evaluate((all) => all.setAttribute("style", "display: none"));
  const { width: w, data: bytes } = await pixels(page, stage);
  assert.deepEqual(labels.map(({ isShown }) => isShown), [true, true, true]);
  for (const label of labels) {
    let covered = 0;
    for (let y = Math.round(label.top - box.y); y < label.top - box.y + label.h; y++) {
      for (let x = Math.round(label.left - box.x); x < label.left - box.x + label.w; x++) {
        const rgb = [0, 1, 2].map((c) => bytes[4 * (y * w + x) + c]!);
        if (Math.max(...rgb) - Math.min(...rgb) > 60) covered += 1;
      }
    }
    assert.ok(covered < 0.2 * label.w * label.h, `${label.text} covers ${covered} pixels of its object`);
  }
  await page.close();
});

test("sizes are in the table in every width, and have the same number of decimals", async () => {
  for (const [width, height] of [[1600, 1000], [1200, 800], [390, 844]] as const) {
    const { page } = await open(browser, "demo.html", { width, height });
    const table = page.locator(".table", { has: page.locator("table[aria-label=Objects]") });
    assert.ok(await table.getByRole("columnheader", { name: "size [m]" }).isVisible(), `${width}`);
    const texts = (await table.locator("td").allTextContents()).filter((text) => text.includes("×") && text.includes("."));
    assert.equal(texts.length, data("demo.html").objects.length);
    for (const text of texts) assert.match(text, /^\d+\.\d{3} × \d+\.\d{3} × \d+\.\d{3}$/);
    const [room, needed] = await table.evaluate((at) => [at.clientWidth, at.scrollWidth]);
    assert.ok(needed! <= room!, `${width}: ${needed} pixels in ${room}`);
    // Lengths in the 3D view are those of the table.
    await select(page, 8);
    const report = data("demo.html");
    const labels = await page.locator(".labels .plain").allTextContents();
    for (const length of extents(report, report.objects[8]!.body).split(" × ")) assert.ok(labels.includes(`${length} m`));
    await page.close();
  }
});

/** A report with bodies of these half sizes. */
function reportOf(...halves: number[]): Report {
  const objects = halves.map((half, k) => ({
    id: `${k}`, status: "ok", body: sphere(half), centerShell: sphere(k === 0 ? 0.9 * half : 0.1 * half),
  }));
  return { objects, lengthUnit: "m" } as unknown as Report;
}

const sphere = (half: number): Body =>
  ({ kind: "ellipsoid", center: [0, 0, 0], half: [half, half, half], rotation: [1, 0, 0, 0], exponent: 2 });

test("lengths have the decimals of a typical object; a tiny one has more", () => {
  const report = reportOf(0.1, 2, 5);
  assert.deepEqual(lengths(report, [10, 4, 0.2]), ["10.00", "4.00", "0.20"]);
  assert.deepEqual(lengths(report, [0.2, 0.003]), ["0.200", "0.003"]);
  assert.deepEqual(lengths(report, [0.2, 1e-9]), ["0.200", "1.00e-9"]);
  assert.equal(position(report, [-1.23456, 0, 12]), "(−1.23, 0.00, 12.00) m");
  assert.equal(extents(reportOf(), null), "–");
});

test("a region of uncertainty as large as its object is faint, a small one is not", () => {
  const style = { opacity: 0.5, largeOpacity: 0.1, color: () => "#ff0000", shows: () => true, over: true };
  const layer = new BodyLayer(reportOf(1, 1), "centerShell", [0, 0, 0], style);
  const opacities = layer.group.children.map((mesh) => ((mesh as THREE.Mesh).material as THREE.Material).opacity);
  assert.deepEqual(opacities, [0.1, 0.5]);
});

test("round bodies are smooth, with fewer triangles where there are many", () => {
  const positions = unitGeometry(sphere(1), roundsFor(10)).getAttribute("position");
  // Around the equator: the border of a body that is 1000 pixels wide is about half a pixel off.
  const angles = Array.from({ length: positions.count }, (_, i) => i)
    .filter((i) => Math.abs(positions.getY(i)) < 1e-6)
    .map((i) => Math.atan2(positions.getZ(i), positions.getX(i)))
    .sort((a, b) => a - b);
  const widest = Math.max(...angles.slice(1).map((angle, k) => angle - angles[k]!));
  assert.ok(500 * (1 - Math.cos(widest / 2)) < 0.7, `${widest}`);
  assert.ok(roundsFor(10) > roundsFor(100) && roundsFor(100) > roundsFor(1000));
});

test("light comes from where up is in the world", () => {
  assert.deepEqual(skyLight([0, -1, 0]).position.toArray(), [0, -1, 0]);
});
