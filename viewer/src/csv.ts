// The table of objects as CSV (RFC 4180), with all digits.

import type { Body, Report } from "./data.ts";
import { extentsSd, objectName, sortedExtents } from "./words.ts";

type Value = string | number | null | undefined;

/** One line for each object that is shown. */
export function objectsCsv(report: Report, shows: (object: number) => boolean): string {
  const unit = report.lengthUnit ?? "units";
  const header = [
    "object", "id", "category", "status", "body",
    ...["x", "y", "z"].map((axis) => `center ${axis} [${unit}]`),
    `center sd [${unit}]`,
    ...[1, 2, 3].map((k) => `size ${k} [${unit}]`),
    ...[1, 2, 3].map((k) => `size ${k} sd [${unit}]`),
    "yaw sd [deg]", "tilt sd [deg]",
    ...[1, 2, 3].map((k) => `bounds ${k} [${unit}]`),
    ...[1, 2, 3].map((k) => `bounds ${k} sd [${unit}]`),
    "residual [px]", "views used", "views rejected", "held-out IoU",
  ];
  const rows = report.objects.flatMap((object, index): Value[][] => {
    if (!shows(index)) return [];
    const sizesOf = (body: Body | null): (number | null)[] => (body === null ? [null, null, null] : sortedExtents(body));
    return [[
      objectName(report, index), object.id, report.categories[object.category], object.status, object.body?.kind,
      ...(object.center ?? [null, null, null]), object.centerSd,
      ...sizesOf(object.body), ...extentsSd(object.body, object.halfExtentsSd),
      ...(object.rotationSdDeg ?? [null, null]),
      ...sizesOf(object.bounds), ...extentsSd(object.bounds, object.boundsSd),
      object.residual, object.viewsUsed, object.viewsRejected, object.predictedIou,
    ]];
  });
  return [header, ...rows].map((row) => `${row.map(cell).join(",")}\r\n`).join("");
}

function cell(value: Value): string {
  if (typeof value !== "string") return value == null ? "" : `${value}`;
  // Spreadsheets run texts that begin like formulas.
  const text = /^[=+\-@\t\r]/.test(value) ? `'${value}` : value;
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}
