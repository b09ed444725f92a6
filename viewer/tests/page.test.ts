// What issue reports have found missing or wrong in the page: one test each.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { createRequire } from "node:module";
import { readFileSync, writeFileSync } from "node:fs";
import { join, resolve } from "node:path";
import type { Browser, Page } from "playwright-core";
import { Colors } from "../src/colors.ts";
import { bestFrame, viewsOf } from "../src/object_views.ts";
import { fitView } from "../src/fit_view.ts";
import { placeLabels } from "../src/place_labels.ts";
import {
  colored, data, difference, folder, launch, open, pixels, project, quadlift, readScene, writeScene, type Pixels,
} from "./browser.ts";

let browser: Browser;

before(async () => {
  browser = await launch();
  quadlift("demo", "-q", "--out", "demo");
  quadlift("evaluate", "-q", "demo/estimate.json", "demo/truth.json", "--report", "demo.html");
  // Two objects with masks, in no unit.
  const rendered = join(project, "crates/quadlift-cli/tests/fixtures/rendered/scene.json");
  quadlift("localize", "-q", rendered, "--report", "masks.html");
  // Boxes of which some are quite wrong and none says what it shows.
  const wrong = ["--noise", "box:0.05", "--outliers", "0.06"];
  quadlift("synth", "-q", "-o", "named.json", "--objects", "6", "--views", "16", "--scale", "0.05", ...wrong);
  const { objects: _, ...scene } = { ...readScene("named.json"), length_unit: "m" };
  writeScene("named.json", { ...scene, objects: _ });
  quadlift("localize", "-q", "named.json", "--enclosing", "--report", "named.html");
  writeScene("boxes.json", { ...scene, detections: scene.detections.map(({ object: _, ...box }) => box) });
  quadlift("localize", "-q", "boxes.json", "--associate", "always", "--report", "boxes.html");
});

after(async () => browser.close());

const row = (page: Page, k: number) => page.locator("table[aria-label=Objects] tbody tr").nth(k);

test("focus shows the selected object large, and needs one", async () => {
  const { page } = await open(browser, "demo.html");
  const zoom = page.getByRole("checkbox", { name: "Focus" });
  assert.ok(await zoom.isDisabled(), "there is nothing to zoom to");
  await row(page, 1).click();
  const whole = await pixels(page, page.locator(".sheet"));
  await zoom.check();
  const near = await pixels(page, page.locator(".sheet"));
  assert.ok(difference(whole, near) > 0.3 * whole.width * whole.height, "the picture is another one");
  await row(page, 2).click();
  assert.ok(difference(near, await pixels(page, page.locator(".sheet"))) > 0.1 * near.width * near.height);
  await page.close();
});

test("selecting an object opens the frame that shows it best; selecting it in a frame stays there", async () => {
  const report = data("demo.html");
  const { page } = await open(browser, "demo.html");
  for (const [k] of report.objects.entries()) {
    await row(page, k).click();
    const best = bestFrame(report, k);
    assert.ok(best >= 0);
    await page.waitForSelector(`.strip[aria-activedescendant=frame-${best}]`);
    assert.ok((await page.locator(".picture h2").textContent())!.startsWith(`Frame ${report.frames[best]!.id}`));
  }
  // A click into the picture.
  const last = bestFrame(report, report.objects.length - 1);
  const frame = report.frames[last]!;
  const at = frame.detections.object.findIndex((k) => k >= 0 && k !== report.objects.length - 1);
  const [x0, y0, x1, y1] = frame.detections.box.slice(4 * at, 4 * at + 4) as number[];
  const box = (await page.locator(".sheet canvas").boundingBox())!;
  const scale = box.width / frame.size[0];
  await page.mouse.click(box.x + ((x0! + x1!) / 2) * scale, box.y + ((y0! + y1!) / 2) * scale);
  assert.equal(await page.locator(".strip").getAttribute("aria-activedescendant"), `frame-${last}`);
  await page.close();
});

