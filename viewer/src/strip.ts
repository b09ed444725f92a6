// The strip of frames: small pictures side by side, of which only those in sight are drawn.

import { REJECTED, type Report } from "./data.ts";
import type { Colors } from "./colors.ts";
import { drawFrame, type FrameImages } from "./draw_frame.ts";
import { element, fitCanvas, oncePerPicture, onTheme, themeColor } from "./dom.ts";
import type { Filter } from "./filter.ts";
import { detectedRegion, wholeFrame } from "./frame_region.ts";
import type { Selection } from "./selection.ts";

/** Size of a small picture and of the place it takes, CSS pixels. */
const [WIDTH, HEIGHT, PLACE] = [112, 72, 120];

export class Strip {
  readonly element: HTMLElement;
  private readonly track: HTMLElement;
  private readonly items = new Map<number, HTMLElement>();
  private readonly redraw = oncePerPicture(() => this.draw());

  constructor(
    private readonly report: Report,
    private readonly selection: Selection,
    private readonly images: FrameImages,
    private readonly colors: Colors,
    private readonly filter: Filter,
  ) {
    this.track = element("div", { class: "track", role: "presentation" });
    this.track.style.width = `${PLACE * report.frames.length}px`;
    this.element = element(
      "div",
      { class: "strip", role: "listbox", tabindex: "0", "aria-label": "Frames", "aria-orientation": "horizontal" },
      this.track,
    );
    this.element.addEventListener("scroll", this.redraw);
    this.element.addEventListener("keydown", (event) => this.onKey(event));
    this.element.addEventListener("click", (event) => {
      const item = event.target instanceof Element ? event.target.closest<HTMLElement>("[data-frame]") : null;
      if (item !== null) selection.selectFrame(Number(item.dataset["frame"]));
    });
    new ResizeObserver(this.redraw).observe(this.element);
    // A link may have selected another frame than the first one.
    requestAnimationFrame(() => this.reveal());
    selection.onChange((now, before) => {
      if (now.object !== before.object) this.forget();
      if (now.frame !== before.frame) this.reveal();
      this.redraw();
    });
    const again = (): void => {
      this.forget();
      this.redraw();
    };
    onTheme(again);
    colors.onChange(again);
    filter.onChange(again);
  }

  /** Scrolls until the selected frame is in sight. */
  private reveal(): void {
    const left = PLACE * this.selection.frame;
    const { scrollLeft, clientWidth } = this.element;
    if (left < scrollLeft || left + PLACE > scrollLeft + clientWidth) {
      this.element.scrollLeft = left - (clientWidth - PLACE) / 2;
    }
  }

  private forget(): void {
    for (const item of this.items.values()) item.remove();
    this.items.clear();
  }

  private draw(): void {
    const { scrollLeft, clientWidth } = this.element;
    const first = Math.max(0, Math.floor(scrollLeft / PLACE) - 2);
    const last = Math.min(this.report.frames.length - 1, Math.ceil((scrollLeft + clientWidth) / PLACE) + 2);
    for (const [index, item] of this.items) {
      if (index >= first && index <= last) continue;
      item.remove();
      this.items.delete(index);
    }
    for (let index = first; index <= last; index++) {
      let item = this.items.get(index);
      if (item === undefined) {
        item = this.item(index);
        this.items.set(index, item);
        this.track.append(item);
      }
      item.setAttribute("aria-selected", `${index === this.selection.frame}`);
    }
    this.element.setAttribute("aria-activedescendant", `frame-${this.selection.frame}`);
  }

  private item(index: number): HTMLElement {
    const frame = this.report.frames[index];
    const canvas = element("canvas");
    const seen = frame === undefined ? -1 : frame.detections.object.indexOf(this.selection.object);
    const shown = this.selection.object >= 0 && seen >= 0;
    const rejected = shown && frame?.detections.state[seen] === REJECTED;
    const label = element("span", { class: "label" }, frame?.id ?? "");
    const item = element("div", {
      class: `frame${shown ? (rejected ? " rejected" : " seen") : ""}`,
      id: `frame-${index}`,
      role: "option",
      "data-frame": `${index}`,
      "aria-label": `frame ${frame?.id ?? ""}${rejected ? ", rejected" : ""}`,
    }, canvas, label);
    item.style.left = `${PLACE * index}px`;
    this.paint(canvas, index);
    return item;
  }

  private paint(canvas: HTMLCanvasElement, index: number): void {
    const frame = this.report.frames[index];
    if (frame === undefined) return;
    // A blank frame shows where its detections are; an image is shown as it is.
    const region = frame.image === null ? detectedRegion(frame) : wholeFrame(frame);
    const scale = Math.min(WIDTH / region.width, HEIGHT / region.height);
    const context = fitCanvas(canvas, region.width * scale, region.height * scale);
    const image = this.images.get(index, () => this.paint(canvas, index));
    if (context === null) return;
    drawFrame(context, region.width * scale, this.report, index, image, this.colors, {
      region,
      // Outlines of hundreds of objects in a small picture are a blot.
      outlines: this.report.objects.length <= 60,
      boxes: true,
      boxes3d: false,
      masks: false,
      truth: false,
      names: false,
      shows: (object) => this.filter.shows(object),
      selected: this.selection.object,
      blank: themeColor("--sheet"),
      edge: themeColor("--line"),
    });
  }

  private onKey(event: KeyboardEvent): void {
    const last = this.report.frames.length - 1;
    const moves: Record<string, number> = {
      ArrowRight: this.selection.frame + 1,
      ArrowLeft: this.selection.frame - 1,
      PageDown: this.selection.frame + 10,
      PageUp: this.selection.frame - 10,
      Home: 0,
      End: last,
    };
    const next = moves[event.key];
    if (next === undefined || last < 0) return;
    event.preventDefault();
    this.selection.selectFrame(Math.min(Math.max(next, 0), last));
  }
}
