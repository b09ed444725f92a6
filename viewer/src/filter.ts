// Which objects are shown: those of the categories that are switched on, whose names hold the text of the search.

import type { Report } from "./data.ts";
import { objectName } from "./words.ts";

export class Filter {
  private readonly hidden = new Set<number>();
  private text = "";
  private shown: boolean[];
  private readonly listeners: (() => void)[] = [];

  constructor(private readonly report: Report) {
    this.shown = report.objects.map(() => true);
  }

  /** Whether an object is shown; what belongs to no object (-1) is, as long as nothing is searched for. */
  shows(object: number): boolean {
    return object < 0 ? this.text === "" : (this.shown[object] ?? true);
  }

  showsCategory(category: number): boolean {
    return !this.hidden.has(category);
  }

  /** Number of objects that are shown. */
  get count(): number {
    return this.shown.filter(Boolean).length;
  }

  setCategory(category: number, shown: boolean): void {
    if (shown) this.hidden.delete(category);
    else this.hidden.add(category);
    this.apply();
  }

  /** Shows objects whose id or category holds this text, whatever its case. */
  search(text: string): void {
    this.text = text.trim().toLowerCase();
    this.apply();
  }

  onChange(listener: () => void): void {
    this.listeners.push(listener);
  }

  private apply(): void {
    const { objects, categories } = this.report;
    this.shown = objects.map((object, index) => {
      const words = `${objectName(this.report, index)} ${object.id} ${object.trueId ?? ""} ${categories[object.category] ?? ""}`.toLowerCase();
      return !this.hidden.has(object.category) && words.includes(this.text);
    });
    for (const listener of this.listeners) listener();
  }
}