test("the best frame was used, shows the whole object, and shows it large", () => {
  const report = data("named.html");
  report.objects.forEach((_, k) => {
    const best = bestFrame(report, k);
    const views = viewsOf(report, k);
    const area = (frame: number): number => {
      const view = views.find((of) => of.frame === frame)!;
      const [x0, y0, x1, y1] = report.frames[frame]!.detections.box.slice(4 * view.row, 4 * view.row + 4) as number[];
      return (x1! - x0!) * (y1! - y0!);
    };
    const used = views.filter((view) => view.state === 1).map((view) => area(view.frame));
    assert.equal(views.find((view) => view.frame === best)!.state, 1);
    assert.ok(area(best) >= 0.8 * Math.max(...used), `${area(best)} of ${Math.max(...used)}`);
  });
});

test("the 3D view has two thirds of the width, the image fills the rest, and its pixels are fine enough", async () => {
  const { page } = await open(browser, "demo.html");
  const [stage, sheet] = await Promise.all([".stage", ".sheet canvas"].map((at) => page.locator(at).boundingBox()));
  assert.ok(Math.abs(stage!.width / 1600 - 2 / 3) < 0.01, `${stage!.width}`);
  assert.ok(sheet!.width > 0.92 * (1600 - stage!.width), `${sheet!.width} beside ${stage!.width}`);
  await page.close();
  // A scene whose images are larger than what a report of hundreds of them would keep.
  const width = await imageWidth();
  const [own] = data("demo.html").frames[0]!.size;
  assert.equal(width, Math.min(own, 800));
});

async function imageWidth(): Promise<number> {
  const page = await browser.newPage();
  const width = await page.evaluate(async (source) => {
    const image = new Image();
    image.src = source;
    await image.decode();
    return image.naturalWidth;
  }, data("demo.html").frames[0]!.image!);
  await page.close();
  return width;
}

test("objects are named in space and in images, and a switch takes the names away", async () => {
  const { page } = await open(browser, "named.html");
  const names = page.locator(".labels span");
  const shown = await names.evaluateAll((spans) => spans.flatMap((span) => {
    const seen = !(span as HTMLElement).hidden && getComputedStyle(span).visibility === "visible";
    const { left, top, right, bottom } = span.getBoundingClientRect();
    return seen ? [{ text: span.textContent, left, top, right, bottom }] : [];
  }));
  const report = data("named.html");
  const named = report.objects.filter(({ id }) => shown.some(({ text }) => text === id || text!.endsWith(id.slice(-1))));
  assert.ok(named.length >= 4, `${shown.map(({ text }) => text)}`);
  for (const [k, a] of shown.entries()) {
    for (const b of shown.slice(k + 1)) {
      const apart = a.right <= b.left + 1 || b.right <= a.left + 1 || a.bottom <= b.top + 1 || b.bottom <= a.top + 1;
      assert.ok(apart, `${a.text} covers ${b.text}`);
    }
  }
  const sheet = page.locator(".sheet");
  const withNames = await pixels(page, sheet);
  await page.locator(".picture").getByRole("checkbox", { name: "names" }).uncheck();
  assert.ok(difference(withNames, await pixels(page, sheet)) > 500, "names are drawn on the image");
  await page.locator(".space").getByRole("checkbox", { name: "names" }).uncheck();
  await page.locator(".space").getByRole("checkbox", { name: "grid" }).uncheck();
  assert.equal(await names.count(), 0);
  await page.close();
});

test("labels never cover each other, and take the first place that is free", () => {
  const wish = (x: number, must = false) => ({ width: 40, height: 10, places: [[x, 0], [x, 12]] as [number, number][], must });
  assert.deepEqual(placeLabels([wish(0), wish(10), wish(20), wish(30, true)], 200, 100), [[0, 0], [10, 12], null, [30, 0]]);
  assert.deepEqual(placeLabels([wish(190)], 200, 100), [[160, 0]], "and stay in the picture");
});

