// The page of a report: reads the data, makes the parts and lets them listen to one selection.

import "./style.css";
import { Colors } from "./colors.ts";
import { controls } from "./controls.ts";
import { objectsCsv } from "./csv.ts";
import { readReport, REJECTED, type Report } from "./data.ts";
import { element } from "./dom.ts";
import { downloadButton } from "./download.ts";
import { FrameImages } from "./draw_frame.ts";
import { Filter } from "./filter.ts";
import { frameTable } from "./frame_table.ts";
import { FrameView } from "./frame_view.ts";
import { followLinks, selectedBy } from "./links.ts";
import { Measure } from "./measure.ts";
import { objectDetails } from "./object_details.ts";
import { objectTable } from "./object_table.ts";
import { bestFrame } from "./object_views.ts";
import { separators } from "./panes.ts";
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
      ? `${ok} of ${count(estimated.length, "object")} localized`
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

/** Frames wider than this stand above each other with the 3D view, not beside it. */
const WIDE = 2;

function show(page: HTMLElement, report: Report): void {
  document.title = `${report.title} – quadlift`;
  const withObjects = report.frames.findIndex(({ detections }) => detections.object.length > 0);
  const frame = report.frames.length === 0 ? -1 : Math.max(0, withObjects);
  const start = { object: -1, frame };
  const best = (object: number): number => bestFrame(report, object);
  const selection = new Selection(selectedBy(location.hash, report, start, best), best);
  followLinks(report, selection, start, best);
  const colors = new Colors(report);
  const filter = new Filter(report);
  const measure = new Measure(report, selection);
  const images = new FrameImages(report.frames);
  const { panel, view } = spacePanel(report, selection, colors, filter, measure);
  const parts = [panel];
  if (report.frames.length > 0) {
    const picture = new FrameView(report, selection, images, colors, filter).element;
    const strip = new Strip(report, selection, images, colors, filter).element;
    const table = frameTable(report, selection, colors, filter);
    parts.push(element("div", { class: "frames" }, picture, table), strip);
  }
  const look = view === null ? null : (index: number): void => view.focus(index);
  const details = objectDetails(report, selection, colors, measure, look);
  const csv = (): Blob => new Blob([objectsCsv(report, (k) => filter.shows(k))], { type: "text/csv" });
  const save = downloadButton(report, "CSV", "download the table of objects as CSV", "objects.csv", csv);
  const objects = report.objects.length === 0 ? element("p", { class: "dim" }, "There are no objects.") : element(
    "section",
    { "aria-label": "Objects" },
    element("header", {}, element("h2", {}, "Objects"), save),
    objectTable(report, selection, colors, filter, look),
  );
  const banner = report.banner === null ? [] : [element("p", { class: "banner", role: "alert" }, report.banner)];
  const [w, h] = report.frames[0]?.size ?? [4, 3];
  const isWide = w / h > WIDE;
  // Where there is room, frames that are not wide stand in a column beside the 3D view.
  page.classList.toggle("columns", report.frames.length > 0 && !isWide);
  const views = element("div", { class: isWide ? "views wide" : "views" }, ...parts);
  views.style.setProperty("--aspect", `${w / h}`);
  const [middle, below] = separators(page, views, isWide);
  panel.after(...[middle, ...(report.frames.length > 0 ? [below] : [])].flatMap((line) => line ?? []));
  page.replaceChildren(
    element(
      "header",
      { class: "title" },
      ...banner,
      element("span", { class: "dim" }, "quadlift report"),
      element("h1", {}, report.title),
      element("p", {}, summary(report)),
      ...controls(report, colors, filter),
    ),
    views,
    element(
      "div",
      { class: "texts", role: "region", "aria-label": "Tables and figures", tabindex: "-1" },
      objects,
      details,
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
