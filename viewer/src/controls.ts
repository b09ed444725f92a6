// The bar above all: search, what colors mean, and the categories, which can be switched off.

import { Colors, type ColorMode } from "./colors.ts";
import type { Report } from "./data.ts";
import { element } from "./dom.ts";
import type { Filter } from "./filter.ts";

export function controls(report: Report, colors: Colors, filter: Filter): HTMLElement[] {
  if (report.objects.length === 0) return [];
  const shown = element("span", { class: "dim", role: "status" });
  const search = element("input", { type: "search", placeholder: "search objects", "aria-label": "Search objects" });
  search.addEventListener("input", () => filter.search(search.value));
  const mode = element("select", { "aria-label": "Colors by" });
  for (const [value, name] of colors.modes) mode.append(element("option", { value }, `color by ${name}`));
  mode.value = colors.mode;
  mode.addEventListener("change", () => colors.setMode(mode.value as ColorMode));
  const legend = element("span", { class: "scale" });
  const chips = categoryChips(report, colors, filter);
  const paint = (): void => {
    legend.replaceChildren(...legendOf(colors));
    shown.textContent = filter.count === report.objects.length ? "" : `${filter.count} of ${report.objects.length} shown`;
  };
  colors.onChange(paint);
  filter.onChange(paint);
  paint();
  return [element("div", { class: "controls", role: "group", "aria-label": "What is shown" }, search, mode, legend, ...chips, shown)];
}

/** What the colors of a mode mean; those of categories stand in their chips. */
function legendOf(colors: Colors): Node[] {
  if (colors.mode === "status") {
    return Colors.statuses.map(([name, color]) => element("span", {}, swatch(color), name));
  }
  const scale = colors.scale();
  if (scale === null) return [];
  const bar = element("span", { class: "ramp" });
  bar.style.background = `linear-gradient(to right, ${scale.stops.join(", ")})`;
  return [element("span", {}, scale.low), bar, element("span", {}, scale.high)];
}

function swatch(color: string): HTMLElement {
  const mark = element("span", { class: "mark" });
  mark.style.background = color;
  return mark;
}

/** A button for each category that switches its objects off and on. */
function categoryChips(report: Report, colors: Colors, filter: Filter): Node[] {
  const categories = report.categories.map((name, index): [string, number] => [name, index]);
  if (report.objects.some((object) => object.category < 0)) categories.push(["no category", -1]);
  if (categories.length < 2) return [];
  const marks: [HTMLElement, number][] = [];
  const buttons = categories.map(([name, category]) => {
    const number = report.objects.filter((object) => object.category === category).length;
    const mark = swatch(Colors.ofCategory(category));
    marks.push([mark, category]);
    const button = element(
      "button",
      { type: "button", class: "chip", "aria-pressed": "true", title: "show or hide these objects" },
      mark,
      `${name} `,
      element("span", { class: "dim" }, `${number}`),
    );
    button.addEventListener("click", () => {
      filter.setCategory(category, !filter.showsCategory(category));
      button.setAttribute("aria-pressed", `${filter.showsCategory(category)}`);
    });
    return button;
  });
  const paint = (): void => marks.forEach(([mark]) => (mark.hidden = colors.mode !== "category"));
  colors.onChange(paint);
  paint();
  return buttons;
}
