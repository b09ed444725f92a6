// A table that can be sorted by its columns and walked through by keyboard; rows stand for objects or frames.

import { element } from "./dom.ts";

export interface Column<Row> {
  title: string;
  /** What the title means, where that is not clear. */
  hint?: string;
  /** What the rows are sorted by. */
  value: (row: Row) => number | string | null;
  /** What is shown. */
  text: (row: Row) => string;
  /** Whether the cells hold numbers, which stand to the right. */
  number?: boolean;
  /** Class of a cell, for colors. */
  style?: (row: Row) => string;
  /** Color of a mark before the text. */
  mark?: (row: Row) => string;
  /** The width of a table that has room for the column; the selected object's text has it too. */
  room?: "wide" | "medium" | "narrow" | undefined;
  /** What the pointer shows over a cell, where that is more than its text. */
  tip?: (row: Row) => string;
  /** Share of the cell that a bar fills, in [0, 1]. */
  bar?: (row: Row) => number;
}

export class Table<Row> {
  readonly element: HTMLElement;
  private readonly body = element("tbody");
  private readonly headers: HTMLTableCellElement[] = [];
  private rows: { row: Row; key: number; line: HTMLTableRowElement }[] = [];
  private sorted: { column: number; down: boolean } | null = null;
  private selected = -1;

  /** `select` is called with the key of the row that is clicked or entered, `focus` where it is clicked twice. */
  constructor(
    label: string,
    private readonly columns: Column<Row>[],
    private readonly select: (key: number) => void,
    focus: ((key: number) => void) | null = null,
  ) {
    const line = element("tr", { role: "row" });
    columns.forEach((column, index) => {
      const button = element("button", { type: "button", ...(column.hint ? { title: column.hint } : {}) }, column.title);
      button.addEventListener("click", () => this.sortBy(index));
      const header = element("th", { scope: "col", role: "columnheader", "aria-sort": "none" }, button);
      header.classList.toggle("number", column.number === true);
      if (column.room !== undefined) header.classList.add(column.room);
      this.headers.push(header);
      line.append(header);
    });
    const table = element("table", { role: "grid", "aria-label": label }, element("thead", {}, line), this.body);
    this.element = element("div", { class: "table" }, table);
    this.body.addEventListener("click", (event) => {
      const key = this.keyOf(event.target);
      if (key !== null) this.select(key);
    });
    this.body.addEventListener("dblclick", (event) => {
      const key = this.keyOf(event.target);
      if (key !== null) focus?.(key);
    });
    this.body.addEventListener("keydown", (event) => this.onKey(event));
  }

  /** Shows these rows, in the order that was chosen. */
  show(rows: Row[], keys: number[]): void {
    this.rows = rows.map((row, index) => ({ row, key: keys[index] ?? -1, line: this.line(row, keys[index] ?? -1) }));
    this.arrange();
  }

  /** Gives the marks their colors again. */
  recolor(): void {
    this.columns.forEach((column, index) => {
      if (column.mark === undefined) return;
      for (const { row, line } of this.rows) {
        const mark = line.children[index]?.querySelector<HTMLElement>(".mark");
        if (mark) mark.style.background = column.mark(row);
      }
    });
  }

  /** Shows only the rows whose keys are wanted. */
  filter(isWanted: (key: number) => boolean): void {
    for (const { line, key } of this.rows) line.hidden = !isWanted(key);
    this.chooseTabStop();
  }

  /** Marks the row with a key (none with -1) and brings it into sight. */
  mark(key: number): void {
    this.selected = key;
    for (const { line, key: own } of this.rows) {
      const chosen = key >= 0 && own === key;
      if ((line.getAttribute("aria-selected") === "true") !== chosen) line.setAttribute("aria-selected", `${chosen}`);
    }
    this.chooseTabStop();
    const chosen = key < 0 ? undefined : this.rows.find((row) => row.key === key)?.line;
    if (chosen === undefined) return;
    // Within the table only: the page itself stays where it is.
    const [box, place] = [this.element.getBoundingClientRect(), chosen.getBoundingClientRect()];
    const head = this.headers[0]?.offsetHeight ?? 0;
    if (place.top < box.top + head) this.element.scrollTop -= box.top + head - place.top;
    else if (place.bottom > box.bottom) this.element.scrollTop += place.bottom - box.bottom;
  }

