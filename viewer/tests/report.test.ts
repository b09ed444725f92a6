// Reports in the browser: they open in silence, draw, and their parts are linked.

import assert from "node:assert/strict";
import { readFileSync, statSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser } from "playwright-core";
import { outline } from "../src/outline.ts";
import {
  colored, data, difference, folder, launch, open, pixels, quadlift, readScene, realScene, writeScene,
} from "./browser.ts";

let browser: Browser;

before(async () => {
  browser = await launch();
  quadlift("demo", "-q", "--out", "demo", "--report", "demo.html");
  const synth = ["--objects", "8", "--views", "20", "--scale", "0.05", "--noise", "box:0.05", "--outliers", "0.05"];
  quadlift("synth", "-o", "plain.json", ...synth);
  quadlift("localize", "plain.json", "-o", "plain_estimate.json");
  quadlift("evaluate", "plain_estimate.json", "plain.json", "--report", "plain.html");
});

after(async () => browser.close());

test("the demo opens in silence, draws, turns, and selects what is clicked", async () => {
  const { page, problems } = await open(browser, "demo.html");
  const space = page.locator(".stage");
  const sheet = page.locator(".sheet");
  const first = await pixels(page, space);
  assert.ok(colored(first) > 3000, `bodies are drawn: ${colored(first)} colored pixels`);
  assert.ok(colored(await pixels(page, sheet)) > 500, "boxes and outlines are drawn");

  const box = (await space.boundingBox())!;
  await page.mouse.move(box.x + box.width / 2, box.y + 40);
  await page.mouse.down();
  await page.mouse.move(box.x + box.width / 2 + 150, box.y + 60, { steps: 4 });
  await page.mouse.up();
  const turned = await pixels(page, space);
  assert.ok(difference(first, turned) > 2000, "dragging turns the view");
  assert.equal(await page.locator("tr[aria-selected=true]").count(), 0, "a drag selects nothing");

  const flat = await pixels(page, sheet);
  const row = page.locator("table[aria-label=Objects] tbody tr").nth(3);
  const id = (await row.locator("td").first().textContent())!;
  await row.click();
  assert.equal(await row.getAttribute("aria-selected"), "true");
  assert.ok(difference(turned, await pixels(page, space)) > 1000, "the body is highlighted");
  assert.ok(difference(flat, await pixels(page, sheet)) > 300, "its outline is highlighted");
  assert.equal(await page.locator(".details h2").textContent(), id);

  // Back from the 3D view: a click on the body that fills its middle after "Focus".
  await page.getByRole("button", { name: "Focus", exact: true }).click();
  await page.getByRole("button", { name: "Clear" }).click();
  assert.ok(await page.locator(".overview").isVisible(), "nothing is selected");
  // On a slow machine the view is still on its way.
  let last = await pixels(page, space);
  for (let tries = 0; tries < 50; tries++) {
    await page.waitForTimeout(100);
    const now = await pixels(page, space);
    if (difference(last, now) === 0) break;
    last = now;
  }
  await page.mouse.click(box.x + box.width / 2, box.y + box.height / 2);
  assert.equal(await page.locator(".details h2").textContent(), id, "a click on the body selects its object");

  const before = await pixels(page, sheet);
  await page.locator(".frame").nth(4).click();
  assert.ok(difference(before, await pixels(page, sheet)) > 200, "another frame is shown");
  assert.equal(await page.locator(".frame[aria-selected=true]").count(), 1);
  assert.deepEqual(problems, []);
  await page.close();
});

test("the 3D view follows the size of the window", async () => {
  const { page, problems } = await open(browser, "demo.html");
  await page.setViewportSize({ width: 1200, height: 800 });
  await page.waitForTimeout(200);
  const canvas = page.locator(".stage canvas");
  const [stage, drawn] = [(await page.locator(".stage").boundingBox())!, (await canvas.boundingBox())!];
  assert.deepEqual([drawn.width, drawn.height].map(Math.round), [stage.width, stage.height].map(Math.round));
  assert.ok(colored(await pixels(page, canvas)) > 1500, "it still draws");
  assert.deepEqual(problems, []);
  await page.close();
});

