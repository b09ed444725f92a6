// Numbers and names as people read them.

import {
  REJECTED, USED, type Alternative, type Body, type DetectionState, type GivenPose, type Report, type ReportObject,
  type ScoreColumn,
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

/**
 * The name of an object on pictures: its id, or its category and its number where the id is one of an association
 * (object_0003).
 */
export function objectName(report: Report, index: number): string {
  const object = report.objects[index];
  if (object === undefined) return "no object";
  const category = report.categories[object.category];
  const number = /^object_0*(\d+)$/.exec(object.id)?.[1];
  return category === undefined || number === undefined ? object.id : `${category} ${number}`;
}

/** Full extents of a body. */
export function extents(body: Body | null): string {
  return body === null ? "–" : body.half.map((half) => short(2 * half)).join(" × ");
}

const STATUS: Record<string, string> = {
  ok: "ok",
  inconsistent: "inconsistent",
  not_an_ellipsoid: "not an ellipsoid",
  too_few_views: "too few views",
  degenerate: "degenerate",
  diverged: "diverged",
};

const REASON: Record<string, string> = {
  inconsistent: "no body agrees with its views; the one shown is unreliable",
  not_an_ellipsoid: "the best-fitting quadric is not an ellipsoid; only its centre is reported",
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
export function alternativeInWords(alternative: Alternative): string {
  const share = (100 / (1 + Math.exp(-alternative.logOdds))).toFixed(0);
  return `${extents(alternative.body)}, log odds ${alternative.logOdds.toFixed(1)} (${share} %)`;
}

/** A status in the table. */
export function statusName(status: string | null): string {
  return status === null ? "no estimate" : (STATUS[status] ?? status);
}

/** What is to be said about an object, in sentences. */
export function remarks(object: ReportObject): string[] {
  const reason = object.status === null ? undefined : REASON[object.status];
  const odd = object.oddView === null ? [] : [`the view ${object.oddView} contradicts the others`];
  return [...(reason === undefined ? [] : [`not localised: ${reason}`]), ...object.warnings, ...odd];
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
