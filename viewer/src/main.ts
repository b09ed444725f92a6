// The page of a report: reads the data, makes the parts and lets them listen to one selection.

import "./style.css";
import { makeColors } from "./colors.ts";
import { readReport, REJECTED, type Report } from "./data.ts";
import { element } from "./dom.ts";
import { FrameImages } from "./draw_frame.ts";
import { FrameView } from "./frame_view.ts";
import { objectDetails } from "./object_details.ts";
import { objectTable } from "./object_table.ts";
import { scores, settings, warnings } from "./panels.ts";
import { Selection } from "./selection.ts";
import { spacePanel } from "./space_panel.ts";
import { Strip } from "./strip.ts";
import { count } from "./words.ts";

/** What was found, in one line. */
function summary(report: Report): string {
  const estimated = report.objects.filter((object) => object.status !== null);
  const ok = estimated.filter((object) => object.status === "ok").length;
  const parts = [count(report.frames.length, "frame")];
  parts.unshift(
    estimated.length > 0
      ? `${ok} of ${count(estimated.length, "object")} localised`
      : count(report.objects.length, "object"),
  );
  const rejected = report.frames.reduce(
    (sum, { detections }) => sum + detections.state.filter((state) => state === REJECTED).length,
    0,
  );
  if (rejected > 0) parts.push(`${count(rejected, "view")} rejected`);
  const weak = estimated.filter((object) => object.status === "ok" && object.warnings.length > 0).length;
  if (weak > 0) parts.push(`${count(weak, "object")} with warnings`);
  return parts.join(", ");
}

function show(page: HTMLElement, report: Report): void {
  document.title = `${report.title} – quadlift`;
  const withObjects = report.frames.findIndex(({ detections }) => detections.object.length > 0);
  const frame = report.frames.length === 0 ? -1 : Math.max(0, withObjects);
  const selection = new Selection({ object: -1, frame });
  const colors = makeColors(report);
  const images = new FrameImages(report.frames);
  const { panel, view } = spacePanel(report, selection, colors);
  const parts = [panel];
  if (report.frames.length > 0) {
    const frameView = new FrameView(report, selection, images, colors);
    const strip = new Strip(report, selection, images, colors);
    parts.push(element("div", { class: "frames" }, frameView.picture, frameView.measurements, strip.element));
  }
  const objects = report.objects.length === 0 ? [element("p", { class: "dim" }, "There are no objects.")] : [
    element("section", { "aria-label": "Objects" }, element("h2", {}, "Objects"), objectTable(report, selection, colors)),
    objectDetails(report, selection, colors, view === null ? null : (index) => view.lookAt(index)),
  ];
  const banner = report.banner === null ? [] : [element("p", { class: "banner", role: "alert" }, report.banner)];
  page.replaceChildren(
    element("header", { class: "title" }, ...banner, element("h1", {}, report.title), element("p", {}, summary(report))),
    element("div", { class: "views" }, ...parts),
    element(
      "div",
      { class: "texts" },
      ...objects,
      ...warnings(report, selection),
      ...scores(report, selection, colors),
      ...settings(report),
    ),
  );
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape") selection.selectObject(-1);
  });
}

const page = document.getElementById("page") ?? document.body;
try {
  show(page, readReport());
  page.dataset["ready"] = "true";
} catch (error) {
  const reason = error instanceof Error ? error.message : `${error}`;
  page.replaceChildren(element("p", { class: "remark" }, `This report cannot be shown: ${reason}`));
  throw error;
}
