// Deep links: the part of the address after `#` names the selected object and frame, and follows the selection.

import type { Report } from "./data.ts";
import type { Selected, Selection } from "./selection.ts";
import { objectName } from "./words.ts";

/** The selection that a link names, on top of what is selected without one. */
export function selectedBy(hash: string, report: Report, start: Selected, bestFrame: (object: number) => number): Selected {
  const parts = new URLSearchParams(hash.replace(/^#/, "").replaceAll("+", "%2B"));
  const id = parts.get("object");
  const object = id === null ? -1 : indexOfObject(report, id);
  const named = report.frames.findIndex((frame) => frame.id === parts.get("frame"));
  const best = object < 0 ? -1 : bestFrame(object);
  return { object, frame: named >= 0 ? named : best >= 0 ? best : start.frame };
}

/** The link to a selection; what follows from the rest is left out. */
export function linkTo(selected: Selected, report: Report, start: Selected, bestFrame: (object: number) => number): string {
  const object = report.objects[selected.object];
  const best = object === undefined ? -1 : bestFrame(selected.object);
  const frame = report.frames[selected.frame];
  const parts = [
    ...(object === undefined ? [] : [`object=${encodeURIComponent(object.id)}`]),
    ...(frame === undefined || selected.frame === (best < 0 ? start.frame : best)
      ? []
      : [`frame=${encodeURIComponent(frame.id)}`]),
  ];
  return parts.length === 0 ? "" : `#${parts.join("&")}`;
}

/** Keeps the address and the selection equal. `start` is what is selected without a link. */
export function followLinks(
  report: Report,
  selection: Selection,
  start: Selected,
  bestFrame: (object: number) => number,
): void {
  selection.onChange((now) => {
    const link = linkTo(now, report, start, bestFrame);
    try {
      // No entry in the history for each click. Without a link the address has no `#`, either.
      history.replaceState(null, "", link === "" ? location.pathname + location.search : link);
    } catch {
      // A page inside of another one may have no address of its own.
    }
  });
  window.addEventListener("hashchange", () => selection.select(selectedBy(location.hash, report, start, bestFrame)));
}

/** By id, else by label, as people write links by hand. */
function indexOfObject(report: Report, name: string): number {
  const byId = report.objects.findIndex(({ id }) => id === name);
  return byId >= 0 ? byId : report.objects.findIndex((_, index) => objectName(report, index) === name);
}
