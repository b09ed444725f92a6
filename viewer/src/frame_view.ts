// The selected frame, large: its picture, and the table of what was measured in it.

import { REJECTED, type Report } from "./data.ts";
import type { Colors } from "./colors.ts";
import { detectedRegion, drawFrame, objectAt, wholeFrame, type FrameImages, type Region } from "./draw_frame.ts";
import { element, fitCanvas, oncePerPicture, onTheme, themeColor } from "./dom.ts";
import type { Selection } from "./selection.ts";
import { Table } from "./table.ts";
import { count, short, viewState } from "./words.ts";

/** A detection of the selected frame. */
interface Measured {
  object: number;
  state: number;
  residual: number | null;
  /** Why it was rejected. */
  reason: string | undefined;
}

export class FrameView {
  readonly picture: HTMLElement;
  readonly measurements: HTMLElement;
  private readonly canvas = element("canvas");
  /** What stands on a sheet on which nothing is drawn. */
  private readonly nothing = element("p", { class: "dim" }, "no image and no detections");
  private readonly sheet = element("div", { class: "sheet" }, this.canvas, this.nothing);
  private readonly title = element("h2");
  private readonly table: Table<Measured>;
  /** Largest residual of the frame, for bars. */
  private largest = 1;
  private readonly redraw = oncePerPicture(() => this.draw());
  private readonly truth = element("input", { type: "checkbox", checked: "" });
  private readonly zoom = element("input", { type: "checkbox" });

  constructor(
    private readonly report: Report,
    private readonly selection: Selection,
    private readonly images: FrameImages,
    private readonly colors: Colors,
  ) {
    this.canvas.setAttribute("role", "img");
    const choices = element("span", {}, element("label", {}, this.zoom, " zoom in"));
    if (report.objects.some((object) => object.truth !== null)) {
      choices.append(" ", element("label", {}, this.truth, " truth"));
    }
    for (const choice of [this.zoom, this.truth]) choice.addEventListener("change", this.redraw);
    // On a blank sheet there is nothing to see but the detections.
    this.zoom.checked = report.frames.every((frame) => frame.image === null);
    this.picture = element(
      "section",
      { class: "picture", "aria-label": "Frame" },
      element("header", {}, this.title, choices),
      this.sheet,
    );
    this.table = new Table<Measured>("Detections of this frame", this.columns(), (key) => selection.selectObject(key));
    this.measurements = element("section", { class: "measurements", "aria-label": "Residuals" }, this.table.element);
    this.canvas.addEventListener("click", (event) => this.pick(event));
    new ResizeObserver(this.redraw).observe(this.sheet);
    selection.onChange((now, before) => {
      if (now.frame !== before.frame) this.fill();
      this.table.mark(now.object);
      this.redraw();
    });
    onTheme(this.redraw);
    this.fill();
  }

  private columns(): ConstructorParameters<typeof Table<Measured>>[1] {
    const { objects } = this.report;
    return [
      {
        title: "object",
        value: (row) => objects[row.object]?.id ?? null,
        text: (row) => objects[row.object]?.id ?? "(not known)",
        mark: (row) => this.colors.ofObject(row.object),
      },
      {
        title: "residual",
        hint: "root mean square distance between measured and predicted edges, pixels",
        value: (row) => row.residual,
        text: (row) => (row.residual === null ? "–" : `${short(row.residual)} px`),
        bar: (row) => (row.residual ?? 0) / this.largest,
        number: true,
        style: (row) => (row.state === REJECTED ? "bad" : ""),
      },
      {
        title: "view",
        value: (row) => row.state,
        text: (row) => viewState(row.state, row.reason),
        style: (row) => (row.state === REJECTED ? "bad" : ""),
      },
    ];
  }

  /** Fills title and table for the selected frame. */
  private fill(): void {
    const frame = this.report.frames[this.selection.frame];
    if (frame === undefined) {
      this.title.textContent = "No frames";
      return;
    }
    const { object, state, residual } = frame.detections;
    const reasons = new Map(frame.detections.rejections);
    const rows = object.map((k, row) => (
      { object: k, state: state[row] ?? 0, residual: residual[row] ?? null, reason: reasons.get(row) }
    ));
    this.largest = rows.reduce((most, row) => Math.max(most, row.residual ?? 0), 1e-9);
    this.table.show(rows, object);
    this.table.mark(this.selection.object);
    this.nothing.hidden = frame.image !== null || object.length > 0;
    const text = `Frame ${frame.id}`;
    this.title.textContent = text;
    this.canvas.setAttribute("aria-label", `${text}: ${count(object.length, "detection")} and outlines of the bodies`);
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
      outlines: true,
      truth: this.truth.checked,
      selected: this.selection.object,
      blank: themeColor("--sheet"),
      edge: themeColor("--line"),
    });
  }

  /** The part of the frame that is shown. */
  private region(): Region | null {
    const frame = this.report.frames[this.selection.frame];
    if (frame === undefined) return null;
    return this.zoom.checked ? detectedRegion(frame) : wholeFrame(frame);
  }

  private pick(event: MouseEvent): void {
    const frame = this.report.frames[this.selection.frame];
    const region = this.region();
    if (frame === undefined || region === null) return;
    const scale = region.width / this.canvas.clientWidth;
    const [x, y] = [region.x + event.offsetX * scale, region.y + event.offsetY * scale];
    this.selection.selectObject(objectAt(frame, x, y));
  }
}