test("every sign has a legend: rejected detections, unassigned ones, enclosing bodies, truth", async () => {
  const { page } = await open(browser, "named.html");
  for (const text of ["boxes", "outlines of bodies", "rejected"]) {
    assert.ok(await page.locator(".picture .legend").getByText(text).isVisible(), text);
  }
  for (const text of ["bodies", "enclosing bodies", "uncertainty", "cameras"]) {
    assert.ok(await page.locator(".space .legend").getByText(text, { exact: true }).isVisible(), text);
  }
  await page.close();
  const other = (await open(browser, "boxes.html")).page;
  assert.ok(await other.locator(".picture .legend").getByText("unassigned", { exact: true }).isVisible(), "clutter");
  assert.equal(await other.locator(".space .legend").getByText("enclosing").count(), 0, "there are none without --enclosing");
  await other.close();
  const scored = (await open(browser, "demo.html")).page;
  assert.equal(await scored.locator(".legend").getByText("truth", { exact: true }).count(), 2);
  await scored.close();
});

test("sizes and directions have standard deviations", async () => {
  const report = data("demo.html");
  const { page } = await open(browser, "demo.html");
  const titles = await page.locator("table[aria-label=Objects] th").allTextContents();
  const column = titles.findIndex((title) => title.startsWith("size\u00a0±"));
  for (const [k, { body, halfExtentsSd, rotationSdDeg }] of report.objects.entries()) {
    await row(page, k).click();
    const facts = await page.locator(".details dl").first().innerText();
    const numbers = [...facts.matchAll(/([\d.]+)\s±\s([\d.]+)/g)].slice(0, 3).map(([, size, sd]) => [Number(size), Number(sd)] as const);
    assert.equal(numbers.length, 3, facts);
    const expected = body!.half.map((half, axis) => [2 * half, 2 * halfExtentsSd![axis]!] as const).sort(([a], [b]) => b - a);
    for (const [axis, [size, sd]] of expected.entries()) {
      assert.ok(Math.abs(numbers[axis]![0] - size) < 0.02 * size && Math.abs(numbers[axis]![1] - sd) < 0.06 * sd, `${facts}: ${expected}`);
    }
    // The box around the object stands below.
    assert.match(facts, /bounds\s+[\d.]+\s±/);
    const mean = Math.hypot(...expected.map(([, sd]) => sd)) / Math.sqrt(3);
    const shown = Number(await row(page, k).locator("td").nth(column).textContent());
    assert.ok(Math.abs(shown - mean) < 0.06 * mean, `${shown}: ${mean}`);
    // A mug without a handle may be turned as it likes.
    const [yaw, tilt] = rotationSdDeg!.map((sd) => (sd > 100 ? "not determined" : `± ${Number(sd.toPrecision(2))}`));
    assert.match(facts, new RegExp(`${yaw}[.0 a-z]* about the vertical, ${tilt}[.0 a-z]* away from it`));
  }
  await page.close();
});

test("masks are drawn, and a switch takes them away", async () => {
  const masks = data("masks.html").frames.reduce((sum, frame) => sum + frame.detections.masks.length, 0);
  assert.equal(masks, 16, "two objects in eight frames");
  const { page } = await open(browser, "masks.html");
  await page.locator(".picture").getByRole("checkbox", { name: "outlines of bodies" }).uncheck();
  const shown = await pixels(page, page.locator(".sheet"));
  await page.locator(".picture").getByRole("checkbox", { name: "masks" }).uncheck();
  assert.ok(difference(shown, await pixels(page, page.locator(".sheet"))) > 3000);
  await page.close();
});

