// Which part of a frame is shown: all of it, its detections, or one object.

import type { Frame, Report } from "./data.ts";
import { detectionExtent } from "./object_views.ts";
import { outline } from "./outline.ts";

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

/** The part of a frame, of its proportions, around an object: its detection and the outline of its body. */
export function objectRegion(frame: Frame, report: Report, object: number): Region | null {
  const points: [number, number][] = [];
  const row = frame.detections.object.indexOf(object);
  if (row >= 0) {
    const [x0, y0, x1, y1] = detectionExtent(frame, row);
    if (x1 > x0) points.push([x0, y0], [x1, y1]);
  }
  const body = report.objects[object]?.body ?? report.objects[object]?.truth;
  const shape = body == null ? null : outline(frame.projection, body);
  const [w, h] = frame.size;
  const near = (x: number, side: number): number => Math.min(Math.max(x, -0.25 * side), 1.25 * side);
  if (row >= 0 || shape?.border.some(([x, y]) => x > 0 && y > 0 && x < w && y < h)) {
    for (const [x, y] of shape?.border ?? []) points.push([near(x, w), near(y, h)]);
  }
  if (points.length === 0) return null;
  const [xs, ys] = [points.map(([x]) => x), points.map(([, y]) => y)];
  const [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  const share = Math.min(1, Math.max(1.6 * Math.max((x1 - x0) / w, (y1 - y0) / h), 0.04));
  const [width, height] = [share * w, share * h];
  // Not beyond the image where that can be avoided.
  const inside = (middle: number, size: number, side: number): number =>
    Math.min(Math.max(middle - size / 2, 0), side - size);
  return { x: inside((x0 + x1) / 2, width, w), y: inside((y0 + y1) / 2, height, h), width, height };
}
