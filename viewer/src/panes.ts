// Separators between the panes of the page: dragged, or moved by arrow keys. Sizes are kept until the tab is closed.

import { element } from "./dom.ts";

/** How a separator changes a size of the page. */
interface Separator {
  /** Custom property of the style sheet. */
  property: string;
  label: string;
  /** Whether it stands upright, between a left and a right pane. */
  upright: boolean;
  min: number;
  max: number;
  /** Whether the size shrinks where the separator moves down or to the right. */
  reversed?: boolean;
  /** The present size in the unit of the property. */
  size: (line: HTMLElement) => number;
  /** The size that puts the separator at a place of the pointer. */
  sizeAt: (event: PointerEvent) => number;
}

/** Size that an arrow key adds, in the unit of the property. */
const KEY_STEP = 2;

function separator(page: HTMLElement, options: Separator): HTMLElement {
  const { property, label, upright, min, max } = options;
  const line = element("div", {
    class: upright ? "separator upright" : "separator",
    role: "separator",
    tabindex: "0",
    "aria-label": label,
    "aria-orientation": upright ? "vertical" : "horizontal",
    "aria-valuemin": `${min}`,
    "aria-valuemax": `${max}`,
    title: `${label}: drag, or arrow keys; double click resets it`,
  });
  const tell = (): void => {
    const now = Math.round(options.size(line));
    line.setAttribute("aria-valuenow", `${Math.min(max, Math.max(min, now))}`);
  };
  const set = (size: number | null): void => {
    const value = size === null ? null : Math.min(max, Math.max(min, size));
    if (value === null) page.style.removeProperty(property);
    else page.style.setProperty(property, value.toFixed(2));
    remember(property, value);
    tell();
  };
  line.addEventListener("pointerdown", (event) => {
    line.setPointerCapture(event.pointerId);
    event.preventDefault();
    line.focus();
  });
  line.addEventListener("pointermove", (event) => {
    if (line.hasPointerCapture(event.pointerId)) set(options.sizeAt(event));
  });
  line.addEventListener("dblclick", () => set(null));
  line.addEventListener("keydown", (event) => {
    const now = options.size(line);
    const arrows = upright ? ["ArrowLeft", "ArrowRight"] : ["ArrowUp", "ArrowDown"];
    const [less, more] = options.reversed ? arrows.reverse() : arrows;
    if (event.key === less) set(now - KEY_STEP);
    else if (event.key === more) set(now + KEY_STEP);
    else if (event.key === "Home") set(min);
    else if (event.key === "End") set(max);
    else if (event.key === "Enter") set(null);
    else return;
    event.preventDefault();
  });
  const kept = recall(property);
  if (kept !== null) page.style.setProperty(property, kept.toFixed(2));
  new ResizeObserver(tell).observe(page);
  return line;
}

/** The separators between the 3D view and what is beside it, and at the image. `views` holds the panes. */
export function separators(page: HTMLElement, views: HTMLElement, isWide: boolean): HTMLElement[] {
  const sheet = (): DOMRect => views.querySelector(".sheet")?.getBoundingClientRect() ?? new DOMRect();
  const height = (pixels: number): number => (100 * pixels) / window.innerHeight;
  return [
    separator(page, {
      property: "--split", label: "Width of the 3D view", upright: true, min: 20, max: 80,
      size: (line) => (100 * line.getBoundingClientRect().left) / page.clientWidth,
      sizeAt: (event) => (100 * event.clientX) / page.clientWidth,
    }),
    // Above a wide image, below another one.
    separator(page, {
      property: "--image-height", label: "Height of the image", upright: false, min: 10, max: 75, reversed: isWide,
      size: () => height(sheet().height),
      sizeAt: (event) => height(isWide ? sheet().bottom - event.clientY : event.clientY - sheet().top),
    }),
  ];
}

function remember(property: string, size: number | null): void {
  try {
    if (size === null) sessionStorage.removeItem(`quadlift${property}`);
    else sessionStorage.setItem(`quadlift${property}`, size.toFixed(2));
  } catch {
    // A page in a sandbox has no storage.
  }
}

function recall(property: string): number | null {
  try {
    const kept = sessionStorage.getItem(`quadlift${property}`);
    return kept !== null && Number.isFinite(Number(kept)) ? Number(kept) : null;
  } catch {
    return null;
  }
}