test("nothing is wider than a narrow window, and everything is there", async () => {
  const { page, problems } = await open(browser, "demo.html", { width: 390, height: 844 });
  const width = await page.evaluate(() => document.documentElement.scrollWidth);
  assert.ok(width <= 390, `the page is ${width} pixels wide`);
  for (const part of [".stage", ".sheet", ".strip", "table[aria-label=Objects]"]) {
    assert.ok(await page.locator(part).isVisible(), part);
  }
  assert.deepEqual(problems, []);
  await page.close();
});

test("everything can be reached and done by keyboard", async () => {
  const { page } = await open(browser, "demo.html");
  const stops = new Set<string>();
  for (let k = 0; k < 60; k++) {
    await page.keyboard.press("Tab");
    stops.add(await page.evaluate(() => {
      const at = document.activeElement;
      return at?.closest("table")?.getAttribute("aria-label") ?? at?.getAttribute("role") ?? at?.tagName ?? "";
    }));
  }
  for (const stop of ["img", "listbox", "Objects", "BUTTON", "INPUT", "SUMMARY"]) {
    assert.ok(stops.has(stop), `${stop} in ${[...stops]}`);
  }
  // Table: down, enter.
  await page.locator("table[aria-label=Objects] tbody tr").first().focus();
  await page.keyboard.press("ArrowDown");
  await page.keyboard.press("Enter");
  const second = page.locator("table[aria-label=Objects] tbody tr").nth(1);
  assert.equal(await second.getAttribute("aria-selected"), "true");
  assert.notEqual(await second.evaluate((row) => getComputedStyle(row).outlineStyle), "none", "the focus can be seen");
  // Sorting: by residual, largest first after two presses.
  const header = page.locator("table[aria-label=Objects] th", { hasText: "residual" });
  await header.locator("button").focus();
  await page.keyboard.press("Enter");
  await page.keyboard.press("Enter");
  assert.equal(await header.getAttribute("aria-sort"), "descending");
  const index = await header.evaluate((th) => [...th.parentElement!.children].indexOf(th));
  const cells = await page.locator(`table[aria-label=Objects] tbody td:nth-child(${index + 1})`).allTextContents();
  const values = cells.map(Number);
  assert.deepEqual(values, [...values].sort((a, b) => b - a));
  // Frames: to the right. Then the 3D view: turned.
  await page.locator(".strip").focus();
  await page.keyboard.press("Home");
  await page.keyboard.press("ArrowRight");
  await page.waitForSelector(".strip[aria-activedescendant=frame-1]");
  const canvas = page.locator(".stage canvas");
  await canvas.focus();
  const still = await pixels(page, canvas);
  await page.keyboard.press("ArrowLeft");
  assert.ok(difference(still, await pixels(page, canvas)) > 500, "arrow keys turn the view");
  await page.keyboard.press("Escape");
  assert.equal(await page.locator("tr[aria-selected=true]").count(), 0, "escape selects nothing");
  await page.close();
});

