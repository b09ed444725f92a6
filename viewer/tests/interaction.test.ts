// What people do with the page: resize its panes, follow links, fly, zoom, save files, see what is inconsistent.

import assert from "node:assert/strict";
import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Download, Locator, Page } from "playwright-core";
import type { Box } from "../src/place_labels.ts";
import { placeLabels } from "../src/place_labels.ts";
import { bestFrame } from "../src/object_views.ts";
import { zoomed } from "../src/frame_zoom.ts";
import { extents, extentsWithSd, objectName } from "../src/words.ts";
import { data, difference, folder, launch, open, pixels, quadlift } from "./browser.ts";

let browser: Browser;

before(async () => {
  browser = await launch();
  quadlift("demo", "-q", "--out", "demo", "--report", "demo.html");
  // The page of the demo, in which one object is inconsistent.
  const estimate = JSON.parse(readFileSync(join(folder, "demo/estimate.json"), "utf8"));
  estimate.objects[1].status = "inconsistent";
  writeFileSync(join(folder, "demo/estimate.json"), JSON.stringify(estimate));
  const made = quadlift("view", "demo/scene.json", "demo/estimate.json", "--no-browser").trim();
  writeFileSync(join(folder, "inconsistent.html"), readFileSync(made));
});

after(async () => browser.close());

const row = (page: Page, k: number): Locator => page.locator("table[aria-label=Objects] tbody tr").nth(k);
const width = async (at: Locator): Promise<number> => (await at.boundingBox())!.width;

/** An object whose views do not agree, and one whose views do. */
function inconsistentAndSound(): [number, number] {
  const { objects } = data("inconsistent.html");
  const found = objects.findIndex(({ status, body }) => status === "inconsistent" && body !== null);
  assert.ok(found >= 0, "the demo has an inconsistent object");
  return [found, objects.findIndex(({ status }) => status === "ok")];
}

test("panes are resized by dragging and by keys, are remembered, and are reset", async () => {
  const { page, problems } = await open(browser, "demo.html");
  const [stage, sheet] = [page.locator(".stage"), page.locator(".sheet")];
  const middle = page.getByRole("separator", { name: "Width of the 3D view" });
  const first = await width(stage);
  const at = (await middle.boundingBox())!;
  await page.mouse.move(at.x + 3, at.y + 200);
  await page.mouse.down();
  await page.mouse.move(800, at.y + 200, { steps: 4 });
  await page.mouse.up();
  assert.ok(Math.abs((await width(stage)) - 800) < 4, `${await width(stage)}`);
  // The view is drawn in its new size with the next picture.
  await page.waitForFunction(() => {
    const [stage, canvas] = [".stage", ".stage canvas"].map((what) => document.querySelector(what)!.getBoundingClientRect().width);
    return Math.abs(stage! - canvas!) < 1;
  }, undefined, { timeout: 5000 });
  assert.equal(await middle.getAttribute("aria-valuenow"), "50");
  await page.keyboard.press("ArrowRight");
  assert.ok(Math.abs((await width(stage)) - 832) < 4, "an arrow key moves it by two percent");
  await page.reload();
  await page.waitForSelector("#page[data-ready]");
  assert.ok(Math.abs((await width(stage)) - 832) < 4, "it is remembered");
  await middle.dblclick();
  assert.ok(Math.abs((await width(stage)) - first) < 2, "a double click resets it");
  const below = page.getByRole("separator", { name: "Height of the image" });
  const height = (await sheet.boundingBox())!.height;
  await below.focus();
  for (let k = 0; k < 4; k++) await page.keyboard.press("ArrowUp");
  assert.ok((await sheet.boundingBox())!.height < height - 60, "the image is lower");
  await page.keyboard.press("Enter");
  assert.ok(Math.abs((await sheet.boundingBox())!.height - height) < 2);
  assert.deepEqual(problems, []);
  await page.close();
});

