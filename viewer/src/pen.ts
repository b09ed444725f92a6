// Draws bodies and detections into the picture of a frame.

import type { Outline } from "./outline.ts";

/** Distance of the lines of a hatching, pixels. */
const HATCH = 7;

/** Draws in pixels of the frame with lines whose width is in pixels of the screen. */
export class Pen {
  constructor(
    private readonly context: CanvasRenderingContext2D,
    private readonly scale: number,
    private readonly line: number,
  ) {}

  /** An estimated body: filled; hatched and dashed where its views do not agree with it. */
  body(shape: Outline, color: string, strength: number, strong: boolean, unreliable: boolean): void {
    if (unreliable) {
      this.hatch(shape.border, color, strength);
    } else {
      this.path(shape.border);
      this.context.globalAlpha = (strong ? 0.45 : 0.3) * strength;
      this.context.fillStyle = color;
      this.context.fill();
    }
    this.path(shape.border);
    this.stroke(color, strength, strong ? 2.2 : 1.2, unreliable ? [7, 4] : []);
    if (unreliable) return;
    if (shape.lines.length > 0) {
      this.context.beginPath();
      for (const [a, b] of shape.lines) {
        this.context.moveTo(a[0] * this.scale, a[1] * this.scale);
        this.context.lineTo(b[0] * this.scale, b[1] * this.scale);
      }
      this.stroke(color, strength, strong ? 1.4 : 0.7, []);
    }
  }

  /** Slanting lines inside of a border. */
  private hatch(border: [number, number][], color: string, strength: number): void {
    const { context, scale } = this;
    const [xs, ys] = [border.map(([x]) => x * scale), border.map(([, y]) => y * scale)];
    const [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    // A body that reaches far beyond the image needs no thousands of lines.
    const step = Math.max(HATCH, (x1 - x0 + y1 - y0) / 400);
    context.save();
    this.path(border);
    context.clip();
    context.beginPath();
    for (let x = x0 - (y1 - y0); x < x1; x += step) {
      context.moveTo(x, y1);
      context.lineTo(x + y1 - y0, y0);
    }
    this.stroke(color, 0.7 * strength, 0.8, []);
    context.restore();
  }

  /** The edges of a measured 3D box, dashed: those of estimated bodies are solid. */
  box3d(shape: Outline, color: string, strength: number): void {
    this.context.beginPath();
    for (const [a, b] of shape.lines) {
      this.context.moveTo(a[0] * this.scale, a[1] * this.scale);
      this.context.lineTo(b[0] * this.scale, b[1] * this.scale);
    }
    if (this.line > 1) this.stroke("#000000", 0.4 * strength, 1.8, [6, 3]);
    this.stroke(color, strength, 1, [6, 3]);
  }

  mask(runs: number[], height: number, color: string, strength: number): void {
    const s = this.scale;
    this.context.globalAlpha = 0.5 * strength;
    this.context.fillStyle = color;
    this.context.beginPath();
    for (let k = 0; k + 2 < runs.length; k += 3) {
      const [y, x0, x1] = [runs[k] ?? 0, runs[k + 1] ?? 0, runs[k + 2] ?? 0];
      this.context.rect(x0 * s, y * s, (x1 - x0) * s, height * s);
    }
    this.context.fill();
    this.context.globalAlpha = 1;
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

  /** The sign of a rejected detection: a white cross on a dark disc. */
  cross(x: number, y: number, strength: number): void {
    const [cx, cy, r] = [x * this.scale, y * this.scale, this.line > 1 ? 7 : 4];
    this.context.beginPath();
    this.context.arc(cx, cy, r, 0, 2 * Math.PI);
    this.context.globalAlpha = strength;
    this.context.fillStyle = "#8c0010";
    this.context.fill();
    this.context.beginPath();
    const d = 0.45 * r;
    for (const s of [-1, 1]) {
      this.context.moveTo(cx - d, cy - s * d);
      this.context.lineTo(cx + d, cy + s * d);
    }
    this.stroke("#ffffff", strength, 1.2, []);
  }

  /** A dark line under the colored one, so that it can be seen on any image; rejected ones are dashed. */
  private measurement(color: string, strength: number, rejected: boolean): void {
    if (this.line > 1) this.stroke("#000000", 0.5 * strength, 2.2, []);
    if (rejected) this.stroke("#ffffff", 0.8 * strength, 1.2, []);
    this.stroke(color, strength, 1.2, rejected ? [5, 5] : []);
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
