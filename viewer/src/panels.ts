// What is told once: the warnings in words, the scores against the truth, the settings of the run.

import type { Report } from "./data.ts";
import type { Colors } from "./colors.ts";
import { element, factList } from "./dom.ts";
import type { Selection } from "./selection.ts";
import { Table, type Column } from "./table.ts";
import { count, objectName, remarks, score, statusName, withLabels } from "./words.ts";

/** Objects whose warnings are listed at once; the rest is in the table. */
const MOST_LISTED = 100;

/** A part of the page that can be folded. */
function panel(title: string, open: boolean, ...content: Node[]): HTMLElement {
  const details = element("details", open ? { open: "" } : {}, element("summary", {}, element("h2", {}, title)));
  details.append(...content);
  return details;
}

export function warnings(report: Report, selection: Selection): HTMLElement[] {
  const list = element("ul", { class: "warnings" });
  for (const note of report.notes) list.append(element("li", {}, withLabels(report, note)));
  const remarked = report.objects.flatMap((object, index) => {
    const texts = object.status === null ? [] : remarks(object);
    return texts.length > 0 ? [{ index, texts }] : [];
  });
  for (const { index, texts } of remarked.slice(0, MOST_LISTED)) {
    const name = element("button", { type: "button", class: "link" }, objectName(report, index));
    name.addEventListener("click", () => selection.selectObject(index));
    list.append(element("li", {}, name, `: ${withLabels(report, texts.join("; "))}`));
  }
  if (remarked.length > MOST_LISTED) {
    list.append(element("li", {}, `and ${count(remarked.length - MOST_LISTED, "more object")}: see the table`));
  }
  const total = report.notes.length + remarked.length;
  if (total === 0) return [];
  return [panel(`Warnings and notes (${total})`, total <= 12, list)];
}

export function scores(report: Report, selection: Selection, colors: Colors): HTMLElement[] {
  const { scores } = report;
  if (scores === null) return [];
  const used = scores.columns.map((_, c) => c).filter((c) => scores.rows.some((row) => (row.values[c] ?? null) !== null));
  const id = (k: number): string => {
    const object = scores.rows[k]?.object ?? -1;
    return report.objects[object] === undefined ? "" : objectName(report, object);
  };
  const title = (c: number): string => {
    const column = scores.columns[c];
    return column?.unit === "length" ? `${column.title} [${report.lengthUnit ?? "units"}]` : (column?.title ?? "");
  };
  const text = (value: number | null | undefined, c: number): string => {
    const column = scores.columns[c];
    return column === undefined ? "" : score(value ?? null, column);
  };
  const trueId = (k: number): string => report.objects[scores.rows[k]?.object ?? -1]?.trueId ?? id(k);
  const columns: Column<number>[] = [
    { title: "object", value: id, text: id, mark: (k) => colors.ofObject(scores.rows[k]?.object ?? -1) },
    // Ids of an association are not those of the truth.
    ...(report.objects.some((object) => object.trueId !== null)
      ? [{ title: "true object", value: trueId, text: trueId }]
      : []),
    {
      title: "status",
      value: (k) => scores.rows[k]?.status ?? null,
      text: (k) => (scores.rows[k]?.status == null ? "missing" : statusName(scores.rows[k].status)),
      style: (k) => (scores.rows[k]?.status === "ok" ? "good" : "bad"),
    },
    ...used.map((c): Column<number> => ({
      title: title(c),
      value: (k) => scores.rows[k]?.values[c] ?? null,
      text: (k) => text(scores.rows[k]?.values[c], c),
      number: true,
      // The means above have them all.
      room: used.indexOf(c) > 1 ? "medium" : undefined,
    })),
  ];
  const table = new Table<number>("Scores against the truth", columns, (object) => selection.selectObject(object));
  table.show(scores.rows.map((_, k) => k), scores.rows.map((row) => row.object));
  table.mark(selection.object);
  colors.onChange(() => table.recolor());
  selection.onChange((now, before) => {
    if (now.object !== before.object) table.mark(now.object);
  });
  const means = used.map((c): [string, string] => [`mean ${title(c)}`, text(scores.mean[c], c)]);
  return [panel("Scores against the truth", true, factList(means), element("p", {}, scores.failures), table.element)];
}

export function settings(report: Report): HTMLElement[] {
  if (report.settings.length === 0) return [];
  return [panel("Settings of the run", false, factList([["program", report.program], ...report.settings]))];
}