test("a link selects an object or a frame on load and later, and the address follows the selection", async () => {
  const report = data("demo.html");
  const id = report.objects[3]!.id;
  const { page, problems } = await open(browser, "demo.html", { hash: `#object=${id}` });
  const title = page.locator(".details h2");
  const frame = page.locator(".picture h2");
  const hash = (): Promise<string> => page.evaluate(() => location.hash);
  assert.equal(await title.textContent(), objectName(report, 3));
  assert.ok((await frame.textContent())!.includes(report.frames[bestFrame(report, 3)]!.id), "its best frame is shown");
  assert.equal(await row(page, 3).getAttribute("aria-selected"), "true");
  // By its label, as people write it.
  await page.evaluate((label) => void (location.hash = `#object=${encodeURIComponent(label)}`), objectName(report, 5));
  await page.waitForFunction((text) => document.querySelector(".details h2")?.textContent === text, objectName(report, 5));
  const last = report.frames.at(-1)!.id;
  await page.evaluate((text) => void (location.hash = text), `#frame=${last}`);
  await page.waitForFunction((text) => document.querySelector(".picture h2")?.textContent?.includes(text), last);
  assert.ok(await page.locator(".overview").isVisible(), "a link without an object selects none");
  await row(page, 2).click();
  assert.equal(await hash(), `#object=${report.objects[2]!.id}`);
  await page.locator(".strip").focus();
  await page.keyboard.press("End");
  const both = `#object=${report.objects[2]!.id}&frame=${last}`;
  assert.equal(await hash(), both);
  await page.keyboard.press("Home");
  await page.keyboard.press("Escape");
  assert.equal(await hash(), "", "nothing is selected that a link would have to name");
  await page.evaluate(() => void (location.hash = "#object=nobody"));
  await page.waitForTimeout(100);
  assert.ok(await page.locator(".overview").isVisible());
  assert.deepEqual(problems, []);
  await page.close();
  const again = (await open(browser, "demo.html", { hash: both })).page;
  assert.equal(await again.locator(".details h2").textContent(), objectName(report, 2));
  assert.ok((await again.locator(".picture h2").textContent())!.includes(last));
  await again.close();
});

test("focus flies there, and is there at once for people who want less motion", async () => {
  for (const motion of [true, false]) {
    const { page } = await open(browser, "demo.html", { motion });
    await row(page, 3).click();
    // The camera of each picture that is drawn after the click, as the place of a label.
    const places = await page.evaluate(() => new Promise<string[]>((done) => {
      const label = document.querySelector<HTMLElement>(".labels .chosen")!;
      const seen: string[] = [];
      [...document.querySelectorAll("button")].find((button) => button.textContent === "Focus")!.click();
      const look = (): void => {
        seen.push(label.style.transform);
        if (seen.length < 60) requestAnimationFrame(look);
        else done(seen);
      };
      requestAnimationFrame(look);
    }));
    // A busy machine draws few pictures of a flight.
    const steps = new Set(places).size;
    assert.ok(motion ? steps > 2 : steps <= 2, `${steps} places, motion: ${motion}`);
    assert.equal(places.at(-1), places.at(-2), "it has arrived");
    await page.close();
  }
});

/** Waits until a flight has arrived, also on a machine that draws slowly; it takes less than a second. */
const arrived = (page: Page): Promise<void> => page.waitForTimeout(1500);