  private line(row: Row, key: number): HTMLTableRowElement {
    const line = element("tr", { role: "row", tabindex: "-1", "data-key": `${key}`, "aria-selected": "false" });
    for (const column of this.columns) {
      const cell = element("td", { role: "gridcell", class: column.style?.(row) ?? "" });
      cell.classList.toggle("number", column.number === true);
      if (column.room !== undefined) cell.classList.add(column.room);
      const tip = column.tip?.(row);
      if (tip !== undefined) cell.title = tip;
      const color = column.mark?.(row);
      if (color !== undefined) {
        const mark = element("span", { class: "mark" });
        mark.style.background = color;
        cell.append(mark);
      }
      const bar = column.bar?.(row);
      if (bar !== undefined && bar > 0) {
        cell.classList.add("bar");
        cell.style.setProperty("--share", `${(100 * bar).toFixed(1)}%`);
      }
      cell.append(column.text(row));
      line.append(cell);
    }
    return line;
  }

  private sortBy(column: number): void {
    this.sorted = { column, down: this.sorted?.column === column && !this.sorted.down };
    this.arrange();
  }

  private arrange(): void {
    const sorted = this.sorted;
    const column = sorted && this.columns[sorted.column];
    if (sorted && column) {
      const sign = sorted.down ? -1 : 1;
      this.rows.sort((a, b) => {
        const [x, y] = [column.value(a.row), column.value(b.row)];
        // What is missing comes last, up and down.
        if (x === null || y === null) return Number(x === null) - Number(y === null) || a.key - b.key;
        const order = typeof x === "number" && typeof y === "number" ? x - y : compareNames(`${x}`, `${y}`);
        return sign * order || a.key - b.key;
      });
    }
    this.headers.forEach((header, index) => {
      const here = sorted?.column === index;
      header.setAttribute("aria-sort", here ? (sorted.down ? "descending" : "ascending") : "none");
    });
    this.body.replaceChildren(...this.rows.map((row) => row.line));
    this.mark(this.selected);
  }

  /** Tab reaches one row: the selected one, or the first. */
  private chooseTabStop(): void {
    const inSight = this.rows.filter(({ line }) => !line.hidden);
    const stop = inSight.find((row) => row.key === this.selected) ?? inSight[0];
    this.body.querySelector("[tabindex='0']")?.setAttribute("tabindex", "-1");
    stop?.line.setAttribute("tabindex", "0");
  }

  private keyOf(target: EventTarget | null): number | null {
    const key = target instanceof Element ? target.closest("tr")?.dataset["key"] : undefined;
    return key === undefined ? null : Number(key);
  }

  private onKey(event: KeyboardEvent): void {
    const key = this.keyOf(event.target);
    const inSight = this.rows.filter(({ line }) => !line.hidden);
    const index = inSight.findIndex((row) => row.key === key);
    if (key === null || index < 0) return;
    const last = inSight.length - 1;
    const moves: Record<string, number> = {
      ArrowDown: index + 1,
      ArrowUp: index - 1,
      PageDown: index + 10,
      PageUp: index - 10,
      Home: 0,
      End: last,
    };
    const next = moves[event.key];
    if (next !== undefined) {
      const line = inSight[Math.min(Math.max(next, 0), last)]?.line;
      this.body.querySelector("[tabindex='0']")?.setAttribute("tabindex", "-1");
      line?.setAttribute("tabindex", "0");
      line?.focus();
    } else if (event.key === "Enter" || event.key === " ") {
      this.select(key);
    } else {
      return;
    }
    event.preventDefault();
  }
}

const names = new Intl.Collator("en", { numeric: true });

function compareNames(a: string, b: string): number {
  return names.compare(a, b);
}
