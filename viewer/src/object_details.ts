// The selected object: its figures, what is to be said about it, and what each view contributed.

import { REJECTED, type Report, type ReportObject } from "./data.ts";
import type { Colors } from "./colors.ts";
import { element } from "./dom.ts";
import type { Selection } from "./selection.ts";
import { Table } from "./table.ts";
import { alternativeInWords, extents, remarks, short, statusName, viewState, withUnit } from "./words.ts";

/** One view of the selected object. */
interface ViewOf {
  frame: number;
  state: number;
  residual: number | null;
  /** Why it was rejected. */
  reason: string | undefined;
}

/** `look` turns the 3D view to an object. */
export function objectDetails(
  report: Report,
  selection: Selection,
  colors: Colors,
  look: ((object: number) => void) | null,
): HTMLElement {
  const place = element("section", { class: "details", "aria-live": "polite", "aria-label": "Selected object" });
  const views = new Table<ViewOf>("Views of the selected object", viewColumns(report), (k) => selection.selectFrame(k));
  const show = (): void => {
    const object = report.objects[selection.object];
    place.replaceChildren();
    if (object === undefined) {
      place.append(element("p", { class: "dim" }, "Select an object here, in space or in an image to see its views."));
      return;
    }
    const mark = element("span", { class: "mark" });
    mark.style.background = colors.ofObject(selection.object);
    const clear = element("button", { type: "button" }, "Clear");
    clear.addEventListener("click", () => selection.selectObject(-1));
    const buttons = [clear];
    if (look !== null) {
      const near = element("button", { type: "button" }, "Look at it");
      near.addEventListener("click", () => look(selection.object));
      buttons.unshift(near);
    }
    place.append(element("header", {}, element("h2", {}, mark, object.id), ...buttons));
    const { lengthUnit } = report;
    const facts: [string, string][] = [
      ["status", statusName(object.status)],
      ...(object.trueId === null ? [] : [["true object", object.trueId] as [string, string]]),
      ["body", object.body === null ? "none" : object.body.kind],
      ["size", object.body === null ? "–" : `${extents(object.body)} ${lengthUnit ?? ""}`],
      ["centre", object.center === null ? "–" : `(${object.center.map((x) => short(x)).join(", ")}) ${lengthUnit ?? ""}`],
      ["centre's deviation", `± ${withUnit(object.centerSd, lengthUnit)} per coordinate`],
      ["residual", object.residual === null ? "–" : `${short(object.residual)} px over ${object.viewsUsed} views`],
      ...(object.misfit === null
        ? []
        : [["misfit", `${short(100 * object.misfit)} % of the boxes' half size${deviations(object)}`] as [string, string]]),
      ...(object.alternatives.length === 0
        ? []
        : [["other bodies", object.alternatives.map(alternativeInWords).join("; ")] as [string, string]]),
      ...(object.predictedIou === null
        ? []
        : [["left-out views", `predicted by the others with IoU ${object.predictedIou.toFixed(2)}`] as [string, string]]),
    ];
    place.append(factList(facts));
    if (object.alternatives.length > 0) {
      const text = "Other bodies fit the views about as well; their wires are drawn while the object is selected.";
      place.append(element("p", { class: "dim" }, text));
    }
    if (object.centerShell !== null && report.region !== null) {
      place.append(element("p", { class: "dim" }, report.region));
    }
    for (const remark of remarks(object)) place.append(element("p", { class: "remark" }, remark));
    const rows = viewsOf(report, selection.object);
    if (rows.length > 0) {
      views.show(rows, rows.map((row) => row.frame));
      place.append(views.element);
      views.mark(selection.frame);
    }
  };
  selection.onChange((now, before) => {
    if (now.object !== before.object) show();
    else views.mark(now.frame);
  });
  show();
  return place;
}

function deviations(object: ReportObject): string {
  const { misfitDeviations } = object;
  return misfitDeviations === null ? "" : `, ${short(misfitDeviations)} times the scene's noise`;
}

/** Names and values. */
export function factList(facts: [string, string][]): HTMLElement {
  return element(
    "dl",
    {},
    ...facts.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)]),
  );
}

function viewsOf(report: Report, object: number): ViewOf[] {
  return report.frames.flatMap(({ detections }, frame) => {
    const row = detections.object.indexOf(object);
    if (row < 0) return [];
    const reason = detections.rejections.find(([k]) => k === row)?.[1];
    return [{ frame, state: detections.state[row] ?? 0, residual: detections.residual[row] ?? null, reason }];
  });
}

function viewColumns(report: Report): ConstructorParameters<typeof Table<ViewOf>>[1] {
  const id = (row: ViewOf): string => report.frames[row.frame]?.id ?? "";
  // Bars are comparable between objects.
  const largest = Math.max(...report.objects.map((object) => object.residual ?? 0), 1e-9);
  return [
    { title: "frame", value: id, text: id },
    {
      title: "residual",
      value: (row) => row.residual,
      text: (row) => (row.residual === null ? "–" : `${short(row.residual)} px`),
      bar: (row) => Math.min(1, (row.residual ?? 0) / (3 * largest)),
      number: true,
      style: (row) => (row.state === REJECTED ? "bad" : ""),
    },
    {
      title: "view",
      value: (row) => row.state,
      text: (row) => viewState(row.state, row.reason),
      style: (row) => (row.state === REJECTED ? "bad" : ""),
    },
  ];
}
