// The frame around the 3D view: its switches, its legend, and what stands there where it cannot be drawn.

import type { Report } from "./data.ts";
import type { Colors } from "./colors.ts";
import { element } from "./dom.ts";
import type { Selection } from "./selection.ts";
import { makeSpace } from "./space.ts";
import { View3d, type Layer } from "./view3d.ts";
import { count } from "./words.ts";

/** Categories in the legend; more would hide the view. */
const MOST_NAMED = 10;

const LAYERS: [Layer, string][] = [
  ["body", "bodies"],
  ["truth", "truth"],
  ["enclosing", "enclosing bodies"],
  ["centerShell", "uncertainty"],
  ["cameras", "cameras"],
  ["path", "path"],
  ["grid", "grid"],
];

/** The panel, and the view in it where the browser can draw it. */
export function spacePanel(
  report: Report,
  selection: Selection,
  colors: Colors,
): { panel: HTMLElement; view: View3d | null } {
  const stage = element("div", { class: "stage" });
  const panel = element("section", { class: "space", "aria-label": "3D view" }, stage);
  const space = makeSpace(report);
  let view: View3d;
  try {
    view = new View3d(report, space, selection, colors, stage);
  } catch (error) {
    const reason = error instanceof Error ? error.message : `${error}`;
    stage.append(element("p", { class: "remark" }, `The 3D view needs WebGL 2, which this browser lacks (${reason}).`));
    return { panel, view: null };
  }
  view.canvas.setAttribute(
    "aria-label",
    `${count(report.objects.length, "object")} and ${count(report.frames.length, "camera")} in space. Arrow keys turn, ` +
      "with shift they shift, plus and minus zoom, Home goes back to the first view.",
  );
  const tools = element("div", { class: "tools" });
  for (const [layer, name] of LAYERS) {
    if (!view.has(layer)) continue;
    const box = element("input", { type: "checkbox" });
    box.checked = view.isShown(layer);
    box.addEventListener("change", () => view.show(layer, box.checked));
    const label = element("label", {}, box, ` ${name}`);
    if (layer === "centerShell" && report.region !== null) label.title = report.region;
    tools.append(label);
  }
  const buttons: [string, () => void][] = [["Everything", () => view.lookAtAll()]];
  if (report.objects.length > 0) buttons.unshift(["Objects", () => view.lookAtObjects()]);
  for (const [name, look] of buttons) {
    const button = element("button", { type: "button", title: `look at ${name.toLowerCase()}` }, name);
    button.addEventListener("click", look);
    tools.append(button);
  }
  panel.append(tools, legend(report, colors, view.gridStep, space.upIsKnown));
  return { panel, view };
}

function legend(report: Report, colors: Colors, step: number, upIsKnown: boolean): HTMLElement {
  const text = element("p", { class: "legend" });
  for (const [name, color] of colors.legend.slice(0, MOST_NAMED)) {
    const mark = element("span", { class: "mark" });
    mark.style.background = color;
    text.append(element("span", {}, mark, name), " ");
  }
  if (colors.legend.length > MOST_NAMED) text.append(`and ${colors.legend.length - MOST_NAMED} more; `);
  for (const [name, color] of [["x", "#e0453c"], ["y", "#3aa655"], ["z", "#3b7de0"]] as const) {
    const mark = element("span", { class: "mark thin" });
    mark.style.background = color;
    text.append(element("span", {}, mark, name), " ");
  }
  text.append(`grid ${step} ${report.lengthUnit ?? ""}`);
  if (!upIsKnown) text.append("; up is where the cameras have it");
  return text;
}
