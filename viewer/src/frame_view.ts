// The selected frame, large: its picture with switches that are its legend, and what the pointer is over.

import { REJECTED, type Report } from "./data.ts";
import type { Colors } from "./colors.ts";
import { detectionAt, drawFrame, type FrameImages } from "./draw_frame.ts";
import { element, fitCanvas, oncePerPicture, onTheme, themeColor } from "./dom.ts";
import { downloadButton, png } from "./download.ts";
import type { Filter } from "./filter.ts";
import { detectedRegion, objectRegion, wholeFrame, type Region } from "./frame_region.ts";
import { FrameZoom } from "./frame_zoom.ts";
import type { Selection } from "./selection.ts";
import { count, isUnreliable, movedInWords, objectName, short, viewState } from "./words.ts";

/** Milliseconds that a frame is shown while they are played. */
const STEP = 250;

export class FrameView {
  readonly element: HTMLElement;
  private readonly canvas = element("canvas");
  /** What stands on a sheet on which nothing is drawn. */
  private readonly nothing = element("p", { class: "dim" }, "no image and no detections");
  private readonly tip = element("p", { class: "tip", hidden: "" });
  private readonly sheet = element("div", { class: "sheet" }, this.canvas, this.nothing, this.tip);
  private readonly title = element("h2");
  private readonly moved = element("span", { class: "moved dim", title: "from the given to the refined pose of the camera" });
  private readonly play = element("button", { type: "button" }, "▶ Play");
  private timer = 0;
  private readonly redraw = oncePerPicture(() => this.draw());
  private readonly focus = element("input", { type: "checkbox" });
  private readonly reset = element("button", { type: "button", title: "show the whole image (Home)" }, "Reset");
  private readonly zoom: FrameZoom;
  /** The part that was chosen by wheel, drag or keys. */
  private part: Region | null = null;
  private readonly switches = new Map<string, HTMLInputElement>();

  constructor(
    private readonly report: Report,
    private readonly selection: Selection,
    private readonly images: FrameImages,
    private readonly colors: Colors,
    private readonly filter: Filter,
  ) {
    this.canvas.setAttribute("role", "img");
    this.play.addEventListener("click", () => this.togglePlay());
    this.play.hidden = report.frames.length < 2;
    const focus = element("label", { title: "show the selected object large (also: double click)" }, this.focus, " Focus");
    this.focus.addEventListener("change", () => this.showPart(null, this.focus.checked));
    this.reset.addEventListener("click", () => this.showPart(null));
    this.zoom = new FrameZoom(this.canvas, () => this.whole(), () => this.region(), (part) => this.showPart(part));
    const save = downloadButton(report, "PNG", "download the image as PNG", "image.png", () => png(this.canvas));
    this.element = element(
      "section",
      { class: "picture", "aria-label": "Frame" },
      element("header", {}, this.title, this.moved, element("span", { class: "looks" }, focus, this.reset, this.play, save)),
      this.sheet,
      this.legend(),
    );
    this.canvas.addEventListener("click", (event) => {
      if (this.zoom.wasDragged || event.detail > 1) return;
      this.selection.selectInFrame(this.frame()?.detections.object[this.rowAt(event)] ?? -1);
    });
    // The first of both clicks has selected what is there.
    this.canvas.addEventListener("dblclick", () => this.showPart(null, this.selection.object >= 0));
    this.canvas.addEventListener("pointermove", (event) => this.showTip(event));
    this.canvas.addEventListener("pointerleave", () => (this.tip.hidden = true));
    new ResizeObserver(this.redraw).observe(this.sheet);
    selection.onChange((now, before) => {
      if (now.frame !== before.frame) this.fill();
      const [size, last] = [now, before].map(({ frame }) => this.report.frames[frame]?.size.join());
      if (size !== last) this.part = null;
      this.tip.hidden = true;
      this.fillZoom();
      this.redraw();
    });
    colors.onChange(this.redraw);
    filter.onChange(this.redraw);
    onTheme(this.redraw);
    this.fill();
    this.fillZoom();
  }

