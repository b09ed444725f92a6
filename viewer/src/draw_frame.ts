// Draws one frame: its image or a blank sheet, the detections and the outlines of the bodies.

import { REJECTED, type Frame, type Report } from "./data.ts";
import type { Colors } from "./colors.ts";
import { drawTags, type Tag } from "./draw_tags.ts";
import type { Region } from "./frame_region.ts";
import { detectionExtent } from "./object_views.ts";
import { outline, type Outline } from "./outline.ts";
import { Pen } from "./pen.ts";
import { isUnreliable, objectName } from "./words.ts";

export interface FrameStyle {
  /** The part that is shown. */
  region: Region;
  boxes: boolean;
  /** 3D boxes of the detections. */
  boxes3d: boolean;
  /** Masks of the detections. */
  masks: boolean;
  /** Outlines of the bodies; not in small pictures of scenes with many objects. */
  outlines: boolean;
  truth: boolean;
  /** Names of the objects. */
  names: boolean;
  /** Whether an object is shown. */
  shows: (object: number) => boolean;
  /** Index of the selected object, -1 for none: the others step back. */
  selected: number;
  /** Color of the sheet where there is no image. */
  blank: string;
  /** Color of its edge. */
  edge: string;
}

/** The images of frames as the browser has decoded them; only those that are looked at. */
export class FrameImages {
  private readonly images = new Map<number, HTMLImageElement>();

  constructor(private readonly frames: Frame[]) {}

  /** The image of a frame, when it is ready; otherwise `ready` is called once it is. */
  get(index: number, ready: () => void): HTMLImageElement | null {
    const source = this.frames[index]?.image;
    if (source == null) return null;
    let image = this.images.get(index);
    if (image === undefined) {
      image = new Image();
      image.src = source;
      this.images.set(index, image);
    }
    if (image.complete && image.naturalWidth > 0) return image;
    image.addEventListener("load", ready, { once: true });
    return null;
  }
}

/** Draws a part of a frame into a canvas of this width (CSS pixels); its height follows from the part. */
export function drawFrame(
  context: CanvasRenderingContext2D,
  width: number,
  report: Report,
  index: number,
  image: HTMLImageElement | null,
  colors: Colors,
  style: FrameStyle,
): void {
  const frame = report.frames[index];
  if (frame === undefined) return;
  const { region } = style;
  const scale = width / region.width;
  context.save();
  context.clearRect(0, 0, width, scale * region.height);
  context.translate(-region.x * scale, -region.y * scale);
  const [w, h] = frame.size.map((side) => side * scale) as [number, number];
  context.fillStyle = style.blank;
  context.fillRect(0, 0, w, h);
  if (frame.image === null) {
    context.strokeStyle = style.edge;
    context.lineWidth = 1;
    context.strokeRect(0.5, 0.5, w - 1, h - 1);
  }
  if (image !== null) context.drawImage(image, 0, 0, w, h);
  const pen = new Pen(context, scale, width < 200 ? 1 : 1.5);
  const { object, state } = frame.detections;
  const strength = (k: number): number => (style.selected < 0 || style.selected === k ? 1 : 0.25);
  // The selected object comes last and so lies on top.
  const rows = object.map((_, row) => row).filter((row) => style.shows(object[row] ?? -1));
  rows.sort((a, b) => Number(object[a] === style.selected) - Number(object[b] === style.selected));
  if (style.masks) {
    for (const [row, height, runs] of frame.detections.masks) {
      const k = object[row] ?? -1;
      if (style.shows(k)) pen.mask(runs, height, colors.ofObject(k), strength(k));
    }
  }
  const shapes = new Map<number, Outline>();
  for (const row of rows) {
    const k = object[row] ?? -1;
    const body = report.objects[k]?.body;
    const shape = body == null ? null : outline(frame.projection, body);
    if (!style.outlines || shape === null) continue;
    shapes.set(row, shape);
    pen.body(shape, colors.ofObject(k), strength(k), k === style.selected, isUnreliable(report.objects[k]));
  }
  for (const row of rows) {
    const k = object[row] ?? -1;
    const truth = report.objects[k]?.truth;
    if (style.truth && truth != null) {
      const shape = outline(frame.projection, truth);
      if (shape !== null) pen.truth(shape, strength(k));
    }
  }
  if (style.boxes3d) {
    for (const [row, box] of frame.detections.boxes3d) {
      const k = object[row] ?? -1;
      const shape = style.shows(k) ? outline(frame.projection, box) : null;
      if (shape !== null) pen.box3d(shape, colors.ofObject(k), strength(k));
    }
  }
  if (style.boxes) drawDetections(pen, frame, rows, colors, strength);
  if (style.names) {
    const named = rows.filter((row) => (object[row] ?? -1) >= 0).reverse();
    const tags = named.map((row): Tag => {
      const k = object[row] ?? -1;
      let [x0, y0, x1, y1] = detectionExtent(frame, row);
      if (x1 <= x0) {
        const border = shapes.get(row)?.border ?? [];
        [x0, x1] = [Math.min(...border.map(([x]) => x)), Math.max(...border.map(([x]) => x))];
        [y0, y1] = [Math.min(...border.map(([, y]) => y)), Math.max(...border.map(([, y]) => y))];
      }
      const rejected = state[row] === REJECTED ? "✕ " : "";
      return {
        text: `${rejected}${objectName(report, k)}`, color: colors.ofObject(k), box: [x0, y0, x1, y1],
        must: k === style.selected, strength: strength(k),
      };
    });
    context.restore();
    context.save();
    drawTags(context, tags, region, scale, width);
  }
  context.restore();
}

