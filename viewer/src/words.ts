// Numbers and names as people read them.

import {
  REJECTED, USED, type Alternative, type Body, type DetectionState, type GivenPose, type Report, type ReportObject,
  type ScoreColumn, type Vec3,
} from "./data.ts";

/** A number with three significant digits, without an exponent where that is readable. */
export function short(value: number | null): string {
  if (value === null) return "–";
  const size = Math.abs(value);
  if (size === 0) return "0";
  if (size >= 1e6 || size < 1e-4) return value.toExponential(2);
  return value.toFixed(Math.max(0, 2 - Math.floor(Math.log10(size))));
}

/** A length; the unit of a world that names none is called a unit. */
export function withUnit(value: number | null, unit: string | null): string {
  return value === null ? short(value) : `${short(value)} ${unit ?? "units"}`;
}

/** How far a refinement has moved a camera. */
export function movedInWords(given: GivenPose, unit: string | null): string {
  return `moved by ${withUnit(given.shift, unit)}, ${short((180 / Math.PI) * given.angle)} deg`;
}

const labels = new WeakMap<Report, string[]>();

/**
 * The label of an object, the same everywhere on the page: its category and its number where its id has one (of an
 * association: object_0003), else its id.
 */
export function objectName(report: Report, index: number): string {
  let known = labels.get(report);
  if (known === undefined) {
    const wished = report.objects.map((object) => {
      const category = report.categories[object.category];
      const number = /^(?:(.*?)[ _-]?)?0*(\d+)$/.exec(object.id);
      const before = number?.[1] ?? "";
      const isNumber = number !== null && ["", "object", category].includes(before);
      return category === undefined || !isNumber ? object.id : `${category} ${number[2]}`;
    });
    // Two objects never have one label.
    const times = new Map<string, number>();
    for (const label of wished) times.set(label, (times.get(label) ?? 0) + 1);
    known = report.objects.map(({ id }, k) => (times.get(wished[k] ?? "") === 1 ? (wished[k] ?? id) : id));
    labels.set(report, known);
  }
  return known[index] ?? "unassigned";
}

/** A text of the program with the labels of the objects in place of their ids. */
export function withLabels(report: Report, text: string): string {
  return text.replace(/\bobject_\d+\b/g, (id) => {
    const index = report.objects.findIndex((object) => object.id === id);
    return index < 0 ? id : objectName(report, index);
  });
}

/** Full extents of a body, the largest first. */
export function sortedExtents(body: Body): number[] {
  return body.half.map((half) => 2 * half).sort((a, b) => b - a);
}

/** Standard deviations of the full extents of a body, in the order of these; nulls where they are not known. */
export function extentsSd(body: Body | null, halfExtentsSd: Vec3 | null): (number | null)[] {
  const order = [0, 1, 2].sort((a, b) => (body?.half[b] ?? 0) - (body?.half[a] ?? 0));
  return order.map((axis) => (halfExtentsSd === null ? null : 2 * (halfExtentsSd[axis] ?? 0)));
}

const decimals = new WeakMap<Report, number>();

/** Number of decimals of all lengths of a report: three significant digits of an object of median size. */
function sharedDecimals(report: Report): number {
  let shared = decimals.get(report);
  if (shared === undefined) {
    const sizes = report.objects.flatMap(({ body }) => (body === null ? [] : [2 * Math.max(...body.half)]));
    sizes.sort((a, b) => a - b);
    shared = Math.max(0, decimalsOf(sizes[Math.floor(sizes.length / 2)] ?? 1, 3));
    decimals.set(report, shared);
  }
  return shared;
}

/** Number of decimals that gives a length so many significant digits. */
function decimalsOf(length: number, digits: number): number {
  return digits - 1 - Math.floor(Math.log10(length));
}

/** Lengths that can be compared with each other: with the same number of decimals. One that would be zero gets more. */
export function lengths(report: Report, values: number[]): string[] {
  const shared = sharedDecimals(report);
  const enough = Math.max(shared, ...values.map((value) => decimalsOf(value, 1)));
  // Sizes that differ by factors of thousands.
  if (!(enough <= shared + 3)) return values.map(short);
  return values.map((value) => value.toFixed(enough));
}

