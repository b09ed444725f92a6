// Texts over the 3D view: names of objects, lengths and axes. They follow their places in space, and stay out of the
// way of each other and of the bodies; a line leads from a text that stands apart to its place.

import * as THREE from "three";
import type { Vec3 } from "./data.ts";
import { element } from "./dom.ts";
import { subtract } from "./linear.ts";
import { placeLabels, type Box } from "./place_labels.ts";

/** A text and its place in the world. */
export interface Label3d {
  text: string;
  at: Vec3;
  /** Color of its mark; a text without one stands alone. */
  color?: string;
  /** Whether it is shown even where it covers another one. */
  must: boolean;
  /** The object that it names: it stands beside its body. */
  object?: number;
  /** The object that it stands out of, with a line to its place in it. */
  outOf?: number;
  /** Whether it may stand apart from its place, with a line to it; names may. */
  mayStandApart?: boolean;
}

/** Beyond this many the view is covered by names. */
const MOST_LABELS = 60;

/** Distances of a name from the box of its object, pixels. */
const DISTANCES = [3, 16, 34, 60];

/** Share of a label that may lie over bodies: their boxes are larger than they are. */
const MAY_COVER = 0.12;

/** A name that is farther from its object than this has a line to it. */
const NEAR = 8;

const SVG = "http://www.w3.org/2000/svg";

export class Labels3d {
  /** Lies over the canvas. The names are in the tables too, so that screen readers need not hear them here. */
  readonly element = element("div", { class: "labels", "aria-hidden": "true" });
  private readonly leaders = document.createElementNS(SVG, "svg");
  private spans: HTMLElement[] = [];
  private labels: Label3d[] = [];
  private placed: { span: HTMLElement; x: number; y: number }[] = [];

  constructor(private readonly origin: Vec3) {}

  /** Shows these labels; those that come first have the first choice of places. */
  set(labels: Label3d[]): void {
    this.labels = labels.slice(0, MOST_LABELS);
    this.spans = this.labels.map(({ text, color, must }) => {
      const span = element("span", { class: color === undefined ? "plain" : must ? "chosen" : "" }, text);
      if (color !== undefined) span.style.borderLeftColor = color;
      return span;
    });
    this.element.replaceChildren(this.leaders, ...this.spans);
  }

  /** Puts the labels where the camera sees their places, in a view of this size with the objects in these boxes. */
  place(camera: THREE.Camera, width: number, height: number, objects: (Box | undefined)[]): void {
    const point = new THREE.Vector3();
    const seen = this.labels.flatMap((label, index) => {
      point.set(...subtract(label.at, this.origin)).project(camera);
      const [x, y] = [((point.x + 1) * width) / 2, ((1 - point.y) * height) / 2];
      const span = this.spans[index];
      const isSeen = point.z < 1 && x > 0 && x < width && y > 0 && y < height;
      if (span) span.hidden = !isSeen;
      const box: Box = (label.object === undefined ? undefined : objects[label.object]) ?? [x, y, x, y];
      const outOf = label.outOf === undefined ? undefined : objects[label.outOf];
      return span && isSeen ? [{ label, span, box, outOf }] : [];
    });
    // All sizes are read before anything is moved.
    const wishes = seen.map(({ label, span, box, outOf }) => {
      const [w, h] = [span.offsetWidth, span.offsetHeight];
      const distances = mayStandApart(label) ? DISTANCES : DISTANCES.slice(0, 1);
      return {
        width: w, height: h, must: label.must, mayCover: label.object === undefined ? 1 : MAY_COVER,
        places: [
          ...distances.flatMap((distance) => around(box, w, h, distance)),
          ...(outOf === undefined ? [] : nextTo(outOf, [box[0], box[1]], w, h)),
        ],
      };
    });
    const obstacles = objects.filter((box) => box !== undefined);
    this.placed = [];
    const leaders: SVGLineElement[] = [];
    placeLabels(wishes, width, height, obstacles).forEach((place, k) => {
      const { span, box, label } = seen[k] ?? {};
      const wish = wishes[k];
      if (span === undefined || box === undefined || wish === undefined) return;
      span.style.visibility = place === null ? "hidden" : "visible";
      if (place === null) return;
      const [x, y] = place;
      span.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
      this.placed.push({ span, x, y });
      const leader = label === undefined || !mayStandApart(label) ? null : leaderBetween(box, [x, y, x + wish.width, y + wish.height]);
      if (leader !== null) leaders.push(leader);
    });
    this.leaders.replaceChildren(...leaders);
  }

