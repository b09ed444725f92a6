// The scene as a whole, shown where the selected object stands when there is none: counts, consistency check, noise, and how
// to read the page.

import { REJECTED, USED, type Report } from "./data.ts";
import { element, factList } from "./dom.ts";
import { count, isUnreliable, statusName, withLabels } from "./words.ts";

export function overview(report: Report): HTMLElement {
  const guide = [
    "Select an object in the table, the 3D view or the image to open the frame that shows it best.",
    "The closer the filled outline lies to the box, the better the body explains that view (residual, in pixels).",
    ...(report.objects.some((object) => object.centerShell !== null)
      ? ["The orange shell around a center is its 95 % confidence region, which is often tiny."]
      : []),
    ...(report.objects.some(isUnreliable)
      ? ["Dashed and hatched bodies are inconsistent: they do not agree with their views. Do not rely on them."]
      : []),
    "3D view: drag to rotate, right button or two fingers to pan, wheel to zoom. Image: wheel to zoom, drag to pan.",
    "Double-click an object, or press Focus, to see it from near. The address of the page follows the selection.",
    "Everything also works with the keyboard: Tab, arrows, plus, minus, Enter.",
  ];
  const facts: [string, string][] = [
    ...objectCounts(report),
    ...viewCounts(report),
    ["unit of length", report.lengthUnit ?? "not given by the scene"],
    ...report.overview.map(([name, text]): [string, string] => [name, withLabels(report, text)]),
  ];
  return element(
    "div",
    { class: "overview" },
    element("h2", {}, "Overview"),
    factList(facts),
    element("h2", {}, "How to read this page"),
    element("ul", {}, ...guide.map((text) => element("li", {}, text))),
  );
}

function objectCounts(report: Report): [string, string][] {
  const estimated = report.objects.filter((object) => object.status !== null);
  if (estimated.length === 0) return [["objects", `${report.objects.length}, none of them estimated`]];
  const statuses = new Map<string, number>();
  for (const { status } of estimated) statuses.set(statusName(status), (statuses.get(statusName(status)) ?? 0) + 1);
  const parts = [...statuses].map(([name, n]) => `${n} ${name}`);
  const weak = estimated.filter((object) => object.status === "ok" && object.warnings.length > 0).length;
  if (weak > 0) parts.push(`${weak} of them with warnings`);
  return [["objects", parts.join(", ")]];
}

function viewCounts(report: Report): [string, string][] {
  let [used, rejected, other, nobody] = [0, 0, 0, 0];
  for (const { detections } of report.frames) {
    detections.state.forEach((state, row) => {
      if (state === USED) used += 1;
      else if (state === REJECTED) rejected += 1;
      else if ((detections.object[row] ?? -1) < 0) nobody += 1;
      else other += 1;
    });
  }
  const parts = [
    ...(used > 0 ? [`${used} used`] : []),
    ...(rejected > 0 ? [`${rejected} rejected (✕)`] : []),
    ...(nobody > 0 ? [`${nobody} unassigned (gray)`] : []),
    ...(other > 0 ? [`${other} without an estimate`] : []),
  ];
  const frames = report.frames.length === 0 ? "" : ` in ${count(report.frames.length, "frame")}`;
  return parts.length === 0 ? [] : [["detections", parts.join(", ") + frames]];
}