test("categories, and what is searched for, filter the table, space and the image", async () => {
  const { page } = await open(browser, "demo.html");
  const rows = page.locator("table[aria-label=Objects] tbody tr:visible");
  const all = await rows.count();
  const [stage, sheet] = [page.locator(".stage"), page.locator(".sheet")];
  const [space, image] = [await pixels(page, stage), await pixels(page, sheet)];
  const chip = page.locator(".chip").first();
  await chip.click();
  assert.equal(await chip.getAttribute("aria-pressed"), "false");
  assert.ok((await rows.count()) < all);
  assert.ok(difference(space, await pixels(page, stage)) > 200, "its bodies are gone");
  assert.ok(difference(image, await pixels(page, sheet)) > 50, "its boxes are gone");
  await chip.click();
  await page.getByLabel("Search objects").fill(data("demo.html").objects[3]!.id);
  assert.equal(await rows.count(), 1);
  assert.ok(await page.getByText(`1 of ${all} shown`).isVisible());
  await page.close();
});

test("colors by residual, uncertainty and status, each with its legend", async () => {
  const { page } = await open(browser, "named.html");
  const mode = page.getByLabel("Colors by");
  const names = await mode.locator("option").allTextContents();
  assert.deepEqual(names.slice(-3), ["residual", "uncertainty", "status"].map((name) => `color by ${name}`));
  let before = await pixels(page, page.locator(".stage"));
  for (const name of ["residual", "uncertainty", "status"]) {
    await mode.selectOption(name);
    const now = await pixels(page, page.locator(".stage"));
    assert.ok(difference(before, now) > 300, name);
    before = now;
    const legend = await page.locator(".scale").textContent();
    assert.ok(name === "status" ? legend!.includes("not localized") : /\d/.test(legend!), `${name}: ${legend}`);
  }
  await page.close();
});

test("no category has the gray of what belongs to no object", () => {
  const categories = Array.from({ length: 10 }, (_, k) => Colors.ofCategory(k));
  assert.equal(new Set(categories).size, 10);
  assert.ok(!categories.includes(Colors.ofCategory(-1)));
});

test("a rejected detection has a sign of its own, and says why on hover and in the table", async () => {
  const { page } = await open(browser, "named.html");
  const report = data("named.html");
  const frame = report.frames.findIndex(({ detections }) => detections.rejections.length > 0);
  assert.ok(frame >= 0, "a view is rejected");
  const { rejections, box, object } = report.frames[frame]!.detections;
  const at = rejections[0]![0];
  await row(page, object[at]!).click();
  const cell = page.locator("table[aria-label='Views of the selected object'] td", { hasText: "✕ rejected: " });
  await cell.first().click();
  const shown = report.frames.findIndex(({ id }) => id === report.frames[frame]!.id);
  for (let k = 0; k < 20 && (await page.locator(`#frame-${shown}[aria-selected=true]`).count()) === 0; k++) {
    await cell.nth(k).click();
  }
  assert.ok((await page.locator(`#frame-${shown}.rejected`).count()) === 1, "the strip marks it");
  // Without an image the sheet shows the part with the detections: the table says where in the page it is.
  const canvas = (await page.locator(".sheet canvas").boundingBox())!;
  let said = "";
  for (let y = 0; y < canvas.height && !said.includes("✕ rejected"); y += 12) {
    for (let x = 0; x < canvas.width && !said.includes("✕ rejected"); x += 12) {
      await page.mouse.move(canvas.x + x, canvas.y + y);
      said = (await page.locator(".tip").isVisible()) ? (await page.locator(".tip").textContent())! : "";
    }
  }
  assert.match(said, /✕ rejected: (far off the other views|the object is behind the camera)/);
  assert.ok(box.length > 0);
  await page.close();
});

test("the view opens on the objects, which fill it", async () => {
  for (const path of ["demo.html", "boxes.html"]) {
    const { page } = await open(browser, path);
    for (const layer of ["cameras", "grid", "names", "uncertainty"]) {
      await page.locator(".space").getByRole("checkbox", { name: layer }).uncheck();
    }
    const path3 = page.locator(".space").getByRole("checkbox", { name: "path" });
    if (await path3.isChecked()) await path3.uncheck();
    const seen = extentOf(await pixels(page, page.locator(".stage canvas")));
    assert.ok(Math.max(seen.width, seen.height) > 0.6, `${path}: ${seen.width} x ${seen.height} of the view`);
    await page.close();
  }
});

