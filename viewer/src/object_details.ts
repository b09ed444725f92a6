// The selected object: its figures, what is to be said about it, how far it is from another one, and what each view
// contributed. Without a selected object the overview of the scene stands here.

import { REJECTED, type Report, type ReportObject } from "./data.ts";
import type { Colors } from "./colors.ts";
import { element, factList } from "./dom.ts";
import type { Measure } from "./measure.ts";
import { viewsOf, type ViewOf } from "./object_views.ts";
import { overview } from "./overview.ts";
import type { Selection } from "./selection.ts";
import { Table } from "./table.ts";
import {
  alternativeInWords, directionInWords, extentsWithSd, objectName, position, remarks, short, statusName, viewState, withLabels, withUnit,
} from "./words.ts";

/** `look` turns the 3D view to an object. */
export function objectDetails(
  report: Report,
  selection: Selection,
  colors: Colors,
  measure: Measure,
  look: ((object: number) => void) | null,
): HTMLElement {
  const place = element("section", { class: "details", "aria-label": "Selected object" });
  const views = new Table<ViewOf>("Views of the selected object", viewColumns(report), (k) => selection.selectFrame(k));
  const general = overview(report);
  const mark = element("span", { class: "mark" });
  const paint = (): void => void (mark.style.background = colors.ofObject(selection.object));
  const show = (): void => {
    const object = report.objects[selection.object];
    if (object === undefined) {
      place.replaceChildren(general);
      return;
    }
    paint();
    const clear = element("button", { type: "button", title: "select nothing (Escape)" }, "Clear");
    clear.addEventListener("click", () => selection.selectObject(-1));
    const buttons = [clear];
    if (look !== null) {
      const near = element("button", { type: "button", title: "look at it from near (also: double click)" }, "Focus");
      near.addEventListener("click", () => look(selection.object));
      buttons.unshift(near);
    }
    const heading = element("h2", { "aria-live": "polite" }, mark, objectName(report, selection.object));
    place.replaceChildren(element("header", {}, heading, ...buttons), factList(facts(report, selection.object, object)));
    if (object.alternatives.length > 0) {
      const text = "Other bodies fit the views about as well; they are drawn as wireframes while the object is selected.";
      place.append(element("p", { class: "dim" }, text));
    }
    for (const remark of remarks(object)) {
      place.append(element("p", { class: "remark" }, withLabels(report, remark)));
    }
    if (object.center !== null && report.objects.some((other) => other !== object && other.center !== null)) {
      place.append(measure.element);
    }
    const rows = viewsOf(report, selection.object);
    if (rows.length > 0) {
      views.show(rows, rows.map((row) => row.frame));
      place.append(views.element);
      views.mark(selection.frame);
    }
    if (object.centerShell !== null && report.region !== null) {
      place.append(element("p", { class: "dim small" }, report.region));
    }
  };
  selection.onChange((now, before) => {
    if (now.object !== before.object) show();
    else views.mark(now.frame);
  });
  colors.onChange(paint);
  show();
  return place;
}

function facts(report: Report, index: number, object: ReportObject): [string, string][] {
  const { lengthUnit } = report;
  const unit = lengthUnit ?? "units";
  const category = report.categories[object.category];
  return [
    ...(objectName(report, index) === object.id ? [] : [["id", object.id] as [string, string]]),
    ...(category === undefined ? [] : [["category", category] as [string, string]]),
    ["status", statusName(object.status)],
    ...(object.trueId === null ? [] : [["true object", object.trueId] as [string, string]]),
    ["body", object.body === null ? "none" : object.body.kind],
    ["size", object.body === null ? "–" : `${extentsWithSd(report, object.body, object.halfExtentsSd)} ${unit}`],
    ...(object.bounds === null
      ? []
      : [["bounds", `${extentsWithSd(report, object.bounds, object.boundsSd)} ${unit}`] as [string, string]]),
    ...(object.rotationSdDeg === null
      ? []
      : [["direction uncertainty", directionInWords(report, object.rotationSdDeg)] as [string, string]]),
    ["center", position(report, object.center)],
    ...(object.centerSd === null
      ? []
      : [["center uncertainty", `± ${withUnit(object.centerSd, lengthUnit)} along each axis`] as [string, string]]),
    ["residual", object.residual === null ? "–" : `${short(object.residual)} px over ${object.viewsUsed} views`],
    ...(object.relativeResidual === null
      ? []
      : [["residual", `${short(100 * object.relativeResidual)} % of the boxes' half size${deviations(object)}`] as [string, string]]),
    ...(object.alternatives.length === 0
      ? []
      : [["other bodies", object.alternatives.map((other) => alternativeInWords(report, other)).join("; ")] as [string, string]]),
    ...(object.predictedIou === null
      ? []
      : [["held-out views", `predicted by the others with IoU ${object.predictedIou.toFixed(2)}`] as [string, string]]),
  ];
}

function deviations(object: ReportObject): string {
  const { normalizedResidual } = object;
  return normalizedResidual === null ? "" : `, ${short(normalizedResidual)} times the scene's noise`;
}

function viewColumns(report: Report): ConstructorParameters<typeof Table<ViewOf>>[1] {
  const id = (row: ViewOf): string => report.frames[row.frame]?.id ?? "";
  // Bars are comparable between objects.
  const largest = Math.max(...report.objects.map((object) => object.residual ?? 0), 1e-9);
  const state = (row: ViewOf): string => viewState(row.state, row.reason);
  return [
    { title: "frame", value: id, text: id },
    {
      title: "residual [px]",
      value: (row) => row.residual,
      text: (row) => short(row.residual),
      bar: (row) => Math.min(1, (row.residual ?? 0) / (3 * largest)),
      number: true,
      style: (row) => (row.state === REJECTED ? "bad" : ""),
    },
    {
      title: "view",
      value: (row) => row.state,
      text: state,
      tip: state,
      style: (row) => (row.state === REJECTED ? "bad" : ""),
    },
  ];
}
