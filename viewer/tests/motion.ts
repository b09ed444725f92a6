// Takes the frames of the moving picture of the README, of the report of the demo: `scripts/moving_picture.sh`.

import { mkdirSync } from "node:fs";
import { join, resolve } from "node:path";
import { launch, open, quadlift } from "./browser.ts";

/** Folder of the frames. */
const folder = resolve(process.argv[2] ?? ".");
/** What is selected, and the images that are then shown. */
const SELECTED = "mug 5";
const SHOWN = ["000000", "000002", "000004", "000006", "000008"];

mkdirSync(folder, { recursive: true });
quadlift("demo", "-q", "--out", "demo");
const browser = await launch();
const { page } = await open(browser, "demo/report.html", { width: 1280, height: 720 });
const view = (await page.locator("canvas").first().boundingBox())!;
const [x, y] = [view.x + 0.5 * view.width, view.y + 0.75 * view.height];
let count = 0;

/** Takes a frame as often as it is shown. */
async function take(times = 1): Promise<void> {
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  for (let k = 0; k < times; k += 1) {
    await page.screenshot({ path: join(folder, `${String(count).padStart(3, "0")}.png`) });
    count += 1;
  }
}

/** Turns the view by so many pixels of the mouse, slow at both ends. */
async function turn(pixels: number, frames: number, meanwhile: (k: number) => Promise<void> = async () => {}): Promise<void> {
  await page.mouse.move(x - pixels / 2, y);
  await page.mouse.down();
  for (let k = 1; k <= frames; k += 1) {
    await page.mouse.move(x - pixels / 2 + (pixels * (1 - Math.cos((Math.PI * k) / frames))) / 2, y);
    await meanwhile(k);
    await take();
  }
  await page.mouse.up();
}

await take(4);
await turn(110, 24);
await page.locator("td", { hasText: SELECTED }).first().click();
await take(8);
const object = new URL(page.url()).hash.replace(/&frame=.*/, "");
await turn(-110, 24, async (k) => {
  const frame = SHOWN[Math.floor((k * SHOWN.length) / 25)];
  if (k % 5 === 0) await page.evaluate((hash) => { location.hash = hash; }, `${object}&frame=${frame}`);
});
await take(8);
await browser.close();
console.log(`${count} frames`);