test("a double click focuses: a body in the 3D view, a row of the table, a detection in the image", async () => {
  const { page, problems } = await open(browser, "demo.html");
  const report = data("demo.html");
  const stage = page.locator(".stage");
  const box = (await stage.boundingBox())!;
  const before = await pixels(page, stage);
  await row(page, 0).dblclick();
  await arrived(page);
  assert.ok(difference(before, await pixels(page, stage)) > 20000, "the 3D view is at the object");
  await page.keyboard.press("Escape");
  const near = await pixels(page, stage);
  await page.getByRole("button", { name: "Objects", exact: true }).click();
  await arrived(page);
  assert.ok(difference(near, await pixels(page, stage)) > 20000, "it has come back");
  // A body near the middle, found by single clicks.
  const selected = page.locator("table[aria-label=Objects] tbody tr[aria-selected=true]");
  let at3d: [number, number] | undefined;
  for (const [dx, dy] of [[0, 0], [-0.1, 0], [0.1, 0], [0, -0.1], [0, 0.1], [-0.2, -0.1], [0.2, -0.1], [-0.2, 0.1], [0.2, 0.1]] as const) {
    const point: [number, number] = [box.x + (0.5 + dx) * box.width, box.y + (0.5 + dy) * box.height];
    await page.mouse.click(...point);
    if ((await selected.count()) > 0) at3d = point;
    await page.keyboard.press("Escape");
    if (at3d) break;
  }
  assert.ok(at3d, "there is a body near the middle");
  await arrived(page);
  const far = await pixels(page, stage);
  await page.mouse.dblclick(...at3d);
  assert.ok((await selected.count()) > 0, "it is selected");
  await arrived(page);
  assert.ok(difference(far, await pixels(page, stage)) > 20000, "the 3D view is at the body");
  await page.keyboard.press("Escape");
  await row(page, 0).click();
  // In the image.
  const frame = report.frames[bestFrame(report, 0)]!;
  const at = frame.detections.object.indexOf(0);
  const [x0, y0, , y1] = frame.detections.box.slice(4 * at, 4 * at + 4) as [number, number, number, number];
  const canvas = (await page.locator(".sheet canvas").boundingBox())!;
  const scale = canvas.width / frame.size[0];
  const focus = page.getByRole("checkbox", { name: "Focus" });
  assert.ok(!(await focus.isChecked()));
  const whole = await pixels(page, page.locator(".sheet"));
  await page.mouse.dblclick(canvas.x + x0 * scale + 6, canvas.y + ((y0 + y1) / 2) * scale);
  assert.ok(await focus.isChecked());
  assert.ok(difference(whole, await pixels(page, page.locator(".sheet"))) > 20000);
  assert.deepEqual(problems, []);
  await page.close();
});

test("the image is zoomed by wheel and keys, moved by dragging, and reset", async () => {
  const { page, problems } = await open(browser, "demo.html");
  const [sheet, reset] = [page.locator(".sheet"), page.getByRole("button", { name: "Reset" })];
  const box = (await page.locator(".sheet canvas").boundingBox())!;
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  // Away from detections, whose tips would be counted.
  const whole = await pixels(page, sheet);
  assert.ok(await reset.isDisabled());
  await page.mouse.move(x, y);
  await page.mouse.wheel(0, -500);
  const near = await pixels(page, sheet);
  assert.ok(difference(whole, near) > 20000, "the wheel zooms in");
  await page.mouse.down();
  await page.mouse.move(x - 80, y - 40, { steps: 4 });
  await page.mouse.up();
  const moved = await pixels(page, sheet);
  assert.ok(difference(near, moved) > 20000, "dragging moves it");
  assert.equal(await page.locator("tr[aria-selected=true]").count(), 0, "and selects nothing");
  await reset.click();
  await page.mouse.move(2, 2);
  assert.ok(difference(whole, await pixels(page, sheet)) < 20, "all is shown again");
  await page.locator(".sheet canvas").focus();
  for (const key of ["+", "+", "ArrowLeft"]) await page.keyboard.press(key);
  assert.ok(difference(whole, await pixels(page, sheet)) > 20000, "keys zoom, too");
  await page.keyboard.press("Home");
  assert.ok(await reset.isDisabled());
  assert.deepEqual(problems, []);
  await page.close();
});

test("zooming keeps the pixel under the pointer, and stays inside of the image", () => {
  const whole = { x: 0, y: 0, width: 640, height: 480 };
  const near = zoomed(whole, whole, 160, 120, 0.5)!;
  assert.deepEqual(near, { x: 80, y: 60, width: 320, height: 240 });
  assert.deepEqual(zoomed(near, whole, 80, 60, 1.5), { x: 80, y: 60, width: 480, height: 360 });
  assert.equal(zoomed(near, whole, 0, 0, 2), null, "the whole");
  const corner = zoomed(whole, whole, 640, 480, 0.001)!;
  assert.ok(corner.width > 10 && Math.abs(corner.x + corner.width - 640) < 1e-9 && Math.abs(corner.y + corner.height - 480) < 1e-9);
});

