// Takes the pictures of docs/report.md of the demo: `npm run screenshots` in viewer/. Look at them.

import { join } from "node:path";
import { launch, open, project, quadlift } from "./browser.ts";

quadlift("demo", "-q", "--out", "demo");
const browser = await launch();
for (const [name, path, row, look] of [
  ["report", "demo/report.html", 3, { width: 1600, height: 1000 }],
  ["report-narrow", "demo/report.html", -1, { width: 390, height: 844, dark: true }],
] as const) {
  const { page } = await open(browser, path, look);
  if (row >= 0) await page.locator("table[aria-label=Objects] tbody tr").nth(row).click();
  await page.waitForTimeout(500);
  const file = join(project, "docs/images", `${name}.jpg`);
  await page.screenshot({ path: file, type: "jpeg", quality: 82, fullPage: look.width < 1000 });
  console.log(file);
}
await browser.close();