  private frame(): Report["frames"][number] | undefined {
    return this.report.frames[this.selection.frame];
  }

  /** Switches with the signs that they switch, and the signs that have no switch. */
  private legend(): HTMLElement {
    const { frames, objects } = this.report;
    const some = (of: (detections: Report["frames"][number]["detections"]) => boolean): boolean =>
      frames.some(({ detections }) => of(detections));
    const hasEllipses = some(({ ellipses }) => ellipses.length > 0);
    const list = element("p", { class: "legend" });
    const add = (name: string, sign: string, text: string, title: string): void => {
      const box = element("input", { type: "checkbox", checked: "" });
      box.addEventListener("change", this.redraw);
      this.switches.set(name, box);
      list.append(element("label", { title }, box, element("span", { class: `sign ${sign}` }), text));
    };
    const say = (sign: string, text: string, title: string): void =>
      list.append(element("span", { title }, element("span", { class: `sign ${sign}` }), text));
    add("boxes", "box", hasEllipses ? "boxes and ellipses" : "boxes", "what was detected");
    if (some(({ masks }) => masks.length > 0)) add("masks", "mask", "masks", "the pixels of the detected objects");
    if (some(({ boxes3d }) => boxes3d.length > 0)) {
      add("boxes3d", "box3d", "3D boxes", "the 3D boxes of the detections, each from this image alone");
    }
    if (objects.some((object) => object.body !== null)) {
      add("outlines", "outline", "outlines of bodies", "the estimated bodies, projected into this image");
    }
    if (objects.some((object) => object.truth !== null)) {
      add("truth", "truth", "truth", "the true bodies, projected into this image");
    }
    if (objects.length > 0) add("names", "name", "names", "names of the objects");
    if (some(({ state }) => state.includes(REJECTED))) {
      say("rejected", "rejected", "outliers: detections that the estimator rejected because they contradict the others");
    }
    if (objects.some(isUnreliable)) {
      say("unreliable", "inconsistent", "bodies that do not agree with their views; do not rely on them");
    }
    if (some(({ object }) => object.includes(-1))) {
      say("nobody", "unassigned", "detections without an object: false positives, or objects with too few views");
    }
    return list;
  }

  private isOn(name: string): boolean {
    return this.switches.get(name)?.checked ?? false;
  }

  /** Title and description of the selected frame. */
  private fill(): void {
    const frame = this.frame();
    this.moved.hidden = frame?.given === undefined;
    if (frame === undefined) {
      this.title.textContent = "No frames";
      return;
    }
    const number = frame.detections.object.length;
    this.nothing.hidden = frame.image !== null || number > 0;
    this.title.textContent = `Frame ${frame.id} (${this.selection.frame + 1} of ${this.report.frames.length})`;
    if (frame.given !== undefined) this.moved.textContent = movedInWords(frame.given, this.report.lengthUnit);
    this.canvas.setAttribute("aria-label", `Frame ${frame.id}: ${count(number, "detection")} and outlines of the bodies`);
  }

  /** Shows a part of the image: what the selected object takes of it, this one, or all. */
  private showPart(part: Region | null, isFocus = false): void {
    this.focus.checked = isFocus;
    this.part = part;
    this.tip.hidden = true;
    this.fillZoom();
    this.redraw();
  }

  /** Focusing needs an object, and resetting a part that is shown. */
  private fillZoom(): void {
    this.focus.disabled = this.selection.object < 0;
    this.focus.parentElement?.classList.toggle("dim", this.focus.disabled);
    const isPart = this.part !== null || (this.focus.checked && !this.focus.disabled);
    this.reset.disabled = !isPart;
    // A finger on the whole image scrolls the page.
    this.canvas.classList.toggle("part", isPart);
  }