test("outlines of the page give the residuals that the program has computed", () => {
  const report = data("plain.html");
  let compared = 0;
  for (const frame of report.frames) {
    const { object, box, residual } = frame.detections;
    object.forEach((k, row) => {
      const body = report.objects[k]?.body;
      const expected = residual[row];
      if (body == null || expected == null) return;
      const border = outline(frame.projection, body)!.border;
      const [xs, ys] = [border.map((p) => p[0]), border.map((p) => p[1])];
      const edges = [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
      const squares = edges.map((x, k) => (x - box[4 * row + k]!) ** 2);
      const found = Math.sqrt(squares.reduce((a, b) => a + b) / 4);
      // Boxes are rounded to tenths of a pixel in the page, and outlines are polygons.
      assert.ok(Math.abs(found - expected) < 0.25, `${report.objects[k]?.id} in ${frame.id}: ${found}, ${expected}`);
      compared += 1;
    });
  }
  assert.ok(compared > 100, `${compared}`);
});

test("true objects with other ids than their estimates are shown as one with them", async () => {
  const truth = readScene("plain.json");
  const boxes = truth.detections.map(({ object: _, ...box }) => box);
  const { objects, ...scene } = truth;
  writeScene("unnamed.json", { ...scene, detections: boxes });
  // One more than there is to be found.
  const far = { id: "unseen", ellipsoid: { center: [50, 50, 0], semi_axes: [1, 1, 1], rotation: [1, 0, 0, 0] } };
  const things = objects.map((object, k) => ({ ...object, id: `thing_${k}` }));
  writeScene("things.json", { ...scene, detections: [], objects: [...things, far] });
  quadlift("localize", "unnamed.json", "--associate", "always", "-o", "associated.json");
  quadlift("evaluate", "associated.json", "things.json", "--report", "associated.html");
  const { page, problems } = await open(browser, "associated.html");
  const rows = page.locator("table[aria-label=Objects] tbody tr");
  const shown = (await rows.allInnerTexts()).map((text) => text.split("\t").map((cell) => cell.trim()));
  assert.equal(shown.length, objects.length + 1, `${shown.map(([id]) => id)}`);
  assert.deepEqual(shown.filter(([, status]) => status === "no estimate").map(([id]) => id), ["unseen"]);
  const scored = page.locator("table[aria-label='Scores against the truth'] tbody tr");
  const pairs = await scored.evaluateAll((lines) => lines.map((line) => [...line.children].map((c) => c.textContent)));
  assert.deepEqual(pairs.map(([, thing]) => thing).sort(), [...things, far].map(({ id }) => id).sort());
  const [id, thing] = pairs[2]!;
  await scored.nth(2).click();
  assert.equal(await page.locator(".details h2").textContent(), id);
  assert.equal(await page.locator(".details dt", { hasText: "true object" }).locator("+ dd").textContent(), thing);
  assert.deepEqual(problems, []);
  await page.close();
});

test("cameras alone are all in sight, and a frame without anything says so", async () => {
  const { objects: _, ...scene } = readScene("plain.json");
  writeScene("cameras.json", { ...scene, detections: [] });
  const path = quadlift("view", "cameras.json", "--no-browser").trim();
  const { page, problems } = await open(browser, path, { width: 1200, height: 780 });
  for (const layer of ["grid", "path"]) await page.getByRole("checkbox", { name: layer }).uncheck();
  const { width, height, data } = await pixels(page, page.locator(".stage canvas"));
  const drawn = (x: number, y: number): boolean => {
    const at = 4 * (y * width + x);
    return [0, 1, 2].some((c) => Math.abs(data[at + c]! - data[c]!) > 24);
  };
  let [inside, border] = [0, 0];
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      if (!drawn(x, y)) continue;
      // At the very edge lies the frame of the view, and a little below its upper edge the legend.
      const deep = Math.min(x, y, width - 1 - x, height - 1 - y);
      if (deep >= 2 && deep < 6) border += 1;
      else if (y > 30) inside += 1;
    }
  }
  assert.ok(inside > 300, `${inside} pixels are drawn`);
  assert.equal(border, 0, "no line is cut off");
  const sheet = await page.locator(".sheet canvas").boundingBox();
  assert.ok(sheet !== null && sheet.width > 100 && sheet.height > 100, "the frame has its size");
  assert.ok(await page.getByText("no image and no detections").isVisible());
  assert.deepEqual(problems, []);
  await page.close();
});

test("all columns of the objects can be read in windows of medium width and wide ones", async () => {
  for (const path of ["demo.html", "plain.html"]) {
    const { page } = await open(browser, path, { width: 1100, height: 800 });
    for (const width of [1100, 1200, 1440, 1480, 1600, 1701, 1920]) {
      await page.setViewportSize({ width, height: 800 });
      const table = page.locator(".table", { has: page.locator("table[aria-label=Objects]") });
      const [room, needed] = await table.evaluate((place) => [place.clientWidth, place.scrollWidth]);
      assert.ok(needed! <= room!, `${path}, ${width}: ${needed} pixels in ${room}`);
    }
    await page.close();
  }
});

