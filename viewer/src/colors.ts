// Colors of objects: by category (or by object where there are fewer than two categories), residual, uncertainty or
// status. Who draws with them listens to changes.

import type { Report, ReportObject } from "./data.ts";
import { remarks, short } from "./words.ts";

/** Paul Tol's bright scheme with four more (gray is for what belongs to no object): can be told apart on light and on
 * dark, the first eight with any color vision. */
const PALETTE = [
  "#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#ee8866",
  "#44bb99", "#9467bd", "#8c613c",
];
/** Viridis: from low to high, monotonic in lightness. */
const SCALE = ["#440154", "#3b528b", "#21918c", "#5ec962", "#fde725"];
const NONE = "#888888";
const STATUS = { ok: "#4477aa", weak: "#ccbb44", failed: "#aa3377", none: NONE };

export type ColorMode = "category" | "object" | "residual" | "uncertainty" | "status";

/** What the colors of a scale mean. */
export interface ColorScale {
  low: string;
  high: string;
  stops: string[];
}

export class Colors {
  /** Names of the modes that tell something in this report. */
  readonly modes: [ColorMode, string][];
  private chosen: ColorMode;
  private ofObjects: string[] = [];
  private readonly listeners: (() => void)[] = [];

  constructor(private readonly report: Report) {
    const { objects, categories } = report;
    const has = (of: (object: ReportObject) => unknown): boolean => objects.some((object) => of(object) !== null);
    this.modes = [
      ...(categories.length > 1 ? [["category", "category"] as [ColorMode, string]] : []),
      ["object", "object"],
      ...(has((object) => object.residual) ? [["residual", "residual"] as [ColorMode, string]] : []),
      ...(has((object) => object.centerSd) ? [["uncertainty", "uncertainty"] as [ColorMode, string]] : []),
      ...(has((object) => object.status) ? [["status", "status"] as [ColorMode, string]] : []),
    ];
    this.chosen = this.modes[0]?.[0] ?? "object";
    this.fill();
  }

  get mode(): ColorMode {
    return this.chosen;
  }

  setMode(mode: ColorMode): void {
    if (mode === this.chosen) return;
    this.chosen = mode;
    this.fill();
    for (const listener of this.listeners) listener();
  }

  onChange(listener: () => void): void {
    this.listeners.push(listener);
  }

  /** The color of an object; gray for -1, which is none. */
  ofObject(index: number): string {
    return this.ofObjects[index] ?? NONE;
  }

  /** The color of a category, whatever the mode. */
  static ofCategory(category: number): string {
    return category < 0 ? NONE : (PALETTE[category % PALETTE.length] ?? NONE);
  }

  /** Names and colors of the statuses. */
  static readonly statuses: [string, string][] = [
    ["ok", STATUS.ok],
    ["ok, weak", STATUS.weak],
    ["not localized", STATUS.failed],
    ["no estimate", STATUS.none],
  ];

  /** The scale of the mode, where it has one. */
  scale(): ColorScale | null {
    const range = this.range();
    if (range === null) return null;
    const unit = this.chosen === "residual" ? "px" : (this.report.lengthUnit ?? "units");
    return { low: `${short(range[0])} ${unit}`, high: `${short(range[1])} ${unit}`, stops: SCALE };
  }

  private fill(): void {
    const range = this.range();
    this.ofObjects = this.report.objects.map((object, index) => {
      switch (this.chosen) {
        case "category": return Colors.ofCategory(object.category);
        case "object": return PALETTE[index % PALETTE.length] ?? NONE;
        case "status": return statusColor(object);
        default: {
          const value = this.value(object);
          if (value === null || range === null) return NONE;
          return onScale(range[1] > range[0] ? (value - range[0]) / (range[1] - range[0]) : 0.5);
        }
      }
    });
  }

  private value(object: ReportObject): number | null {
    return this.chosen === "residual" ? object.residual : this.chosen === "uncertainty" ? object.centerSd : null;
  }

  /** Smallest and largest value of the mode. */
  private range(): [number, number] | null {
    const values = this.report.objects.flatMap((object) => this.value(object) ?? []);
    if (values.length === 0) return null;
    return values.reduce(([low, high], x) => [Math.min(low, x), Math.max(high, x)], [Infinity, -Infinity]);
  }
}

function statusColor(object: ReportObject): string {
  if (object.status === null) return STATUS.none;
  if (object.status !== "ok") return STATUS.failed;
  return remarks(object).length > 0 ? STATUS.weak : STATUS.ok;
}

/** The color at a share of the scale, between its stops. */
function onScale(share: number): string {
  const at = Math.min(Math.max(share, 0), 1) * (SCALE.length - 1);
  const k = Math.min(Math.floor(at), SCALE.length - 2);
  const parts = (color: string): number[] => [1, 3, 5].map((i) => parseInt(color.slice(i, i + 2), 16));
  const [a, b] = [parts(SCALE[k] ?? NONE), parts(SCALE[k + 1] ?? NONE)];
  const mixed = a.map((x, i) => Math.round(x + (at - k) * ((b[i] ?? x) - x)));
  return `#${mixed.map((x) => x.toString(16).padStart(2, "0")).join("")}`;
}