/** The part of a picture that is not paper, as shares of its size. */
function extentOf({ width, height, data: bytes }: Pixels): { width: number; height: number } {
  let [x0, x1, y0, y1] = [width, 0, height, 0];
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      const k = 4 * (y * width + x);
      if ([0, 1, 2].every((c) => Math.abs(bytes[k + c]! - bytes[c]!) <= 24)) continue;
      [x0, x1, y0, y1] = [Math.min(x0, x), Math.max(x1, x), Math.min(y0, y), Math.max(y1, y)];
    }
  }
  return { width: (x1 - x0) / width, height: (y1 - y0) / height };
}

test("a fitted view has all points in sight, and the farthest at its border", () => {
  const points: [number, number, number][] = [[0, 0, 0], [4, 0, 0], [0, 1, 0], [1, 1, 2], [-3, 2, 1]];
  const from: [number, number, number] = [0.6, -0.8, 0];
  const { target, distance } = fitView(points, from, [0, 0, 1], [0.4, 0.3]);
  const right: [number, number, number] = [0.8, 0.6, 0];
  const shares = points.map((point) => {
    const to = point.map((x, i) => x - target[i]!) as [number, number, number];
    const along = (axis: number[]): number => to.reduce((sum, x, i) => sum + x * axis[i]!, 0);
    const depth = distance - along(from);
    return Math.max(Math.abs(along(right)) / depth / 0.4, Math.abs(to[2]) / depth / 0.3);
  });
  assert.ok(Math.max(...shares) < 1.0001 && Math.max(...shares) > 0.999, `${shares}`);
});

test("top, front and the camera are views of their own", async () => {
  const { page } = await open(browser, "demo.html");
  const stage = page.locator(".stage");
  const seen = [await pixels(page, stage)];
  for (const name of ["Top", "Front", "Camera", "Everything"]) {
    await page.getByRole("button", { name, exact: true }).click();
    seen.push(await pixels(page, stage));
    for (const [k, before] of seen.slice(0, -1).entries()) {
      assert.ok(difference(before, seen.at(-1)!) > 2000, `${name} is not view ${k}`);
    }
  }
  await page.getByRole("button", { name: "Objects", exact: true }).click();
  assert.ok(difference(seen[0]!, await pixels(page, stage)) < 50, "and back");
  await page.close();
});

test("points of a COLMAP model are shown behind the objects, and a switch takes them away", async () => {
  const tutorial = join(project, "docs/data/tutorial-colmap-yolo");
  const input = ["--cameras", join(tutorial, "sparse/0"), "--detections", join(tutorial, "labels")];
  quadlift("localize", "-q", ...input, "-o", "colmap.json", "--report", "colmap.html");
  assert.equal(data("colmap.html").points.length, 900);
  const { page, problems } = await open(browser, "colmap.html");
  const stage = page.locator(".stage");
  const hint = "sparse points from structure from motion";
  const box = page.locator(".space").getByRole("checkbox", { name: "points" });
  assert.ok(await box.isChecked());
  assert.equal(await page.locator(".legend label", { has: page.getByRole("checkbox", { name: "points" }) }).getAttribute("title"), hint);
  for (const name of ["grid", "names", "cameras", "path"]) {
    await page.locator(".space").getByRole("checkbox", { name }).setChecked(false);
  }
  const shown = await pixels(page, stage);
  await box.uncheck();
  const without = await pixels(page, stage);
  const changed = difference(shown, without);
  // A few pixels each, in the color of nothing else.
  assert.ok(changed > 300 && changed < 300 * 16, `${changed}`);
  assert.ok(Math.abs(colored(shown) - colored(without)) < 0.02 * colored(without), "the bodies stay as they are");
  assert.deepEqual(problems, []);
  await page.close();
  // A scene without points has no switch.
  const other = (await open(browser, "named.html")).page;
  assert.equal(await other.getByRole("checkbox", { name: "points" }).count(), 0);
  await other.close();
});

