// The table of all objects.

import type { Report, ReportObject } from "./data.ts";
import type { Colors } from "./colors.ts";
import type { Filter } from "./filter.ts";
import type { Selection } from "./selection.ts";
import { Table, type Column } from "./table.ts";
import { deviation, extents, objectName, remarks, score, short, statusName } from "./words.ts";

/** One standard deviation for the three extents of an object. */
function meanSd(object: ReportObject | undefined): number | null {
  if (object?.halfExtentsSd == null) return null;
  return Math.sqrt(object.halfExtentsSd.reduce((sum, sd) => sum + (2 * sd) ** 2, 0) / 3);
}

/** `look` turns the 3D view to an object. */
export function objectTable(
  report: Report,
  selection: Selection,
  colors: Colors,
  filter: Filter,
  look: ((object: number) => void) | null,
): HTMLElement {
  const { objects, categories, lengthUnit, scores } = report;
  const unit = ` [${lengthUnit ?? "units"}]`;
  const largest = Math.max(...objects.map((object) => object.residual ?? 0), 1e-9);
  const size = (object: ReportObject): number | null =>
    object.body === null ? null : object.body.half.reduce((product, half) => product * half, 1);
  const columns: Column<number>[] = [
    {
      title: "object",
      value: (k) => objectName(report, k),
      text: (k) => objectName(report, k),
      tip: (k) => objects[k]?.id ?? "",
      mark: (k) => colors.ofObject(k),
    },
    {
      title: "status",
      value: (k) => statusName(objects[k]?.status ?? null),
      text: (k) => {
        const object = objects[k];
        const weak = object?.status === "ok" && object.warnings.length > 0;
        return statusName(object?.status ?? null) + (weak ? ", weak" : "");
      },
      style: (k) => {
        const object = objects[k];
        if (object?.status == null) return "dim";
        return object.status !== "ok" ? "bad" : remarks(object).length > 0 ? "weak" : "good";
      },
    },
    {
      title: `size${unit}`,
      hint: "full extents along the axes, the largest first; sorted by volume",
      value: (k) => (objects[k] ? size(objects[k]) : null),
      text: (k) => extents(report, objects[k]?.body ?? null),
      number: true,
    },
    {
      title: `size\u00a0±${unit}`,
      hint: "uncertainty of the size: standard deviation of the extents, root mean square over the axes",
      value: (k) => meanSd(objects[k]),
      text: (k) => deviation(meanSd(objects[k])),
      number: true,
      room: "wide",
    },
    {
      title: `center\u00a0±${unit}`,
      hint: "uncertainty of the center: standard deviation along each axis",
      value: (k) => objects[k]?.centerSd ?? null,
      text: (k) => short(objects[k]?.centerSd ?? null),
      number: true,
      room: "wide",
    },
    {
      title: "residual [px]",
      hint: "distance between the measured edges and those of the body's outline, root mean square over the used views",
      value: (k) => objects[k]?.residual ?? null,
      text: (k) => short(objects[k]?.residual ?? null),
      number: true,
      bar: (k) => (objects[k]?.residual ?? 0) / largest,
      // Scores are better than residuals.
      room: scores === null ? "narrow" : "medium",
    },
    {
      title: "views",
      hint: "numbers of used and rejected (✕) views",
      value: (k) => objects[k]?.viewsUsed ?? null,
      text: (k) => {
        const { viewsUsed = 0, viewsRejected = 0 } = objects[k] ?? {};
        return viewsRejected > 0 ? `${viewsUsed} (✕\u202f${viewsRejected})` : `${viewsUsed}`;
      },
      number: true,
      room: "medium",
    },
  ];
  if (objects.some((object) => object.predictedIou !== null)) {
    columns.push({
      title: "held-out IoU",
      hint: "how well the other views predict the box of each view: mean intersection over union with the measured box",
      value: (k) => objects[k]?.predictedIou ?? null,
      text: (k) => objects[k]?.predictedIou?.toFixed(2) ?? "–",
      number: true,
      room: "wide",
    });
  }
  // Objects whose names tell their category need it only once.
  const tells = (k: number): boolean => objectName(report, k).startsWith(categories[objects[k]?.category ?? -1] ?? "");
  if (objects.some((_, k) => !tells(k))) {
    const category = (k: number): string => categories[objects[k]?.category ?? -1] ?? "";
    columns.splice(1, 0, { title: "category", value: category, text: category, room: "wide" });
  }
  const first = scores?.columns[0];
  if (scores && first) {
    const values = new Map(scores.rows.map((row) => [row.object, row.values[0] ?? null]));
    const value = (k: number): number | null => values.get(k) ?? null;
    columns.push({ title: first.title, value, text: (k) => score(value(k), first), number: true, room: "narrow" });
  }
  const table = new Table<number>("Objects", columns, (k) => selection.selectObject(k), look);
  const keys = objects.map((_, k) => k);
  table.show(keys, keys);
  filter.onChange(() => table.filter((k) => filter.shows(k)));
  colors.onChange(() => table.recolor());
  selection.onChange((now, before) => {
    if (now.object !== before.object) table.mark(now.object);
  });
  // A link may have selected one before the table is in its place.
  requestAnimationFrame(() => table.mark(selection.object));
  return table.element;
}