test("through a camera its image stands behind the objects, and other frames follow", async () => {
  const { page, problems } = await open(browser, "demo.html");
  const stage = page.locator(".stage");
  const before = await pixels(page, stage);
  await page.getByRole("button", { name: "Camera", exact: true }).click();
  await page.waitForTimeout(300);
  const seen = await pixels(page, stage);
  // The picture of the desk has no paper in it: nearly all pixels of the middle have changed.
  assert.ok(difference(before, seen) > 0.4 * seen.width * seen.height, `${difference(before, seen)}`);
  await page.locator(".space").getByRole("checkbox", { name: "cameras" }).uncheck();
  assert.ok(difference(seen, await pixels(page, stage)) > 0.3 * seen.width * seen.height, "it belongs to the camera");
  await page.locator(".space").getByRole("checkbox", { name: "cameras" }).check();
  await page.locator(".strip").focus();
  await page.keyboard.press("End");
  await page.waitForTimeout(300);
  assert.ok(difference(seen, await pixels(page, stage)) > 0.2 * seen.width * seen.height, "the view has moved on");
  await page.keyboard.press("Home");
  await page.getByRole("button", { name: "Objects", exact: true }).click();
  await page.waitForTimeout(300);
  assert.ok(difference(before, await pixels(page, stage)) < 0.02 * seen.width * seen.height, "and back");
  assert.deepEqual(problems, []);
  await page.close();
});

test("a double click on a camera looks through it", async () => {
  const { page } = await open(browser, "demo.html");
  await page.getByRole("button", { name: "Everything", exact: true }).click();
  // Without the bodies a click is on a camera, or on nothing.
  await page.locator(".space").getByRole("checkbox", { name: "bodies", exact: true }).uncheck();
  await arrived(page);
  const stage = page.locator(".stage");
  const box = (await stage.boundingBox())!;
  const strip = page.locator(".strip");
  const start = await strip.getAttribute("aria-activedescendant");
  const clicked: [number, number][] = [];
  const isFound = async (): Promise<boolean> => (await strip.getAttribute("aria-activedescendant")) !== start;
  search: for (let y = 20; y < box.height; y += 14) {
    for (let x = 20; x < box.width; x += 14) {
      clicked.push([box.x + x, box.y + y]);
      await page.mouse.click(...clicked.at(-1)!);
      if (await isFound()) break search;
    }
  }
  assert.ok(await isFound(), "a click has selected a camera");
  const before = await pixels(page, stage);
  const enough = 0.3 * before.width * before.height;
  // The strip tells of a click with the next picture: on a slow machine after further clicks.
  let changed = 0;
  for (const point of clicked.slice(-4).reverse()) {
    await page.mouse.dblclick(...point);
    await arrived(page);
    changed = difference(before, await pixels(page, stage));
    if (changed > enough) break;
  }
  assert.ok(changed > enough, `${changed} pixels have changed`);
  await page.close();
});