test("the view opens on the objects wherever the points are", async () => {
  const html = readFileSync(resolve(folder, "named.html"), "utf8");
  const far = '"points":[1e3,0,0,-1e3,5e3,1e4]';
  assert.ok(html.includes('"points":[]'));
  writeFileSync(join(folder, "far.html"), html.replace('"points":[]', far));
  const views = [];
  for (const name of ["named.html", "far.html"]) {
    const { page } = await open(browser, name);
    views.push(await pixels(page, page.locator(".stage")));
    await page.close();
  }
  assert.ok(difference(views[0]!, views[1]!) < 20);
});

test("frames are played, and stop", async () => {
  const { page } = await open(browser, "demo.html");
  const frame = (): Promise<string | null> => page.locator(".strip").getAttribute("aria-activedescendant");
  const start = await frame();
  await page.getByRole("button", { name: "Play" }).click();
  await page.waitForFunction((first) => {
    return document.querySelector(".strip")?.getAttribute("aria-activedescendant") !== first;
  }, start);
  await page.getByRole("button", { name: "Pause" }).click();
  await page.getByRole("button", { name: "Play" }).waitFor();
  const stopped = await frame();
  await page.waitForTimeout(600);
  assert.equal(await frame(), stopped);
  await page.close();
});

test("the selected object has its lengths, and its distance to another one is measured", async () => {
  const { page } = await open(browser, "named.html");
  const report = data("named.html");
  await row(page, 0).click();
  const texts = await page.locator(".labels .plain").allTextContents();
  assert.equal(texts.filter((text) => / m$/.test(text)).length, 3, `${texts}`);
  await page.locator("#measure").selectOption("2");
  const [a, b] = [report.objects[0]!.center!, report.objects[2]!.center!];
  const expected = Math.hypot(...a.map((x, i) => x - b[i]!));
  const found = await page.locator(".measure output").textContent();
  assert.ok(Math.abs(parseFloat(found!) - expected) < 0.006 * expected, `${found} for ${expected}`);
  assert.ok((await page.locator(".labels span").allTextContents()).includes(found!.replace(" between the centers", "")));
  await page.close();
});

test("what is said before something is selected: counts, consistency check, noise, how to read the page", async () => {
  const { page } = await open(browser, "boxes.html");
  const text = (await page.locator(".overview").textContent())!;
  for (const word of ["objects", "detections", "consistency check", "noise of box edges", "association", "How to read this page"]) {
    assert.ok(text.includes(word), `${word} in ${text}`);
  }
  await row(page, 0).click();
  assert.equal(await page.locator(".overview").count(), 0);
  await page.keyboard.press("Escape");
  assert.ok(await page.locator(".overview").isVisible());
  await page.close();
});

test("lengths have their units, and bars grow from the left", async () => {
  const { page } = await open(browser, "named.html");
  const heads = await page.locator("table[aria-label=Objects] th").allTextContents();
  assert.deepEqual(heads.filter((head) => /^(size|center)/.test(head)).map((head) => head.slice(-3)), ["[m]", "[m]", "[m]"]);
  assert.ok(await page.getByText(/^grid of [\d.]+ m$/).isVisible());
  const bar = await page.locator("td.bar").first().evaluate((cell) => getComputedStyle(cell).backgroundImage);
  assert.match(bar, /to right|90deg/);
  await page.close();
});

test("a page of a scene without a unit says so everywhere", async () => {
  const { page } = await open(browser, "masks.html");
  const heads = await page.locator("table[aria-label=Objects] th").allTextContents();
  assert.ok(heads.some((head) => head === "size [units]"), `${heads}`);
  assert.ok(await page.getByText(/^grid of [\d.]+ units?$/).isVisible());
  await page.close();
});

