// What a report shows: the JSON document in the page. Mirrors crates/quadlift-report/src/data.rs.
//
// Lengths are world units; pixels are measured from the corner of the image, as the pinhole camera of the frame sees
// it (lens distortion has been taken out, of measurements and of images); rotations are quaternions, w first.

export type Vec3 = [number, number, number];

export interface Report {
  title: string;
  /** Name and version of the program. */
  program: string;
  lengthUnit: string | null;
  /** World direction against gravity. */
  up: Vec3 | null;
  categories: string[];
  frames: Frame[];
  /** Points of the scene's surfaces in the world: x, y, z of each. */
  points: number[];
  objects: ReportObject[];
  scores: Scores | null;
  /** Settings and counts of the run: name and value. */
  settings: [string, string][];
  /** What is known of the scene as a whole (consistency check, noise, association): name and value, in words. */
  overview: [string, string][];
  /** What should be known about the report or the run, in sentences. */
  notes: string[];
  /** What is wrong with the scene as a whole, shown above all else. */
  banner: string | null;
  /** What the drawn regions of the centers promise; null where no object has one. */
  region: string | null;
}

export interface Frame {
  id: string;
  /** World to pixels, 3x4 by rows, from the refined pose if it was refined. */
  projection: number[];
  /** The pose as given, if it was refined. */
  given?: GivenPose;
  /** Width and height in pixels. */
  size: [number, number];
  /** The image as a data URL. */
  image: string | null;
  detections: Detections;
}

/** The pose of a frame before its refinement with the objects. */
export interface GivenPose {
  /** World to pixels, 3x4 by rows. */
  projection: number[];
  /** Distance between the given and the refined center of the camera. */
  shift: number;
  /** Angle between the given and the refined axes of the camera in radians. */
  angle: number;
}

/** The detections of a frame by columns: there may be hundreds of thousands. */
export interface Detections {
  /** Index of the object, -1 where it is not known. */
  object: number[];
  state: DetectionState[];
  /** Pixels; null where there is none. */
  residual: (number | null)[];
  /** Of those that are rejected and say why: row, reason. */
  rejections: [number, string][];
  /** x0, y0, x1, y1 of each; four nulls where there is no box. */
  box: (number | null)[];
  /** Of those that have an ellipse: row, center x, y, semi-axes, angle (radians). */
  ellipses: [number, number, number, number, number, number][];
  /** Of those that have a mask: row, height of its strips, and y (upper edge), x0, x1 of each run of pixels in them. */
  masks: [number, number, number[]][];
  /** Of those that have a depth: row, depth, and its ratio to that of the estimated body's visible surface. */
  depths: [number, number, number | null][];
  /** Of those that have a whole 3D box: row, and the box. */
  boxes3d: [number, Body][];
}

/** 0: not used or not known, 1: used, 2: rejected as an outlier. */
export type DetectionState = 0 | 1 | 2;
export const USED: DetectionState = 1;
export const REJECTED: DetectionState = 2;

export interface ReportObject {
  id: string;
  /** Id of the true object that the estimate is paired with, where it is another one. */
  trueId: string | null;
  /** Index of the category, -1 where there is none. */
  category: number;
  /** How the estimation ended; null where none was made. */
  status: string | null;
  center: Vec3 | null;
  /** Standard deviation of the center per coordinate. */
  centerSd: number | null;
  /** Standard deviations of the half extents of the body, in their order. */
  halfExtentsSd: Vec3 | null;
  /** Standard deviations of its rotation in degrees: about the vertical, and away from it. */
  rotationSdDeg: [number, number] | null;
  /** The region of 95 % of the center, see `Report.region`. */
  centerShell: Body | null;
  body: Body | null;
  /** The box around the object. */
  bounds: Body | null;
  /** Standard deviations of its half extents, in their order. */
  boundsSd: Vec3 | null;
  /** The larger body that holds the real object. */
  enclosing: Body | null;
  truth: Body | null;
  /** Other bodies that fit the views about as well, the most probable first. */
  alternatives: Alternative[];
  viewsUsed: number;
  viewsRejected: number;
  /** Root mean square over the used views, pixels. */
  residual: number | null;
  /** The same per degree of freedom, relative to the half size of the boxes. */
  relativeResidual: number | null;
  /** The same in standard deviations of the scene's noise. */
  normalizedResidual: number | null;
  /** Mean IoU of the boxes that its other views predict for each of its views, and the measured ones. */
  predictedIou: number | null;
  /** The frame whose detection the other views contradict. */
  suspectView: string | null;
  warnings: string[];
}

export interface Alternative {
  body: Body;
  /** Natural logarithm of its odds against the estimated body. */
  logOdds: number;
}

export interface Body {
  kind: "ellipsoid" | "cuboid" | "cylinder" | "superellipsoid" | "rounded";
  center: Vec3;
  /** Semi-axes, half extents, or the two radii and half the height of a cylinder. */
  half: Vec3;
  /** The columns of this rotation are the axes. */
  rotation: [number, number, number, number];
  /** Exponent of the support function of a superellipsoid, in [1, 2]; 1 of a cuboid, 2 of an ellipsoid; 1 + the roundness
   * of a rounded body; a cylinder has none. */
  exponent: number;
}

export interface Scores {
  columns: ScoreColumn[];
  rows: ScoreRow[];
  mean: (number | null)[];
  /** The number of true objects without an estimated body, in a sentence. */
  failures: string;
}

export interface ScoreColumn {
  title: string;
  unit: "share" | "percent" | "degrees" | "length";
}

export interface ScoreRow {
  /** Index of the object. */
  object: number;
  status: string | null;
  values: (number | null)[];
}

/** Reads the document of the page. */
export function readReport(): Report {
  const text = document.getElementById("report-data")?.textContent ?? "";
  if (text.trim() === "") throw new Error("This page holds no report.");
  return JSON.parse(text) as Report;
}