test("pictures, bodies and the table are saved as files", async () => {
  const { page, problems } = await open(browser, "inconsistent.html");
  const report = data("inconsistent.html");
  const [inconsistent] = inconsistentAndSound();
  const file = async (name: string): Promise<{ bytes: Buffer; name: string }> => {
    const waiting: Promise<Download> = page.waitForEvent("download");
    await page.getByRole("button", { name }).click();
    const download = await waiting;
    return { bytes: readFileSync((await download.path())!), name: download.suggestedFilename() };
  };
  for (const [button, suffix] of [["download the 3D view as PNG", "-3d.png"], ["download the image as PNG", "-image.png"]] as const) {
    const { bytes, name } = await file(button);
    assert.ok(name.endsWith(suffix), name);
    assert.equal(bytes.subarray(1, 4).toString(), "PNG");
    const [w, h] = [bytes.readUInt32BE(16), bytes.readUInt32BE(20)];
    assert.ok(w > 400 && h > 300 && bytes.length > 20000, `${w} x ${h}, ${bytes.length} bytes`);
  }
  const csv = (await file("download the table of objects as CSV")).bytes.toString();
  const lines = csv.trimEnd().split("\r\n").map((line) => line.split(","));
  assert.equal(lines.length, report.objects.length + 1);
  const column = (title: string): number => lines[0]!.indexOf(title);
  const unit = report.lengthUnit!;
  report.objects.forEach((object, k) => {
    const line = lines[k + 1]!;
    assert.deepEqual([line[column("object")], line[column("id")], line[column("status")]], [objectName(report, k), object.id, object.status]);
    assert.equal(Number(line[column(`center y [${unit}]`)]), object.center![1]);
    const sizes = [1, 2, 3].map((i) => Number(line[column(`size ${i} [${unit}]`)]));
    const order = [0, 1, 2].sort((a, b) => object.body!.half[b]! - object.body!.half[a]!);
    assert.deepEqual(sizes, order.map((axis) => 2 * object.body!.half[axis]!));
    const deviations = [1, 2, 3].map((i) => Number(line[column(`size ${i} sd [${unit}]`)]));
    assert.deepEqual(deviations, order.map((axis) => 2 * object.halfExtentsSd![axis]!));
    const bounds = [1, 2, 3].map((i) => Number(line[column(`bounds ${i} [${unit}]`)]));
    assert.deepEqual(bounds, object.bounds!.half.map((half) => 2 * half).sort((a, b) => b - a));
    assert.deepEqual(["yaw", "tilt"].map((angle) => Number(line[column(`${angle} sd [deg]`)])), object.rotationSdDeg);
  });
  const { bytes, name } = await file("download the bodies as GLB (binary glTF)");
  assert.ok(name.endsWith("-bodies.glb"), name);
  assert.equal(bytes.subarray(0, 4).toString(), "glTF");
  assert.equal(bytes.readUInt32LE(4), 2);
  assert.equal(bytes.readUInt32LE(8), bytes.length);
  const length = bytes.readUInt32LE(12);
  const gltf = JSON.parse(bytes.subarray(20, 20 + length).toString()) as Gltf;
  const nodes = gltf.nodes.filter(({ mesh }) => mesh !== undefined);
  assert.deepEqual(nodes.map(({ extras }) => extras.id), report.objects.map(({ id }) => id));
  assert.deepEqual(nodes.map((node) => node.name), report.objects.map((_, k) => objectName(report, k)));
  nodes.forEach((node, k) => assert.deepEqual(node.scale, report.objects[k]!.body!.half));
  const material = gltf.materials[gltf.meshes[nodes[inconsistent]!.mesh!]!.primitives[0]!.material]!;
  assert.equal(material.alphaMode, "BLEND", "what is inconsistent is translucent");
  // Every accessor lies in the binary chunk, and normals have length one.
  const start = 20 + length + 8;
  assert.equal(gltf.buffers[0]!.byteLength, bytes.length - start);
  for (const { attributes } of gltf.meshes.flatMap(({ primitives }) => primitives)) {
    const accessor = gltf.accessors[attributes.NORMAL]!;
    const view = gltf.bufferViews[accessor.bufferView]!;
    assert.ok(view.byteOffset + view.byteLength <= gltf.buffers[0]!.byteLength);
    for (let i = 0; i < accessor.count; i++) {
      const normal = [0, 1, 2].map((c) => bytes.readFloatLE(start + view.byteOffset + 4 * (3 * i + c)));
      assert.ok(Math.abs(Math.hypot(...normal) - 1) < 1e-5);
    }
  }
  assert.deepEqual(problems, []);
  await page.close();
});

interface Gltf {
  nodes: { name: string; mesh?: number; scale: number[]; extras: { id: string } }[];
  meshes: { primitives: { attributes: { NORMAL: number }; material: number }[] }[];
  materials: { alphaMode?: string }[];
  accessors: { bufferView: number; count: number }[];
  bufferViews: { byteOffset: number; byteLength: number }[];
  buffers: { byteLength: number }[];
}

test("inconsistent bodies are dashed and hatched, and both legends say so", async () => {
  const [inconsistent, sound] = inconsistentAndSound();
  const { page } = await open(browser, "inconsistent.html");
  for (const legend of [".space .legend", ".picture .legend"]) {
    assert.ok(await page.locator(legend).getByText("inconsistent", { exact: true }).isVisible(), legend);
  }
  // From near, the share of the picture in its own colors: wires and a hint of a body, not a body.
  for (const layer of ["grid", "cameras", "names", "uncertainty"]) {
    await page.locator(".space").getByRole("checkbox", { name: layer }).uncheck();
  }
  const filled = async (k: number): Promise<number> => {
    const name = objectName(data("inconsistent.html"), k);
    await page.getByLabel("Search objects").fill(name);
    await row(page, k).dblclick();
    await page.keyboard.press("Escape");
    const { data: bytes } = await pixels(page, page.locator(".stage canvas"));
    let strong = 0;
    for (let i = 0; i < bytes.length; i += 4) {
      const rgb = [bytes[i]!, bytes[i + 1]!, bytes[i + 2]!];
      if (Math.max(...rgb) - Math.min(...rgb) > 60) strong += 1;
    }
    return strong / (bytes.length / 4);
  };
  const [dashed, solid] = [await filled(inconsistent), await filled(sound)];
  assert.ok(dashed > 0.001 && dashed < 0.25 * solid, `${dashed} of the picture, ${solid} of a sound body`);
  await page.close();
});