  private togglePlay(): void {
    if (this.timer !== 0) {
      clearInterval(this.timer);
      this.timer = 0;
    } else {
      this.timer = window.setInterval(() => {
        this.selection.selectFrame((this.selection.frame + 1) % this.report.frames.length);
      }, STEP);
    }
    this.play.textContent = this.timer === 0 ? "▶ Play" : "❚❚ Pause";
  }

  private draw(): void {
    const index = this.selection.frame;
    const region = this.region();
    if (region === null) return;
    const { clientWidth, clientHeight } = this.sheet;
    const style = getComputedStyle(this.sheet);
    const room = (a: string, b: string): number => parseFloat(a) + parseFloat(b);
    const scale = Math.min(
      (clientWidth - room(style.paddingLeft, style.paddingRight)) / region.width,
      (clientHeight - room(style.paddingTop, style.paddingBottom)) / region.height,
    );
    const width = region.width * scale;
    const context = fitCanvas(this.canvas, width, region.height * scale);
    const image = this.images.get(index, this.redraw);
    if (context === null || width <= 0) return;
    drawFrame(context, width, this.report, index, image, this.colors, {
      region,
      boxes: this.isOn("boxes"),
      boxes3d: this.isOn("boxes3d"),
      masks: this.isOn("masks"),
      outlines: this.isOn("outlines"),
      truth: this.isOn("truth"),
      names: this.isOn("names"),
      shows: (object) => this.filter.shows(object),
      selected: this.selection.object,
      blank: themeColor("--sheet"),
      edge: themeColor("--line"),
    });
  }

  /** The part of the frame that is shown. */
  private region(): Region | null {
    const frame = this.frame();
    if (frame === undefined) return null;
    const focused = this.focus.checked ? objectRegion(frame, this.report, this.selection.object) : null;
    return focused ?? this.part ?? this.whole();
  }

  /** All that there is to see of the frame; of a blank sheet the part with the detections. */
  private whole(): Region | null {
    const frame = this.frame();
    if (frame === undefined) return null;
    return frame.image === null ? detectedRegion(frame) : wholeFrame(frame);
  }

  /** The row of the detection under the pointer, or -1. */
  private rowAt(event: MouseEvent): number {
    const [frame, region] = [this.frame(), this.region()];
    if (frame === undefined || region === null) return -1;
    const scale = region.width / this.canvas.clientWidth;
    const [x, y] = [region.x + event.offsetX * scale, region.y + event.offsetY * scale];
    return detectionAt(frame, x, y, (object) => this.filter.shows(object));
  }

  /** Says what the pointer is over, and why that was rejected. */
  private showTip(event: PointerEvent): void {
    if (event.buttons !== 0) {
      this.tip.hidden = true;
      return;
    }
    const frame = this.frame();
    const row = this.rowAt(event);
    this.tip.hidden = frame === undefined || row < 0;
    if (frame === undefined || row < 0) return;
    const { object, state, residual, rejections } = frame.detections;
    const k = object[row] ?? -1;
    const id = this.report.objects[k]?.id;
    const name = objectName(this.report, k);
    const off = residual[row] ?? null;
    const reason = rejections.find(([of]) => of === row)?.[1];
    const parts = [
      id === undefined || id === name ? name : `${name} (${id})`,
      ...(off === null ? [] : [`residual ${short(off)} px`]),
      ...((state[row] ?? 0) === 0 ? [] : [viewState(state[row] ?? 0, reason)]),
    ];
    this.tip.textContent = parts.join(" · ");
    const [place, own] = [this.sheet.getBoundingClientRect(), this.tip.getBoundingClientRect()];
    const left = Math.min(event.clientX - place.left + 12, place.width - own.width - 4);
    const top = event.clientY - place.top + 16;
    this.tip.style.left = `${Math.max(4, left)}px`;
    this.tip.style.top = `${top + own.height > place.height ? top - own.height - 28 : top}px`;
  }
}
