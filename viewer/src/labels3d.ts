// Texts over the 3D view: names of objects, lengths and axes. They follow their places in space, and stay out of each
// other's way.

import * as THREE from "three";
import type { Vec3 } from "./data.ts";
import { element } from "./dom.ts";
import { subtract } from "./linear.ts";
import { placeLabels } from "./place_labels.ts";

/** A text and its place in the world. */
export interface Label3d {
  text: string;
  at: Vec3;
  /** Colour of its mark; a text without one stands alone. */
  color?: string;
  /** Whether it is shown even where it covers another one. */
  must: boolean;
}

/** Beyond this many the view is covered by names. */
const MOST_LABELS = 60;

export class Labels3d {
  /** Lies over the canvas. The names are in the tables too, so that screen readers need not hear them here. */
  readonly element = element("div", { class: "labels", "aria-hidden": "true" });
  private spans: HTMLElement[] = [];
  private labels: Label3d[] = [];

  constructor(private readonly origin: Vec3) {}

  /** Shows these labels; those that come first have the first choice of places. */
  set(labels: Label3d[]): void {
    this.labels = labels.slice(0, MOST_LABELS);
    this.spans = this.labels.map(({ text, color, must }) => {
      const span = element("span", { class: color === undefined ? "plain" : must ? "chosen" : "" }, text);
      if (color !== undefined) span.style.borderLeftColor = color;
      return span;
    });
    this.element.replaceChildren(...this.spans);
  }

  /** Puts the labels where the camera sees their places, in a view of this size. */
  place(camera: THREE.Camera, width: number, height: number): void {
    const point = new THREE.Vector3();
    const seen = this.labels.flatMap((label, index) => {
      point.set(...subtract(label.at, this.origin)).project(camera);
      const [x, y] = [((point.x + 1) * width) / 2, ((1 - point.y) * height) / 2];
      const span = this.spans[index];
      const isSeen = point.z < 1 && x > 0 && x < width && y > 0 && y < height;
      if (span) span.hidden = !isSeen;
      return span && isSeen ? [{ label, span, x, y }] : [];
    });
    // All sizes are read before anything is moved.
    const wishes = seen.map(({ label, span, x, y }) => {
      const [w, h] = [span.offsetWidth, span.offsetHeight];
      const places: [number, number][] = [
        [x - w / 2, y - h - 3], [x + 5, y - h / 2], [x - w - 5, y - h / 2], [x - w / 2, y + 4],
        [x + 5, y - h - 5], [x - w - 5, y - h - 5], [x - w / 2, y - 2 * h - 5], [x - w / 2, y + h + 6],
        [x + 5, y + 4], [x - w - 5, y + 4], [x + 5, y - 2 * h - 5], [x - w - 5, y - 2 * h - 5],
      ];
      return { width: w, height: h, places, must: label.must };
    });
    placeLabels(wishes, width, height).forEach((place, k) => {
      const span = seen[k]?.span;
      if (span === undefined) return;
      span.style.visibility = place === null ? "hidden" : "visible";
      if (place !== null) span.style.transform = `translate(${place[0].toFixed(1)}px, ${place[1].toFixed(1)}px)`;
    });
  }
}