test("a page without inconsistent bodies says nothing of them", async () => {
  quadlift("synth", "-q", "-o", "sound.json", "--objects", "4", "--views", "12", "--noise", "box:0.005");
  quadlift("localize", "-q", "sound.json", "--report", "sound.html");
  assert.ok(data("sound.html").objects.every(({ status }) => status === "ok"));
  const { page } = await open(browser, "sound.html");
  assert.equal(await page.getByText("inconsistent", { exact: true }).count(), 0);
  await page.close();
});

test("labels stay out of objects where there is a place, and are left out where there is none", () => {
  const object: Box = [40, 40, 80, 80];
  const wish = (must: boolean) => ({ width: 30, height: 10, places: [[45, 45], [45, 82]] as [number, number][], must });
  assert.deepEqual(placeLabels([wish(false)], 200, 200, [object]), [[45, 82]]);
  const full: Box = [0, 0, 200, 200];
  assert.deepEqual(placeLabels([wish(false), wish(true)], 200, 200, [full]), [null, [45, 45]]);
});

test("names in the 3D view cover no body", async () => {
  const { page } = await open(browser, "demo.html");
  const stage = page.locator(".stage");
  const names = await page.locator(".labels span:not(.plain)").evaluateAll((spans) => spans.flatMap((span) => {
    const { left, top, width: w, height: h } = span.getBoundingClientRect();
    return getComputedStyle(span).visibility === "visible" ? [{ text: span.textContent!, left, top, w, h }] : [];
  }));
  assert.ok(names.length > 8, `${names.length} names`);
  for (const layer of ["names", "grid", "cameras", "path", "uncertainty"]) {
    await page.locator(".space").getByRole("checkbox", { name: layer }).uncheck();
  }
  const box = (await stage.boundingBox())!;
  const { width: w, data: bytes } = await pixels(page, stage);
  for (const name of names) {
    let covered = 0;
    for (let y = Math.round(name.top - box.y); y < name.top - box.y + name.h; y++) {
      for (let x = Math.round(name.left - box.x); x < name.left - box.x + name.w; x++) {
        const k = 4 * (y * w + x);
        const rgb = [bytes[k]!, bytes[k + 1]!, bytes[k + 2]!];
        if (Math.max(...rgb) - Math.min(...rgb) > 40) covered += 1;
      }
    }
    assert.ok(covered < 0.13 * name.w * name.h, `${name.text} covers ${covered} pixels of bodies`);
  }
  await page.close();
});

test("an object has one label everywhere, and its sizes are sorted", async () => {
  const report = data("demo.html");
  const { page } = await open(browser, "demo.html", { hash: `#object=${report.objects[8]!.id}` });
  const label = objectName(report, 8);
  assert.equal(label, `${report.categories[report.objects[8]!.category]} 8`);
  assert.equal((await row(page, 8).locator("td").first().textContent()), label);
  assert.equal(await page.locator(".details h2").textContent(), label);
  assert.equal(await page.locator(".labels .chosen").textContent(), label);
  assert.equal(await page.locator("#measure option").first().textContent(), "–");
  const sizes = extents(report, report.objects[8]!.body).split(" × ").map(Number);
  assert.deepEqual(sizes, [...sizes].sort((a, b) => b - a));
  assert.ok((await page.locator(".details").textContent())!.includes(`${extentsWithSd(report, report.objects[8]!.body, report.objects[8]!.halfExtentsSd)} ${report.lengthUnit}`));
  // No id of an association stands in a text.
  for (const part of [".warnings", ".overview", ".measurements"]) {
    for (const text of await page.locator(part).allTextContents()) assert.ok(!/object_\d/.test(text), text);
  }
  await page.close();
});