  /** Draws the labels as they stand into a picture whose pixels are `ratio` times as fine. */
  drawOn(context: CanvasRenderingContext2D, ratio: number): void {
    context.save();
    context.scale(ratio, ratio);
    for (const leader of this.leaders.children) {
      const at = (name: string): number => Number(leader.getAttribute(name));
      context.strokeStyle = getComputedStyle(leader).stroke;
      context.beginPath();
      context.moveTo(at("x1"), at("y1"));
      context.lineTo(at("x2"), at("y2"));
      context.stroke();
    }
    context.textBaseline = "middle";
    for (const { span, x, y } of this.placed) {
      const style = getComputedStyle(span);
      const [w, h] = [span.offsetWidth, span.offsetHeight];
      const border = parseFloat(style.borderLeftWidth) || 0;
      context.fillStyle = style.backgroundColor;
      context.fillRect(x, y, w, h);
      context.fillStyle = style.borderLeftColor;
      context.fillRect(x, y, border, h);
      context.fillStyle = style.color;
      context.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
      context.fillText(span.textContent ?? "", x + border + parseFloat(style.paddingLeft), y + h / 2, w - border);
    }
    context.restore();
  }
}

function mayStandApart(label: Label3d): boolean {
  return label.object !== undefined || label.mayStandApart === true;
}

/** Places of a label around a box at a distance. */
function around([x0, y0, x1, y1]: Box, w: number, h: number, distance: number): [number, number][] {
  const [x, y] = [(x0 + x1 - w) / 2, (y0 + y1 - h) / 2];
  const [left, right, above, below] = [x0 - w - distance, x1 + distance, y0 - h - distance, y1 + distance];
  return [
    [x, above], [right, y], [left, y], [x, below],
    [right, above], [left, above], [right, below], [left, below],
    [x0, above], [x1 - w, above], [right, y0], [left, y0], [x0, below], [x1 - w, below],
  ];
}

/** Places of a label on the sides of a box, straight out from a point in it, the nearest first. */
function nextTo([x0, y0, x1, y1]: Box, [x, y]: [number, number], w: number, h: number): [number, number][] {
  const [gap] = DISTANCES as [number];
  const sides: [number, number, number][] = [
    [x - x0, x0 - w - gap, y - h / 2], [x1 - x, x1 + gap, y - h / 2],
    [y - y0, x - w / 2, y0 - h - gap], [y1 - y, x - w / 2, y1 + gap],
  ];
  return sides.sort((a, b) => a[0] - b[0]).map(([, left, top]) => [left, top]);
}

/** A line from the middle of an object to its label, where these are apart. */
function leaderBetween(object: Box, label: Box): SVGLineElement | null {
  const gap = (k: 0 | 1): number => Math.max(object[k] - label[k + 2]!, label[k] - object[k + 2]!, 0);
  if (Math.hypot(gap(0), gap(1)) < NEAR) return null;
  const [cx, cy] = [(object[0] + object[2]) / 2, (object[1] + object[3]) / 2];
  const line = document.createElementNS(SVG, "line");
  const ends = {
    x1: cx, y1: cy,
    x2: Math.min(Math.max(cx, label[0]), label[2]), y2: Math.min(Math.max(cy, label[1]), label[3]),
  };
  for (const [name, value] of Object.entries(ends)) line.setAttribute(name, value.toFixed(1));
  return line;
}
