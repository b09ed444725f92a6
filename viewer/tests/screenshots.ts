// Takes the pictures of docs/report.md of a rendered scene: `npm run screenshots` in viewer/. Look at them.

import { join } from "node:path";
import { folder, launch, open, project, quadlift } from "./browser.ts";

quadlift("synth", "-q", "-o", "scene.json", "--render", "--objects", "7", "--views", "24", "--seed", "5");
quadlift("localize", "-q", "scene.json", "-o", "estimate.json");
quadlift("evaluate", "-q", "estimate.json", "scene.json", "--report", "report.html");
const browser = await launch();
for (const [name, look] of [
  ["report", { width: 1600, height: 1000 }],
  ["report-narrow", { width: 390, height: 844, dark: true }],
] as const) {
  const { page } = await open(browser, "report.html", look);
  await page.getByRole("button", { name: "Objects" }).click();
  if (look.width > 1000) await page.locator("table[aria-label=Objects] tbody tr").nth(3).click();
  await page.waitForTimeout(500);
  const path = join(project, "docs/images", `${name}.jpg`);
  await page.screenshot({ path, type: "jpeg", quality: 85, fullPage: look.width < 1000 });
  console.log(path);
}
await browser.close();
console.log(`made in ${folder}`);
