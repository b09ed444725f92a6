// The frame around the 3D view: its switches with the signs of what they switch, where to look from, and what stands
// there where it cannot be drawn.

import type { Report } from "./data.ts";
import type { Colors } from "./colors.ts";
import { downloadButton, png } from "./download.ts";
import { element } from "./dom.ts";
import type { Filter } from "./filter.ts";
import { bodiesGlb } from "./glb.ts";
import type { Measure } from "./measure.ts";
import type { Selection } from "./selection.ts";
import { makeSpace } from "./space.ts";
import { View3d, type Layer } from "./view3d.ts";
import { count, isUnreliable } from "./words.ts";

/** Layer, name, sign, what it is. */
const LAYERS: [Layer, string, string, string][] = [
  ["body", "bodies", "outline", "the estimated bodies"],
  ["truth", "truth", "wires", "the true bodies, as wires"],
  ["enclosing", "enclosing bodies", "enclosing", "larger bodies that contain the whole real object"],
  ["centerShell", "uncertainty", "shell", "95 % confidence region of the center"],
  ["names", "names", "name", "names of the objects"],
  ["cameras", "cameras", "camera", "the cameras; the camera of the current frame shows its image"],
  ["given", "given poses", "given", "the cameras before their poses were refined, with lines to the refined ones"],
  ["path", "path", "path", "the camera trajectory"],
  ["points", "points", "dots", "sparse points from structure from motion"],
  ["grid", "grid", "grid", "a grid at the height of the lowest objects, and the axes of the world"],
];

/** The panel, and the view in it where the browser can draw it. */
export function spacePanel(
  report: Report,
  selection: Selection,
  colors: Colors,
  filter: Filter,
  measure: Measure,
): { panel: HTMLElement; view: View3d | null } {
  const stage = element("div", { class: "stage" });
  const panel = element("section", { class: "space", "aria-label": "3D view" }, stage);
  const space = makeSpace(report);
  let view: View3d;
  try {
    view = new View3d(report, space, selection, colors, filter, measure, stage);
  } catch (error) {
    const reason = error instanceof Error ? error.message : `${error}`;
    stage.append(element("p", { class: "remark" }, `The 3D view needs WebGL 2, which this browser lacks (${reason}).`));
    return { panel, view: null };
  }
  view.canvas.setAttribute(
    "aria-label",
    `${count(report.objects.length, "object")} and ${count(report.frames.length, "camera")} in space. Arrow keys rotate, ` +
      "with shift they pan, plus and minus zoom, F focuses the selected object, Home resets the view.",
  );
  const buttons = lookButtons(report, view);
  const save = downloadButton(report, "PNG", "download the 3D view as PNG", "3d.png", () => png(view.picture()));
  buttons.append(save);
  if (report.objects.some((object) => object.body !== null)) {
    buttons.append(downloadButton(report, "GLB", "download the bodies as GLB (binary glTF)", "bodies.glb", () => {
      const file = bodiesGlb(report, (object) => filter.shows(object), (object) => colors.ofObject(object));
      return new Blob([file], { type: "model/gltf-binary" });
    }));
  }
  panel.prepend(element("header", {}, element("h2", {}, "3D view"), buttons));
  const legend = element("p", { class: "legend" });
  for (const [layer, name, sign, hint] of LAYERS) {
    if (!view.has(layer)) continue;
    const box = element("input", { type: "checkbox" });
    box.checked = view.isShown(layer);
    box.addEventListener("change", () => view.show(layer, box.checked));
    const text = layer === "grid" ? `grid of ${view.gridStep} ${report.lengthUnit ?? (view.gridStep === 1 ? "unit" : "units")}` : name;
    const title = layer === "centerShell" && report.region !== null ? report.region : hint;
    legend.append(element("label", { title }, box, element("span", { class: `sign ${sign}` }), text));
  }
  if (report.objects.some(isUnreliable)) {
    const title = "bodies that do not agree with their views; do not rely on them";
    legend.append(element("span", { title }, element("span", { class: "sign unreliable" }), "inconsistent"));
  }
  if (!space.upIsKnown) {
    const title = "the scene has no up direction; it is estimated from the orientation of the cameras";
    legend.append(element("span", { class: "dim", title }, "up: from the cameras"));
  }
  panel.append(legend);
  return { panel, view };
}

/** Buttons that say from where one looks. */
function lookButtons(report: Report, view: View3d): HTMLElement {
  const looks: [string, string, () => void][] = [
    ...(report.objects.length > 0
      ? [["Objects", "look at the objects (Home)", () => view.home()] as [string, string, () => void]]
      : []),
    ["Everything", "look at objects and cameras", () => view.lookAtAll()],
    ["Top", "look from above", () => view.lookFrom("top")],
    ["Front", "look from the front, along the ground", () => view.lookFrom("front")],
    ...(report.frames.length > 0
      ? [["Camera", "look through the camera of the current frame, with its image behind the objects", () => view.lookFromCamera()] as [string, string, () => void]]
      : []),
  ];
  const buttons = looks.map(([name, title, look]) => {
    const button = element("button", { type: "button", title }, name);
    button.addEventListener("click", look);
    return button;
  });
  return element("span", { class: "looks" }, ...buttons);
}
