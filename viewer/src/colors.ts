// Colours of objects: one for each category, or one for each object where there are fewer than two categories.

import type { Report } from "./data.ts";

/** Paul Tol's bright scheme with two more: can be told apart with any colour vision, on light and on dark. */
const PALETTE = ["#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#ee8866", "#888888"];

export interface Colors {
  ofObject(index: number): string;
  /** Names and colours, where colours mean categories. */
  legend: [string, string][];
}

function color(index: number): string {
  return PALETTE[index % PALETTE.length] ?? "#888888";
}

export function makeColors(report: Report): Colors {
  const byCategory = report.categories.length > 1;
  return {
    ofObject(index) {
      const category = report.objects[index]?.category ?? -1;
      if (index < 0 || (byCategory && category < 0)) return "#888888";
      return color(byCategory ? category : index);
    },
    legend: byCategory ? report.categories.map((name, index) => [name, color(index)]) : [],
  };
}