/** Boxes and ellipses, those that were rejected with a cross. */
function drawDetections(
  pen: Pen,
  frame: Frame,
  rows: number[],
  colors: Colors,
  strength: (object: number) => number,
): void {
  const { object, state, box } = frame.detections;
  const ellipses = new Map(frame.detections.ellipses.map(([row, ...ellipse]) => [row, ellipse]));
  for (const row of rows) {
    const k = object[row] ?? -1;
    const rejected = state[row] === REJECTED;
    const edges = box.slice(4 * row, 4 * row + 4);
    if (edges.every((x) => x !== null)) pen.box(edges as number[], colors.ofObject(k), strength(k), rejected);
    const ellipse = ellipses.get(row);
    if (ellipse !== undefined) pen.ellipse(ellipse, colors.ofObject(k), strength(k), rejected);
    const [, y0, x1] = detectionExtent(frame, row);
    if (rejected) pen.cross(x1, y0, strength(k));
  }
}

/** The row of the smallest detection of a frame at a pixel, among those that are shown; or -1. */
export function detectionAt(frame: Frame, x: number, y: number, shows: (object: number) => boolean): number {
  const { object, box, ellipses } = frame.detections;
  let [best, area] = [-1, Infinity];
  const offer = (row: number, size: number): void => {
    if (size < area && shows(object[row] ?? -1)) [best, area] = [row, size];
  };
  object.forEach((_, row) => {
    const [x0, y0, x1, y1] = box.slice(4 * row, 4 * row + 4);
    if (x0 == null || y0 == null || x1 == null || y1 == null) return;
    if (x >= x0 && x <= x1 && y >= y0 && y <= y1) offer(row, (x1 - x0) * (y1 - y0));
  });
  for (const [row, cx, cy, a, b, angle] of ellipses) {
    const [dx, dy, c, s] = [x - cx, y - cy, Math.cos(angle), Math.sin(angle)];
    const inside = ((dx * c + dy * s) / a) ** 2 + ((dy * c - dx * s) / b) ** 2 <= 1;
    if (inside) offer(row, 4 * a * b);
  }
  return best;
}
