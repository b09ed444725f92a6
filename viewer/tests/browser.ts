// What the tests in the browser share: a page that is watched, pixels of what it shows, the program quadlift.

import { execFileSync } from "node:child_process";
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";
import type { Report } from "../src/data.ts";
import { chromium, type Browser, type Locator, type Page } from "playwright-core";

/** Folder of the project; the tests run in viewer/. */
export const project = resolve("..");

/** A folder for the files of this run. */
export const folder = mkdtempSync(join(tmpdir(), "quadlift-viewer-"));
process.on("exit", () => {
  rmSync(folder, { recursive: true, force: true });
});

/** Runs the program: QUADLIFT names it, otherwise that of the debug build is taken. */
export function quadlift(...args: string[]): string {
  const target = process.env["CARGO_TARGET_DIR"] ?? join(project, "target");
  const program = process.env["QUADLIFT"] ?? join(target, "debug", "quadlift");
  return execFileSync(program, args, { cwd: folder, encoding: "utf8", maxBuffer: 1 << 28 });
}

/** The data in a report. */
export function data(path: string): Report {
  const html = readFileSync(resolve(folder, path), "utf8");
  const start = html.indexOf('id="report-data">') + 'id="report-data">'.length;
  return JSON.parse(html.slice(start, html.indexOf("</script>", start))) as Report;
}

/** What the tests change in scene files. */
export interface SceneText {
  detections: { object?: string }[];
  objects: { id: string }[];
}

export function readScene(path: string): SceneText {
  return JSON.parse(readFileSync(join(folder, path), "utf8")) as SceneText;
}

export function writeScene(path: string, scene: object): void {
  writeFileSync(join(folder, path), JSON.stringify(scene));
}

/** A real scene, or null where the data are not at hand. */
export function realScene(name: string): string | null {
  const data = process.env["QUADLIFT_DATA"] ?? join(project, "../shared/data");
  const path = resolve(join(data, "scenes", name));
  return existsSync(path) ? path : null;
}

export function launch(): Promise<Browser> {
  const executablePath = process.env["CHROMIUM"] ?? "/usr/bin/chromium";
  // WebGL 2 in software: there is no graphics card in CI.
  const args = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
  return chromium.launch({ executablePath, args });
}

/** An open report, and everything that it complained about or asked the network for. */
export interface Opened {
  page: Page;
  problems: string[];
  /** Milliseconds until the page was ready and drawn. */
  time: number;
}

export async function open(
  browser: Browser,
  path: string,
  look: { width?: number; height?: number; dark?: boolean; hash?: string; motion?: boolean } = {},
): Promise<Opened> {
  const context = await browser.newContext({
    viewport: { width: look.width ?? 1600, height: look.height ?? 1000 },
    colorScheme: look.dark ? "dark" : "light",
    hasTouch: (look.width ?? 1600) < 500,
    // Flights of the 3D view would have to be waited for.
    reducedMotion: look.motion ? "no-preference" : "reduce",
  });
  const page = await context.newPage();
  const problems: string[] = [];
  const url = pathToFileURL(resolve(folder, path)).href;
  page.on("console", (message) => {
    if (["error", "warning"].includes(message.type())) problems.push(`console: ${message.text()}`);
  });
  page.on("pageerror", (error) => problems.push(`error: ${error.message}`));
  page.on("request", (request) => {
    const asked = request.url();
    if (asked !== url && !asked.startsWith("data:") && !asked.startsWith("blob:")) problems.push(`request: ${asked}`);
  });
  const start = performance.now();
  await page.goto(url + (look.hash ?? ""));
  await page.waitForSelector("#page[data-ready]");
  // Two pictures later everything has been drawn once.
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  return { page, problems, time: performance.now() - start };
}

/** What can be seen of an element: its pixels, four bytes each, as the browser has drawn them. */
export interface Pixels {
  width: number;
  height: number;
  data: Uint8Array;
}

export async function pixels(page: Page, element: Locator): Promise<Pixels> {
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  const png = (await element.screenshot()).toString("base64");
  const { width, height, text } = await page.evaluate(async (source) => {
    const image = new Image();
    image.src = `data:image/png;base64,${source}`;
    await image.decode();
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [image.width, image.height];
    const context = canvas.getContext("2d", { willReadFrequently: true })!;
    context.drawImage(image, 0, 0);
    const { data } = context.getImageData(0, 0, image.width, image.height);
    let text = "";
    for (const byte of data) text += String.fromCharCode(byte);
    return { width: image.width, height: image.height, text: btoa(text) };
  }, png);
  return { width, height, data: Buffer.from(text, "base64") };
}

/** Number of pixels that differ clearly. */
export function difference(a: Pixels, b: Pixels): number {
  if (a.width !== b.width || a.height !== b.height) return Infinity;
  let count = 0;
  for (let k = 0; k < a.data.length; k += 4) {
    const apart = [0, 1, 2].map((c) => Math.abs(a.data[k + c]! - b.data[k + c]!));
    if (Math.max(...apart) > 24) count += 1;
  }
  return count;
}

/** Number of pixels that are clearly colored: bodies are, paper, grid and text are not. */
export function colored(a: Pixels): number {
  let count = 0;
  for (let k = 0; k < a.data.length; k += 4) {
    const rgb = [a.data[k]!, a.data[k + 1]!, a.data[k + 2]!];
    if (Math.max(...rgb) - Math.min(...rgb) > 40) count += 1;
  }
  return count;
}