test("in a window of medium width space and image are large, and nothing is outside of the window", async () => {
  for (const [width, height, leastSpace, leastImage] of [[1200, 900, 440, 265], [1100, 700, 250, 240]] as const) {
    const { page } = await open(browser, "demo.html", { width, height });
    const [stage, image] = await Promise.all([".stage", ".sheet canvas"].map((at) => page.locator(at).boundingBox()));
    assert.ok(stage!.width >= 0.66 * width && stage!.height > leastSpace, `space: ${stage!.width} x ${stage!.height}`);
    assert.ok(image!.height > leastImage, `image: ${image!.width} x ${image!.height}`);
    const page_ = await page.evaluate(() => [document.documentElement.scrollWidth, document.documentElement.scrollHeight]);
    assert.deepEqual(page_, [width, height], "each part scrolls for itself");
    // All parts are in sight, and none covers another one.
    const parts = [".space", ".picture", ".measurements", ".strip", ".texts"];
    const boxes = await Promise.all(parts.map((at) => page.locator(at).boundingBox()));
    for (const [k, a] of boxes.entries()) {
      assert.ok(a!.height > 80 && a!.y + a!.height <= height + 1, `${parts[k]}: ${a!.height} at ${a!.y}`);
      for (const [l, b] of boxes.entries()) {
        const apart = a!.x + a!.width <= b!.x + 1 || b!.x + b!.width <= a!.x + 1
          || a!.y + a!.height <= b!.y + 1 || b!.y + b!.height <= a!.y + 1;
        assert.ok(k === l || apart, `${parts[k]} covers ${parts[l]} at ${width} x ${height}`);
      }
    }
    await page.close();
  }
});

test("names with HTML and scripts are shown as text", async () => {
  const hostile = '</script><script>window.hacked=1</script><img src=x onerror="window.hacked=2"><!--';
  const text = readFileSync(join(folder, "plain.json"), "utf8");
  const scene = JSON.parse(text) as { name: string; frames: { id: string }[]; detections: Record<string, string>[] };
  const first = scene.frames[0]!.id;
  scene.name = `scene ${hostile}`;
  scene.frames[0]!.id = `frame ${hostile}`;
  const object = scene.detections[0]!["object"];
  for (const detection of scene.detections) {
    detection["category"] = `category ${hostile}`;
    if (detection["frame"] === first) detection["frame"] = `frame ${hostile}`;
    if (detection["object"] === object) detection["object"] = `object ${hostile}`;
  }
  writeFileSync(join(folder, "hostile.json"), JSON.stringify(scene));
  quadlift("localize", "hostile.json", "--report", "hostile.html");
  const { page, problems } = await open(browser, "hostile.html");
  const name = `object ${hostile}`;
  await page.locator("table[aria-label=Objects] td", { hasText: name }).first().click();
  assert.equal(await page.locator(".details h2").textContent(), name);
  assert.ok((await page.locator("h1").textContent())!.includes(hostile));
  await page.locator(".strip").focus();
  await page.keyboard.press("Home");
  assert.ok((await page.locator(".picture h2").textContent())!.includes(hostile));
  assert.equal(await page.evaluate(() => (window as unknown as { hacked?: number }).hacked), undefined);
  assert.equal(await page.locator("img").count(), 0);
  assert.deepEqual(problems, []);
  await page.close();
});

test("a thousand objects in five hundred frames open and answer", async () => {
  await writeLargeScene();
  const path = quadlift("view", "large.json", "large_estimate.json", "--no-browser").trim();
  const size = statSync(path).size;
  assert.ok(size < 30e6, `${size} bytes`);
  const { page, problems, time } = await open(browser, path);
  const report = data(path);
  const images = report.frames.filter((frame) => frame.image !== null).length;
  console.log(`1000 objects, 500 frames, ${images} images, ${size} bytes: open after ${Math.round(time)} ms`);
  assert.ok(images >= 200, `${images} images`);
  assert.equal(report.notes.some((note) => note.includes("images are in the report")), images < 500, "it is said");
  assert.ok(colored(await pixels(page, page.locator(".stage canvas"))) > 3000);
  const start = performance.now();
  await page.locator("table[aria-label=Objects] tbody tr").nth(10).click();
  await page.locator(".strip").focus();
  for (let k = 0; k < 5; k++) await page.keyboard.press("ArrowRight");
  await page.waitForSelector(".strip[aria-activedescendant=frame-5]");
  const answer = (performance.now() - start) / 6;
  console.log(`selecting takes ${Math.round(answer)} ms`);
  assert.deepEqual(problems, []);
  await page.close();
});

