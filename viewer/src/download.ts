// Buttons that save what the page shows as a file.

import type { Report } from "./data.ts";
import { element } from "./dom.ts";

/** A button that saves what `make` gives; `name` is the end of the file's name, with its extension. */
export function downloadButton(
  report: Report,
  text: string,
  title: string,
  name: string,
  make: () => Blob | null | Promise<Blob | null>,
): HTMLButtonElement {
  const button = element("button", { type: "button", title, "aria-label": title }, `↓ ${text}`);
  button.addEventListener("click", () => {
    void Promise.resolve(make()).then((blob) => {
      if (blob !== null) save(blob, `${fileName(report.title)}-${name}`);
    });
  });
  return button;
}

/** A canvas as PNG; null where the browser cannot. */
export function png(canvas: HTMLCanvasElement): Promise<Blob | null> {
  return new Promise((done) => canvas.toBlob(done, "image/png"));
}

function save(blob: Blob, name: string): void {
  const url = URL.createObjectURL(blob);
  element("a", { href: url, download: name }).click();
  // The browser has read it by then.
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}

/** A title as a name that every file system takes. */
function fileName(title: string): string {
  return title.replace(/[^\p{L}\p{N}._-]+/gu, "-").replace(/^[-.]+|[-.]+$/g, "").slice(0, 60) || "report";
}
