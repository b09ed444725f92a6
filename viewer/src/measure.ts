// The distance between the selected object and another one that is chosen here, or clicked with shift in space.

import type { Report, Vec3 } from "./data.ts";
import { element } from "./dom.ts";
import { norm, subtract } from "./linear.ts";
import type { Selection } from "./selection.ts";
import { objectName, withUnit } from "./words.ts";

export class Measure {
  readonly element: HTMLElement;
  private chosen = -1;
  private readonly list: HTMLSelectElement;
  private readonly result = element("output");
  private readonly listeners: (() => void)[] = [];

  constructor(private readonly report: Report, private readonly selection: Selection) {
    this.list = element("select", { id: "measure" }, element("option", { value: "-1" }, "–"));
    report.objects.forEach((object, index) => {
      if (object.center !== null) this.list.append(element("option", { value: `${index}` }, objectName(report, index)));
    });
    const label = element("label", { for: "measure" }, "distance to ");
    this.element = element("p", { class: "measure" }, label, this.list, " ", this.result);
    this.list.addEventListener("change", () => this.choose(Number(this.list.value)));
    selection.onChange((now, before) => {
      if (now.object !== before.object) this.choose(-1);
    });
  }

  /** Measures to this object; to none with -1. */
  choose(other: number): void {
    this.chosen = other === this.selection.object ? -1 : other;
    this.list.value = `${this.chosen}`;
    const line = this.line();
    this.result.textContent = line === null ? "" : `${line.text} between the centers`;
    for (const listener of this.listeners) listener();
  }

  /** What is measured: both ends in the world and the distance in words. */
  line(): { from: Vec3; to: Vec3; text: string } | null {
    const [from, to] = [this.selection.object, this.chosen].map((index) => this.report.objects[index]?.center ?? null);
    if (from == null || to == null) return null;
    return { from, to, text: withUnit(norm(subtract(from, to)), this.report.lengthUnit) };
  }

  onChange(listener: () => void): void {
    this.listeners.push(listener);
  }
}