/** A place in the world. */
export function position(report: Report, center: Vec3 | null): string {
  if (center === null) return "–";
  const texts = center.map((x) => (sharedDecimals(report) > 6 ? short(x) : x.toFixed(sharedDecimals(report))));
  return `(${texts.join(", ").replaceAll("-", "−")}) ${report.lengthUnit ?? "units"}`;
}

/** Full extents in words, the largest first. */
export function extents(report: Report, body: Body | null): string {
  return body === null ? "–" : lengths(report, sortedExtents(body)).join(" × ");
}

/** The same of a body or a box, each with its standard deviation. */
export function extentsWithSd(report: Report, body: Body | null, halfExtentsSd: Vec3 | null): string {
  if (body === null) return "–";
  const sd = extentsSd(body, halfExtentsSd);
  const texts = lengths(report, sortedExtents(body));
  return texts.map((text, k) => (sd[k] == null ? text : `${text}\u00a0±\u00a0${deviation(sd[k])}`)).join(" × ");
}

/** A standard deviation: two significant digits. */
export function deviation(sd: number | null): string {
  return sd !== null && sd > 0 && sd < 1e6 ? sd.toFixed(Math.max(0, decimalsOf(sd, 2))) : short(sd);
}

/** How sure the direction of a body is. */
export function directionInWords(report: Report, [yaw, tilt]: [number, number]): string {
  // A body that looks the same from all sides has that of an angle that may be anything.
  const angle = (sd: number): string => (sd > 100 ? "not determined" : `± ${deviation(sd)} deg`);
  if (report.up === null) return `${angle(yaw)} about each axis`;
  return `${angle(yaw)} about the vertical, ${angle(tilt)} away from it`;
}

/** Whether an object's body is shown though its views do not agree with it. */
export function isUnreliable(object: ReportObject | undefined): boolean {
  return object != null && object.body !== null && object.status !== null && object.status !== "ok";
}

const STATUS: Record<string, string> = {
  ok: "ok",
  inconsistent: "inconsistent",
  undetermined: "undetermined",
  not_an_ellipsoid: "not an ellipsoid",
  too_few_views: "too few views",
  degenerate: "degenerate",
  diverged: "diverged",
};

const REASON: Record<string, string> = {
  inconsistent: "no body agrees with its views; the one shown is unreliable",
  undetermined: "its views leave open where it is; the one shown is one of many",
  not_an_ellipsoid: "the best-fitting quadric is not an ellipsoid; only its center is reported",
  too_few_views: "it has fewer views than the method needs",
  degenerate: "its views do not determine it: they are all from the same position, or contradict each other",
  diverged: "no finite body in front of the cameras fits its views",
};

const REJECTION: Record<string, string> = {
  residual: "far off the other views",
  behind_camera: "the object is behind the camera",
};

/** What became of a view, with the reason where it was rejected. */
export function viewState(state: DetectionState | number, reason: string | undefined): string {
  if (state === USED) return "used";
  if (state !== REJECTED) return "–";
  return reason === undefined ? "✕ rejected" : `✕ rejected: ${REJECTION[reason] ?? reason}`;
}

/** How probable another body is beside the estimated one, in words. */
export function alternativeInWords(report: Report, alternative: Alternative): string {
  const share = (100 / (1 + Math.exp(-alternative.logOdds))).toFixed(0);
  return `${extents(report, alternative.body)} ${report.lengthUnit ?? "units"}, log odds ${alternative.logOdds.toFixed(1)} (${share} %)`;
}

/** A status in the table. */
export function statusName(status: string | null): string {
  return status === null ? "no estimate" : (STATUS[status] ?? status);
}

/** What is to be said about an object, in sentences. */
export function remarks(object: ReportObject): string[] {
  const reason = object.status === null ? undefined : REASON[object.status];
  const odd = object.suspectView === null ? [] : [`the view ${object.suspectView} contradicts the others`];
  return [...(reason === undefined ? [] : [`not localized: ${reason}`]), ...object.warnings, ...odd];
}

/** A score; angles are given in radians and shown in degrees, shares as they are. */
export function score(value: number | null, column: ScoreColumn): string {
  if (value === null) return "–";
  switch (column.unit) {
    case "share":
      return value.toFixed(3);
    case "percent":
      return (100 * value).toFixed(1);
    case "degrees":
      return ((180 / Math.PI) * value).toFixed(1);
    case "length":
      return short(value);
  }
}

export function count(n: number, noun: string): string {
  return `${n} ${noun}${n === 1 ? "" : "s"}`;
}
