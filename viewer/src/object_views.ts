// The views of an object, and which of them shows it best.

import { REJECTED, USED, type Frame, type Report } from "./data.ts";

/** One view of an object. */
export interface ViewOf {
  frame: number;
  /** Row of the detection in its frame. */
  row: number;
  state: number;
  /** Pixels. */
  residual: number | null;
  /** Why it was rejected. */
  reason: string | undefined;
}

/** All views of an object, in the order of the frames. */
export function viewsOf(report: Report, object: number): ViewOf[] {
  if (object < 0) return [];
  return report.frames.flatMap(({ detections }, frame) => {
    const row = detections.object.indexOf(object);
    if (row < 0) return [];
    const reason = detections.rejections.find(([k]) => k === row)?.[1];
    return [{ frame, row, state: detections.state[row] ?? 0, residual: detections.residual[row] ?? null, reason }];
  });
}

/**
 * The frame that shows an object best, -1 where none does: a view that was used before one that was not, before one
 * that was rejected; whole objects before those that the image cuts off; then the one that is largest in its image.
 */
export function bestFrame(report: Report, object: number): number {
  let [best, rank] = [-1, -Infinity];
  for (const view of viewsOf(report, object)) {
    const frame = report.frames[view.frame];
    if (frame === undefined) continue;
    const [w, h] = frame.size;
    const [x0, y0, x1, y1] = detectionExtent(frame, view.row);
    const whole = x0 > 1 && y0 > 1 && x1 < w - 1 && y1 < h - 1;
    const share = Math.max(0, ((x1 - x0) * (y1 - y0)) / (w * h));
    const state = view.state === USED ? 2 : view.state === REJECTED ? 0 : 1;
    // A picture is better to look at than a blank sheet.
    const own = 8 * state + 4 * Number(frame.image !== null) + 2 * Number(whole) + Math.min(1, share);
    if (own > rank) [best, rank] = [view.frame, own];
  }
  return best;
}

/** Where a detection lies: its box, or that around its ellipse; all zero where it has neither. */
export function detectionExtent(frame: Frame, row: number): [number, number, number, number] {
  const [x0, y0, x1, y1] = frame.detections.box.slice(4 * row, 4 * row + 4);
  if (x0 != null && y0 != null && x1 != null && y1 != null) return [x0, y0, x1, y1];
  const ellipse = frame.detections.ellipses.find(([of]) => of === row);
  if (ellipse === undefined) return [0, 0, 0, 0];
  const [, x, y, a, b, angle] = ellipse;
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const [dx, dy] = [Math.hypot(a * c, b * s), Math.hypot(a * s, b * c)];
  return [x - dx, y - dy, x + dx, y + dy];
}
