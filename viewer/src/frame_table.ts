// The detections of the selected frame in a table.

import { REJECTED, type Report } from "./data.ts";
import type { Colors } from "./colors.ts";
import { element } from "./dom.ts";
import type { Filter } from "./filter.ts";
import type { Selection } from "./selection.ts";
import { Table, type Column } from "./table.ts";
import { objectName, short, viewState } from "./words.ts";

/** A detection of the selected frame. */
interface Measured {
  object: number;
  state: number;
  /** Pixels. */
  residual: number | null;
  /** Why it was rejected. */
  reason: string | undefined;
  /** Measured depth, and its ratio to that of the estimated body's visible surface. */
  depth: number | null;
  ratio: number | null;
}

export function frameTable(report: Report, selection: Selection, colors: Colors, filter: Filter): HTMLElement {
  const { objects, frames } = report;
  // Largest residual of the frame, for bars.
  let largest = 1;
  const state = (row: Measured): string => (row.object < 0 ? "unassigned" : viewState(row.state, row.reason));
  const unit = report.lengthUnit === null ? "" : ` [${report.lengthUnit}]`;
  // Most scenes have no depths.
  const depths: Column<Measured>[] = frames.some((frame) => frame.detections.depths.length > 0)
    ? [
        {
          title: `depth${unit}`,
          hint: "measured depth of the visible surface",
          value: (row) => row.depth,
          text: (row) => short(row.depth),
          number: true,
        },
        {
          title: "depth / estimate",
          hint: "measured depth over that of the visible surface of the estimated body",
          value: (row) => row.ratio,
          text: (row) => short(row.ratio),
          number: true,
        },
      ]
    : [];
  const table = new Table<Measured>("Detections of this frame", [
    {
      title: "detections of this frame",
      value: (row) => (row.object < 0 ? null : objectName(report, row.object)),
      text: (row) => (row.object < 0 ? "–" : objectName(report, row.object)),
      tip: (row) => objects[row.object]?.id ?? "",
      mark: (row) => colors.ofObject(row.object),
    },
    {
      title: "residual [px]",
      hint: "distance between the measured edges and those of the body's outline, root mean square",
      value: (row) => row.residual,
      text: (row) => short(row.residual),
      bar: (row) => (row.residual ?? 0) / largest,
      number: true,
      style: (row) => (row.state === REJECTED ? "bad" : ""),
    },
    {
      title: "view",
      value: (row) => row.state,
      text: state,
      tip: state,
      style: (row) => (row.state === REJECTED ? "bad" : row.object < 0 ? "dim" : ""),
    },
    ...depths,
  ], (key) => selection.selectInFrame(key));
  const fill = (): void => {
    const detections = frames[selection.frame]?.detections;
    if (detections === undefined) return;
    const reasons = new Map(detections.rejections);
    const measured = new Map(detections.depths.map(([row, depth, ratio]) => [row, [depth, ratio] as const]));
    const rows = detections.object.map((object, row): Measured => ({
      object, state: detections.state[row] ?? 0, residual: detections.residual[row] ?? null, reason: reasons.get(row),
      depth: measured.get(row)?.[0] ?? null, ratio: measured.get(row)?.[1] ?? null,
    }));
    largest = rows.reduce((most, row) => Math.max(most, row.residual ?? 0), 1e-9);
    table.show(rows, detections.object);
    table.filter((k) => filter.shows(k));
    table.mark(selection.object);
  };
  selection.onChange((now, before) => {
    if (now.frame !== before.frame) fill();
    else table.mark(now.object);
  });
  filter.onChange(() => table.filter((k) => filter.shows(k)));
  colors.onChange(() => table.recolor());
  fill();
  return element("section", { class: "measurements", "aria-label": "Residuals" }, table.element);
}
