// Draws one frame: its image or a blank sheet, the detections and the outlines of the bodies.

import { REJECTED, type Frame, type Report } from "./data.ts";
import type { Colors } from "./colors.ts";
import { outline, type Outline } from "./outline.ts";

/** A part of a frame, in pixels of the frame; it may reach beyond. */
export interface Region {
  x: number;
  y: number;
  width: number;
  height: number;
}

/** The whole frame. */
export function wholeFrame(frame: Frame): Region {
  return { x: 0, y: 0, width: frame.size[0], height: frame.size[1] };
}

/** The part of a frame, of its proportions, where its detections are; the whole where they fill most of it. */
export function detectedRegion(frame: Frame): Region {
  const { box, ellipses } = frame.detections;
  let [x0, y0, x1, y1] = [Infinity, Infinity, -Infinity, -Infinity];
  const hold = (x: number, y: number): void => {
    [x0, y0, x1, y1] = [Math.min(x0, x), Math.min(y0, y), Math.max(x1, x), Math.max(y1, y)];
  };
  for (let k = 0; k < box.length; k += 2) if (box[k] != null) hold(box[k] as number, box[k + 1] as number);
  for (const [, x, y, a, b] of ellipses) {
    hold(x - Math.max(a, b), y - Math.max(a, b));
    hold(x + Math.max(a, b), y + Math.max(a, b));
  }
  const [w, h] = frame.size;
  const share = 1.3 * Math.max((x1 - x0) / w, (y1 - y0) / h);
  // Without detections the share is no positive number.
  if (!(share > 0 && share < 0.7)) return wholeFrame(frame);
  const [width, height] = [share * w, share * h];
  return { x: (x0 + x1 - width) / 2, y: (y0 + y1 - height) / 2, width, height };
}

export interface FrameStyle {
  /** The part that is shown. */
  region: Region;
  /** Outlines, or the detections alone (for small pictures of scenes with many objects). */
  outlines: boolean;
  truth: boolean;
  /** Index of the selected object, -1 for none: the others step back. */
  selected: number;
  /** Colour of the sheet where there is no image. */
  blank: string;
  /** Colour of its edge. */
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
  const { object, state, box } = frame.detections;
  const strength = (k: number): number => (style.selected < 0 || style.selected === k ? 1 : 0.25);
  // The selected object comes last and so lies on top.
  const rows = object.map((_, row) => row);
  rows.sort((a, b) => Number(object[a] === style.selected) - Number(object[b] === style.selected));
  for (const row of rows) {
    const k = object[row] ?? -1;
    const body = report.objects[k]?.body;
    if (!style.outlines || body == null) continue;
    const shape = outline(frame.projection, body);
    if (shape !== null) pen.body(shape, colors.ofObject(k), strength(k), k === style.selected);
  }
  for (const row of rows) {
    const k = object[row] ?? -1;
    const truth = report.objects[k]?.truth;
    if (style.truth && truth != null) {
      const shape = outline(frame.projection, truth);
      if (shape !== null) pen.truth(shape, strength(k));
    }
    const edges = box.slice(4 * row, 4 * row + 4);
    const rejected = state[row] === REJECTED;
    if (edges.every((x) => x !== null)) pen.box(edges as number[], colors.ofObject(k), strength(k), rejected);
  }
  for (const [row, x, y, a, b, angle] of frame.detections.ellipses) {
    const k = object[row] ?? -1;
    pen.ellipse([x, y, a, b, angle], colors.ofObject(k), strength(k), state[row] === REJECTED);
  }
  context.restore();
}

/** Draws in pixels of the frame with lines whose width is in pixels of the screen. */
class Pen {
  constructor(
    private readonly context: CanvasRenderingContext2D,
    private readonly scale: number,
    private readonly line: number,
  ) {}

  body(shape: Outline, color: string, strength: number, strong: boolean): void {
    this.path(shape.border);
    this.context.globalAlpha = (strong ? 0.45 : 0.3) * strength;
    this.context.fillStyle = color;
    this.context.fill();
    this.stroke(color, strength, strong ? 2.2 : 1, []);
    if (shape.lines.length > 0) {
      this.context.beginPath();
      for (const [a, b] of shape.lines) {
        this.context.moveTo(a[0] * this.scale, a[1] * this.scale);
        this.context.lineTo(b[0] * this.scale, b[1] * this.scale);
      }
      this.stroke(color, strength, strong ? 1.4 : 0.7, []);
    }
  }

  truth(shape: Outline, strength: number): void {
    this.path(shape.border);
    this.stroke("#ffffff", 0.7 * strength, 1.6, []);
    this.path(shape.border);
    this.stroke("#000000", strength, 0.8, [2, 3]);
  }

  box([x0, y0, x1, y1]: number[], color: string, strength: number, rejected: boolean): void {
    const s = this.scale;
    this.context.beginPath();
    this.context.rect((x0 ?? 0) * s, (y0 ?? 0) * s, ((x1 ?? 0) - (x0 ?? 0)) * s, ((y1 ?? 0) - (y0 ?? 0)) * s);
    this.measurement(color, strength, rejected);
  }

  ellipse([x, y, a, b, angle]: number[], color: string, strength: number, rejected: boolean): void {
    const s = this.scale;
    this.context.beginPath();
    this.context.ellipse((x ?? 0) * s, (y ?? 0) * s, (a ?? 0) * s, (b ?? 0) * s, angle ?? 0, 0, 2 * Math.PI);
    this.measurement(color, strength, rejected);
  }

  /** A dark line under the coloured one: it can be seen on any image. */
  private measurement(color: string, strength: number, rejected: boolean): void {
    if (this.line > 1) this.stroke("#000000", 0.5 * strength, 2, []);
    if (rejected) this.stroke("#ff2020", strength, 1.3, [6, 4]);
    else this.stroke(color, strength, 1, []);
  }

  private path(points: [number, number][]): void {
    this.context.beginPath();
    for (const [x, y] of points) this.context.lineTo(x * this.scale, y * this.scale);
    this.context.closePath();
  }

  private stroke(color: string, alpha: number, width: number, dash: number[]): void {
    this.context.globalAlpha = alpha;
    this.context.strokeStyle = color;
    this.context.lineWidth = width * this.line;
    this.context.setLineDash(dash);
    this.context.stroke();
    this.context.setLineDash([]);
    this.context.globalAlpha = 1;
  }
}

/** The smallest detection of a frame at a pixel: the index of its object, or -1. */
export function objectAt(frame: Frame, x: number, y: number): number {
  const { object, box, ellipses } = frame.detections;
  let [best, area] = [-1, Infinity];
  const offer = (k: number, size: number): void => {
    if (k >= 0 && size < area) [best, area] = [k, size];
  };
  object.forEach((k, row) => {
    const [x0, y0, x1, y1] = box.slice(4 * row, 4 * row + 4);
    if (x0 == null || y0 == null || x1 == null || y1 == null) return;
    if (x >= x0 && x <= x1 && y >= y0 && y <= y1) offer(k, (x1 - x0) * (y1 - y0));
  });
  for (const [row, cx, cy, a, b, angle] of ellipses) {
    const [dx, dy, c, s] = [x - cx, y - cy, Math.cos(angle), Math.sin(angle)];
    const inside = ((dx * c + dy * s) / a) ** 2 + ((dy * c - dx * s) / b) ** 2 <= 1;
    if (inside) offer(object[row] ?? -1, 4 * a * b);
  }
  return best;
}