/** A scene in which every object is seen in every one of 500 frames with an image, and its estimates. */
async function writeLargeScene(): Promise<void> {
  const [objects, frames] = [1000, 500];
  writeFileSync(join(folder, "large.jpg"), await photograph());
  const estimate = JSON.parse(readFileSync(join(folder, "plain_estimate.json"), "utf8"));
  const template = estimate.objects[0];
  estimate.objects = Array.from({ length: objects }, (_, k) => {
    const center = [k % 10, Math.floor(k / 10) % 10, Math.floor(k / 100)].map((x) => (x - 4.5) / 8);
    const view_residuals_px = Array.from({ length: frames }, (_, f) => ({
      frame: `${f}`, inlier: (k + f) % 40 !== 0, residual_px: ((7 * k + f) % 31) / 10,
    }));
    const body = { ...template.body, center };
    return { ...template, id: `object ${k}`, center, body, enclosing: body, view_residuals_px };
  });
  const cameras = estimate.frames;
  estimate.frames = Array.from({ length: frames }, (_, f) => (
    { ...cameras[f % cameras.length], id: `${f}`, image: "large.jpg" }
  ));
  const detections = estimate.frames.flatMap((frame: { id: string }, f: number) => (
    estimate.objects.map((object: { id: string }, k: number) => {
      const [x, y] = [(k * 37.3 + f) % 600, (k * 91.7 + 2 * f) % 440];
      return { frame: frame.id, object: object.id, box: [x, y, x + 31.4, y + 25.7] };
    })
  ));
  writeFileSync(join(folder, "large_estimate.json"), JSON.stringify(estimate));
  const { localization: _, objects: __, ...scene } = estimate;
  writeFileSync(join(folder, "large.json"), JSON.stringify({ ...scene, detections }));
}

/** A picture of the size of the demo's frames with about as many details as a photograph. */
async function photograph(): Promise<Buffer> {
  const { width, height } = JSON.parse(readFileSync(join(folder, "plain.json"), "utf8")).cameras[0];
  const page = await browser.newPage();
  const url = await page.evaluate(([w, h]) => {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [w!, h!];
    const context = canvas.getContext("2d")!;
    for (let k = 0; k < 1500; k++) {
      context.fillStyle = `hsl(${(k * 137) % 360} 40% ${20 + ((k * 31) % 60)}%)`;
      context.fillRect((k * 73) % w!, (k * 151) % h!, 10 + (k % 61), 10 + (k % 47));
    }
    return canvas.toDataURL("image/jpeg", 0.9);
  }, [width, height]);
  await page.close();
  return Buffer.from(url.slice(url.indexOf(",") + 1), "base64");
}

const REAL: [string, string[]][] = [
  ["kitti_S09_oxts", ["--source", "rrc", "--body", "cuboid", "--priors", "builtin"]],
  ["lmo_A", ["--source", "model"]],
];
for (const [name, options] of REAL) {
  const scene = realScene(`${name}.json`);
  const skip = scene === null ? "there are no real data (set QUADLIFT_DATA)" : false;
  test(`the report of ${name}`, { skip }, async () => {
    if (scene === null) return;
    quadlift("localize", scene, "-o", `${name}.json`, ...options);
    quadlift("evaluate", `${name}.json`, scene, "--report", `${name}.html`);
    const { page, problems } = await open(browser, `${name}.html`);
    const canvas = page.locator(".stage canvas");
    const first = await pixels(page, canvas);
    assert.ok(colored(first) > 1000, `${colored(first)} colored pixels`);
    const rows = page.locator("table[aria-label=Objects] tbody tr");
    assert.equal(await rows.count(), data(`${name}.html`).objects.length);
    await rows.first().click();
    assert.ok(difference(first, await pixels(page, canvas)) > 100, "the body is highlighted");
    if (name === "lmo_A") assert.ok(data(`${name}.html`).frames.every((frame) => frame.image !== null), "images");
    assert.deepEqual(problems, []);
    await page.close();
  });
}
