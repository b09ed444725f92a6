// Zooming into the image of a frame and moving it: by wheel, drag and keys.

import type { Region } from "./frame_region.ts";

/** The part that is `factor` times as large, with the pixel (x, y) in its place; null for the whole. */
export function zoomed(region: Region, whole: Region, x: number, y: number, factor: number): Region | null {
  const width = Math.max(region.width * factor, MIN_SHARE * whole.width);
  if (width >= whole.width) return null;
  const scale = width / region.width;
  return inside({
    x: x + (region.x - x) * scale, y: y + (region.y - y) * scale, width, height: region.height * scale,
  }, whole);
}

/** The part that is moved by so many pixels, as far as the whole reaches. */
export function moved(region: Region, whole: Region, dx: number, dy: number): Region {
  return inside({ ...region, x: region.x + dx, y: region.y + dy }, whole);
}

function inside(region: Region, whole: Region): Region {
  const within = (at: number, size: number, low: number, length: number): number =>
    Math.max(low, Math.min(at, low + length - size));
  return {
    ...region,
    x: within(region.x, region.width, whole.x, whole.width), y: within(region.y, region.height, whole.y, whole.height),
  };
}

/** The smallest part of the image that is shown. */
const MIN_SHARE = 0.02;

/** How much a step of the wheel (100 units) and a key zoom. */
const [WHEEL, KEY] = [1.2, 1.25];

/** Listens to wheel, drags and keys on a canvas that shows `shown()` of `whole()`, and says what is to be shown. */
export class FrameZoom {
  /** Whether the pointer has been dragged since it was pressed: the click that ends it selects nothing. */
  wasDragged = false;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly whole: () => Region | null,
    private readonly shown: () => Region | null,
    private readonly show: (region: Region | null) => void,
  ) {
    canvas.tabIndex = 0;
    canvas.addEventListener("wheel", (event) => {
      const factor = WHEEL ** (event.deltaY * (event.deltaMode === 0 ? 0.01 : 0.3));
      const [region, all] = [shown(), whole()];
      if (region === null || all === null) return;
      // The wheel scrolls the page where there is nothing to zoom out of.
      if (factor > 1 && region.width >= all.width) return;
      event.preventDefault();
      const scale = region.width / canvas.clientWidth;
      show(zoomed(region, all, region.x + event.offsetX * scale, region.y + event.offsetY * scale, factor));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => this.onKey(event));
    this.listenToDrags();
  }

  private listenToDrags(): void {
    const { canvas } = this;
    let last: [number, number] | null = null;
    let way = 0;
    canvas.addEventListener("pointerdown", (event) => {
      this.wasDragged = false;
      [last, way] = [[event.clientX, event.clientY], 0];
    });
    canvas.addEventListener("pointermove", (event) => {
      const [region, all] = [this.shown(), this.whole()];
      if (last === null || event.buttons === 0 || region === null || all === null || region.width >= all.width) return;
      const [dx, dy] = [event.clientX - last[0], event.clientY - last[1]];
      last = [event.clientX, event.clientY];
      way += Math.hypot(dx, dy);
      if (way < 4) return;
      this.wasDragged = true;
      canvas.setPointerCapture(event.pointerId);
      const scale = region.width / canvas.clientWidth;
      this.show(moved(region, all, -dx * scale, -dy * scale));
    });
    canvas.addEventListener("pointerup", () => (last = null));
    canvas.addEventListener("pointercancel", () => (last = null));
  }

  private onKey(event: KeyboardEvent): void {
    const [region, all] = [this.shown(), this.whole()];
    if (region === null || all === null || event.ctrlKey || event.metaKey) return;
    const [x, y] = [region.x + region.width / 2, region.y + region.height / 2];
    const [dx, dy] = [0.15 * region.width, 0.15 * region.height];
    switch (event.key) {
      case "+": case "=": this.show(zoomed(region, all, x, y, 1 / KEY)); break;
      case "-": this.show(zoomed(region, all, x, y, KEY)); break;
      case "Home": this.show(null); break;
      case "ArrowLeft": this.show(moved(region, all, -dx, 0)); break;
      case "ArrowRight": this.show(moved(region, all, dx, 0)); break;
      case "ArrowUp": this.show(moved(region, all, 0, -dy)); break;
      case "ArrowDown": this.show(moved(region, all, 0, dy)); break;
      default: return;
    }
    event.preventDefault();
  }
}