test("bodies look the same in whatever order the file has them", async () => {
  const scene = readScene("named.json");
  writeScene("turned.json", { ...scene, objects: [...scene.objects].reverse() });
  const seen = [];
  for (const name of ["named.json", "turned.json"]) {
    const path = quadlift("view", name, "--no-browser").trim();
    const { page } = await open(browser, path);
    await page.getByLabel("Colors by").selectOption("status").catch(() => undefined);
    await page.locator(".space").getByRole("checkbox", { name: "names" }).uncheck();
    seen.push(await pixels(page, page.locator(".stage")));
    await page.close();
  }
  assert.ok(colored(seen[0]!) >= 0 && difference(seen[0]!, seen[1]!) < 20, `${difference(seen[0]!, seen[1]!)} pixels differ`);
});

test("on a phone the page scrolls when it is swiped outside of the 3D view, and nothing is cut off", async () => {
  const { page } = await open(browser, "demo.html", { width: 390, height: 844 });
  const client = await page.context().newCDPSession(page);
  for (const part of [".sheet", ".strip", "table[aria-label=Objects]", ".title"]) {
    await page.evaluate((at) => {
      window.scrollTo(0, 0);
      const box = document.querySelector(at)!.getBoundingClientRect();
      window.scrollTo(0, Math.max(0, box.top - 300));
    }, part);
    const before = await page.evaluate(() => window.scrollY);
    const box = (await page.locator(part).boundingBox())!;
    const [x, y] = [Math.round(box.x + box.width / 2), Math.round(box.y + Math.min(60, box.height / 2))];
    const touch = (type: "touchStart" | "touchMove" | "touchEnd", touchPoints: { x: number; y: number }[]) =>
      client.send("Input.dispatchTouchEvent", { type, touchPoints });
    await touch("touchStart", [{ x, y }]);
    for (let k = 1; k <= 10; k++) {
      await touch("touchMove", [{ x, y: y - 20 * k }]);
      await page.waitForTimeout(16);
    }
    await touch("touchEnd", []);
    await page.waitForTimeout(100);
    assert.ok((await page.evaluate(() => window.scrollY)) > before + 60, `swiped on ${part}`);
  }
  await row(page, 0).click();
  const cut = await page.evaluate(() => [...document.querySelectorAll(".table, .legend, .controls, header, dl")]
    .filter((part) => part.scrollWidth > part.clientWidth + 1).map((part) => part.className || part.tagName));
  assert.deepEqual(cut, []);
  await page.close();
});

test("in the frame of a notebook the whole image is in sight", async () => {
  for (const width of [700, 950, 1300]) {
    const { page } = await open(browser, "demo.html", { width, height: 640 });
    await page.locator(".sheet canvas").evaluate((canvas) => canvas.scrollIntoView({ block: "end" }));
    const box = (await page.locator(".sheet canvas").boundingBox())!;
    assert.ok(box.y >= 0 && box.y + box.height <= 641 && box.x >= 0 && box.x + box.width <= width, JSON.stringify(box));
    assert.ok(box.height > 250, `${box.height} at ${width}`);
    await page.close();
  }
});

test("axe finds nothing serious, light and dark, with and without a selected object", async () => {
  const source = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
  for (const dark of [false, true]) {
    for (const width of [1600, 390]) {
      const { page } = await open(browser, "boxes.html", { width, height: 900, dark });
      for (const selected of [false, true]) {
        if (selected) await row(page, 1).click();
        await page.evaluate(source);
        const found = await page.evaluate(async () => {
          const axe = (window as unknown as { axe: { run: () => Promise<{ violations: Violation[] }> } }).axe;
          return (await axe.run()).violations.map(({ id, impact, nodes }) => ({ id, impact, at: nodes[0]!.html }));
          interface Violation { id: string; impact: string; nodes: { html: string }[] }
        });
        const serious = found.filter(({ impact }) => impact === "serious" || impact === "critical");
        assert.deepEqual(serious, [], `${width} pixels, ${dark ? "dark" : "light"}, selected: ${selected}`);
      }
      await page.close();
    }
  }
});
