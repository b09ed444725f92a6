// Making elements. Text from the report goes into the page through here, and only as text, never as HTML.

type Child = Node | string;

/** An element with attributes and children; strings become text. */
export function element<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Record<string, string> = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/** Names and values. */
export function factList(facts: [string, string][]): HTMLElement {
  return element(
    "dl",
    {},
    ...facts.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)]),
  );
}

/** A canvas fitted to its place on the screen, and its context in CSS pixels. */
export function fitCanvas(canvas: HTMLCanvasElement, width: number, height: number): CanvasRenderingContext2D | null {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  canvas.width = Math.max(1, Math.round(width * ratio));
  canvas.height = Math.max(1, Math.round(height * ratio));
  canvas.style.width = `${width}px`;
  canvas.style.height = `${height}px`;
  // Drawn by the processor: thousands of thin lines are slower on most graphics cards, and much slower without one.
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context?.scale(ratio, ratio);
  return context;
}

/** Calls `change` now and whenever the page turns from light to dark or back. */
export function onTheme(change: () => void): void {
  change();
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", change);
}

/** A color of the style sheet. */
export function themeColor(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

/** Runs `work` at most once before the next picture, however often it is asked for. */
export function oncePerPicture(work: () => void): () => void {
  let asked = false;
  return () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      work();
    });
  };
}
